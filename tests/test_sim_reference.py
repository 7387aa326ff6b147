import sys
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.simulation.mujoco_contact import (
    MujocoScene,
    agreement,
    feel_in_mujoco,
    instant,
    load,
    poses,
    pressures,
    sheet_about,
)

from eskin.errors import ExtraError
from eskin.sim import load_constants
from eskin.sim.contact.pressure import compute_pressure_field
from helpers.contacts import DOME, FINGERS, FLAT, TIP, TUBE, WIDE_TUBE, field, press

pytest.importorskip("mujoco", reason="the reference needs MuJoCo, extra `sim`")

# Fewer points than in earnest, to be quick.
CONSTANTS = load_constants().scaled({"contact.reference.points": 0.3})
CHARTS = {"flat": FLAT, "tube": TUBE, "wide tube": WIDE_TUBE, "dome": DOME}
each_chart = pytest.mark.parametrize("name", CHARTS)


def scene_of(touch, chart):
    return MujocoScene(touch, chart, sheet_about(touch, chart, CONSTANTS))


def reference(touch, chart):
    return feel_in_mujoco(touch, chart, CONSTANTS)


@each_chart
def test_a_part_is_as_deep_in_the_surface_as_it_was_pushed(name):
    scene = scene_of(press(TIP, 1.0), CHARTS[name])
    depths = scene.depths(0, 0.0015)
    assert depths.max() == pytest.approx(0.0015, rel=0.01)
    assert depths.min() == 0.0
    assert np.all(scene.depths(0, -0.001) == 0.0)


def test_a_part_on_a_flat_carries_what_its_law_says():
    touch = press(TIP, 1.0)
    scene = scene_of(touch, FLAT)
    b, m = touch.tissue.b, touch.tissue.m
    # The law is of a paraboloid, from which an ellipsoid departs as it sinks.
    for depth in (0.0002, 0.0004, 0.0006):
        law = b / m * (np.expm1(m * depth) - m * depth)
        found = load(pressures(touch, scene, depth), scene)
        assert found == pytest.approx(law, rel=0.08)


@each_chart
@pytest.mark.parametrize("body", [TIP, FINGERS], ids=["tip", "fingers"])
def test_the_parts_come_to_carry_the_force(name, body):
    felt = reference(press(body, 6.0, conformity=0.9), CHARTS[name])
    assert felt.force[0] == pytest.approx(6.0, rel=0.01)


def test_a_body_that_conforms_lies_on_the_tube():
    touch = press(FINGERS, 1.0, angle=np.pi / 2, conformity=1.0)
    positions, rotations = poses(touch, TUBE, TUBE.surface)
    outward = positions * [1.0, 1.0, 0.0]
    assert np.linalg.norm(outward, axis=1) == pytest.approx(0.0375)
    assert rotations[:, :, 2] * 0.0375 == pytest.approx(outward)


def test_a_body_that_stays_flat_leaves_the_tube_as_a_tangent_does():
    touch = press(FINGERS, 1.0, angle=np.pi / 2, conformity=0.0)
    positions, rotations = poses(touch, TUBE, TUBE.surface)
    normal = TUBE.surface.wrap(touch.centre).normals[0]
    assert positions @ normal == pytest.approx(0.0375)
    assert np.allclose(rotations[:, :, 2], normal)


@each_chart
def test_poses_are_frames_that_turn_no_part_over(name):
    touch = press(FINGERS, 1.0, angle=0.8, conformity=0.6)
    _, rotations = poses(touch, CHARTS[name], CHARTS[name].surface)
    assert np.linalg.det(rotations) == pytest.approx(1.0)
    assert rotations @ rotations.transpose(0, 2, 1) == pytest.approx(
        np.tile(np.eye(3), (FINGERS.count, 1, 1)), abs=1e-12
    )


@each_chart
@pytest.mark.parametrize("force", [0.5, 2.0])
def test_a_fingertip_agrees_with_the_reference(name, force):
    touch = press(TIP, force)
    found = agreement(
        compute_pressure_field(touch, CHARTS[name], CONSTANTS),
        reference(touch, CHARTS[name]),
    )
    assert found.area == pytest.approx(1.0, abs=0.25)
    assert found.centroid < 0.001
    assert found.correlation > 0.9


@pytest.mark.parametrize("name", ["flat", "tube", "wide tube"])
def test_a_light_hand_has_its_force_where_the_reference_has(name):
    touch = press(FINGERS, 5.0, angle=1.3, conformity=0.9)
    found = agreement(
        compute_pressure_field(touch, CHARTS[name], CONSTANTS),
        reference(touch, CHARTS[name]),
    )
    assert found.centroid < 0.004
    assert found.correlation > 0.8


def test_the_reference_comes_round_the_tube_with_the_press():
    here = press(TIP, 2.0, centre=(0.117, 0.0))
    there = replace(here, centre=here.centre - [TUBE.circumference, 0.0])
    fields = [field(reference(touch, TUBE), TUBE) for touch in (here, there)]
    assert fields[0].max() > 10.0
    assert fields[1] == pytest.approx(fields[0], rel=0.02, abs=0.1)


def test_a_hand_that_goes_all_round_is_not_counted_twice():
    wide = replace(FINGERS, centres=FINGERS.centres * [4.0, 1.0])
    sheet = sheet_about(press(wide, 1.0, angle=0.0), TUBE, CONSTANTS)
    assert np.ptp(sheet.s) < TUBE.circumference


def test_what_agrees_with_itself_agrees_in_all():
    felt = compute_pressure_field(press(FINGERS, 5.0), FLAT, CONSTANTS)
    found = agreement(felt, felt)
    assert (found.area, found.centroid) == (1.0, 0.0)
    assert found.correlation == pytest.approx(1.0)
    assert found.strict == pytest.approx(1.0)


def test_an_instant_is_one_step_of_a_press():
    series = press(TIP, [1.0, 2.0, 3.0])
    assert instant(series, 1).force.tolist() == [2.0]
    assert instant(series, 1).steps == 1


def test_a_body_too_small_for_its_force_is_refused():
    edge = replace(TIP, radii=np.array([[0.0005, 0.001]]))
    with pytest.raises(ValueError, match="sink in altogether before they carry 60"):
        reference(press(edge, 60.0), FLAT)


def test_who_lacks_mujoco_is_told_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraError, match=r"pip install 'eskin\[sim\]'"):
        reference(press(TIP, 1.0), FLAT)
