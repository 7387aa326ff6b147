"""Laws of scans that no touch can cause: they leave no trace, or the patch is out."""

import numpy as np
import pytest

from helpers.touch import (
    SECOND,
    START,
    build_mounted_grid,
    build_pipeline,
    calibration_of,
    press_pad,
    scan_at,
)

RATE = 50
REST = 200
FULL = 1000
PANEL = build_mounted_grid(rows=10, columns=12)
CALIBRATION = calibration_of(PANEL.skin)
"""One count is 0.1 kPa; contact begins at 7 counts."""


def stream(change, seconds, mounted=PANEL, noise=0.5, seed=0):
    """Push counts at rest, changed by `change(t, counts)`; yield time and state."""
    pipeline = build_pipeline(mounted)
    rng = np.random.default_rng(seed)
    for k in range(round(seconds * RATE)):
        counts = REST + noise * rng.standard_normal(mounted.skin.count)
        counts = change(k / RATE, np.round(counts).astype(int))
        yield k / RATE, pipeline.push_scan(scan_at(k / RATE, np.clip(counts, -1, FULL)))


def press(centre, start, seconds=0.3, mounted=PANEL):
    """Return the counts of a press as a function of time."""
    peak = calibration_of(mounted.skin).compute_counts(
        press_pad(mounted.skin, centre, kpa=20.0)
    )

    def counts_at(t):
        return np.round(peak * (start <= t < start + seconds)).astype(int)

    return counts_at


def felt(states, start, seconds=0.3):
    """Return whether a touch opened in the time of a press."""
    return any(
        touch.onset >= START + (start - 0.01) * SECOND
        for t, state in states
        if start <= t < start + seconds
        for touch in state.open
    )


def is_out(state):
    """Return whether the patch is reported as out."""
    return any(fault.kind == "patch" for fault in state.faults)


def draw_scan(rng, counts):
    """Return any counts in place of some."""
    value = rng.choice([FULL, 0, -1, rng.integers(FULL)])
    values = rng.integers(-1, FULL + 1, len(counts)) if rng.random() < 0.3 else value
    start = rng.integers(len(counts))
    length = rng.integers(1, len(counts) + 1)
    struck = (np.arange(len(counts)) - start) % len(counts) < length
    struck |= rng.random() < 0.3
    struck &= rng.random(len(counts)) < rng.choice([1.0, rng.random()])
    return np.where(struck, values, counts)


@pytest.mark.parametrize("seed", range(40))
def test_one_scan_of_anything_hides_no_press_a_second_later(seed):
    rng = np.random.default_rng(seed)
    at = round(rng.uniform(0.0, 5.0), 2)
    pad = press(PANEL.skin.positions[rng.integers(120), :2], at + 1.0)

    def change(t, counts):
        counts = counts + pad(t)
        return draw_scan(rng, counts) if abs(t - at) < 0.5 / RATE else counts

    states = list(stream(change, at + 1.3, seed=seed))
    assert felt(states, at + 1.0)


@pytest.mark.parametrize("value", [0, FULL, -1, 60])
@pytest.mark.parametrize("seconds", [0.1, 0.6, 3.0, 12.0])
def test_patch_feels_at_once_after_an_outage_which_is_reported(value, seconds):
    pad = press(PANEL.skin.positions[52, :2], 4.2 + seconds)

    def change(t, counts):
        return np.where(4.0 <= t < 4.0 + seconds, value, counts + pad(t))

    states = list(stream(change, 4.5 + seconds))
    assert felt(states, 4.2 + seconds)
    assert not any(state.open for t, state in states if t < 4.15 + seconds)
    reported = [t for t, state in states if is_out(state)]
    assert bool(reported) == (seconds > 0.5)
    assert all(4.5 <= t <= 4.15 + seconds for t in reported)


@pytest.mark.parametrize("zeros", [0.02, 0.5, 5.0])
def test_patch_that_starts_on_zeros_feels_a_second_after_them(zeros):
    pad = press(PANEL.skin.positions[52, :2], zeros + 1.0)

    def change(t, counts):
        return np.where(t < zeros, 0, counts + pad(t))

    states = list(stream(change, zeros + 1.3))
    assert felt(states, zeros + 1.0)
    assert not any(state.open for t, state in states if t < zeros + 1.0)


@pytest.mark.parametrize("seconds", [0.8, 12.0])
def test_patch_that_comes_back_above_rest_is_out_until_it_is_at_rest(seconds):
    def change(t, counts):
        back = 4.0 + seconds
        counts = counts + 60 * (back <= t < back + 3.0)
        return np.where(4.0 <= t < back, 0, counts)

    states = list(stream(change, 9.0 + seconds))
    assert all(is_out(s) for t, s in states if 4.7 <= t < 7.0 + seconds)
    assert not any(is_out(s) for t, s in states if t > 7.2 + seconds)
    assert not any(s.open for _, s in states)


def test_hand_that_lies_on_a_part_of_a_patch_is_felt_after_an_outage():
    hand = press(PANEL.skin.positions[52, :2], 3.0, 30.0)

    def change(t, counts):
        return np.where(4.0 <= t < 16.0, 0, counts + hand(t))

    states = list(stream(change, 18.0))
    assert all(len(state.open) == 1 for t, state in states if t > 16.1)


@pytest.mark.parametrize(("columns", "scans"), [(3, 1), (4, 2)])
def test_press_on_all_taxels_is_felt_at_once_on_up_to_twelve(columns, scans):
    mounted = build_mounted_grid(rows=4, columns=columns)

    def change(t, counts):
        return counts + 300 * (t >= 4.0)

    states = list(stream(change, 5.0, mounted))
    first = next(t for t, state in states if state.contacts)
    assert first == pytest.approx(4.0 + (scans - 1) / RATE)
    assert all(state.contacts for t, state in states if t >= first)


def test_first_press_on_all_taxels_of_a_skin_that_rests_at_zero_is_felt():
    mounted = build_mounted_grid(rows=4, columns=4)

    def change(t, counts):
        return (counts - REST) * 0 + 300 * (t >= 12.0)

    states = list(stream(change, 12.5, mounted))
    assert all(bool(state.contacts) == (t >= 12.02) for t, state in states)
