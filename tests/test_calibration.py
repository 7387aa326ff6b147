import json
from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import ReadingError, RecordingError, SkinMismatchError
from eskin.touch import (
    Calibration,
    CalibrationConfig,
    Calibrator,
    ContactConfig,
    Scan,
)
from helpers.touch import (
    REST,
    SECOND,
    START,
    build_grid_skin,
    calibration_of,
    pressed,
    reading_at,
    scan_at,
)

SKIN = build_grid_skin()
TOUCHED = pressed(SKIN, (0.02, 0.02), kpa=1.0) > 0


def play(signal, seconds, rate, calibrator=None, start=0.0):
    """Push `signal(t) -> counts` and return the readings' pressures."""
    calibrator = calibrator or Calibrator(SKIN, calibration_of(SKIN))
    times = start + np.arange(round(seconds * rate)) / rate
    pressures = [calibrator.push(scan_at(t, signal(t))).pressure for t in times]
    return times, np.array(pressures)


def touch(start, end, counts):
    """Rest, and a touch of the middle taxels from start to end [s]."""
    return lambda t: np.where(TOUCHED & (start <= t < end), REST + counts, REST)


@pytest.mark.parametrize("rate", [10, 100, 500])
def test_a_touch_is_measured_above_rest_with_the_gain(rate):
    _, pressure = play(touch(3.0, 4.0, 200), 4.0, rate)
    np.testing.assert_allclose(pressure[-1][TOUCHED], 20.0, atol=1e-5)
    assert not pressure[-1][~TOUCHED].any()


@pytest.mark.parametrize("rate", [10, 200])
def test_a_touch_of_a_minute_is_not_learned(rate):
    _, pressure = play(touch(3.0, 63.0, 200), 63.0, rate)
    np.testing.assert_allclose(pressure[-1][TOUCHED], 20.0, atol=0.1)


@pytest.mark.parametrize("rate", [10, 200])
def test_a_slow_drift_is_learned(rate):
    _, pressure = play(
        lambda t: np.full(SKIN.count, round(REST + 0.5 * t)), 120.0, rate
    )
    assert pressure.max() < 1.0


def test_drift_under_a_neighbouring_touch_waits_until_it_is_over():
    def signal(t):
        return touch(3.0, 8.0, 200)(t) + np.where(t > 4.0, 10, 0)

    _, during = play(signal, 8.0, 50)
    beside = SKIN.positions[:, :2] - (0.02, 0.02)
    beside = (np.linalg.norm(beside, axis=1) < 0.023) & ~TOUCHED
    np.testing.assert_allclose(during[-1][beside], 1.0, atol=0.05)
    _, after = play(signal, 60.0, 50)
    assert after[-1].max() < 0.1


def test_a_touch_within_the_tare_is_not_taken_for_rest():
    _, pressure = play(touch(0.4, 2.5, 200), 2.5, 50)
    np.testing.assert_allclose(pressure[-1][TOUCHED], 20.0, atol=0.1)


def test_rest_is_found_soon_after_a_touch_that_was_there_from_the_start():
    times, pressure = play(touch(-1.0, 6.0, 200), 9.0, 50)
    assert pressure[times < 6.0].max() == 0.0
    calibrator = Calibrator(SKIN, calibration_of(SKIN))
    play(touch(-1.0, 6.0, 200), 9.0, 50, calibrator)
    _, again = play(touch(9.0, 10.0, 200), 1.0, 50, calibrator, start=9.0)
    np.testing.assert_allclose(again[-1][TOUCHED], 20.0, atol=0.2)


def test_one_low_outlier_does_not_move_the_baseline():
    calibrator = Calibrator(SKIN, calibration_of(SKIN))
    play(touch(0, 0, 0), 4.0, 50, calibrator)
    calibrator.push(scan_at(4.0, np.zeros(SKIN.count)))
    _, pressure = play(touch(0, 0, 0), 1.0, 50, calibrator, start=4.02)
    assert pressure.max() == 0.0


def test_zeros_of_a_device_that_starts_are_not_taken_for_rest():
    _, pressure = play(lambda t: np.full(SKIN.count, REST if t > 0.05 else 0), 3.0, 50)
    assert pressure[-1].max() == 0.0


