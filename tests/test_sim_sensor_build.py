"""These tests check drawn sensor builds: their scatter, crosstalk and events."""

from typing import Literal

import numpy as np
import pytest

from eskin.sim.sensor.build import draw_build
from eskin.sim.sensor.faults import (
    ELECTRICAL_EVENTS,
    add_electrical_event,
    find_line_taxels,
)
from eskin.sim.sensor.kernels import read_array
from helpers.sensors import CONSTANTS, SKIN
from helpers.touch import build_grid_skin

Kind = Literal["fresh", "shifted"]
LARGE_SKIN = build_grid_skin(12, 12, patches=6)


def draw(kind: Kind = "fresh", seed=1, skin=LARGE_SKIN, constants=CONSTANTS):
    return draw_build("b", kind, skin, constants, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def builds():
    kinds: tuple[Kind, ...] = ("fresh", "shifted")
    return {kind: [draw(kind, seed) for seed in range(8)] for kind in kinds}


@pytest.mark.slow
def test_gains_scatter_within_and_between_patches_as_stated(builds):
    for kind, drawn in builds.items():
        gains = np.log([build.velostat.gain for build in drawn]).reshape(-1, 6, 144)
        within, between = (
            CONSTANTS.value(f"sensor.gain_{of}.{kind}") for of in ("taxel", "patch")
        )
        assert gains.std(axis=2).mean() == pytest.approx(within, rel=0.05)
        assert gains.mean(axis=2).std() == pytest.approx(between, rel=0.2)


def test_dead_lines_are_listed_and_dead():
    constants = CONSTANTS.scaled({"sensor.dead_line.shifted": 10.0})
    defects = draw("shifted", constants=constants).defects
    assert len(defects.lines) == 6
    for line in defects.lines:
        inside = find_line_taxels(line, LARGE_SKIN)
        assert inside.sum() == 12
        assert defects.dead[inside].all()


def test_calibration_of_a_build_knows_its_converter_but_no_single_taxel():
    build = draw("shifted")
    calibration = build.calibration(LARGE_SKIN)
    assert calibration.full_scale == 2**build.electronics.bits - 1
    assert np.unique(calibration.gain).size == 1
    assert calibration.curve == "divider"
    assert calibration.exponent == CONSTANTS.value("sensor.nominal_exponent")


def draw_cells(seed, shape, conducting):
    """Draw conductances of an array of which some taxels, rows, columns are free."""
    rng = np.random.default_rng(seed)
    cells = rng.uniform(0.2, 2.0, shape)
    cells[rng.random(shape) > conducting] = 0.0
    return cells.astype(np.float32)


def read(cells, ghost, leak):
    cells = np.ascontiguousarray(cells)
    out = np.zeros_like(cells)
    read_array(cells, ghost, leak, out)
    return out


def solve_detours(cells):
    """Return what an ideal circuit adds to each cell over all others of the array."""
    rows, columns = cells.shape
    laplacian = np.zeros((rows + columns, rows + columns))
    laplacian[:rows, rows:] = -cells
    laplacian[rows:, :rows] = -cells.T
    laplacian -= np.diag(laplacian.sum(axis=1))
    potential = np.linalg.pinv(laplacian)
    own = np.diag(potential)
    resistance = own[:rows, None] + own[rows:] - 2 * potential[:rows, rows:]
    return 1 / resistance - cells


@pytest.mark.parametrize(
    "cells",
    [np.full(shape, 0.7) for shape in ((2, 2), (3, 5), (10, 10))]
    + [np.array([[0.0, 0.5], [0.2, 1.0]])],
    ids=["2x2", "3x5", "10x10", "uneven"],
)
def test_ghosts_are_those_of_the_circuit_in_even_or_small_arrays(cells):
    expected = cells + 0.05 * solve_detours(cells)
    found = read(cells.astype(np.float32), 0.05, 0.0)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_leak_adds_a_share_of_row_and_column():
    cells = draw_cells(1, (6, 5), 0.6)
    others = cells.sum(1, keepdims=True) + cells.sum(0) - 2 * cells
    np.testing.assert_allclose(
        read(cells, 0.0, 0.01), cells + 0.01 * others, rtol=1e-5, atol=1e-7
    )
    assert not read(0 * cells, 0.08, 0.01).any()


@pytest.mark.parametrize(
    "turn", [np.transpose, np.flipud, np.fliplr], ids=lambda each: each.__name__
)
def test_crosstalk_turns_and_mirrors_with_the_array(turn):
    cells = draw_cells(1, (6, 5), 0.6)
    cells[2] = 0.0
    cells[:, 3] = 0.0
    turned = read(turn(cells), 0.05, 0.01)
    np.testing.assert_allclose(turned, turn(read(cells, 0.05, 0.01)), rtol=1e-5)


BUILD = draw(skin=SKIN)
REST = np.full((100, SKIN.count), 200, np.int32)
RECEIVED = np.ones(REST.shape, bool)


def add_event(kind, seed):
    rng = np.random.default_rng(seed)
    return add_electrical_event(
        kind, REST, RECEIVED, SKIN, BUILD.electronics, rng, CONSTANTS
    )


@pytest.mark.parametrize("kind", ELECTRICAL_EVENTS)
def test_electrical_event_changes_its_place_and_time_only(kind):
    full = BUILD.electronics.full_scale
    lengths = []
    for seed in range(20):
        counts, received, drawn = add_event(kind, seed)
        place = str(drawn["place"])
        onset = int(drawn["onset"])
        lengths.append(int(drawn["readings"]))
        inside = SKIN.patch_index == int(place[1])
        if ":" in place:
            inside = find_line_taxels(place, SKIN)
        expected = np.zeros(REST.shape, bool)
        expected[onset : onset + lengths[-1], inside] = True
        changed = (counts != REST) | ~received
        assert changed.any()
        assert not changed[~expected].any()
        assert not counts[~received].any()
        assert counts.min() >= 0 and counts.max() <= full
        assert received.all() == (kind != "dropout")
        values = counts[changed & received]
        if kind == "stuck_line":
            assert np.all(values == full)
        elif kind == "line_step":
            assert len(np.unique(values)) == 1
        elif kind == "burst":
            assert values.min() < 200 < values.max()
    assert min(lengths) >= 1 and max(lengths) <= 60
    assert (REST == 200).all() and RECEIVED.all()
