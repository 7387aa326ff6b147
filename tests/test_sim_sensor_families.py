"""These tests check builds of sensor families: their flaws, calibrations and rates."""

import numpy as np
import pytest

from eskin.sim.sensor import (
    FAMILIES,
    FLAWS,
    Sensor,
    draw_build,
    draw_flawed_build,
    sense,
)
from eskin.sim.sensor.proximity import add_proximity
from eskin.sim.sensor.sensor import draw_reading_times
from helpers.sensors import CONSTANTS, SKIN
from helpers.touch import build_grid_skin

TAXELS = np.array([7, 8, 14, 21, 50])
PRESSURE = np.zeros((500, len(TAXELS)))
PRESSURE[200:350] = 40.0
LARGE_SKIN = build_grid_skin(16, 16, patches=4)
FREE = np.zeros((1000, 0)), np.zeros(0, np.int64)


OFTEN = CONSTANTS.scaled({"flaw.jumps": 20.0})
"""Constants with which jumps are so frequent that short series show some."""


def draw_flawed(flaws, family="divider", seed=1, skin=SKIN):
    rng = np.random.default_rng(seed)
    return draw_flawed_build("b", family, flaws, skin, OFTEN, rng)


def read(build, pressure=PRESSURE, taxels=TAXELS, skin=SKIN, seed=2):
    return sense(pressure, taxels, build, skin, np.random.default_rng(seed))


def read_rest(flaws, steps=1000, family="linear"):
    """Return counts of an untouched large skin."""
    build = draw_flawed(flaws, family, skin=LARGE_SKIN)
    return read(build, np.zeros((steps, 0)), FREE[1], LARGE_SKIN)[0], build


@pytest.mark.parametrize("family", FAMILIES)
def test_intact_build_reads_what_its_data_sheet_says(family):
    build = draw_flawed({}, family)
    counts, received = read(build)
    above = np.median(counts[110:170], axis=0) - np.median(counts[:90], axis=0)
    for calibration in (build.calibration(SKIN), build.exact_calibration(SKIN)):
        pressure = calibration.compute_pressure(above)
        np.testing.assert_allclose(pressure[TAXELS], 40.0, rtol=0.04)
        assert np.delete(pressure, TAXELS).max() < 0.5
    assert received.all()


@pytest.mark.parametrize("family", FAMILIES)
def test_nominal_calibration_knows_nothing_of_the_build(family):
    flaws = dict.fromkeys(("gain", "exponent", "activation", "creep"), "high")
    builds = [draw_flawed(flaws, family, seed) for seed in (1, 2)]
    nominal = {build.calibration(SKIN).to_bytes() for build in builds}
    assert nominal == {draw_flawed({}, family).calibration(SKIN).to_bytes()}
    # Of gain and exponent together, no calibration can hold the most extreme taxels.
    del flaws["exponent"]
    builds = [draw_flawed(flaws, family, seed) for seed in (1, 2)]
    assert len({build.exact_calibration(SKIN).to_bytes() for build in builds}) == 2


@pytest.mark.parametrize("kind", [*FAMILIES, "fresh", "shifted"])
def test_exact_calibration_removes_the_spread_of_gains(kind):
    rng = np.random.default_rng(5)
    build = draw_build("b", kind, SKIN, CONSTANTS, rng)
    gain = build.exact_calibration(SKIN).gain
    assert np.corrcoef(np.log(gain), np.log(build.velostat.gain))[0, 1] < -0.5


CAPACITIVE_FLAWS = ("neighbours", "proximity", "quantisation")


@pytest.mark.parametrize("flaw", FLAWS)
def test_flaw_that_is_named_is_all_that_changes(flaw):
    family = "capacitive" if flaw in CAPACITIVE_FLAWS else "divider"
    intact = draw_flawed({}, family)
    build = draw_flawed({flaw: "high"}, family)
    wave = 30.0 * np.clip(np.sin(np.linspace(0, 20, 500)), 0, 1)
    pressure = np.tile(wave[:, None], SKIN.count)
    taxels = np.arange(SKIN.count)
    before, whole = read(intact, pressure, taxels)
    after, received = read(build, pressure, taxels)
    times = draw_reading_times(build, 100, np.random.default_rng(0))
    changed = (
        after.shape != before.shape
        or (after != before).any()
        or not received.all()
        or np.ptp(np.diff(times)) > 1e-9
    )
    assert changed and whole.all()


@pytest.mark.parametrize("family", FAMILIES)
def test_readings_do_not_depend_on_how_many_are_read_at_a_time(family):
    # With jitter, a patch may be scanned after the latest step that there is yet.
    flaws = dict.fromkeys(FLAWS, "high") | {"rate": "typical"}
    del flaws["jitter"]
    build = draw_flawed(flaws, family)
    expected, received = read(build)
    sensor = Sensor(build, SKIN, np.random.default_rng(2))
    pressure, taxels = add_proximity(PRESSURE, TAXELS, build, SKIN)
    counts = []
    for first in range(0, len(pressure), 2):
        sensor.simulate_steps(pressure[first : first + 2], taxels)
        counts.append(sensor.read(np.array([float(first)]))[0])
    assert (np.array(counts) == expected)[received].all()


