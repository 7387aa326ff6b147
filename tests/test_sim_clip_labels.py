"""Labels of clips: from what was really done, and from what was felt."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.recording import Label
from eskin.sim.dataset import GenerationSettings
from eskin.sim.dataset.session_file import (
    build_ranges,
    build_true_labels,
    compute_peak_pressures,
    compute_rest_counts,
)
from eskin.touch import Calibration
from helpers.simulation import FULL_SCALE, StandIn

START = 1_750_000_000_000_000_000
MAKER = StandIn("square")
SETTINGS = GenerationSettings("train", "square", clips=10, subjects=1)
LEAD, PLAN, *_ = SETTINGS.plan_clips(SETTINGS.sessions[0])
CLIP = MAKER.make(PLAN)
RNG = np.random.default_rng(1)
TAXELS = 12


def touched(onset, end, number=0):
    parts = {"onset": onset, "end": end, "number": number}
    return replace(CLIP.truths[0], gesture="poke", **parts)


def at(seconds):
    return START + round(seconds * 1_000_000_000)


@pytest.mark.parametrize(
    ("onset", "end", "shown"),
    [
        (0.5, 1.0, (0.5, 1.0)),
        (-0.7, 1.0, (0.0, 1.0)),
        (1.5, 2.6, (1.5, 2.0)),
        (-1.0, 3.0, (0.0, 2.0)),
        (2.1, 2.6, None),
        (-0.5, -0.1, None),
    ],
)
def test_a_label_is_the_part_of_a_touch_that_its_clip_shows(onset, end, shown):
    clip = replace(CLIP, truths=(touched(onset, end),))
    labels = build_true_labels(PLAN, clip, START)
    expected = shown and Label(at(shown[0]), at(shown[1]), "poke", "true")
    assert labels == ((expected,) if expected else ())


def test_only_the_touch_that_a_clip_is_made_for_is_labelled():
    clip = replace(CLIP, truths=(touched(0.2, 0.4), touched(1.0, 1.4, number=1)))
    [label] = build_true_labels(PLAN, clip, START)
    assert label.start == at(0.2)
    alone = replace(CLIP, truths=(touched(1.0, 1.4, number=1),))
    assert build_true_labels(PLAN, alone, START) == ()


def test_touches_of_a_stream_are_labelled_unless_they_overlap_an_earlier_one():
    stream = replace(PLAN, gesture=None, seconds=60.0)
    spans = [(9.0, 10.0), (2.0, 4.0), (3.0, 5.0), (4.5, 6.0)]
    truths = tuple(touched(*span, number=i) for i, span in enumerate(spans))
    labels = build_true_labels(stream, replace(CLIP, truths=truths), START)
    assert [label.start for label in labels] == [at(2.0), at(4.5), at(9.0)]
    assert build_ranges(stream, labels, START)[0].start == at(1.0)


def test_the_range_of_a_clip_is_the_clip():
    [label] = build_ranges(PLAN, (), START)
    assert label == Label(START, at(2.0), PLAN.gesture, "range")


def test_a_taxel_rests_where_it_was_most_of_the_time():
    lead = MAKER.make(LEAD)
    rest = compute_rest_counts(lead)
    assert (np.abs(rest - 100) <= 1).all()
    received = lead.received.copy()
    received[:, 3] = False
    assert compute_rest_counts(replace(lead, received=received))[3] > FULL_SCALE


@pytest.mark.parametrize("curve", ["linear", "divider"])
def test_the_peak_is_the_largest_pressure_of_what_was_received(curve):
    gain = np.repeat([0.02, 0.03, 0.05], 4)
    calibration = Calibration(gain, FULL_SCALE, curve=curve, exponent=0.8)
    rest = RNG.integers(50, 150, TAXELS).astype(np.int32)
    counts = RNG.integers(0, 3000, (30, TAXELS)).astype(np.int32)
    received = RNG.random(counts.shape) < 0.7
    received[4] = False
    above = np.where(received, np.maximum(counts - rest, 0), 0)
    share = above / FULL_SCALE
    bent = FULL_SCALE * (share / (1 - share)) ** (1 / 0.8)
    pressure = gain * (above if curve == "linear" else bent)
    peaks = compute_peak_pressures(counts, received, rest, calibration)
    np.testing.assert_allclose(peaks, pressure.max(axis=1), rtol=1e-12)
    assert peaks[4] == 0
