"""What rows and columns leak: learned, taken off, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eskin.sim.sensor.kernels import read_array
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, CrosstalkCompensator, Reading, TouchPipeline
from eskin.touch.calibration_kernels import LEAK
from helpers.touch import REST, calibration_of, mounted_grid, pressed, scan_at

ROWS, COLUMNS = 12, 14
SKIN = build_grid_skin(ROWS, COLUMNS)
PLAIN = Calibration(
    np.full(SKIN.count, 50.0 / 4095), 4095, curve="divider", exponent=0.85, unfelt=2.0
)
MATRIX = replace(PLAIN, matrix=True)
PRESSURES = arrays(np.float32, SKIN.count, elements=st.floats(0, 200, width=32))


def reading_of(pressure, valid=None) -> Reading:
    every = np.ones(SKIN.count, dtype=bool)
    return Reading(
        0,
        np.asarray(pressure, np.float32),
        every if valid is None else valid,
        np.empty(0),
    )


def read(pressure, leak, ghost) -> Reading:
    """What a plain matrix of taxels shows of a pressure."""
    cells = np.zeros((ROWS, COLUMNS), np.float32)
    cells[SKIN.rows, SKIN.columns] = MATRIX.compute_conductance(np.asarray(pressure))
    shown = np.zeros_like(cells)
    read_array(cells, ghost, leak, shown)
    return reading_of(MATRIX.invert_conductance(shown[SKIN.rows, SKIN.columns]))


def pad(row, column, kpa=60.0, size=2):
    """A small square that is pressed."""
    inside = (abs(SKIN.rows - row) < size) & (abs(SKIN.columns - column) < size)
    return kpa * inside


PADS = [pad(3, 4), pad(8, 9), pad(3, 10), pad(6, 6, 90.0)]
CROSSING = [pad(2, 3) + pad(9, 10), pad(3, 11) + pad(8, 2), pad(2, 2) + pad(8, 8)]


def taught(leak, ghost) -> CrosstalkCompensator:
    """A device that has been touched here and there."""
    crosstalk = CrosstalkCompensator(SKIN, MATRIX)
    for pressure in PADS + CROSSING:
        crosstalk.compensate(read(pressure, leak, ghost))
    return crosstalk


@pytest.mark.parametrize("leak", [0.001, 0.004, 0.01])
@pytest.mark.parametrize("ghost", [0.0, 0.02, 0.08])
def test_what_no_one_touches_shows_nothing_and_what_is_touched_stays(leak, ghost):
    crosstalk = taught(leak, ghost)
    for pressure in PADS + CROSSING:
        shown = read(pressure, leak, ghost)
        left = crosstalk.compensate(shown).pressure
        touched = pressure > 0
        assert (shown.pressure[~touched] > 0.0).any()
        assert left[~touched].max() < 0.5
        assert left[touched] == pytest.approx(pressure[touched], rel=0.25)


@pytest.mark.parametrize("leak", [0.001, 0.004, 0.01])
@pytest.mark.parametrize("ghost", [0.02, 0.08])
def test_it_learns_how_much_leaks(leak, ghost):
    crosstalk = taught(leak, ghost)
    assert crosstalk.leak == pytest.approx(leak, rel=0.15)
    assert crosstalk.ghost == pytest.approx(ghost, rel=0.3)


def test_a_device_that_does_not_leak_is_left_alone():
    crosstalk = taught(0.0, 0.0)
    for pressure in PADS + CROSSING:
        left = crosstalk.compensate(reading_of(pressure)).pressure
        assert left == pytest.approx(pressure, rel=1e-5)


def test_a_hand_over_the_whole_patch_teaches_nothing():
    crosstalk = CrosstalkCompensator(SKIN, MATRIX)
    broad = np.random.default_rng(0).uniform(10, 40, SKIN.count)
    reading = reading_of(broad)
    for _ in range(20):
        left = crosstalk.compensate(reading)
    assert left.pressure == pytest.approx(reading.pressure, rel=1e-5)


@given(st.lists(PRESSURES, min_size=1, max_size=3))
def test_nothing_is_added_and_nothing_pulls(pressures):
    crosstalk = taught(0.005, 0.05)
    for pressure in pressures:
        reading = reading_of(pressure)
        left = crosstalk.compensate(reading).pressure
        assert left.dtype == reading.pressure.dtype
        assert (left >= 0).all()
        assert (left <= reading.pressure * (1 + 1e-5) + 1e-6).all()


def test_a_device_that_isolates_its_taxels_keeps_its_readings():
    reading = read(pad(3, 4), 0.01, 0.05)
    assert CrosstalkCompensator(SKIN, PLAIN).compensate(reading) is reading


def test_what_is_not_valid_leaks_nothing():
    crosstalk = taught(0.005, 0.0)
    pressure = np.zeros(SKIN.count)
    pressure[[6, 7]] = 5.0, 300.0
    valid = np.arange(SKIN.count) != 7
    left = crosstalk.compensate(reading_of(pressure, valid)).pressure
    assert left[6] == pytest.approx(5.0)


def test_patches_do_not_leak_into_each_other():
    left_half = (SKIN.columns < COLUMNS // 2).astype(np.int32)
    both = replace(SKIN, patch_index=left_half, patches=SKIN.patches * 2)
    crosstalk = CrosstalkCompensator(both, MATRIX)
    crosstalk.estimate.value[LEAK] = 0.01
    pressure = np.zeros(SKIN.count)
    pressure[[0, COLUMNS - 1]] = 100.0, 5.0
    assert both.rows[0] == both.rows[COLUMNS - 1]
    left = crosstalk.compensate(reading_of(pressure)).pressure
    assert left[COLUMNS - 1] == pytest.approx(5.0)


def test_touches_are_of_what_is_left_and_faults_of_what_came():
    mounted = mounted_grid(rows=12, columns=12)
    skin = mounted.skin
    plain = calibration_of(skin)
    cells = np.zeros((12, 12), np.float32)
    cells[skin.rows, skin.columns] = pressed(skin, (0.04, 0.06), kpa=80.0)
    leaking = np.zeros_like(cells)
    read_array(cells, 0.0, 0.01, leaking)
    shown = 10 * leaking[skin.rows, skin.columns]
    states = []
    for calibration in (plain, replace(plain, matrix=True)):
        pipeline = TouchPipeline(mounted, calibration)
        for n in range(400):
            trembling = np.round(shown * (1.0 + 0.3 * np.sin(n / 3)))
            counts = REST + trembling * (n > 150)
            counts[skin.rows == 2] *= n <= 200
            state = pipeline.push(scan_at(n / 50, counts))
        states.append(state)
    one, other = states
    assert one.faults and one.faults == other.faults
    assert np.array_equal(one.reading.valid, other.reading.valid)
    touched = np.flatnonzero(cells[skin.rows, skin.columns])
    assert sum(len(c.taxels) for c in one.contacts) > len(touched)
    assert np.concatenate([c.taxels for c in other.contacts]).tolist() == list(touched)


@pytest.mark.parametrize("matrix", [True, False])
def test_how_it_is_read_out_travels_with_the_calibration(matrix):
    calibration = replace(PLAIN, matrix=matrix)
    assert Calibration.from_bytes(calibration.to_bytes()).matrix is matrix


@given(st.floats(0, 0.98), st.sampled_from(["linear", "divider"]), st.floats(0.5, 1.5))
def test_pressure_and_conductance_undo_each_other(share, curve, exponent):
    calibration = replace(PLAIN, curve=curve, exponent=exponent)
    pressure = calibration.compute_pressure(np.full(SKIN.count, 4095 * share))
    back = calibration.invert_conductance(calibration.compute_conductance(pressure))
    assert back == pytest.approx(pressure, rel=1e-6, abs=1e-9)
