"""These tests check the validation of the simulator, alone and against MuJoCo."""

import sys
from dataclasses import replace
from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest

from eskin.errors import ExtraError
from eskin.sim import load_constants
from eskin.sim.contact.pressure import compute_pressure_field
from helpers.contacts import CHARTS, FINGERS, FLAT, TIP, TUBE, field, press
from lab.simulation import mujoco_contact
from lab.simulation.bands import (
    BANDS,
    SIZES,
    build_forearm,
    length_checks,
    second_peak,
    size_checks,
    slow_share,
    spectrum_checks,
    stroke_check,
)
from lab.simulation.check import as_table, at_most, ordered, within
from lab.simulation.element import element_checks
from lab.simulation.mujoco_contact import (
    MujocoScene,
    agreement,
    feel_in_mujoco,
    sheet_about,
)
from lab.simulation.physics import physics_checks
from lab.simulation.rig import COST, measure, rig_checks

CONSTANTS = load_constants()
# Fewer points than in earnest, to be quick.
COARSE = CONSTANTS.scaled({"contact.reference.points": 0.3})
NEEDS_MUJOCO = pytest.mark.skipif(
    find_spec("mujoco") is None, reason="the reference needs MuJoCo, extra `sim`"
)
get_forearm = cache(lambda: build_forearm(CONSTANTS))


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
def test_fingertip_element_and_strokes_meet_their_checks():
    failures = list_failures(physics_checks(CONSTANTS, people=4, seed=0))
    assert not [name for name in failures if name.startswith("fingertip")]
    assert list_failures(element_checks(CONSTANTS, seed=0, repeats=3)) == []
    assert list_failures([stroke_check(get_forearm(), people=12, seed=0)]) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("check", "count"),
    [
        (lambda: rig_checks(CONSTANTS, 2, 1, 0.0, 0), 2 * len(COST) + 7),
        (lambda: size_checks(get_forearm(), people=2, seed=0), len(BANDS) * len(SIZES)),
        (lambda: length_checks(get_forearm(), people=2, seed=0), 5),
        (lambda: spectrum_checks(get_forearm(), people=2, seed=0), 4),
    ],
    ids=["rig", "sizes", "lengths", "spectra"],
)
def test_every_number_is_checked(check, count):
    checks = check()
    assert len(checks) == count
    assert "nan" not in "".join(each.measured for each in checks)


def test_rig_counts_cells_over_half_of_the_largest_reading():
    images = np.zeros((3, 8, 8))
    images[1, 2:4, 3] = 4.0
    assert measure(images, step=0.01) == (0.01, 2 / 64, 4.0)


def test_spectra_find_slow_power_and_the_rate_of_pulses():
    times = np.arange(100) / 50
    for rate, share in ((1, 1.0), (5, 0.0)):
        found = slow_share(np.sin(2 * np.pi * rate * times))
        assert found == pytest.approx(share)
    one, other = (np.exp(-(((times - at) / 0.03) ** 2)) for at in (0.5, 0.75))
    assert second_peak(one + other) == pytest.approx(4.0, rel=0.1)


def build_scene(touch, chart):
    return MujocoScene(touch, chart, sheet_about(touch, chart, COARSE))


@NEEDS_MUJOCO
@pytest.mark.parametrize("chart", CHARTS.values(), ids=list(CHARTS))
def test_pad_sinks_as_deep_as_it_is_pushed(chart):
    scene = build_scene(press(TIP, 1.0), chart)
    depths = scene.depths(0, 0.0015)
    assert depths.max() == pytest.approx(0.0015, rel=0.01)
    assert depths.min() == 0.0
    assert np.all(scene.depths(0, -0.001) == 0.0)


@NEEDS_MUJOCO
@pytest.mark.parametrize("depth", [0.0002, 0.0004, 0.0006])
def test_pad_on_a_plane_bears_what_its_law_says(depth):
    touch = press(TIP, 1.0)
    scene = build_scene(touch, FLAT)
    b, m = touch.tissue.b, touch.tissue.m
    # The law is of a paraboloid, from which an ellipsoid departs as it sinks.
    law = b / m * (np.expm1(m * depth) - m * depth)
    pressure = mujoco_contact.pressures(touch, scene, depth)
    assert mujoco_contact.load(pressure, scene) == pytest.approx(law, rel=0.08)


@pytest.mark.parametrize("conformity", [0.0, 1.0])
def test_conforming_hand_lies_on_the_tube_and_a_stiff_one_is_tangent(conformity):
    touch = press(FINGERS, 1.0, angle=np.pi / 2, conformity=conformity)
    positions, rotations = mujoco_contact.poses(touch, TUBE, TUBE.surface)
    normals = np.tile(TUBE.surface.wrap(touch.centre).normals[0], (FINGERS.count, 1))
    if conformity:
        normals = positions * [1.0, 1.0, 0.0] / 0.0375
    assert np.sum(positions * normals, axis=1) == pytest.approx(0.0375)
    assert rotations[:, :, 2] == pytest.approx(normals)


@NEEDS_MUJOCO
@pytest.mark.parametrize("force", [0.5, 2.0])
@pytest.mark.parametrize("chart", CHARTS.values(), ids=list(CHARTS))
def test_fingertip_agrees_with_the_reference(chart, force):
    touch = press(TIP, force)
    reference = feel_in_mujoco(touch, chart, COARSE)
    assert reference.force[0] == pytest.approx(force, rel=0.01)
    found = agreement(compute_pressure_field(touch, chart, COARSE), reference)
    assert found.area == pytest.approx(1.0, abs=0.25)
    assert found.centroid < 0.001
    assert found.correlation > 0.9


@NEEDS_MUJOCO
@pytest.mark.parametrize("name", ["flat", "tube", "wide tube"])
def test_light_hand_has_its_force_where_the_reference_has(name):
    touch = press(FINGERS, 5.0, angle=1.3, conformity=0.9)
    reference = feel_in_mujoco(touch, CHARTS[name], COARSE)
    assert reference.force[0] == pytest.approx(5.0, rel=0.01)
    computed = compute_pressure_field(touch, CHARTS[name], COARSE)
    found = agreement(computed, reference)
    assert found.centroid < 0.004
    assert found.correlation > 0.8
    same = agreement(computed, computed)
    assert (same.area, same.centroid) == (1.0, 0.0)
    assert same.correlation == pytest.approx(1.0) == same.strict


@NEEDS_MUJOCO
def test_reference_does_not_change_with_a_turn_around_the_tube():
    here = press(TIP, 2.0, centre=(0.117, 0.0))
    there = replace(here, centre=here.centre - [TUBE.circumference, 0.0])
    one, other = (
        field(feel_in_mujoco(touch, TUBE, COARSE), TUBE) for touch in (here, there)
    )
    assert one.max() > 10.0
    assert other == pytest.approx(one, rel=0.02, abs=0.1)
    wide = replace(FINGERS, centres=FINGERS.centres * [4.0, 1.0])
    sheet = sheet_about(press(wide, 1.0, angle=0.0), TUBE, COARSE)
    assert np.ptp(sheet.s) < TUBE.circumference


@NEEDS_MUJOCO
def test_pad_too_small_for_its_force_is_refused():
    edge = replace(TIP, radii=np.array([[0.0005, 0.001]]))
    with pytest.raises(ValueError, match="carry 60"):
        feel_in_mujoco(press(edge, 60.0), FLAT, COARSE)


def test_missing_mujoco_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraError, match=r"pip install '.\[sim\]'"):
        feel_in_mujoco(press(TIP, 1.0), FLAT, COARSE)
