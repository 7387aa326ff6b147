"""Tests of the start from a calibration of rest: nothing has to be learned first."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.touch import Calibration, TouchPipeline
from helpers.touch import (
    REST,
    SECOND,
    START,
    build_mounted_grid,
    calibration_of,
    press_pad,
    scan_at,
)

MOUNTED = build_mounted_grid()
SKIN = MOUNTED.skin
RATE = 50
NOMINAL = calibration_of(SKIN)
"""One count is 0.1 kPa."""
REST_COUNTS = REST + np.random.default_rng(1).integers(-60, 60, SKIN.count)
MEASURED = replace(
    NOMINAL, source="rest", noise=np.ones(SKIN.count), rest=REST_COUNTS.astype(float)
)
PAD = press_pad(SKIN, (0.02, 0.02), kpa=1.0, radius=0.015)
"""Share of a press on each taxel of a pad."""
PALM = press_pad(SKIN, (0.0, 0.025), kpa=1.0, radius=0.038)
"""The same of a hand over most of the patch."""
LONE = np.arange(SKIN.count) == 14


def push_counts(added, seconds, calibration=MEASURED, pipeline=None, start=0.0):
    """Push noisy scans at rest plus `added(t)`; return the touches by id, and both."""
    rng = np.random.default_rng(5)
    seen = {}
    pipeline = pipeline or TouchPipeline(MOUNTED, calibration)
    for t in start + np.arange(round(seconds * RATE)) / RATE:
        counts = REST_COUNTS + rng.standard_normal(SKIN.count) + added(t)
        state = pipeline.push_scan(scan_at(t, np.round(counts)))
        for touch in (*state.touches, *state.closed_touches):
            seen[touch.id] = touch
    return list(seen.values()), state, pipeline


def late_by(touch, seconds):
    """Return how long after a time a touch begins [s]."""
    return (touch.onset - START) / SECOND - seconds


def test_press_soon_after_the_start_is_felt_with_the_calibrated_noise():
    def press(t):
        return 20 * PAD * (0.2 <= t < 0.7)

    [touch], *_ = push_counts(press, 2.0)
    assert 0.0 <= late_by(touch, 0.2) <= 0.04
    assert touch.peak == pytest.approx(2.0, rel=0.2)
    assert not push_counts(press, 0.9, NOMINAL)[0]


@pytest.mark.parametrize("shape", [PAD, PALM], ids=["a finger", "a palm"])
@pytest.mark.parametrize("drift", [0, 8, -8])
def test_hand_on_a_skin_that_is_switched_on_is_felt_at_once(shape, drift):
    [touch], state, _ = push_counts(lambda t: drift + 100 * shape, 0.5)
    assert late_by(touch, 0.0) <= 0.04
    np.testing.assert_allclose(state.reading.pressure, 10 * shape, atol=0.5)


def test_uneven_hand_on_all_of_a_patch_is_felt_at_once():
    shape = 0.3 + PALM
    [touch], state, _ = push_counts(lambda t: 100 * shape, 0.5)
    assert late_by(touch, 0.0) <= 0.04
    np.testing.assert_allclose(state.reading.pressure, 10 * shape, atol=0.5)


@pytest.mark.parametrize(
    "moved",
    [
        100.0,
        -100.0,
        10.0,
        np.random.default_rng(2).integers(-90, 90, SKIN.count),
        300.0 * LONE,
        -300.0 * LONE,
    ],
    ids=["far up", "far down", "a little", "another patch", "one up", "one down"],
)
def test_rest_that_is_another_one_opens_no_touch(moved):
    seen, state, _ = push_counts(lambda t: moved, 4.0)
    assert not seen
    assert state.reading.pressure.max() < 1.0


def test_press_after_a_long_silence_is_felt_with_the_calibrated_noise():
    *_, pipeline = push_counts(lambda t: 0.0, 2.0)
    again, *_ = push_counts(
        lambda t: 20 * PAD * (20.2 <= t < 20.7), 2.0, pipeline=pipeline, start=20.0
    )
    assert [0.0 <= late_by(touch, 20.2) <= 0.04 for touch in again] == [True]


def test_noise_that_has_grown_is_followed():
    calibration = replace(MEASURED, noise=np.full(SKIN.count, 0.3))
    rng = np.random.default_rng(0)
    pipeline = TouchPipeline(MOUNTED, calibration)
    for t in np.arange(20 * RATE) / RATE:
        noisy = REST_COUNTS + 3.0 * rng.standard_normal(SKIN.count)
        pipeline.push_scan(scan_at(t, np.round(noisy)))
    assert np.median(pipeline.front_end.floor) == pytest.approx(1.8, rel=0.3)


def test_taxels_are_compared_as_they_are_received():
    """A hand on the second half of the taxels, which come a scan later."""
    half = np.arange(SKIN.count) >= SKIN.count // 2
    pipeline = TouchPipeline(MOUNTED, MEASURED)
    for t in np.arange(10) / RATE:
        counts = REST_COUNTS + 100 * PAD
        state = pipeline.push_scan(scan_at(t, counts, received=~half | (t > 0.0)))
    np.testing.assert_allclose(state.reading.pressure, 10 * PAD, atol=0.5)


def test_old_calibration_is_learned_from_as_before():
    assert Calibration.from_bytes(NOMINAL.to_bytes()).rest is None
    seen, *_ = push_counts(lambda t: 100 * PAD, 4.0, NOMINAL)
    assert not seen
