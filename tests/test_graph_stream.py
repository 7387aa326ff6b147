"""One graph a reading for every open touch."""

import numpy as np
import pytest

from eskin.graph import WHOLE_SKIN, GraphStream
from eskin.touch import Calibration, TouchPipeline
from helpers.graphs import bump, flat, pressure_summary, reading_at

STEP = 0.05


def streamed(mounted, pressures):
    """What a stream gives for readings `STEP` apart."""
    calibration = Calibration.uniform(mounted.skin.count, 1000, 100.0)
    pipeline, stream = TouchPipeline(mounted, calibration), GraphStream(mounted)
    return [
        stream.push(pipeline.push_reading(reading_at(STEP * n, pressure)))
        for n, pressure in enumerate(pressures)
    ]


def test_two_touches_apart_have_two_graphs_and_each_only_its_own_pressure():
    mounted = flat(columns=24)
    left, right = (bump(mounted.skin, (x, 0, 0), radius=0.015) for x in (-0.1, 0.1))
    alone, both = streamed(mounted, [left, left + right])[0:2]
    assert len(alone) == 1
    assert len(both) == 2
    for graph, load in zip(both.values(), (left, right), strict=True):
        want = np.flatnonzero(load >= 3.0)
        assert np.array_equal(np.sort(graph.taxels[graph.pressure > 0]), want)


def test_a_touch_remembers_its_last_reading_and_no_other_touches():
    mounted = flat(columns=24)
    left, right = (bump(mounted.skin, (x, 0, 0), radius=0.015) for x in (-0.1, 0.1))
    first, second = streamed(mounted, [left + right, 2 * (left + right)])
    assert list(first) == list(second)
    for key, graph in second.items():
        pressed = graph.pressure > 0
        np.testing.assert_allclose(graph.before[pressed] * 2, graph.pressure[pressed])
        assert not first[key].before.any()


def test_a_touch_that_takes_another_over_remembers_its_load_too():
    mounted = flat(columns=24)
    left, right = (bump(mounted.skin, (x, 0, 0), radius=0.015) for x in (-0.1, 0.1))
    bridge = bump(mounted.skin, (0.05, 0, 0), radius=0.015)
    bridge += bump(mounted.skin, (0.0, 0, 0), radius=0.015)
    bridge += bump(mounted.skin, (-0.05, 0, 0), radius=0.015)
    apart, together = streamed(mounted, [left + right, left + right + bridge])
    assert (len(apart), len(together)) == (2, 1)
    [graph] = together.values()
    load = (left + right)[graph.taxels]
    np.testing.assert_allclose(graph.before, np.where(load >= 3.0, load, 0), rtol=1e-6)


def test_between_two_pats_a_touch_has_a_graph_without_pressure_and_then_is_gone():
    mounted = flat()
    pat = bump(mounted.skin, (0, 0, 0))
    pressures = [pat, 0 * pat, 0 * pat, pat, *[0 * pat] * 15]
    graphs = streamed(mounted, pressures)
    assert [len(g) for g in graphs[:4]] == [1] * 4
    assert len({key for g in graphs[:4] for key in g}) == 1
    force = [pressure_summary(next(iter(g.values())))[0, 0] for g in graphs[:4]]
    assert [f > 0 for f in force] == [True, False, False, True]
    sizes = [len(next(iter(g.values())).taxels) for g in graphs[:4]]
    assert sizes[1] == sizes[0] and sizes[2] == 0
    assert graphs[-1] == {}


def test_a_skin_without_measures_has_one_sequence_that_never_ends():
    mounted = flat(columns=24, calibrated=False)
    left, right = (bump(mounted.skin, (x, 0, 0), radius=0.015) for x in (-0.1, 0.1))
    pressures = [0 * left, left + right, left, *[0 * left] * 15]
    graphs = streamed(mounted, pressures)
    assert all(list(g) == [WHOLE_SKIN] for g in graphs)
    assert all(g[WHOLE_SKIN].count == 1 for g in graphs)
    active = [int((g[WHOLE_SKIN].pressure > 0).sum()) for g in graphs]
    assert active[0] == active[-1] == 0
    assert active[1] == 2 * active[2] > 0


@pytest.mark.parametrize("calibrated", [True, False])
def test_a_skin_that_nobody_touches_gives_nothing_to_tell(calibrated):
    mounted = flat(calibrated=calibrated)
    graphs = streamed(mounted, np.zeros((3, mounted.skin.count)))
    assert all(len(graph.taxels) == 0 for g in graphs for graph in g.values())