def test_some_taxels_are_far_noisier_than_the_median():
    counts, _ = read_rest({"noisy_taxels": "high"})
    deviations = counts.std(axis=0)
    assert 0.07 < np.mean(deviations > 3.0 * np.median(deviations)) < 0.21


def test_touched_taxels_are_noisier_than_at_rest():
    build = draw_flawed({"touched_noise": "high"}, "linear")
    counts, _ = read(build, np.repeat(PRESSURE[[0, 250]], 1000, axis=0))
    rest, touched = (
        np.diff(part[:, TAXELS], axis=0).std() for part in (counts[:500], counts[500:])
    )
    assert touched / rest == pytest.approx(10.0, rel=0.1)


def test_jumps_stay_and_have_both_signs():
    counts, build = read_rest({"jumps": "high"}, steps=2000)
    limit = 0.01 * build.electronics.full_scale
    moved = np.median(counts[-50:], axis=0) - np.median(counts[:50], axis=0)
    assert (moved > limit).any() and (moved < -limit).any()
    assert np.mean(abs(moved) > limit) < 0.5
    assert abs(np.diff(counts, axis=0)).max(axis=0)[abs(moved) > limit].min() > limit


def test_drift_is_slow_and_noise_is_not():
    quiet, slow = (read_rest({flaw: "high"})[0] for flaw in ("noise", "drift"))

    def measure_slowness(counts):
        return counts.std(axis=0).mean() / np.diff(counts, axis=0).std(axis=0).mean()

    assert measure_slowness(quiet) == pytest.approx(np.sqrt(0.5), rel=0.05)
    assert measure_slowness(slow) > 2.0


def test_capacitive_taxels_feel_what_is_near_earlier_later_and_beside():
    build = draw_flawed({"proximity": "high"}, "capacitive")
    pressure = np.zeros((400, len(TAXELS)))
    pressure[150:250, list(TAXELS).index(14)] = 30.0
    apparent, taxels = add_proximity(pressure, TAXELS, build, SKIN)
    middle = apparent[:, taxels == 14][:, 0]
    assert set(TAXELS) < set(taxels)
    np.testing.assert_array_equal(middle[150:250], pressure[150:250].max(axis=1))
    assert (np.diff(middle[100:150]) > 0).all() and (np.diff(middle[251:300]) < 0).all()
    assert middle[250] < 0.3 * build.velostat.half_pressure
    away = np.linalg.norm(SKIN.positions[taxels] - SKIN.positions[14], axis=1)
    beside = apparent[200, np.argsort(away)[1:]]
    assert (np.diff(beside) <= 1e-12).all() and beside[0] > 0
    assert not apparent[:, away > 0.05].any()


def test_released_signal_falls_in_the_stated_time():
    build = draw_flawed({"lag": "high"}, "linear")
    counts, _ = read(build, np.concatenate([PRESSURE[200:350]] * 3 + [PRESSURE[:200]]))
    signal = (counts[:, 14] - np.median(counts[:, 0])) / 2**16
    signal = signal[225:] / signal[220]
    falls = np.flatnonzero(signal < 0.1)[0] - np.flatnonzero(signal < 0.9)[0]
    assert 0.02 * falls == pytest.approx(1.1, abs=0.08)


def test_creep_grows_alike_in_each_doubling_of_time():
    build = draw_flawed({"creep": "typical"}, "linear")
    counts, _ = read(build, np.repeat(PRESSURE[[0, 250]], [50, 3300], axis=0))
    signal = counts[25:, 14] - np.median(counts[:20, 14])
    growth = np.diff(np.log(signal[[50, 100, 200, 400, 800, 1600]]))
    assert 0.01 < growth.min() and growth.max() < 0.03


def test_readings_are_lost_one_by_one_and_repeated():
    build = draw_flawed({"lost": "high", "repeated": "high", "noise": "high"}, "linear")
    counts, received = read(build, np.zeros((20_000, 0)), FREE[1])
    lost = ~received[:, 0]
    assert lost.mean() == pytest.approx(0.08, abs=0.01)
    assert np.mean(lost[1:][lost[:-1]]) < 0.12
    again = (counts[1:, :36] == counts[:-1, :36]).all(axis=1)[received[1:, 0]]
    assert again.mean() == pytest.approx(0.18, abs=0.03)


@pytest.mark.parametrize("level", ["typical", "high"])
def test_jittering_stamps_increase(level):
    build = draw_flawed({"jitter": level, "rate": level})
    times = draw_reading_times(build, 500, np.random.default_rng(1))
    assert (np.diff(times) > 0.0).all() and times[0] >= 0.0
    expected = CONSTANTS.at_level("flaw.jitter", level)
    assert (times - build.electronics.period * np.arange(500)).std() == pytest.approx(
        expected, rel=0.15
    )


@pytest.mark.parametrize("family", FAMILIES)
def test_drawn_builds_differ_in_rate_and_scale(family):
    builds = [
        draw_build("b", family, SKIN, CONSTANTS, np.random.default_rng(seed))
        for seed in range(12)
    ]
    periods = [build.electronics.period for build in builds]
    assert 0.005 <= min(periods) < 0.015 and 0.03 < max(periods) <= 0.1
    assert max(b.nominal_half for b in builds) > 1.5 * min(
        b.nominal_half for b in builds
    )
