"""Crosstalk against its formula, and within the bounds of its sources."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from eskin.sim.build import draw_build
from eskin.sim.crosstalk_kernels import read_array
from eskin.sim.sensor import Stages, sense
from sensor_scenes import CONSTANTS, NONE, SKIN, same_session


def ghosts(g):
    """Three-resistor return paths, straight from the formula."""
    found = np.zeros_like(g)
    rows, columns = range(g.shape[0]), range(g.shape[1])
    for i, j, k, via in product(rows, columns, rows, columns):
        path = (g[i, via], g[k, via], g[k, j])
        if k != i and via != j and min(path) > 0:
            found[i, j] += 1 / sum(1 / part for part in path)
    return found


def array(seed=1, shape=(6, 5)):
    rng = np.random.default_rng(seed)
    cells = rng.uniform(0.0, 2.0, shape)
    cells[rng.random(shape) < 0.4] = 0.0
    cells[2], cells[:, 3] = 0.0, 0.0
    return cells.astype(np.float32)


def read(cells, ghost, leak):
    out = np.zeros_like(cells)
    read_array(cells, ghost, leak, out)
    return out


def test_ghosts_are_those_of_the_formula():
    cells = array()
    np.testing.assert_allclose(
        read(cells, 0.05, 0.0), cells + 0.05 * ghosts(cells.astype(float)), rtol=1e-5
    )


def test_a_leak_is_a_part_of_the_others_in_row_and_column():
    cells = array()
    others = cells.sum(1, keepdims=True) + cells.sum(0) - 2 * cells
    np.testing.assert_allclose(
        read(cells, 0.0, 0.01), cells + 0.01 * others, rtol=1e-5, atol=1e-7
    )


def test_crosstalk_turns_and_mirrors_with_the_array():
    cells = array()
    for turned in (lambda c: c.T, lambda c: c[::-1], lambda c: c[:, ::-1]):
        other = np.ascontiguousarray(turned(cells))
        np.testing.assert_allclose(
            read(other, 0.05, 0.01), turned(read(cells, 0.05, 0.01)), rtol=1e-5
        )


def test_an_array_that_nothing_conducts_in_reads_nothing():
    assert not read(np.zeros((4, 4), np.float32), 0.08, 0.01).any()


@pytest.mark.parametrize(("kind", "most"), [("fresh", 0.04), ("shifted", 0.30)])
@pytest.mark.parametrize("pressed", [1, 3])
def test_the_ghost_of_a_pressed_taxel_is_within_the_measured_bounds(
    kind, most, pressed
):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        build = draw_build("b", kind, SKIN, CONSTANTS, rng)
        taxels = np.array([14, 16, 26])[:pressed]
        series = np.full((20, pressed), 30.0)
        stages = replace(NONE, ghosting=True)
        still = sense(0 * series, taxels, build, SKIN, rng, stages, same_session())
        counts, _ = sense(series, taxels, build, SKIN, rng, stages, same_session())
        risen = (counts - still[0])[-1]
        assert not risen[36:].any()
        others = np.delete(risen, taxels)
        assert others.max() <= most * risen[taxels].min()


def test_ghosts_do_not_cross_from_patch_to_patch():
    build = draw_build("b", "shifted", SKIN, CONSTANTS, np.random.default_rng(1))
    one, two = np.array([7, 8, 13]), np.array([50, 51, 56])
    series = np.full((20, 3), 30.0)

    def counts(taxels, series):
        rng = np.random.default_rng(2)
        return sense(series, taxels, build, SKIN, rng, Stages())[0]

    both = counts(np.append(one, two), np.hstack([series, series]))
    np.testing.assert_array_equal(both[:, :36], counts(one, series)[:, :36])
    np.testing.assert_array_equal(both[:, 36:], counts(two, series)[:, 36:])
