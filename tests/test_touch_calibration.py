"""Tests of calibration: counts become pressure, and baselines follow the rest level."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import RecordingError
from eskin.touch import Calibration, CalibrationConfig, ContactConfig, FrontEnd
from helpers.touch import (
    REST,
    build_grid_skin,
    calibration_of,
    press_pad,
    reorder_taxels,
    scan_at,
)

SKIN = build_grid_skin()
TOUCHED = press_pad(SKIN, (0.02, 0.02)) > 0
DISTANCE = np.linalg.norm(SKIN.positions[:, :2] - (0.02, 0.02), axis=1)
MIDDLE = DISTANCE < 1e-6
RIM = TOUCHED & ~MIDDLE
LINEAR = calibration_of(SKIN)
DIVIDER = Calibration(
    np.full(SKIN.count, 40.0 / 4095), 4095, curve="divider", exponent=0.8
)
CLOSING = replace(DIVIDER, unfelt=2.0)
MEASURED = replace(
    CLOSING,
    source="presses",
    noise=np.linspace(0.3, 3.0, SKIN.count),
    rest=np.full(SKIN.count, 200.25),
    gain_deviation=np.array([0.2]),
    exponent_deviation=0.1,
    unfelt_deviation=0.5,
)


def push_signal(signal, seconds, rate=50, front_end=None, start=0.0):
    """Push `signal(t)` as counts; return the times and the pressures."""
    front_end = front_end or FrontEnd(SKIN, LINEAR)
    times = start + np.arange(round(seconds * rate)) / rate
    pressures = [front_end.make_reading(scan_at(t, signal(t))).pressure for t in times]
    return times, np.array(pressures)


def touch(start, end, counts, kept=0, trembling=0):
    """Return the signal of a touch of the middle taxels; some counts stay after it."""

    def signal(t):
        above = counts + np.round(trembling * np.sin(5 * t))
        return REST + TOUCHED * (above if start <= t < end else kept * (t >= end))

    return signal


def rest(t):
    """Return the counts of an untouched skin."""
    return np.full(SKIN.count, REST)


def divider_counts(kpa):
    """Compute the counts above rest of a divider at half scale at 40 kPa."""
    conductance = (kpa / 40.0) ** 0.8
    return round(4095 * conductance / (1 + conductance))


@pytest.mark.parametrize(
    ("calibration", "counts", "kpa", "rate"),
    [(LINEAR, 200, 20.0, rate) for rate in (10, 100, 500)]
    + [(DIVIDER, divider_counts(kpa), kpa, 50) for kpa in (1.6, 5.0, 40.0, 150.0)]
    + [(CLOSING, divider_counts(kpa), kpa + 2.0, 50) for kpa in (5.0, 40.0)],
)
def test_touch_is_measured_above_rest(calibration, counts, kpa, rate):
    front_end = FrontEnd(SKIN, calibration)
    _, pressure = push_signal(touch(3.0, 4.0, counts), 4.0, rate, front_end)
    np.testing.assert_allclose(pressure[-1][TOUCHED], kpa, rtol=2e-3)
    assert not pressure[-1][~TOUCHED].any()


@pytest.mark.parametrize(
    ("signal", "seconds", "rate", "kpa", "tolerance"),
    [
        (touch(3.0, 63.0, 200), 63.0, 10, 20.0, 0.1),
        (touch(3.0, 63.0, 200), 63.0, 25, 20.0, 0.1),
        (touch(0.4, 2.5, 200), 2.5, 50, 20.0, 0.1),
        (touch(3.0, 30.0, 40, trembling=8), 30.0, 50, 4.0, 1.0),
        (
            lambda t: touch(3.0, 29.0, 40)(t) + MIDDLE * touch(3, 29, 100, 0, 40)(t),
            29.0,
            50,
            4.0,
            0.3,
        ),
    ],
    ids=["minute", "minute", "during the tare", "light trembling", "steady rim"],
)
def test_touch_is_not_learned(signal, seconds, rate, kpa, tolerance):
    _, pressure = push_signal(signal, seconds, rate)
    np.testing.assert_allclose(pressure[-1][RIM], kpa, atol=tolerance)


@pytest.mark.parametrize(
    ("signal", "seconds", "config"),
    [
        (lambda t: rest(t) + round(0.5 * t), 120.0, CalibrationConfig()),
        (touch(3.0, 1e9, 100), 60.0, CalibrationConfig(longest_seconds=20.0)),
    ],
    ids=["drift", "very long change"],
)
@pytest.mark.parametrize("rate", [10, 25])
def test_change_of_the_rest_level_is_learned(signal, seconds, config, rate):
    front_end = FrontEnd(SKIN, LINEAR, config)
    _, pressure = push_signal(signal, seconds, rate, front_end)
    assert pressure[-1].max() < 0.9


@pytest.mark.parametrize(
    ("calibration", "counts", "kpa", "kept", "end", "seconds", "rate"),
    [(LINEAR, 300, 30.0, 50, 5.0, 8.0, rate) for rate in (10, 50, 200)]
    + [
        (LINEAR, 500, 50.0, 40, 20.0, 40.0, 20),
        (DIVIDER, divider_counts(50.0), 50.0, 150, 20.0, 40.0, 20),
    ],
)
def test_residual_after_a_touch_is_learned_but_not_the_touch(
    calibration, counts, kpa, kept, end, seconds, rate
):
    signal = touch(3.0, end, counts, kept)
    front_end = FrontEnd(SKIN, calibration)
    times, pressure = push_signal(signal, seconds, rate, front_end)
    assert pressure[times < end - 1e-6][-1].max() == pytest.approx(kpa, rel=0.01)
    after = pressure[(times > end) & (times < end + 0.2)][:, TOUCHED]
    kept_kpa = calibration.compute_pressure(np.full(SKIN.count, float(kept))).max()
    assert after.min() > 0.8 * kept_kpa
    assert pressure[-1].max() < 0.5


def test_drift_beside_a_touch_is_learned_after_the_touch():
    def signal(t):
        return touch(3.0, 8.0, 200)(t) + 10 * (t > 4.0)

    times, pressure = push_signal(signal, 60.0)
    beside = (DISTANCE < 0.023) & ~TOUCHED
    during = pressure[times < 8.0][-1]
    np.testing.assert_allclose(during[beside], 1.0, atol=0.05)
    assert pressure[-1].max() < 0.1


def test_rest_is_found_after_a_touch_from_the_start():
    front_end = FrontEnd(SKIN, LINEAR)
    times, pressure = push_signal(touch(-1.0, 6.0, 200), 9.0, front_end=front_end)
    assert pressure[times < 6.0].max() == 0.0
    _, pressure = push_signal(touch(9.0, 10.0, 200), 1.0, 50, front_end, start=9.0)
    np.testing.assert_allclose(pressure[-1][TOUCHED], 20.0, atol=0.2)


@pytest.mark.parametrize("zeros", [(0.0, 0.05), (4.0, 4.01)])
def test_zeros_at_the_start_or_once_do_not_move_the_baseline(zeros):
    begin, end = zeros
    times, pressure = push_signal(lambda t: rest(t) * (not begin <= t <= end), 5.0)
    assert pressure[times > max(end, 2.0)].max() == 0.0


def test_corrupt_zeros_in_noise_do_not_lower_the_baseline():
    rng = np.random.default_rng(3)
    front_end = FrontEnd(SKIN, LINEAR)

    def signal(t):
        counts = rest(t) + np.round(4.0 * rng.standard_normal(SKIN.count))
        return np.where(rng.random(SKIN.count) < 1 / 1300, 0, counts)

    push_signal(signal, 40.0, 50, front_end)
    assert np.median(front_end.rest) == pytest.approx(REST, abs=0.5)


def test_patch_silent_for_long_is_tared_again():
    front_end = FrontEnd(SKIN, LINEAR)
    push_signal(rest, 3.0, front_end=front_end)
    none = np.zeros(SKIN.count, bool)
    front_end.make_reading(scan_at(4.0, np.zeros(SKIN.count), received=none))
    assert not front_end.make_reading(
        scan_at(30.0, np.full(SKIN.count, 600))
    ).pressure.any()


def test_readings_do_not_depend_on_the_order_of_taxels():
    rng = np.random.default_rng(2)
    order = rng.permutation(SKIN.count)
    one = FrontEnd(SKIN, LINEAR)
    other = FrontEnd(reorder_taxels(SKIN, order), LINEAR)
    for step in range(200):
        counts = REST + rng.integers(-30, 60, SKIN.count)
        expected = one.make_reading(scan_at(step / 20, counts)).pressure[order]
        got = other.make_reading(scan_at(step / 20, counts[order])).pressure
        np.testing.assert_array_equal(got, expected)


def test_missing_and_faulty_taxels_are_not_valid_and_not_learned_from():
    front_end = FrontEnd(SKIN, LINEAR)
    push_signal(rest, 3.0, front_end=front_end)
    taxel = np.arange(SKIN.count)
    counts = np.where((taxel == 3) | (taxel == 4), -1000, REST)
    for step in range(50):
        scan = scan_at(3.0 + step / 50, counts, received=taxel != 3)
        reading = front_end.make_reading(scan)
    assert np.flatnonzero(~reading.valid).tolist() == [3, 4]
    for step in range(80):
        reading = front_end.make_reading(scan_at(4.0 + step / 50, rest(5.0)))
    assert reading.valid.all() and not reading.pressure.any()


def test_offset_is_learned_beside_a_faulty_taxel_that_was_touched():
    front_end = FrontEnd(SKIN, LINEAR)
    taxel = np.arange(SKIN.count)
    for t in np.arange(10 * 50) / 50:
        counts = rest(t) + 60 * (taxel == 14) * (t >= 5.0) + 60 * (taxel == 15)
        counts -= 60 * (taxel == 15) * (t < 4.5)
        received = (taxel != 15) | (t < 4.8)
        reading = front_end.make_reading(scan_at(t, counts, received))
    assert reading.pressure[14] < 0.5


@pytest.mark.parametrize("gap", [0.4, 0.6, 2.0, 8.0])
def test_hand_is_not_learned_where_data_are_missing_for_a_while(gap):
    front_end = FrontEnd(SKIN, LINEAR)
    signal = touch(5.0, 60.0, 200)
    push_signal(signal, 8.0, front_end=front_end)
    _, pressure = push_signal(signal, 3.0, front_end=front_end, start=8.0 + gap)
    np.testing.assert_allclose(pressure[:, TOUCHED], 20.0, atol=0.1)


def test_shear_is_measured_from_rest_and_not_learned_during_a_touch():
    calibration = Calibration(np.full(SKIN.count, 0.1), 1000, 0.5, 128)
    front_end = FrontEnd(SKIN, calibration)
    signal = touch(10.0, 30.0, 100)
    for t in np.arange(0, 30, 0.05):
        shear = np.full((SKIN.count, 2), 130, np.int32)
        shear[TOUCHED] += np.array((40, -20), np.int32) * (t >= 10.0)
        reading = front_end.make_reading(scan_at(t, signal(t), shear=shear))
    assert reading.shear is not None and reading.shear.dtype == np.float32
    expected = np.tile([20.0, -10.0], (TOUCHED.sum(), 1))
    np.testing.assert_allclose(reading.shear[TOUCHED], expected, atol=0.6)


def test_saturated_divider_reads_finite_increasing_pressure():
    front_end = FrontEnd(SKIN, DIVIDER)
    push_signal(rest, 3.0, front_end=front_end)
    counts = np.linspace(REST - 50, 5000, SKIN.count).astype(int)
    # All counts move at once, which is no touch until the next scan confirms it.
    front_end.make_reading(scan_at(3.0, counts))
    pressure = front_end.make_reading(scan_at(3.02, counts)).pressure
    assert np.isfinite(pressure).all() and (np.diff(pressure) >= 0).all()
    assert pressure[-1] > 1000.0


@pytest.mark.parametrize("calibration", [LINEAR, DIVIDER, CLOSING])
@pytest.mark.parametrize(("factor", "is_learned"), [(0.9, True), (1.1, False)])
def test_margin_is_the_same_pressure_for_every_curve(calibration, factor, is_learned):
    at_margin = calibration.compute_counts(2.0 * ContactConfig().on)
    high = np.round(factor * at_margin).astype(int)
    low = high - np.round(0.4 * at_margin).astype(int)

    def signal(t):
        return REST + np.where(round(t) % 2, high, low) * (t > 3.0)

    front_end = FrontEnd(SKIN, calibration)
    times, pressure = push_signal(signal, 60.0, 10, front_end)
    assert (pressure[times > 58.0].max() < 0.7) == is_learned


CURVES = {
    "linear": {},
    "divider": {"exponent": 0.8, "unfelt": 2.0},
    "logarithmic": {"exponent": 0.7, "unfelt": 2.0, "span": 300.0},
}


@pytest.mark.parametrize("curve", CURVES)
def test_counts_and_pressure_are_inverse_for_every_curve(curve):
    options: dict = CURVES[curve]
    calibration = Calibration(np.full(3, 0.02), 4095, curve=curve, **options)
    pressure = np.array([[0.0, 0.5, 3.0], [5.0, 20.0, 80.0]])
    counts = calibration.compute_counts(pressure)
    assert (counts >= 0).all() and (counts <= 4095).all()
    found = calibration.compute_pressure(counts)
    np.testing.assert_allclose(found, pressure, rtol=1e-6)  # as of float32
    felt = np.maximum(pressure - calibration.unfelt, pressure / 2)
    conductance = (felt / (0.02 * 4095)) ** calibration.exponent
    shares = {
        "linear": conductance,
        "divider": conductance / (1 + conductance),
        "logarithmic": np.log1p(300.0 * conductance) / np.log1p(300.0),
    }
    np.testing.assert_allclose(counts, 4095 * shares[curve])
    again = Calibration.from_bytes(calibration.to_bytes())
    np.testing.assert_equal(vars(again), vars(calibration))


@pytest.mark.parametrize("data", [b"", b"rows: 1", b"{}", b"[]", b'{"version": 1}'])
def test_file_that_is_no_calibration_is_told_with_what_measures_one(data):
    with pytest.raises(RecordingError, match="; measure it with eskin calibrate$"):
        Calibration.from_bytes(data)


@pytest.mark.parametrize(
    "calibration",
    [Calibration(np.array([0.1, 1 / 3]), 4095, 0.25, 128, 3.0), LINEAR, MEASURED]
    + [replace(DIVIDER, matrix=True)],
)
def test_calibration_survives_its_bytes(calibration):
    again = Calibration.from_bytes(calibration.to_bytes())
    np.testing.assert_equal(vars(again), vars(calibration))


def test_older_files_open_and_nominal_ones_are_written_as_before():
    content = json.loads(CLOSING.to_bytes())
    assert not {"source", "noise", "rest", "gain_deviation"} & content.keys()
    for name in ("curve", "exponent", "unfelt", "matrix"):
        del content[name]
    old = Calibration.from_bytes(json.dumps(content).encode())
    assert (old.curve, old.exponent, old.unfelt) == ("linear", 1.0, 0.0)
    assert (old.source, old.noise, old.rest, old.matrix) == ("nominal", None, None, 0)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_scan_takes_the_unsigned_counts_of_a_converter(kind):
    top = np.iinfo(kind).max
    given = np.array([0, 1, top], kind)
    scan = replace(
        scan_at(0.0, np.zeros(3)), counts=given, shear=np.stack([given] * 2, 1)
    )
    assert scan.counts.tolist() == [0, 1, top] and scan.counts.dtype == np.int32
    assert scan.shear is not None and scan.shear.dtype == np.int32


def test_floor_raises_both_thresholds_of_contact():
    config = ContactConfig(on=3.0, off=2.0)
    assert config.with_floor(0.0) == config
    raised = config.with_floor(12.0)
    assert (raised.on, raised.off) == (12.0, 8.0)
