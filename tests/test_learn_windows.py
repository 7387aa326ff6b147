"""Windows end with the reading asked for and see two seconds, of one sequence."""

import numpy as np
import pytest

from eskin.learn.windows import Windows, cut, thin
from eskin.model import SLOT_NS
from learn_scenes import START, bare

SLOTS = 100
SEEDS = range(4)


def random_dataset(rng):
    """Sequences of random lengths and rates, from 5 Hz to 500 Hz."""
    stamps, sequence = [], []
    for index in range(5):
        count = int(rng.integers(1, 60))
        period = int(rng.choice([2, 10, 33, 100, 200])) * 1_000_000
        steps = period + rng.integers(0, period // 2, count)
        stamps.append(START + int(rng.integers(10**9)) + np.cumsum(steps))
        sequence.append(np.full(count, index))
    return bare(np.concatenate(stamps), np.concatenate(sequence))


def random_windows(seed):
    rng = np.random.default_rng(seed)
    dataset = random_dataset(rng)
    ends = rng.integers(len(dataset.stamps), size=40)
    low = dataset.starts[ends]
    firsts = low + (rng.random(40) * (ends - low + 1)).astype(np.int64)
    return dataset, ends, firsts, cut(dataset, ends, firsts, SLOTS)


def each(windows):
    return [np.flatnonzero(windows.window == w) for w in range(windows.count)]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_window_is_all_rows_of_its_two_seconds_since_its_first_row(seed):
    dataset, ends, firsts, windows = random_windows(seed)
    for end, first, place in zip(ends, firsts, each(windows), strict=True):
        slots = dataset.stamps // SLOT_NS - dataset.stamps[end] // SLOT_NS + SLOTS - 1
        inside = np.arange(first, end + 1)
        np.testing.assert_array_equal(windows.rows[place], inside[slots[inside] >= 0])
        np.testing.assert_array_equal(windows.slot[place], slots[windows.rows[place]])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_window_stays_in_its_sequence_and_behind_its_first_row(seed):
    dataset, ends, firsts, windows = random_windows(seed)
    for end, first, place in zip(ends, firsts, each(windows), strict=True):
        assert set(dataset.sequence[windows.rows[place]]) == {dataset.sequence[end]}
        assert windows.rows[place].min() >= first


@pytest.mark.parametrize("seed", SEEDS)
def test_slots_are_in_range_and_the_last_reading_has_the_last_one(seed):
    dataset, ends, _, windows = random_windows(seed)
    assert windows.slot.min() >= 0
    for end, place in zip(ends, each(windows), strict=True):
        assert windows.rows[place][-1] == end
        assert windows.slot[place][-1] == SLOTS - 1
        assert (np.diff(windows.slot[place]) >= 0).all()
        span = np.ptp(dataset.stamps[windows.rows[place]])
        assert span <= SLOTS * SLOT_NS


def test_two_seconds_at_ten_hertz_are_twenty_readings():
    stamps = START + np.arange(50) * 100_000_000
    dataset = bare(stamps, np.zeros(50, np.int64))
    windows = cut(dataset, np.array([49, 4]), np.array([0, 0]), SLOTS)
    assert [len(place) for place in each(windows)] == [20, 5]
    np.testing.assert_array_equal(windows.slot[:3], [4, 9, 14])


@pytest.mark.parametrize("most", [1, 3, 1000])
def test_thinning_keeps_at_most_so_many_readings_in_order(most):
    *_, windows = random_windows(0)
    thinned = thin(windows, most, np.random.default_rng(0))
    assert thinned.count == windows.count
    for before, after in zip(each(windows), each(thinned), strict=True):
        assert len(after) == min(most, len(before))
        rows = thinned.rows[after]
        assert (np.diff(rows) > 0).all()
        assert set(rows) <= set(windows.rows[before])
        slot_of = dict(zip(windows.rows[before], windows.slot[before], strict=True))
        assert [slot_of[row] for row in rows] == thinned.slot[after].tolist()


def test_every_reading_of_a_window_is_as_likely_kept():
    rows = np.arange(12)
    windows = Windows(rows, np.repeat([0, 1], 6), rows % 6, 2)
    rng = np.random.default_rng(0)
    kept = np.concatenate([thin(windows, 3, rng).rows for _ in range(600)])
    np.testing.assert_allclose(np.bincount(kept) / 600, 0.5, atol=0.08)
