"""Tests of one simulated element under the loads of the public velostat logs."""

import numpy as np
import pytest

from eskin.sim.sensor.build import draw_build
from eskin.sim.sensor.model import SensorStages, draw_session
from eskin.sim.sensor.sensor import sense
from helpers.sensors import (
    CONSTANTS,
    NEUTRAL_SESSION,
    SKIN,
    STEP,
    read_conductance,
    step_load,
)
from helpers.touch import build_grid_skin

ONSET = 5
PERIOD = 0.02


def get_index(seconds):
    """Return the index of the reading so many seconds after the onset."""
    return ONSET + round(seconds / PERIOD)


def build_ramp(pressure, seconds):
    """Return a series of pressures [kPa] up and down, each in so many seconds."""
    up = np.linspace(0.0, pressure, round(seconds / STEP) + 1)
    return np.concatenate([up, up[-2::-1], [0.0]])


def test_press_creeps_as_the_logged_ones():
    g = read_conductance(step_load(20.0, 1.5))
    logged = {0.1: -0.303, 0.2: -0.223, 0.4: -0.114, 1.2: 0.051}
    for seconds, expected in logged.items():
        found = np.log(g[get_index(seconds)] / g[get_index(0.8)])
        assert found == pytest.approx(expected, abs=0.01)


def test_hold_creeps_as_the_logged_ones():
    g = read_conductance(step_load(20.0, 62.0))
    # The weight was put on about 1 s before the logged start.
    logged = {0.5: 0.905, 1: 0.925, 2: 0.955, 10: 1.035, 20: 1.085, 40: 1.17, 60: 1.21}
    for seconds, expected in logged.items():
        found = g[get_index(seconds + 1)] / g[get_index(6)]
        assert found == pytest.approx(expected, abs=0.04)


@pytest.mark.parametrize(
    ("seconds", "least", "most"), [(0.5, 0.15, 0.35), (20, 0.07, 0.2)]
)
def test_loop_of_a_ramp_is_as_wide_as_measured(seconds, least, most):
    series = build_ramp(30.0, seconds)
    g = read_conductance(series)
    pressure = series[::2]
    top = len(g) // 2
    up = g[: top + 1]
    down = g[top:][::-1]
    back = np.interp(pressure[: top + 1], pressure[top:][::-1], down)
    assert least < (back - up).max() / g.max() < most


def test_presses_of_two_sessions_repeat_as_the_logged_ones():
    rng = np.random.default_rng(2)
    build = draw_build("b", "fresh", build_grid_skin(20, 20), CONSTANTS, rng)
    one, two = (np.log(draw_session(build, rng).gain) for _ in range(2))
    assert 0.03 < (one - two).std() < 0.08
    assert 0.0 < one.mean() < 0.09


def test_idle_noise_is_that_of_the_logged_elements():
    quiet = np.zeros((400, 0)), np.zeros(0, int)
    noises = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        build = draw_build("b", "fresh", SKIN, CONSTANTS, rng)
        stages = SensorStages(drift=False, faults=False)
        counts, _ = sense(*quiet, build, SKIN, rng, stages, NEUTRAL_SESSION)
        # At half scale, where those elements idled, a count is 4 / full scale of R.
        noises.append(counts.std(axis=0).mean() * 4 / build.electronics.full_scale)
    assert 0.001 < np.mean(noises) < 0.0025
    assert 0.0009 < min(noises) and max(noises) < 0.0035
