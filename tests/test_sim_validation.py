import numpy as np
import pytest
from benchmarks.simulation.bands import (
    BANDS,
    SIZES,
    forearm_of,
    length_checks,
    second_peak,
    size_checks,
    slow_share,
    spectrum_checks,
    stroke_check,
)
from benchmarks.simulation.check import Check, as_table, at_most, ordered, within
from benchmarks.simulation.element import element_checks
from benchmarks.simulation.physics import physics_checks
from benchmarks.simulation.rig import COST, measure, rig_checks

from eskin.sim.constants import load_constants

CONSTANTS = load_constants()


@pytest.fixture(scope="module")
def forearm():
    return forearm_of(CONSTANTS)


def failed(checks):
    assert checks and all(isinstance(each, Check) for each in checks)
    return [each.name for each in checks if not each.met]


def test_a_number_is_met_between_its_bounds_alone():
    assert within("a", 1.0, 1.0, 2.0, "b").met and not within("a", 2.1, 1, 2, "b").met
    assert not at_most("a", np.nan, 1.0, "b").met
    assert not ordered("a", {"x": 1.0, "y": 1.0}, "b", "").met


def test_a_table_has_a_row_for_each_check_and_says_no_aloud():
    rows = as_table("t", [within("a", 3.0, 1.0, 2.0, "b", "s")]).splitlines()
    assert rows[-1] == "| a | 1 to 2 s | 3 s | NO | b |"


def test_contact_is_as_it_should_be():
    names = failed(physics_checks(CONSTANTS, people=8, seed=0))
    assert not [name for name in names if name.startswith("fingertip")]


def test_one_element_replays_the_logs():
    assert failed(element_checks(CONSTANTS, seed=0, repeats=3)) == []


def test_the_rig_checks_mean_and_spread_of_every_gesture_and_seven_ratios():
    checks = rig_checks(CONSTANTS, people=2, repeats=1, difficulty=0.0, seed=0)
    assert len(checks) == 2 * len(COST) + 7
    failed(checks)


def test_the_rig_counts_cells_over_half_of_the_largest_reading():
    images = np.zeros((3, 8, 8))
    images[1, 2:4, 3] = 4.0
    seconds, area, peak = measure(images, step=0.01)
    assert (seconds, area, peak) == (0.01, 2 / 64, 4.0)


def test_every_gesture_has_its_sizes(forearm):
    checks = size_checks(forearm, people=2, seed=0)
    assert len(checks) == len(BANDS) * len(SIZES)
    failed(checks)


def test_times_and_pulses_are_checked(forearm):
    assert len(length_checks(forearm, people=2, seed=0)) == 5
    assert failed([stroke_check(forearm, people=12, seed=0)]) == []


def test_spectra_are_of_what_the_skin_reads(forearm):
    checks = spectrum_checks(forearm, people=2, seed=0)
    assert len(checks) == 4 and "nan" not in "".join(each.measured for each in checks)


def test_a_slow_series_has_its_power_below_2_hz():
    times = np.arange(100) / 50
    assert slow_share(np.sin(2 * np.pi * times)) == pytest.approx(1.0)
    assert slow_share(np.sin(2 * np.pi * 5 * times)) == pytest.approx(0.0)


def test_two_pulses_peak_at_their_rate():
    times = np.arange(100) / 50
    pulses = [np.exp(-(((times - at) / 0.03) ** 2)) for at in (0.5, 0.75)]
    assert second_peak(pulses[0] + pulses[1]) == pytest.approx(4.0, rel=0.1)