def test_what_a_taxel_keeps_after_a_touch_is_learned_but_the_touch_is_not():
    def signal(t):
        return touch(3.0, 20.0, 500)(t) + np.where(TOUCHED & (t >= 20.0), 40, 0)

    times, pressure = play(signal, 40.0, 50)
    assert pressure[times < 20.0][-1].max() == pytest.approx(50.0, abs=0.1)
    assert pressure[-1].max() < 0.5


def test_a_change_at_rest_is_learned_at_last():
    config = CalibrationConfig(longest_seconds=20.0)
    calibrator = Calibrator(SKIN, calibration_of(SKIN), config)
    _, pressure = play(touch(3.0, 1e9, 100), 60.0, 20, calibrator)
    assert pressure[-1].max() < 0.3


def test_a_patch_silent_for_long_is_tared_anew():
    calibrator = Calibrator(SKIN, calibration_of(SKIN))
    play(touch(0, 0, 0), 3.0, 50, calibrator)
    none = np.zeros(SKIN.count, bool)
    calibrator.push(scan_at(4.0, np.zeros(SKIN.count), received=none))
    pressure = calibrator.push(scan_at(30.0, np.full(SKIN.count, 600))).pressure
    assert pressure.max() == 0.0


def test_readings_do_not_depend_on_the_order_of_the_taxels():
    order = np.random.default_rng(1).permutation(SKIN.count)
    shuffled = build_grid_skin()
    for name in ("rows", "columns", "positions", "normals", "areas", "tangents"):
        object.__setattr__(shuffled, name, getattr(SKIN, name)[order])
    rng = np.random.default_rng(2)
    one = Calibrator(SKIN, calibration_of(SKIN))
    two = Calibrator(shuffled, calibration_of(SKIN))
    for step in range(200):
        counts = REST + rng.integers(-30, 60, SKIN.count)
        first = one.push(scan_at(step / 20, counts)).pressure
        second = two.push(scan_at(step / 20, counts[order])).pressure
        np.testing.assert_array_equal(first[order], second)


def test_what_was_not_received_or_is_faulty_is_not_valid_and_teaches_nothing():
    calibrator = Calibrator(SKIN, calibration_of(SKIN))
    play(touch(0, 0, 0), 3.0, 50, calibrator)
    received = np.arange(SKIN.count) != 3
    faulty = np.arange(SKIN.count) == 4
    counts = np.full(SKIN.count, REST)
    counts[3:5] = -1000
    for step in range(50):
        scan = scan_at(3.0 + step / 50, counts, received)
        reading = calibrator.push(scan, faulty)
    assert np.flatnonzero(~reading.valid).tolist() == [3, 4]
    reading = calibrator.push(scan_at(5.0, np.full(SKIN.count, REST)))
    assert reading.valid.all()
    assert reading.pressure.max() == 0.0


def test_shear_is_measured_from_rest_and_not_learned_while_touched():
    calibration = Calibration(np.full(SKIN.count, 0.1), 1000, 0.5, 128)
    calibrator = Calibrator(SKIN, calibration)
    for t in np.arange(0, 30, 0.05):
        pressing = t >= 10
        shear = np.full((SKIN.count, 2), 130)
        shear[TOUCHED] += (40, -20) if pressing else (0, 0)
        counts = np.where(TOUCHED & pressing, REST + 100, REST)
        reading = calibrator.push(scan_at(t, counts, shear=shear.astype(np.int32)))
    assert reading.shear is not None
    expected = np.tile([20.0, -10.0], (TOUCHED.sum(), 1))
    np.testing.assert_allclose(reading.shear[TOUCHED], expected, atol=0.6)
    assert reading.shear.dtype == np.float32


def test_a_calibration_survives_its_bytes():
    calibration = Calibration(np.array([0.1, 1 / 3]), 4095, 0.25, 128)
    again = Calibration.from_bytes(calibration.to_bytes())
    np.testing.assert_array_equal(again.gain, calibration.gain)
    assert (again.full_scale, again.shear_gain, again.shear_rest) == (4095, 0.25, 128)


DIVIDER = Calibration(
    np.full(SKIN.count, 40.0 / 4095), 4095, curve="divider", exponent=0.8
)


def divided(kpa):
    """Counts above rest of a divider at half scale at 40 kPa."""
    conductance = (kpa / 40.0) ** 0.8
    return np.round(4095 * conductance / (1 + conductance)).astype(int)


