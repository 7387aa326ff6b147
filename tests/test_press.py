"""A press on purpose is found, with the taxel that felt most of it."""

import numpy as np

from eskin.touch import PressDetector, TouchPipeline
from helpers.touch import calibration_of, mounted_grid, pressed, reading_at

MOUNTED = mounted_grid(rows=8, columns=8)
SPOT = 3 * 8 + 5


def found_in(pressure_at, seconds=3.0, rate=50):
    """The taxels of all presses found."""
    pipeline = TouchPipeline(MOUNTED, calibration_of(MOUNTED.skin))
    finder = PressDetector()
    times = np.arange(round(seconds * rate)) / rate
    states = (pipeline.push_reading(reading_at(t, pressure_at(t))) for t in times)
    return [taxel for taxel in map(finder.push, states) if taxel is not None]


def press_of(kpa, begin, end):
    def pressure_at(t):
        if not begin <= t < end:
            return np.zeros(MOUNTED.skin.count)
        load = pressed(MOUNTED.skin, MOUNTED.skin.positions[SPOT, :2], kpa)
        load[SPOT] *= 1.5
        return load

    return pressure_at


def test_a_press_is_told_once_when_it_ends_by_its_hardest_taxel():
    assert found_in(press_of(30.0, 1.0, 1.5)) == [SPOT]


def test_two_presses_are_two():
    one, two = press_of(30.0, 0.5, 1.0), press_of(30.0, 1.5, 2.0)
    assert found_in(lambda t: one(t) + two(t)) == [SPOT, SPOT]


def test_what_is_light_or_short_is_no_press():
    assert found_in(press_of(0.8, 1.0, 2.0)) == []
    assert found_in(press_of(30.0, 1.0, 1.1)) == []
