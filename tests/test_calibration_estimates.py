"""Tests of rest, noise and gains as they are estimated from scans and presses."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.calibration import (
    FingertipPress,
    RestEstimate,
    estimate_gains,
    estimate_rest,
)
from eskin.calibration.fingertip import press_taxels
from eskin.calibration.gains import GainPrior
from eskin.calibration.rest import find_resting_hand
from eskin.touch import Calibration
from helpers.touch import build_grid_skin, scan_at

SKIN = build_grid_skin(patches=2)
RATE = 50
ROUNDING = 12**-0.5


def record_rest(make_counts, seconds=5.0, received=None):
    """Record scans whose counts are a function of the time."""
    times = np.arange(round(seconds * RATE)) / RATE
    uses = [None] * len(times) if received is None else received
    return [scan_at(t, make_counts(t), use) for t, use in zip(times, uses, strict=True)]


def gaussian(deviation, drift=0.0, seed=0):
    """Return a function of time: noise about 200.3 counts, with a drift [1/s]."""
    rng = np.random.default_rng(seed)

    def make_counts(t):
        noise = deviation * rng.standard_normal(SKIN.count)
        return np.round(200.3 + drift * (t - 2.5) + noise)

    return make_counts


@pytest.mark.parametrize("deviation", [0.4, 1.0, 3.0, 20.0])
@pytest.mark.parametrize("drift", [0.0, 4.0])
def test_noise_at_rest_is_measured_whatever_the_drift(deviation, drift):
    found = estimate_rest(record_rest(gaussian(deviation, drift)), SKIN)
    np.testing.assert_allclose(found.rest, 200.3, atol=0.1 + 0.3 * deviation)
    expected = np.hypot(deviation, ROUNDING)
    np.testing.assert_allclose(np.median(found.noise), expected, rtol=0.06)


def test_spikes_and_lost_scans_change_neither_rest_nor_noise():
    rng = np.random.default_rng(1)
    clean = gaussian(2.0)
    spiky = record_rest(
        lambda t: clean(t) + 300 * (rng.random(SKIN.count) < 0.03),
        received=rng.random((5 * RATE, SKIN.count)) < 0.9,
    )
    found = estimate_rest(spiky, SKIN)
    np.testing.assert_allclose(found.rest.mean(), 200.3, atol=0.1)
    np.testing.assert_allclose(found.noise.mean(), np.hypot(2.0, ROUNDING), rtol=0.06)


def test_counts_that_never_change_have_the_noise_of_rounding():
    found = estimate_rest(record_rest(lambda t: np.full(SKIN.count, 7)), SKIN)
    assert (found.rest == 7).all()
    np.testing.assert_allclose(found.noise, ROUNDING)


def test_taxels_that_are_not_received_have_the_rest_of_their_patch():
    silent = np.zeros(SKIN.count, bool)
    silent[3] = True
    received = np.tile(~silent, (5 * RATE, 1))
    found = estimate_rest(record_rest(gaussian(1.0), received=received), SKIN)
    np.testing.assert_array_equal(found.measured, ~silent)
    assert abs(found.rest[3] - 200.3) < 0.5


@pytest.mark.parametrize(("scans", "received"), [(19, 1.0), (200, 0.05), (0, 1.0)])
def test_rest_of_which_nothing_is_known_is_refused(scans, received):
    rng = np.random.default_rng(2)
    uses = rng.random((scans, SKIN.count)) < received
    record = record_rest(gaussian(1.0), scans / RATE, uses)
    with pytest.raises(ValueError, match="allowed are 20 or more"):
        estimate_rest(record, SKIN)


@pytest.mark.parametrize(("higher", "noisier"), [(20, 1), (0, 5), (20, 5)])
def test_hand_has_rested_where_taxels_are_both_higher_and_noisier(higher, noisier):
    hand = (SKIN.patch_index == 1) & (SKIN.rows < 3) & (SKIN.columns < 3)
    rest = RestEstimate(
        200.0 + higher * hand, np.where(hand, noisier, 1.0), np.ones(SKIN.count, bool)
    )
    found = find_resting_hand(rest, SKIN, Calibration.uniform(SKIN.count, 1000, 100.0))
    expected = hand if higher and noisier > 1 else np.zeros(SKIN.count, bool)
    np.testing.assert_array_equal(found, expected)


DIVIDER = Calibration(
    np.full(SKIN.count, 20.0 / 4095), 4095, curve="divider", exponent=0.85, unfelt=2.0
)
LINEAR = Calibration.uniform(SKIN.count, 4095, 100.0)
PRIOR = GainPrior()


def draw_truth(calibration, rng):
    """Draw the constants of a skin by the prior: ln gains, exponent, activation."""
    gains = PRIOR.device * rng.standard_normal()
    gains = gains + PRIOR.patch * rng.standard_normal(len(SKIN.patches))
    exponent = calibration.exponent
    unfelt = calibration.unfelt
    if calibration.curve != "linear":
        exponent *= np.exp(PRIOR.exponent * rng.standard_normal())
        unfelt *= np.exp(PRIOR.unfelt * rng.standard_normal())
    return gains, exponent, unfelt


def press(calibration, truth, patch, force, rng):
    """Press the middle of a patch: taxels under their activation show nothing."""
    gains, exponent, unfelt = truth
    members = np.flatnonzero(SKIN.patch_index == patch)
    force_felt = force * np.exp(PRIOR.repeat * rng.standard_normal())
    offset = rng.uniform(-0.005, 0.005, (1, 2))
    size = np.array([90e-6 * force_felt**0.42 * np.exp(0.25 * rng.standard_normal())])
    middle = press_taxels(force_felt, size, offset, 0.01)[0]
    taxels = members.reshape(6, 6)[:5, :5].ravel()
    felt = np.maximum(middle.ravel() - unfelt, 0.0)
    half = calibration.gain[taxels] * calibration.full_scale
    half = half * np.exp(gains[patch] + PRIOR.taxel * rng.standard_normal(len(taxels)))
    conductance = (felt / half) ** exponent
    if calibration.curve == "divider":
        conductance = conductance / (1.0 + conductance)
    above = calibration.full_scale * conductance
    shown = replace(calibration, gain=calibration.gain[taxels]).compute_pressure(above)
    seen = shown >= 0.5
    return FingertipPress(patch, taxels[seen], above[seen], force)


def press_all(calibration, truth, rng, known, loads=(4.0,)):
    """Press each patch five times; forces are those of one person, or known."""
    finger = np.exp(PRIOR.finger * rng.standard_normal())
    usual = PRIOR.force * np.exp(PRIOR.person * rng.standard_normal())
    presses = []
    for patch in range(len(SKIN.patches)):
        for number in range(5):
            force = usual * np.exp(PRIOR.press * rng.standard_normal())
            if known:
                force = loads[number % len(loads)]
            made = replace(
                press(calibration, truth, patch, finger * force, rng), force=force
            )
            presses.append(made if known else replace(made, force=None))
    return tuple(presses)


def test_without_presses_the_estimate_is_the_data_sheet():
    found = estimate_gains(SKIN, DIVIDER, ())
    assert not found.ln_gain.any()
    spread = np.hypot(PRIOR.device, PRIOR.patch)
    np.testing.assert_allclose(found.gain_deviation, spread)
    assert found.exponent == pytest.approx(DIVIDER.exponent)


def test_patch_that_is_not_pressed_follows_the_others_but_is_less_certain():
    rng = np.random.default_rng(2)
    truth = np.array([1.0, 1.0]), 1.0, 0.0
    presses = press_all(LINEAR, truth, rng, known=True)
    found = estimate_gains(SKIN, LINEAR, presses[:5])
    assert 0.3 < found.ln_gain[1] < found.ln_gain[0]
    assert found.gain_deviation[1] > 1.5 * found.gain_deviation[0]


def test_a_known_force_tells_the_gain_better_than_that_of_people():
    rng = np.random.default_rng(3)
    truth = np.array([0.4, -0.4]), 0.85, 2.0
    presses = press_all(DIVIDER, truth, rng, known=True)
    known = estimate_gains(SKIN, DIVIDER, presses)
    usual = estimate_gains(
        SKIN, DIVIDER, tuple(replace(press, force=None) for press in presses)
    )
    assert (known.gain_deviation < 0.8 * usual.gain_deviation).all()
    # How the patches differ is told by any force that is about the same for both.
    assert usual.ln_gain[0] - usual.ln_gain[1] == pytest.approx(0.8, abs=0.5)


def test_several_loads_tell_more_about_the_activation_than_one():
    rng = np.random.default_rng(4)
    truth = np.array([0.0, 0.0]), 0.85, 2.0
    one, three = (
        estimate_gains(SKIN, DIVIDER, press_all(DIVIDER, truth, rng, True, loads))
        for loads in ((10.0,), (0.7, 2.0, 10.0))
    )
    assert three.unfelt_deviation < 0.8 * one.unfelt_deviation
    assert three.unfelt_deviation < PRIOR.unfelt


@pytest.mark.long
@pytest.mark.parametrize("calibration", [LINEAR, DIVIDER], ids=["linear", "divider"])
@pytest.mark.parametrize("known", [False, True], ids=["any force", "known force"])
def test_true_gain_lies_in_the_interval_in_19_of_20_draws(calibration, known):
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        truth = draw_truth(calibration, rng)
        presses = press_all(calibration, truth, rng, known, (1.0, 3.0, 8.0))
        found = estimate_gains(SKIN, calibration, presses)
        inside += list(abs(found.ln_gain - truth[0]) <= 1.96 * found.gain_deviation)
    # 95 % less three deviations of 60 draws, and not all.
    assert 0.87 <= np.mean(inside) < 1.0


def test_calibration_measured_by_presses_keeps_all_else():
    found = estimate_gains(SKIN, DIVIDER, ())
    applied = found.apply(replace(DIVIDER, matrix=True), SKIN)
    assert applied.source == "presses" and applied.matrix
    np.testing.assert_allclose(applied.gain, DIVIDER.gain)
    assert len(applied.gain_deviation) == len(SKIN.patches)