@pytest.mark.parametrize("kpa", [1.6, 5.0, 40.0, 150.0])
def test_what_a_divider_bends_is_straightened(kpa):
    calibrator = Calibrator(SKIN, DIVIDER)
    _, pressure = play(touch(3.0, 4.0, divided(kpa)), 4.0, 50, calibrator)
    np.testing.assert_allclose(pressure[-1][TOUCHED], kpa, rtol=0.01)
    assert not pressure[-1][~TOUCHED].any()


def test_a_saturated_divider_reads_finite_pressure_and_more_counts_never_less():
    calibrator = Calibrator(SKIN, DIVIDER)
    play(touch(0, 0, 0), 3.0, 50, calibrator)
    counts = np.linspace(REST - 50, 5000, SKIN.count).astype(int)
    pressure = calibrator.push(scan_at(3.0, counts)).pressure
    assert np.isfinite(pressure).all()
    assert (np.diff(pressure) >= 0).all()
    assert pressure[-1] > 1000.0


def test_the_margin_is_the_same_pressure_behind_a_divider():
    closing = replace(DIVIDER, unfelt=2.0)
    for calibration in (calibration_of(SKIN), DIVIDER, closing):
        calibrator = Calibrator(SKIN, calibration)
        at_margin = calibration.compute_counts(1.5)
        for factor, learned in ((0.9, True), (1.1, False)):
            above = np.round(factor * at_margin).astype(int)
            down = np.round(0.4 * at_margin).astype(int)
            calibrator = Calibrator(SKIN, calibration)

            def signal(t, high=above, low=above - down):
                return REST + np.where(round(t) % 2, high, low) * (t > 3.0)

            times, pressure = play(signal, 60.0, 20, calibrator)
            last = pressure[times > 58.0]
            assert (last.max() < 0.7) == learned


def test_a_divider_learns_what_a_taxel_keeps_but_not_the_touch():
    calibrator = Calibrator(SKIN, DIVIDER)

    def signal(t):
        return touch(3.0, 20.0, divided(50.0))(t) + np.where(
            TOUCHED & (t >= 20), 150, 0
        )

    times, pressure = play(signal, 40.0, 50, calibrator)
    assert pressure[times < 20.0][-1].max() == pytest.approx(50.0, rel=0.01)
    assert pressure[-1].max() < 0.5


def test_pressure_and_counts_of_a_calibration_undo_each_other():
    closing = replace(DIVIDER, unfelt=2.0)
    for calibration in (calibration_of(SKIN), DIVIDER, closing):
        calibrator = Calibrator(SKIN, calibration)
        play(lambda t: np.zeros(SKIN.count), 3.0, 50, calibrator)
        counts = np.round(calibration.compute_counts(30.0)).astype(int)
        pressure = calibrator.push(scan_at(3.0, counts)).pressure
        np.testing.assert_allclose(pressure, 30.0, rtol=1e-3)
        above = calibration.compute_counts(30.0)
        np.testing.assert_allclose(calibration.compute_pressure(above), 30.0)


def test_what_closes_the_sensor_is_added_but_never_more_than_is_felt():
    plain, closing = DIVIDER, replace(DIVIDER, unfelt=2.0)
    above = np.linspace(0.0, 500.0, SKIN.count)
    felt, whole = plain.compute_pressure(above), closing.compute_pressure(above)
    np.testing.assert_allclose(whole, felt + np.minimum(felt, 2.0))
    assert whole[0] == 0.0


def test_a_calibration_without_a_curve_reads_as_linear():
    content = json.loads(calibration_of(SKIN).to_bytes())
    del content["curve"], content["exponent"]
    old = Calibration.from_bytes(json.dumps(content).encode())
    assert (old.curve, old.exponent) == ("linear", 1.0)
    again = Calibration.from_bytes(DIVIDER.to_bytes())
    assert (again.curve, again.exponent) == ("divider", 0.8)


@pytest.mark.parametrize("changes", [{"curve": "round"}, {"exponent": 0.0}])
def test_a_curve_that_is_unknown_is_refused_in_one_line(changes):
    content = json.loads(DIVIDER.to_bytes()) | changes
    with pytest.raises(RecordingError, match="calibration cannot be read") as error:
        Calibration.from_bytes(json.dumps(content).encode())
    assert "\n" not in str(error.value)
    if "exponent" in changes:
        with pytest.raises(ValueError, match="finite positive number"):
            Calibration(np.ones(3), 100, curve="divider", exponent=np.inf)


