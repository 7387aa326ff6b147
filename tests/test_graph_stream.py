"""Tests of graph streams: the graphs and the history of every open touch."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from eskin.live import HISTORY, GraphBatch, GraphConfig, GraphStream, join_graphs
from eskin.live.graph_builder import WHOLE_SKIN
from eskin.touch import Calibration, TouchPipeline
from eskin.units import NS_PER_S
from helpers.graphs import (
    SCENES,
    bump,
    flat,
    make_scene,
    mirror_scene,
    motion,
    move_scene,
    pressure_summary,
    renumber_scene,
    rolled,
)

STEP = 0.05
WIDE = flat(columns=40)
LEFT, RIGHT = (bump(WIDE.skin, (x, 0, 0), radius=0.015) for x in (-0.1, 0.1))


def push_scene(touch, config=None):
    """Return the graphs of each reading of a scene, by key."""
    calibration = Calibration.uniform(touch.mounted.skin.count, 1000, 100.0)
    pipeline = TouchPipeline(touch.mounted, calibration)
    stream = GraphStream(touch.mounted, config)
    return [stream.build_graphs(pipeline.push_reading(each)) for each in touch.readings]


def push_loads(mounted, *loads, step=STEP):
    return push_scene(make_scene(mounted, loads, step=step))


def join_sequences(touch):
    """Return the graphs of each sequence of a scene, one after another."""
    found = {}
    for graphs in push_scene(touch):
        for key, graph in graphs.items():
            found.setdefault(key, []).append(graph)
    return [join_graphs(graphs) for graphs in found.values()]


def get_history(touch):
    """Return the history of each touch of a scene by column."""
    return [
        dict(zip(HISTORY, graphs.history.T, strict=True))
        for graphs in join_sequences(touch)
    ]


def test_each_touch_has_a_graph_of_its_own_load():
    alone, one, two = push_loads(WIDE, LEFT, LEFT + RIGHT, 2 * (LEFT + RIGHT))
    assert len(alone) == 1
    assert list(one) == list(two)
    for key, load in zip(two, (LEFT, RIGHT), strict=True):
        pressed = np.flatnonzero(load >= 3.0)
        graph = one[key]
        assert np.array_equal(graph.taxels[graph.pressure > 0], pressed)
        before = two[key].before[two[key].before > 0]
        np.testing.assert_allclose(before, load[pressed], rtol=1e-6)
    assert not one[max(one)].before.any()


def test_merged_touch_has_the_load_of_both_before():
    both = LEFT + RIGHT
    bridge = sum(bump(WIDE.skin, (x, 0, 0), radius=0.015) for x in (-0.05, 0, 0.05))
    apart, together = push_loads(WIDE, both, both + bridge)
    assert (len(apart), len(together)) == (2, 1)
    [graph] = together.values()
    load = both[graph.taxels]
    np.testing.assert_allclose(graph.before, np.where(load >= 3.0, load, 0), rtol=1e-6)


def test_touch_has_graphs_without_pressure_until_it_closes():
    pat = bump(WIDE.skin, (0, 0, 0))
    graphs = push_loads(WIDE, pat, 0 * pat, 0 * pat, pat, *[0 * pat] * 15)
    assert len({key for found in graphs[:4] for key in found}) == 1
    assert graphs[-1] == {}
    first = [found for graph in graphs[:4] for found in graph.values()]
    force = [pressure_summary(graph)[0, 0] for graph in first]
    assert [f > 0 for f in force] == [True, False, False, True]
    sizes = [len(graph.taxels) for graph in first]
    assert sizes[1] == sizes[0] and sizes[2] == 0


def test_skin_without_calibration_has_one_sequence_without_history():
    mounted = flat(columns=40, calibrated=False)
    graphs = push_loads(mounted, 0 * LEFT, LEFT + RIGHT, LEFT, *[0 * LEFT] * 15)
    assert all(list(found) == [WHOLE_SKIN] for found in graphs)
    batch = join_graphs([found[WHOLE_SKIN] for found in graphs])
    active, before = (
        np.bincount(batch.graph_index[loads > 0], minlength=len(graphs))
        for loads in (batch.pressure, batch.before)
    )
    assert active[0] == active[-1] == 0
    assert active[1] == 2 * active[2] > 0
    assert np.array_equal(before[1:], active[:-1])
    assert not batch.history.any()


@pytest.mark.parametrize(("shear_on", "count"), [(1.5, 3), (np.inf, 0)])
def test_skin_without_calibration_finds_touch_by_shear(shear_on, count):
    mounted = flat(calibrated=False)
    touch = make_scene(mounted, np.zeros((1, mounted.skin.count)), shear=True)
    touch.readings[0].shear[:3] = 0.0, 2.0
    [graphs] = push_scene(touch, GraphConfig(shear_on=shear_on))
    shear = graphs[WHOLE_SKIN].shear
    assert np.count_nonzero(np.linalg.norm(shear, axis=1) > 1.5) == count


def make_pats(pattern, step=STEP):
    """Press the same place in some readings, ever harder, and not in others."""
    mounted = flat()
    load = bump(mounted.skin, (0, 0, 0))
    loads = [on * (1 + 1e-3 * n) * load for n, on in enumerate(pattern)]
    return make_scene(mounted, loads, step=step)


def make_stroke(mounted=WIDE):
    """Move a load along a grid and half the way back."""
    there = np.arange(0.0, 0.121, 0.2 * STEP)
    x = np.concatenate([there, there[-2 : len(there) // 2 : -1]]) - 0.06
    loads = [bump(mounted.skin, (at, 0.003, 0)) for at in x]
    return make_scene(mounted, loads, step=STEP)


def repeat_readings(touch, count):
    """Return a scene that is read so many times as often as it is measured."""
    readings = [
        replace(reading, stamp=reading.stamp + round(n * STEP / count * NS_PER_S))
        for reading in touch.readings
        for n in range(count)
    ]
    return replace(touch, readings=tuple(readings))


def test_readings_that_repeat_a_measurement_have_no_graphs():
    """A slow device that is read often has the graphs of its own measurements."""
    own, often = (
        join_sequences(touch)[0]
        for touch in (make_stroke(), repeat_readings(make_stroke(), 5))
    )
    for name in set(GraphBatch._fields) - {"history"}:
        expected = getattr(own, name)
        np.testing.assert_allclose(
            getattr(often, name)[: len(expected)], expected, atol=1e-5
        )
    clocks = [HISTORY.index(name) for name in ("age", "pause", "contacts")]
    np.testing.assert_allclose(
        often.history[: own.size, clocks], own.history[:, clocks], atol=1e-6
    )


def test_graphs_of_a_fast_skin_are_8_ms_apart_and_hold_the_load_of_the_last():
    x = np.linspace(-0.06, 0.06, 201)
    loads = [bump(WIDE.skin, (at, 0.003, 0), radius=0.015) for at in x]
    found = push_loads(WIDE, *loads, step=0.001)
    used = [n for n, graphs in enumerate(found) if graphs]
    assert used[:3] == [0, 1, 2] and used[4:] == list(range(used[4], 201, 8))
    graphs = [graph for each in found for graph in each.values()]
    assert graphs[-1].seconds[0] == pytest.approx(0.008)
    for before, graph in pairwise(graphs):
        was = dict(zip(before.taxels, before.pressure, strict=True))
        expected = [was.pop(taxel, 0.0) for taxel in graph.taxels]
        np.testing.assert_array_equal(graph.before, expected)
        assert not any(was.values())


def test_touches_that_begin_at_once_have_graphs_every_8_ms_afterwards():
    places = np.linspace(-0.18, 0.18, 4)
    hands = [bump(WIDE.skin, (x, 0, 0), radius=0.015) for x in places]
    loads = [sum(hands[: n + 1]) * (1 + 1e-3 * n) for n in range(60)]
    found = push_loads(WIDE, *loads, step=0.001)
    used = [n for n, graphs in enumerate(found) if graphs]
    assert max(np.diff(used)) <= 8


def test_load_that_stays_has_a_graph_every_three_tenths_of_a_second():
    graphs = push_loads(WIDE, *[LEFT] * 31, step=0.02)
    assert [n for n, found in enumerate(graphs) if found] == [0, 15, 30]
    assert [found[1].seconds[0] for found in graphs if found][1:] == pytest.approx(
        [0.3] * 2
    )
    assert graphs[30][1].history[0, HISTORY.index("age")] == pytest.approx(0.6)


@pytest.mark.parametrize("change", ["shear", "another touch", "a taxel less", "pause"])
def test_reading_repeats_only_if_nothing_has_changed(change):
    less = np.where(LEFT == LEFT[LEFT >= 3.0].min(), 0.0, LEFT)
    loads = {"another touch": LEFT + RIGHT, "a taxel less": less, "pause": 0 * LEFT}
    mounted = flat(columns=40, calibrated=change != "shear")
    touch = make_scene(
        mounted, [LEFT, loads.get(change, LEFT)], shear=change == "shear"
    )
    first, second = push_scene(touch)
    assert len(first) == 1 and set(first) <= set(second)


def test_touch_has_a_graph_at_every_reading_of_a_pause():
    graphs = push_scene(make_pats([1, *[0] * 6]))
    assert all(len(found) == 1 for found in graphs)


def make_two_touches():
    loads = LEFT, 0.99 * LEFT, LEFT + RIGHT, LEFT + 2 * RIGHT
    return make_scene(WIDE, loads, step=STEP)


def test_history_has_age_pause_and_number_of_contacts():
    [found] = get_history(make_pats([1, 1, 0, 0, 1, 0, 0, 0, 1, 1]))
    np.testing.assert_allclose(found["age"], STEP * np.arange(10), atol=1e-6)
    pause = [0, 0, 1, 2, 0, 1, 2, 3, 0, 0]
    np.testing.assert_allclose(found["pause"], STEP * np.array(pause), atol=1e-6)
    assert found["contacts"].tolist() == [1, 1, 1, 1, 2, 2, 2, 2, 3, 3]


@pytest.mark.parametrize(
    ("pattern", "step"), [([1] * 6, 0.005), ([1] * 6, 0.1), ([1, 1, 0, 1, 1, 1], 0.02)]
)
def test_steady_or_flickering_contact_counts_once(pattern, step):
    [found] = get_history(make_pats(pattern, step))
    assert set(found["contacts"].tolist()) == {1}


def test_travel_is_the_distance_from_the_start():
    [found] = get_history(make_stroke())
    travel = found["travel"]
    assert travel[0] == 0.0
    assert travel.max() == pytest.approx(12.0, abs=0.3)
    assert travel[-1] == pytest.approx(6.0, abs=1.5)
    farthest = np.maximum.accumulate(travel)
    np.testing.assert_allclose(found["farthest"], farthest, rtol=1e-6)


def test_impulse_and_peak_force_are_in_newton_seconds_and_newton():
    mounted = flat(pitch=0.02)
    load = np.where(bump(mounted.skin, (0, 0, 0), radius=0.021) > 0, 50.0, 0.0)
    force = 5 * 50e3 * 4e-4
    loads = [load, 1.00001 * load, 2 * load, load, 0 * load]
    [found] = get_history(make_scene(mounted, loads, step=STEP))
    peak = force * np.array([1, 1, 2, 2, 2])
    np.testing.assert_allclose(found["peak force"], peak, rtol=1e-5)
    # Nothing is known of the time before the first reading.
    impulse = force * STEP * np.array([1, 1.5, 1.5, 0.5])
    np.testing.assert_allclose(np.diff(found["impulse"]), impulse, rtol=1e-4)


def test_each_touch_has_its_own_history():
    left, right = get_history(make_two_touches())
    assert left["age"] == pytest.approx([0, 0.05, 0.1, 0.15])
    assert right["age"] == pytest.approx([0, 0.05])
    assert right["peak force"][-1] == pytest.approx(2 * left["peak force"][-1])
    pat = bump(WIDE.skin, (-0.17, 0, 0), radius=0.015)
    loads = [
        on * pat + bump(WIDE.skin, (0.02 * n, 0, 0), radius=0.015)
        for n, on in enumerate((1, 0, 0, 1, 0, 0, 1))
    ]
    pats, stroke = get_history(make_scene(WIDE, loads, step=STEP))
    assert (pats["contacts"][-1], stroke["contacts"][-1]) == (3, 1)
    assert pats["farthest"][-1] < 1 < 11 < stroke["farthest"][-1]


def test_later_touch_starts_without_history():
    first, second = get_history(make_pats([1, 1, 0, 0, 1, *[0] * 13, 1, 1]))
    # Impulse also covers the time since the reading before.
    for name in set(HISTORY) - {"impulse", "peak force"}:
        np.testing.assert_allclose(second[name][:2], first[name][:2], atol=1e-6)
    assert second["peak force"][0] == pytest.approx(first["peak force"][0], rel=0.1)


TOUCHES = {
    "stroke": make_stroke,
    "stroke around a tube": lambda: make_stroke(rolled(rows=25)),
    "pats": lambda: make_pats([1, 1, 0, 0, 1, 0, 1]),
    "two touches": make_two_touches,
    "patches on two links": SCENES["patches on two links"],
    "two links of the ur5": SCENES["two links of the ur5"],
}


@pytest.mark.parametrize("name", TOUCHES)
@pytest.mark.parametrize(
    "change",
    [lambda touch: move_scene(mirror_scene(touch), motion(4)), renumber_scene],
    ids=["mirrored and moved", "renumbered"],
)
def test_history_is_invariant(name, change):
    touch = TOUCHES[name]()
    histories = [
        [graphs.history for graphs in join_sequences(each)]
        for each in (touch, change(touch))
    ]
    assert any(history.any() for history in histories[0])
    # Touches that begin at one reading may be numbered in another order.
    for parts in histories:
        parts.sort(key=lambda history: (len(history), *history[-1]))
    for before, after in zip(*histories, strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-4, atol=1e-4)
