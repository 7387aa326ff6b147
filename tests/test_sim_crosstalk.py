"""Crosstalk against its formula, and within the bounds of its sources."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.sim.sensor.build import draw_build
from eskin.sim.sensor.kernels import read_array
from eskin.sim.sensor.model import SensorStages
from eskin.sim.sensor.sensor import sense
from helpers.sensors import CONSTANTS, NONE, SKIN, same_session


def network(g, i, j):
    """Conductance between row i and column j of a whole array, less the cell's own."""
    rows, columns = g.shape
    laplacian = np.zeros((rows + columns, rows + columns))
    laplacian[:rows, rows:], laplacian[rows:, :rows] = -g, -g.T
    laplacian -= np.diag(laplacian.sum(axis=1))
    potential = np.linalg.pinv(laplacian)
    k = rows + j
    resistance = potential[i, i] + potential[k, k] - 2 * potential[i, k]
    return 1 / resistance - g[i, j]


def ghosts(g):
    """The detours of every cell of an array, from its circuit."""
    return np.array(
        [[network(g, i, j) for j in range(g.shape[1])] for i in range(len(g))]
    )


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


@pytest.mark.parametrize("shape", [(2, 2), (3, 5), (10, 10)])
def test_ghosts_in_an_evenly_pressed_block_are_those_of_the_circuit(shape):
    cells = np.full(shape, 0.7, np.float32)
    expected = cells + 0.05 * ghosts(cells.astype(float))
    np.testing.assert_allclose(read(cells, 0.05, 0.0), expected, rtol=1e-5)


def test_a_single_detour_is_three_resistors_in_series():
    cells = np.array([[0.0, 0.5], [0.2, 1.0]], np.float32)
    assert read(cells, 0.1, 0.0)[0, 0] == pytest.approx(0.1 / (2 + 1 + 5), rel=1e-5)


def test_ghosts_are_never_less_than_those_of_the_circuit_and_not_much_more():
    rng = np.random.default_rng(3)
    cells = rng.uniform(0.2, 2.0, (6, 5)).astype(np.float32)
    added, circuit = read(cells, 1.0, 0.0) - cells, ghosts(cells.astype(float))
    assert (added > 0.999 * circuit).all()
    assert (added < 1.3 * circuit).all()


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
        return sense(series, taxels, build, SKIN, rng, SensorStages())[0]

    both = counts(np.append(one, two), np.hstack([series, series]))
    np.testing.assert_array_equal(both[:, :36], counts(one, series)[:, :36])
    np.testing.assert_array_equal(both[:, 36:], counts(two, series)[:, 36:])