@pytest.mark.parametrize("data", [b"", b"[]", b"{}", b'{"version": 1}', b"\xff"])
def test_bytes_that_are_no_calibration_are_refused_in_one_line(data):
    with pytest.raises(RecordingError, match="calibration cannot be read") as error:
        Calibration.from_bytes(data)
    assert "\n" not in str(error.value)


def test_gains_that_no_electronics_have_are_refused():
    with pytest.raises(ValueError, match="finite positive"):
        Calibration(np.array([0.1, np.nan]), 100)


def test_stamps_that_do_not_advance_are_refused():
    calibrator = Calibrator(SKIN, calibration_of(SKIN))
    calibrator.push(scan_at(1.0, np.zeros(SKIN.count)))
    for seconds in (1.0, 0.5):
        with pytest.raises(ReadingError, match="allowed is only later"):
            calibrator.push(scan_at(seconds, np.zeros(SKIN.count)))


def test_a_scan_or_calibration_of_another_length_is_refused():
    with pytest.raises(SkinMismatchError, match="has 5 taxels"):
        Calibrator(SKIN, Calibration.uniform(5, 1000, 100.0))
    calibrator = Calibrator(SKIN, calibration_of(SKIN))
    with pytest.raises(ReadingError, match="scan has 5 taxels, skin 'grid' has 36"):
        calibrator.push(scan_at(0.0, np.zeros(5)))


def test_arrays_that_do_not_belong_together_are_refused():
    q, yes = np.zeros(0), np.ones(3, bool)
    with pytest.raises(ReadingError, match="counts is float64"):
        Scan(START, np.array([1.0, np.nan, 2.0]), yes, q)
    with pytest.raises(ReadingError, match=r"received has shape \(2,\)"):
        Scan(START, np.zeros(3, np.int32), yes[:2], q)
    with pytest.raises(ReadingError, match="stamp is float"):
        Scan(START / SECOND, np.zeros(3, np.int32), yes, q)
    with pytest.raises(ReadingError, match="q of joint 1 is nan"):
        Scan(START, np.zeros(3, np.int32), yes, np.array([0.0, np.nan]))


def test_a_nan_marked_valid_is_refused_and_one_marked_invalid_is_not():
    with pytest.raises(ReadingError, match="pressure of taxel 1 is nan"):
        reading_at(0.0, [1.0, np.nan, 2.0])
    reading_at(0.0, [1.0, np.nan, 2.0], valid=np.array([True, False, True]))


def test_a_floor_raises_both_thresholds_of_contact_and_never_lowers_them():
    config = ContactConfig(on=3.0, off=2.0)
    assert config.with_floor(0.0) == config
    raised = config.with_floor(12.0)
    assert (raised.on, raised.off) == (12.0, 8.0)


@pytest.mark.parametrize("rate", [10, 50, 200])
def test_what_stays_the_same_after_a_touch_is_rest(rate):
    """A sensor that keeps a few kPa is free again after a second, a minute earlier."""

    def signal(t):
        return touch(3.0, 5.0, 300)(t) + np.where(TOUCHED & (t >= 5.0), 50, 0)

    times, pressure = play(signal, 8.0, rate)
    assert pressure[(times > 5.0) & (times < 5.5)][:, TOUCHED].min() > 4.0
    assert pressure[-1].max() < 0.5


def test_a_light_touch_that_trembles_stays():
    def signal(t):
        return touch(3.0, 30.0, 40)(t) + TOUCHED * np.round(8 * np.sin(5 * t))

    _, pressure = play(signal, 30.0, 50)
    assert pressure[-20:, TOUCHED].mean() > 3.0


def test_a_steady_taxel_beside_a_trembling_one_stays():
    """The rim of a hand that rests is touched as long as the hand is."""
    middle = np.linalg.norm(SKIN.positions[:, :2] - (0.02, 0.02), axis=1) < 1e-6
    rim = TOUCHED & ~middle

    def signal(t):
        rim = touch(3.0, 30.0, 40)(t)
        return rim + middle * np.round(100 + 40 * np.sin(5 * t)) * (t >= 3.0)

    _, pressure = play(signal, 29.0, 50)
    np.testing.assert_allclose(pressure[-1][rim], 4.0, atol=0.3)
