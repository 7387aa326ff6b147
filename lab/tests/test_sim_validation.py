"""These tests check the validation of the simulator."""

import numpy as np
import pytest

from eskin.sim import load_constants
from lab.simulation.check import as_table, at_most, ordered, within
from lab.simulation.element import element_checks
from lab.simulation.physics import physics_checks
from lab.simulation.rig import COST, measure, rig_checks

CONSTANTS = load_constants()


def list_failures(checks):
    return [check.name for check in checks if not check.met]


def test_check_is_met_between_its_bounds_only():
    met, missed = (within("a", value, 1.0, 2.0, "b", "s") for value in (1.0, 3.0))
    assert met.met and not missed.met
    assert not at_most("a", np.nan, 1.0, "b").met
    assert not ordered("a", {"x": 1.0, "y": 1.0}, "b", "").met
    rows = as_table("t", [missed]).splitlines()
    assert rows[-1] == "| a | 1 to 2 s | 3 s | NO | b |"


@pytest.mark.slow
def test_fingertip_and_element_meet_their_checks():
    failures = list_failures(physics_checks(CONSTANTS, people=4, seed=0))
    assert not [name for name in failures if name.startswith("fingertip")]
    assert list_failures(element_checks(CONSTANTS, seed=0, repeats=3)) == []


@pytest.mark.slow
def test_every_number_of_the_rig_is_checked():
    checks = rig_checks(CONSTANTS, 2, 1, 0.0, 0)
    assert len(checks) == 2 * len(COST) + 7
    assert "nan" not in "".join(each.measured for each in checks)


def test_rig_counts_cells_over_half_of_the_largest_reading():
    images = np.zeros((3, 8, 8))
    images[1, 2:4, 3] = 4.0
    assert measure(images, step=0.01) == (0.01, 2 / 64, 4.0)
