"""What rows and columns leak: taken off, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.skin import grid_skin
from eskin.touch import Calibration, Reading, TouchPipeline
from eskin.touch.crosstalk import Crosstalk
from touch_scenes import REST, calibration_of, mounted_grid, pressed, scan_at

SKIN = grid_skin(4, 5)
PRESSURES = st.lists(st.floats(0, 200), min_size=SKIN.count, max_size=SKIN.count)
SHARES = st.floats(0, 0.1)


def reading_of(pressure, valid=None) -> Reading:
    every = np.ones(SKIN.count, dtype=bool)
    return Reading(
        0,
        np.asarray(pressure, np.float32),
        every if valid is None else valid,
        np.empty(0),
    )


def leaking(pressure, share) -> np.ndarray:
    """What taxels show that leak a share of each other's pressure, told slowly."""
    shown = np.array(pressure, dtype=np.float64)
    for i in range(SKIN.count):
        for j in range(SKIN.count):
            shares_row = SKIN.rows[i] == SKIN.rows[j]
            shares_column = SKIN.columns[i] == SKIN.columns[j]
            if i != j and (shares_row or shares_column):
                shown[i] += share * pressure[j]
    return shown


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_what_one_pressed_taxel_leaks_is_gone_and_its_own_pressure_stays(share):
    pressed = np.zeros(SKIN.count)
    pressed[7] = 80.0
    shown = leaking(pressed, share)
    assert np.count_nonzero(shown) == 1 + 3 + 4
    left = Crosstalk(SKIN, share).taken_off(reading_of(shown)).pressure
    assert np.flatnonzero(left > 1e-4).tolist() == [7]
    # What the others show leaks back, to second order.
    assert left[7] == pytest.approx(80.0, rel=7 * share**2 + 1e-6)


@given(PRESSURES, SHARES)
def test_nothing_is_added_and_nothing_pulls(pressure, share):
    reading = reading_of(pressure)
    left = Crosstalk(SKIN, share).taken_off(reading).pressure
    assert left.dtype == reading.pressure.dtype
    assert (left >= 0).all() and (left <= reading.pressure).all()


@given(PRESSURES, SHARES, st.floats(0.1, 10))
def test_twice_the_pressure_leaves_twice_as_much(pressure, share, factor):
    crosstalk = Crosstalk(SKIN, share)
    once = crosstalk.taken_off(reading_of(pressure)).pressure
    more = crosstalk.taken_off(reading_of(factor * np.array(pressure))).pressure
    assert np.allclose(more, factor * once, rtol=1e-4, atol=1e-2)


def test_without_a_share_a_reading_stays_as_it_is():
    reading = reading_of(np.arange(SKIN.count))
    assert Crosstalk(SKIN, 0.0).taken_off(reading) is reading


def test_what_is_not_valid_leaks_nothing():
    pressure = np.zeros(SKIN.count)
    pressure[[6, 7]] = 5.0, 1000.0
    valid = np.arange(SKIN.count) != 7
    left = Crosstalk(SKIN, 0.1).taken_off(reading_of(pressure, valid)).pressure
    assert left[6] == 5.0


def test_patches_do_not_leak_into_each_other():
    both = replace(SKIN, patch_index=(np.arange(SKIN.count) >= 10).astype(np.int32))
    pressure = np.zeros(SKIN.count)
    same_column = np.flatnonzero(both.columns == both.columns[0])
    far = int(same_column[-1])
    assert both.patch_index[0] != both.patch_index[far]
    pressure[[0, far]] = 100.0, 5.0
    left = Crosstalk(both, 0.1).taken_off(reading_of(pressure)).pressure
    assert left[far] == 5.0


def test_touches_are_of_what_is_left_and_faults_of_what_came():
    mounted = mounted_grid()
    plain = calibration_of(mounted.skin)
    row = mounted.skin.rows == 2
    pad = pressed(mounted.skin, (0.02, 0.04), kpa=60.0)
    states = []
    for calibration in (plain, replace(plain, crosstalk=0.05)):
        pipeline = TouchPipeline(mounted, calibration)
        for n in range(400):
            counts = REST + 10 * pad * (n > 150)
            counts[row] = 0 if n > 200 else counts[row]
            state = pipeline.push(scan_at(n / 50, counts))
        states.append(state)
    one, other = states
    assert one.faults and one.faults == other.faults
    assert np.array_equal(one.reading.valid, other.reading.valid)
    expected = Crosstalk(mounted.skin, 0.05).taken_off(one.reading)
    assert np.array_equal(other.reading.pressure, expected.pressure)
    assert 0 < other.contacts[0].force < one.contacts[0].force


def test_it_travels_with_the_calibration():
    leaky = replace(Calibration.uniform(SKIN.count, 4095, 100.0), crosstalk=0.02)
    assert Calibration.from_bytes(leaky.to_bytes()).crosstalk == 0.02


@pytest.mark.parametrize("share", [-0.1, 1.0, np.nan])
def test_a_share_that_no_skin_has_is_refused(share):
    with pytest.raises(ValueError, match=r"crosstalk is .*; allowed is"):
        replace(Calibration.uniform(SKIN.count, 4095, 100.0), crosstalk=share)
