"""These tests check clips and streams: touches, counts, truth and labels agree."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.recording import Label
from eskin.sim import TrueTouch
from eskin.sim.dataset import GenerationSettings, get_build
from eskin.sim.dataset.clip import make_clip
from eskin.sim.dataset.session_file import (
    build_metadata,
    build_ranges,
    build_true_labels,
)
from eskin.sim.dataset.staging import draw_start
from eskin.sim.scene.scene import (
    find_contact_steps,
    shift_touch,
)
from helpers.contacts import TIP, press
from helpers.simulation import StandIn
from helpers.worlds import world

START = 1_750_000_000_000_000_000
STAND_IN = StandIn("ur5")
SETTINGS = GenerationSettings("train", "ur5", clips=10, subjects=1)
LEAD, FIRST, *_ = SETTINGS.plan_clips(SETTINGS.sessions[0])
STILL = {"moving": False, "fold_share": 0.0, "concurrent": 0.0}
PLAN = replace(FIRST, gesture="poke", kind=None, difficulty=1.5, **STILL)
STREAM = replace(PLAN, gesture=None, seconds=30.0)


def make(plan=PLAN, number=0, env=None, **changes):
    return make_clip(replace(plan, seed=(1, number), **changes), env or world())


def make_many(count, **changes):
    return [make(number=number, **changes) for number in range(count)]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"moving": True, "fold_share": 1.0},
        {"gesture": "none", "kind": "electrical"},
        {"gesture": "none", "kind": "cable", "moving": True},
    ],
    ids=["still", "moving", "electrical", "cable"],
)
def test_same_plan_gives_the_same_clip(changes):
    one, other = (make(number=3, **changes) for _ in range(2))
    for name in ("counts", "received", "q"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    assert one.drawn == other.drawn
    assert one.counts.shape == one.received.shape == (100, world().mounted.skin.count)
    assert one.q.shape == (100, 6)
    assert (np.ptp(one.q, axis=0).max() > 1e-3) == changes.get("moving", False)
    electrical = any(name.startswith("electrical.") for name in one.drawn)
    assert electrical == (changes.get("kind") == "electrical")


@pytest.mark.parametrize("gesture", ["poke", "double_pat", "grab", "stroke"])
def test_counts_rise_where_and_when_the_true_touch_is(gesture):
    calibration = get_build(PLAN.build, world()).calibration(world().mounted.skin)
    distances = []
    for clip in make_many(8, gesture=gesture):
        (truth,) = clip.truths
        touched = np.flatnonzero(truth.force) * 0.02
        assert truth.onset - 0.02 < touched[0] and touched[-1] < truth.end
        rest = np.median(clip.counts, axis=0)
        pressure = calibration.compute_pressure(clip.counts - rest) * clip.received
        pressure[:, pressure.mean(axis=0) > 5.0] = 0.0  # stuck taxels
        reading, taxel = np.unravel_index(pressure.argmax(), pressure.shape)
        if pressure[reading, taxel] < 10.0:
            continue
        near = slice(max(0, reading - 2), reading + 3)
        pressed = truth.force[near] > 0
        assert pressed.any()
        p_world, _ = world().mounted.place_taxels(clip.q[reading])
        steps = truth.centroid[near][pressed] - p_world[taxel]
        distances.append(np.linalg.norm(steps, axis=1).min())
    assert len(distances) >= 3
    assert max(distances) < 0.14  # A hand is that large.


@pytest.mark.slow
def test_no_gesture_takes_place_beside_a_touch_that_is_none():
    for clip in make_many(15, gesture="none", kind="resting_hand", concurrent=1.0):
        assert {truth.gesture for truth in clip.truths} == {"none"}


@pytest.mark.slow
def test_second_touch_is_the_weaker():
    clips = make_many(15, gesture="grab", concurrent=1.0)
    two = [clip.truths for clip in clips if len(clip.truths) == 2]
    assert len(two) > 6
    for first, second in two:
        assert 0 < second.force.sum() < 1.05 * first.force.sum()


def test_touches_of_a_stream_lie_within_it():
    clip = make(STREAM, moving=True)
    assert len(clip.counts) == 1500
    assert len(clip.truths) >= 3
    spans = [(each.onset, each.end) for each in clip.truths if each.kind != "guiding"]
    assert min(spans)[0] > 0 and max(end for _, end in spans) < 30.0
    assert all(start < end for start, end in spans)


@pytest.mark.parametrize("moving", [False, True])
def test_stream_of_accidents_holds_accidents_only(moving):
    clips = [make(STREAM, kind="accidents", moving=moving)]
    assert all(len(clip.truths) >= 3 for clip in clips)
    truths = [truth for clip in clips for truth in clip.truths]
    assert {truth.gesture for truth in truths} == {"none"}
    kinds = {truth.kind for truth in truths}
    assert kinds <= set(world().constants.weights("stream.accidents"))
    assert not kinds & {"press", "single_pat", "squeeze_hold", "guiding"}


@pytest.mark.parametrize("moving", [False, True])
def test_quiet_stream_has_electrical_events_only(moving):
    """Half a minute at 120 times the rate has as many events as an hour."""
    constants = world().constants.scaled({"stream.electrical": 120.0})
    env = replace(world(), constants=constants)
    clip = make(STREAM, env=env, kind="quiet", moving=moving)
    assert clip.truths == () and len(clip.counts) == 1500
    onsets = [float(clip.drawn[n]) for n in clip.drawn if n.endswith(".onset")]
    assert 10 <= len(onsets) <= 40
    assert min(onsets) < 500 and max(onsets) > 1000
    assert bool(np.ptp(clip.q, axis=0).max() > 1e-3) == moving


def place_steady_touch(steps, rng):
    """Place a touch of constant force in a clip; return its first and last step."""
    force = np.concatenate([[0.0], np.full(steps, 3.0), [0.0]])
    touch = TrueTouch("poke", "one_tip", "p", (press(TIP, force),), {})
    start = draw_start(touch, 200, world().constants, rng)
    return find_contact_steps(shift_touch(touch, start))


def test_clip_shows_at_least_the_stated_share_of_its_touch():
    rng = np.random.default_rng(0)
    inside = world().constants.value("clip.inside")
    cut = 0
    for _ in range(400):
        length = int(rng.integers(5, 190))
        first, end = place_steady_touch(length, rng)
        shown = min(end, 200) - max(first, 0)
        assert shown >= inside * length - 1
        cut += shown < length
    assert 0.05 < cut / 400 < 0.25
    for _ in range(100):  # Longer than the clip.
        first, end = place_steady_touch(350, rng)
        assert min(end, 200) - max(first, 0) >= 0.6 * 200 - 1
        assert first < 0 or end > 200


def label_touches(*spans, **changes):
    """Return the labels of a clip with pokes of these onsets and ends."""
    clip = STAND_IN.make(PLAN)
    truths = tuple(
        replace(clip.truths[0], gesture="poke", onset=onset, end=end, number=number)
        for number, (onset, end) in spans
    )
    plan = replace(PLAN, **changes)
    return plan, build_true_labels(plan, replace(clip, truths=truths), START)


def at(seconds):
    return START + round(seconds * 1_000_000_000)


@pytest.mark.parametrize(
    ("onset", "end", "shown"),
    [
        (0.5, 1.0, [(0.5, 1.0)]),
        (-0.7, 1.0, [(0.0, 1.0)]),
        (1.5, 2.6, [(1.5, 2.0)]),
        (-1.0, 3.0, [(0.0, 2.0)]),
        (2.1, 2.6, []),
        (-0.5, -0.1, []),
    ],
)
def test_label_is_the_part_of_a_touch_that_its_clip_shows(onset, end, shown):
    _, labels = label_touches((0, (onset, end)), (1, (1.0, 1.4)))
    assert labels == tuple(Label(at(a), at(b), "poke", "true") for a, b in shown)


def test_touches_of_a_stream_that_overlap_an_earlier_one_have_no_label():
    spans = [(9.0, 10.0), (2.0, 4.0), (3.0, 5.0), (4.5, 6.0)]
    plan, labels = label_touches(*enumerate(spans), gesture=None, seconds=60.0)
    assert [label.start for label in labels] == [at(2.0), at(4.5), at(9.0)]
    assert build_ranges(plan, labels, START)[0].start == at(1.0)


def test_clip_of_a_family_has_its_own_rate_and_says_its_family():
    settings = GenerationSettings("test-capacitive", clips=5, subjects=1)
    session = settings.sessions[0]
    lead, plan, *_ = settings.plan_clips(session)
    build = get_build(plan.build, world())
    clip = make_clip(plan, world())
    assert clip.times is not None and (np.diff(clip.times) > 0.0).all()
    assert len(clip.times) == len(clip.counts) == len(clip.q)
    assert len(clip.times) == int(2.0 / build.electronics.period + 1e-9)
    assert {len(truth.force) for truth in clip.truths} <= {len(clip.counts)}
    notes = build_metadata(settings, session).notes
    assert notes["family"] == notes["build_kind"] == "capacitive"
    assert "family" not in build_metadata(SETTINGS, SETTINGS.sessions[0]).notes
