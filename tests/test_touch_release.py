"""Laws of how contacts end: with the hand that leaves, and not with one that eases."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.touch import Calibration, Scan, TouchPipeline
from helpers.touch import REST, SECOND, START, build_mounted_grid, press_pad

RATE = 50
MOUNTED = build_mounted_grid(rows=10, columns=10)
SKIN = MOUNTED.skin
CALIBRATION = Calibration.uniform(SKIN.count, 4000, 200.0)
PAD = press_pad(SKIN, (0.04, 0.04), kpa=1.0, radius=0.015)
SLOW = 0.3
"""Time constant with which a slow sensor falls [s]."""


def build_pipeline(**constants) -> TouchPipeline:
    """Build the pipeline of a skin with constants of its calibration."""
    return TouchPipeline(MOUNTED, replace(CALIBRATION, **constants))


def push(pipeline, kpa, falling=0.0, noise=1.0, seed=0):
    """Push a pad pressed with `kpa` [kPa] at each scan; return the states.

    The signal of the sensor rises at once, and falls with a time constant of `falling`
    [s].
    """
    rng = np.random.default_rng(seed)
    kept = np.exp(-1.0 / (RATE * falling)) if falling else 0.0
    signal = 0.0
    states = []
    for n, pressure in enumerate(kpa):
        signal = max(pressure, kept * signal)
        counts = REST + CALIBRATION.compute_counts(signal * PAD.astype(np.float64))
        counts = np.round(counts + noise * rng.standard_normal(SKIN.count))
        stamp = START + round(n * SECOND / RATE)
        received = np.ones(SKIN.count, np.bool_)
        counts = np.clip(counts, 0, 4000).astype(np.int32)
        states.append(pipeline.push_scan(Scan(stamp, counts, received, np.zeros(0))))
    return states


def hold(kpa, seconds):
    """Return the pressures of a steady press for a time [s]."""
    return [kpa] * round(seconds * RATE)


def ease(start, end, seconds):
    """Return the pressures of a hand that goes from one to another in a time [s]."""
    return np.linspace(start, end, round(seconds * RATE) + 1)[1:].tolist()


def tremble(kpa, seconds):
    """Return the pressures of a hand that rests and trembles for a time [s]."""
    times = np.arange(round(seconds * RATE)) / RATE
    return (kpa * (1.0 + 0.05 * np.sin(50.0 * times))).tolist()


def is_present(state):
    """Return whether a touch is in contact, or something presses without contact."""
    in_contact = any(len(touch.taxels) or len(touch.held) for touch in state.open)
    return in_contact or bool(state.tracking.held)


@settings(max_examples=30, deadline=None)
@given(
    share=st.floats(0.2, 0.5),
    seconds=st.floats(0.04, 1.0),
    falling=st.sampled_from([0.0, 0.1, SLOW]),
)
def test_hand_that_eases_and_stays_is_present_until_it_leaves(share, seconds, falling):
    firm = 40.0
    light = share * firm
    pressures = hold(0.0, 2.0) + tremble(firm, 1.0)
    pressures += ease(firm, light, seconds) + tremble(light, 10.0)
    end = len(pressures)
    pressures += hold(0.0, 4.0)
    pipeline = build_pipeline(release_seconds=falling or 0.1)
    states = push(pipeline, pressures, falling)
    begin = round(2.2 * RATE)
    assert all(map(is_present, states[begin:end]))
    assert not is_present(states[-1])


@pytest.mark.parametrize("falling", [0.15, SLOW])
def test_touches_on_a_slow_sensor_are_told_apart(falling):
    presses = 6
    pressures = hold(0.0, 2.0)
    for _ in range(presses):
        pressures += tremble(30.0, 0.3) + ease(30.0, 0.0, 0.08) + hold(0.0, 0.62)
    states = push(build_pipeline(release_seconds=falling), pressures, falling)
    closed = [touch for state in states for touch in state.closed_touches]
    opened = [touch.id for state in states for touch in state.open]
    assert len(set(opened)) == presses
    for n, touch in enumerate(closed):
        lifted = START + round((2.0 + n + 0.38) * SECOND)
        assert abs(touch.last - lifted) < 0.16 * SECOND


def test_time_constant_of_a_slow_sensor_is_learned_from_its_releases():
    pressures = hold(0.0, 2.0)
    for _ in range(20):
        pressures += tremble(30.0, 0.3) + hold(0.0, 2.0)
    pipeline = build_pipeline()
    push(pipeline, pressures, SLOW)
    assert pipeline.tracker.release_seconds == pytest.approx(SLOW, rel=0.25)


def test_press_that_fades_a_little_stays_one_contact():
    pressures = hold(0.0, 2.0) + tremble(40.0, 0.5) + ease(40.0, 24.0, 0.5)
    pressures += tremble(24.0, 1.0) + ease(24.0, 38.0, 0.3) + tremble(38.0, 0.5)
    states = push(build_pipeline(), pressures + hold(0.0, 1.0))
    [touch] = [touch for state in states for touch in state.closed_touches]
    assert (touch.last - touch.onset) / SECOND == pytest.approx(2.8, abs=0.1)


def test_residual_of_a_press_opens_no_touch():
    """What is left decays within seconds, on the pad and beside it."""
    left = [40.0 * 0.12 * np.exp(-n / (2.0 * RATE)) for n in range(6 * RATE)]
    pressures = hold(0.0, 2.0) + tremble(40.0, 0.6) + ease(40.0, left[0], 0.06) + left
    states = push(build_pipeline(), pressures)
    closed = [touch for state in states for touch in state.closed_touches]
    assert len(closed) == 1
    assert (closed[0].last - closed[0].onset) / SECOND < 0.8
