"""One taxel under known loads, for the tests of the simulated sensor."""

from dataclasses import fields, replace

import numpy as np

from eskin.sim.constants import load_constants
from eskin.sim.sensor.build import build_nominal_sensor
from eskin.sim.sensor.model import SensorSession, SensorStages
from eskin.sim.sensor.sensor import sense
from helpers.touch import build_grid_skin

CONSTANTS = load_constants()
SKIN = build_grid_skin(6, 6, patches=2)
STEP = 0.01
NONE = SensorStages(**{field.name: False for field in fields(SensorStages)})
ELEMENT = replace(NONE, power=True, creep=True, hysteresis=True, divider=True)


def fine(build, **changes):
    """A build with a converter too fine to matter."""
    return replace(build, electronics=replace(build.electronics, bits=20, **changes))


def element(**changes):
    """A build like the element of the public logs: exponent 0.76, no gap."""
    build = fine(build_nominal_sensor(SKIN, CONSTANTS))
    exponent = np.full(SKIN.count, 0.76)
    return replace(
        build, velostat=replace(build.velostat, exponent=exponent, **changes)
    )


def same_session():
    return SensorSession(np.ones(SKIN.count), 0.0)


def run(series, build, stages=ELEMENT, taxel=14, seed=1, session=None):
    """Counts of one taxel under a series of pressures [kPa] at 100 Hz."""
    pressure = np.asarray(series, float)[:, None]
    rng = np.random.default_rng(seed)
    session = session or same_session()
    counts, _ = sense(pressure, np.array([taxel]), build, SKIN, rng, stages, session)
    return counts[:, taxel]


def conductance(series, build, stages=ELEMENT, **options):
    """Conductance of one taxel every 20 ms, as found from its counts."""
    x = run(series, build, stages, **options) / build.electronics.full_scale
    return x / (1.0 - x)


def step_load(pressure, seconds, before=0.1, after=0.0):
    steps = [round(part / STEP) for part in (before, seconds, after)]
    return np.repeat([0.0, pressure, 0.0], steps)


def ramp(pressure, seconds):
    """Up and down again, each in so many seconds."""
    up = np.linspace(0.0, pressure, round(seconds / STEP) + 1)
    return np.concatenate([up, up[-2::-1], [0.0]])
