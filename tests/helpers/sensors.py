"""These helpers build simulated sensors and press one taxel of them."""

from dataclasses import fields, replace

import numpy as np

from eskin.sim import load_constants
from eskin.sim.sensor.build import build_nominal_sensor
from eskin.sim.sensor.model import SensorSession, SensorStages
from eskin.sim.sensor.sensor import sense
from helpers.touch import build_grid_skin

CONSTANTS = load_constants()
SKIN = build_grid_skin(6, 6, patches=2)
STEP = 0.01
TAXEL = 14
NO_STAGES = SensorStages(**{field.name: False for field in fields(SensorStages)})
ELEMENT_STAGES = replace(
    NO_STAGES, power=True, creep=True, hysteresis=True, divider=True
)
NEUTRAL_SESSION = SensorSession(np.ones(SKIN.count), 0.0)


def change_build(build, **parts):
    """Return a build with other fields, given as a dict for each part of it."""
    changed = {name: replace(getattr(build, name), **of) for name, of in parts.items()}
    return replace(build, **changed)


def build_element():
    """Build taxels like those of the public logs, read by a very fine converter."""
    return change_build(
        build_nominal_sensor(SKIN, CONSTANTS),
        electronics={"bits": 20},
        velostat={"exponent": np.full(SKIN.count, 0.76)},
    )


def read_counts(series, build, stages=ELEMENT_STAGES, lead=0):
    """Return the counts of one taxel under a series of pressures [kPa] at 100 Hz."""
    rng = np.random.default_rng(1)
    pressure = np.asarray(series, float)[:, None]
    taxels = np.array([TAXEL])
    counts, _ = sense(pressure, taxels, build, SKIN, rng, stages, NEUTRAL_SESSION, lead)
    return counts[:, TAXEL]


def read_conductance(series, stages=ELEMENT_STAGES, lead=0):
    """Return the conductance of an element every 20 ms, as found from its counts."""
    build = build_element()
    x = read_counts(series, build, stages, lead=lead) / build.electronics.full_scale
    return x / (1.0 - x)


def step_load(pressure, seconds, before=0.1, after=0.0):
    """Return a series of one constant pressure between pauses [kPa]."""
    steps = [round(part / STEP) for part in (before, seconds, after)]
    return np.repeat([0.0, pressure, 0.0], steps)
