"""Tests of crosstalk: leakage of rows and columns is estimated and subtracted."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eskin.sim.sensor.kernels import read_array
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, FrontEnd, TouchPipeline
from eskin.touch.taxel_kernels import select
from helpers.touch import (
    REST,
    build_mounted_grid,
    calibration_of,
    press_pad,
    reading_at,
    scan_at,
)

ROWS = 12
COLUMNS = 14
SKIN = build_grid_skin(ROWS, COLUMNS)
HALVES = replace(
    SKIN,
    patch_index=(SKIN.columns >= COLUMNS // 2).astype(np.int64),
    patches=SKIN.patches * 2,
)
ISOLATED = Calibration(
    np.full(SKIN.count, 50.0 / 4095), 4095, curve="divider", exponent=0.85, unfelt=2.0
)
MATRIX = replace(ISOLATED, matrix=True)
PRESSURES = arrays(np.float32, SKIN.count, elements=st.floats(0, 200, width=32))


def read_matrix(pressure, leak, ghost, skin=SKIN):
    """Return the reading of a pressure by an array that leaks within each patch."""
    share = MATRIX.compute_counts(np.asarray(pressure, np.float64)) / MATRIX.full_scale
    conductance = share / (1.0 - share)
    shown = np.zeros(skin.count)
    for patch in np.unique(skin.patch_index):
        taxels = skin.patch_index == patch
        cells = np.zeros((ROWS, COLUMNS), np.float32)
        cells[skin.rows[taxels], skin.columns[taxels]] = conductance[taxels]
        leaking = np.zeros_like(cells)
        read_array(cells, ghost, leak, leaking)
        shown[taxels] = leaking[skin.rows[taxels], skin.columns[taxels]]
    above = MATRIX.full_scale * shown / (1.0 + shown)
    return reading_at(0.0, MATRIX.compute_pressure(above))


def press_square(row, column, kpa=60.0):
    """Return the pressures of a square of 3 x 3 taxels."""
    return kpa * ((abs(SKIN.rows - row) < 2) & (abs(SKIN.columns - column) < 2))


PRESSES = [
    press_square(3, 4),
    press_square(8, 9),
    press_square(3, 10),
    press_square(6, 6, 90.0),
    press_square(2, 3) + press_square(9, 10),
    press_square(3, 11) + press_square(8, 2),
    press_square(2, 2),
    press_square(2, 2) + press_square(8, 8),
]


def compensate(front_end, reading):
    """Return the pressures of a reading without crosstalk."""
    pressure = reading.pressure.copy()
    front_end.compensate(pressure, reading.valid)
    return pressure


def teach(leak, ghost, skin=SKIN):
    """Return a compensator of a device that has been touched here and there."""
    crosstalk = FrontEnd(skin, MATRIX)
    for pressure in PRESSES:
        compensate(crosstalk, read_matrix(pressure, leak, ghost, skin))
    return crosstalk


@pytest.mark.parametrize("leak", [0.001, 0.004, 0.01])
@pytest.mark.parametrize("ghost", [0.0, 0.02, 0.08])
def test_crosstalk_is_estimated_and_subtracted(leak, ghost):
    crosstalk = teach(leak, ghost)
    assert crosstalk.leak == pytest.approx(leak, rel=0.15)
    if ghost:
        assert crosstalk.ghost == pytest.approx(ghost, rel=0.3)
    for pressure in PRESSES:
        shown = read_matrix(pressure, leak, ghost)
        left = compensate(crosstalk, shown)
        touched = pressure > 0
        assert (shown.pressure[~touched] > 0.0).any()
        assert left[~touched].max() < 0.5
        assert left[touched] == pytest.approx(pressure[touched], rel=0.25)


def test_readings_of_a_device_without_crosstalk_stay_the_same():
    crosstalk = teach(0.0, 0.0)
    for pressure in PRESSES:
        left = compensate(crosstalk, reading_at(0.0, pressure))
        assert left == pytest.approx(pressure, rel=1e-5)


def test_hand_over_the_whole_patch_changes_no_estimate():
    crosstalk = FrontEnd(SKIN, MATRIX)
    broad = np.random.default_rng(0).uniform(10, 40, SKIN.count)
    reading = reading_at(0.0, broad)
    for _ in range(20):
        left = compensate(crosstalk, reading)
    assert left == pytest.approx(reading.pressure, rel=1e-5)


@settings(max_examples=30, deadline=None)
@given(st.lists(PRESSURES, min_size=1, max_size=3))
def test_compensation_never_adds_pressure_and_never_makes_it_negative(pressures):
    crosstalk = teach(0.005, 0.05)
    for pressure in pressures:
        left = compensate(crosstalk, reading_at(0.0, pressure))
        assert left.dtype == np.float32
        assert (left >= 0).all() and (left <= pressure * (1 + 1e-5) + 1e-6).all()


def test_readings_of_isolated_taxels_are_passed_on():
    reading = read_matrix(PRESSES[0], 0.01, 0.05)
    left = compensate(FrontEnd(SKIN, ISOLATED), reading)
    np.testing.assert_array_equal(left, reading.pressure)


def test_invalid_taxels_have_no_crosstalk():
    pressure = np.zeros(SKIN.count)
    pressure[[6, 7]] = 5.0, 300.0
    reading = reading_at(0.0, pressure, valid=np.arange(SKIN.count) != 7)
    left = compensate(teach(0.005, 0.0), reading)
    assert left[6] == pytest.approx(5.0)


def test_patches_have_no_crosstalk_with_each_other():
    crosstalk = teach(0.01, 0.0, HALVES)
    assert crosstalk.leak == pytest.approx(0.01, rel=0.15)
    pressure = np.zeros(SKIN.count)
    pressure[[0, COLUMNS - 1]] = 100.0, 5.0
    left = compensate(crosstalk, reading_at(0.0, pressure))
    assert left[COLUMNS - 1] == pytest.approx(5.0)


def test_pipeline_finds_contacts_without_crosstalk_and_faults_with_it():
    mounted = build_mounted_grid(rows=12, columns=12)
    skin = mounted.skin
    cells = press_pad(skin, (0.04, 0.06), kpa=80.0).reshape(12, 12)
    leaking = np.zeros_like(cells)
    read_array(cells, 0.0, 0.01, leaking)
    shown = 10 * leaking.ravel()
    states = []
    for matrix in (False, True):
        calibration = replace(calibration_of(skin), matrix=matrix)
        pipeline = TouchPipeline(mounted, calibration)
        for n in range(250):
            trembling = np.round(shown * (1.0 + 0.3 * np.sin(n / 3)))
            counts = REST + trembling * (n > 100)
            counts[skin.rows == 2] *= n <= 150
            state = pipeline.push_scan(scan_at(n / 50, counts))
        states.append(state)
    plain, compensated = states
    assert plain.faults and plain.faults == compensated.faults
    np.testing.assert_array_equal(plain.reading.valid, compensated.reading.valid)
    touched = np.flatnonzero(cells)
    assert sum(len(contact.taxels) for contact in plain.contacts) > len(touched)
    [contact] = compensated.contacts
    assert contact.taxels.tolist() == touched.tolist()


@given(arrays(np.float64, st.integers(1, 40), elements=st.floats(-3.0, 3.0)), st.data())
def test_value_at_a_place_is_that_of_the_sorted_values(values, data):
    place = data.draw(st.integers(0, len(values) - 1))
    assert select(values.copy(), place) == np.sort(values)[place]
