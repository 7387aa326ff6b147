"""This package simulates the sensor, from pressure on taxels to counts."""

from eskin.sim.sensor.build import SensorBuild, draw_build, draw_flawed_build
from eskin.sim.sensor.flaws import FAMILIES, FLAWS, Flaws
from eskin.sim.sensor.model import SensorSession, SensorStages, draw_session
from eskin.sim.sensor.sensor import Sensor, sense

__all__ = [
    "FAMILIES",
    "FLAWS",
    "Flaws",
    "Sensor",
    "SensorBuild",
    "SensorSession",
    "SensorStages",
    "draw_build",
    "draw_flawed_build",
    "draw_session",
    "sense",
]
