"""Windows: rows of the two seconds before a reading, within one sequence."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.learn.batches import (
    TIME_COLUMNS,
    Windows,
    cut_windows,
    drop_readings,
    measure_since_kept,
    stretch_time,
    subsample_readings,
)
from eskin.live import HISTORY, SLOT_NS, compute_summary, join_graphs
from helpers.graphs import random_graph, stroke_on_grid
from helpers.learning import START, bare

SLOTS = 100
SEEDS = range(4)


def random_dataset(rng):
    """Sequences of random lengths and rates, from 5 Hz to 500 Hz."""
    stamps = []
    sequence = []
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
    return dataset, ends, firsts, cut_windows(dataset, ends, firsts, SLOTS)


def each(windows):
    return [np.flatnonzero(windows.window == w) for w in range(windows.count)]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_window_holds_all_rows_of_its_two_seconds(seed):
    dataset, ends, firsts, windows = random_windows(seed)
    for end, first, place in zip(ends, firsts, each(windows), strict=True):
        slots = dataset.stamps // SLOT_NS - dataset.stamps[end] // SLOT_NS + SLOTS - 1
        inside = np.arange(first, end + 1)
        np.testing.assert_array_equal(windows.rows[place], inside[slots[inside] >= 0])
        np.testing.assert_array_equal(windows.slot[place], slots[windows.rows[place]])


@pytest.mark.parametrize("most", [1, 3, 1000])
def test_thinning_keeps_at_most_the_given_number_in_order(most):
    *_, windows = random_windows(0)
    thinned = subsample_readings(windows, most, np.random.default_rng(0))
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
    kept = np.concatenate(
        [subsample_readings(windows, 3, rng).rows for _ in range(600)]
    )
    np.testing.assert_allclose(np.bincount(kept) / 600, 0.5, atol=0.08)


def laid(count=40, lengths=30, seed=0):
    """Windows of so many readings each, and a graph for every reading."""
    rng = np.random.default_rng(seed)
    slot = [np.sort(rng.choice(SLOTS - 1, lengths - 1, False)) for _ in range(count)]
    slot = np.concatenate([np.append(one, SLOTS - 1) for one in slot])
    n = count * lengths
    windows = Windows(np.arange(n), np.repeat(np.arange(count), lengths), slot, count)
    return windows, join_graphs([random_graph(rng, 2) for _ in range(n)])


def stretched(spread, seed=0):
    windows, graphs = laid(seed=seed)
    rng = np.random.default_rng(seed + 1)
    return windows, graphs, *stretch_time(windows, graphs, spread, SLOTS, rng)


@pytest.mark.parametrize("seed", SEEDS)
def test_stretching_keeps_the_order_and_the_last_reading(seed):
    windows, _, slower, graphs = stretched(0.5, seed)
    assert slower.count == windows.count
    assert graphs.size == len(slower.rows) < len(windows.rows)
    assert 0 <= slower.slot.min() and slower.slot.max() == SLOTS - 1
    for before, after in zip(each(windows), each(slower), strict=True):
        kept = len(after)
        # What falls out is the oldest.
        assert slower.rows[after].tolist() == windows.rows[before][-kept:].tolist()
        assert slower.slot[after][-1] == SLOTS - 1
        assert (np.diff(slower.slot[after]) >= 0).all()


def factors(windows, graphs, slower, changed):
    """How much longer each window takes, by its readings' time steps."""
    now = changed.seconds / graphs.seconds[slower.rows]
    for place in each(slower):
        np.testing.assert_allclose(now[place], now[place][0], rtol=1e-6)
    return now


@pytest.mark.parametrize("seed", SEEDS)
def test_stretching_scales_all_times_of_a_window_by_one_factor(seed):
    windows, graphs, slower, changed = stretched(0.3, seed)
    factor = factors(windows, graphs, slower, changed)
    was = graphs.select(slower.rows)
    ago = SLOTS - 1 - slower.slot
    ago_before = SLOTS - 1 - windows.slot[slower.rows]
    np.testing.assert_allclose(ago, ago_before * factor, atol=0.501)
    node = factor[changed.graph_index]
    np.testing.assert_allclose(changed.age, was.age * node, rtol=1e-5)
    for column, name in enumerate(HISTORY):
        grows = factor if name in ("age", "pause", "impulse") else np.ones(len(factor))
        assert (column in TIME_COLUMNS) == (name in ("age", "pause", "impulse"))
        np.testing.assert_allclose(
            changed.history[:, column], was.history[:, column] * grows, rtol=1e-5
        )
    others = {"seconds", "age", "history"}
    for name in set(changed._fields) - others:
        np.testing.assert_array_equal(getattr(changed, name), getattr(was, name))


def came(share, halved, seed=0):
    *_, windows = random_windows(seed)
    places = drop_readings(windows, share, halved, np.random.default_rng(seed))
    return windows, places, windows.select(places)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("share", "halved"), [(1.0, 0.0), (0.3, 0.5), (1.0, 1.0)])
def test_dropping_readings_keeps_the_last_of_each_window(seed, share, halved):
    windows, places, left = came(share, halved, seed)
    assert (np.diff(places) > 0).all()
    assert left.count == windows.count
    for before, after in zip(each(windows), each(left), strict=True):
        assert left.rows[after][-1] == windows.rows[before][-1]
        assert left.slot[after][-1] == SLOTS - 1
        assert set(left.rows[after]) <= set(windows.rows[before])


def test_only_halving_the_rate_keeps_every_other_reading_from_the_last():
    windows, places, _ = came(0.0, 0.0)
    assert places.tolist() == list(range(len(windows.rows)))
    windows, _, left = came(0.0, 1.0)
    for before, after in zip(each(windows), each(left), strict=True):
        assert (
            left.rows[after].tolist() == windows.rows[before][::-1][::2][::-1].tolist()
        )


@pytest.mark.parametrize("shear", [False, True])
@pytest.mark.parametrize("every", [1, 2, 3])
def test_graphs_of_readings_left_are_those_of_a_slower_device(every, shear):
    touch = stroke_on_grid(shear, speed=0.2 / every)
    stamps = np.array([reading.stamp for reading in touch.readings])
    kept = np.arange(0, len(stamps), every)
    slower = replace(touch, readings=touch.readings[::every]).graphs()
    window = np.zeros(len(kept), np.int64)
    windows = Windows(kept, window, window, 1)
    found = measure_since_kept(windows, touch.graphs().select(kept), stamps)
    np.testing.assert_allclose(found.seconds[1:], slower.seconds[1:], rtol=1e-6)
    summary, expected = (compute_summary(each, shear) for each in (found, slower))
    np.testing.assert_allclose(summary, expected, rtol=1e-4, atol=1e-4)
