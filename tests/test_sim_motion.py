"""These tests check motion of the robot, and how hands follow it late."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from eskin.sim import Chart, Press, SoftTissue
from eskin.sim.contact.press import WorldAnchor
from eskin.sim.scene import are_collision_free
from eskin.sim.scene.motion import (
    build_speed_profile,
    drag_past,
    draw_motion,
    draw_pose_path,
    follow_with_delay,
)
from eskin.sim.scene.poses import compute_pose_group
from eskin.skin import Dome, Plane, Surface, Tube
from eskin.transforms import apply, make_transform, rotate, rpy_to_matrix
from helpers.contacts import TIP
from helpers.worlds import EVERY, poses, world

STEP = 0.01
T_LINK_SURFACE = make_transform(rpy_to_matrix(np.array([0.4, -1.0, 2.0])), np.ones(3))
SURFACES = (
    Plane(T_LINK_SURFACE),
    Tube(0.05, T_LINK_SURFACE),
    Dome(0.05, T_LINK_SURFACE),
)
SITE = np.array([[0.0, 0.0]])
TISSUE = SoftTissue(190.0, 2100.0, 1.0, 0.4, 0.7)


def find_ring():
    """Return the chart on the last link, whose joint turns about its axis."""
    links = [chart.link for chart in world().charts]
    return links.index("wrist_3_link")


@cache
def draw_motions(count, seed=0):
    """Draw poses, each with two seconds of motion through it."""
    rng = np.random.default_rng(seed)
    return [(q, draw_motion(world(), q, 2.0, rng)) for q in poses(count, seed)]


def build_press(chart, steps, first=0, centre=(0.0, 0.0), angle=0.2):
    centres = np.tile(np.array(centre), (steps, 1))
    angles = np.full(steps, angle)
    return Press(chart, first, np.ones(steps), centres, angles, TIP, TISSUE)


def turn_wrist(speed, steps):
    """Return a series in which the last joint alone turns evenly."""
    series = np.tile(poses(1)[0], (steps, 1))
    series[:, 5] += speed * STEP * np.arange(steps)
    return series


def compute_clearances(series):
    return world().collision.compute_clearance(world().poses(series), 0.02)


def compute_skin_speeds(series):
    positions, _ = world().mounted.place_taxels(series)
    return np.linalg.norm(np.diff(positions, axis=0), axis=2) / STEP


def test_motion_takes_its_pose_in_the_middle_within_all_limits():
    robot = world().mounted.robot
    constants = world().constants
    spread = constants.get_constant("motion.speed").spread
    assert spread is not None
    for q, series in draw_motions(20):
        assert series.shape == (200, 6)
        np.testing.assert_allclose(series[100], q, atol=1e-12)
        speed = np.diff(series, axis=0) / STEP
        assert 0.02 < np.abs(speed).max() <= spread.high + 1e-9
        assert np.abs(np.diff(speed, axis=0)).max() / STEP <= 2.0 + 1e-6
        assert np.all(series >= robot.lower) and np.all(series <= robot.upper)
        assert np.all(np.abs(speed) <= robot.velocity)
        assert compute_clearances(series).min() > 1e-3
        fastest = 1.1 * constants.value("motion.fastest")
        assert compute_skin_speeds(series[90:111]).max() <= fastest


@pytest.mark.parametrize(("length", "speed"), [(2.0, 0.5), (0.05, 0.8)])
def test_move_starts_and_ends_at_rest_and_covers_its_length(length, speed):
    move = build_speed_profile(length, speed, 1.0)
    time = np.linspace(-0.1, move.duration + 0.1, 20001)
    travelled = move.at(time)
    rate = np.gradient(travelled, time)
    assert travelled[0] == 0 and travelled[-1] == pytest.approx(length)
    assert rate.min() >= -1e-9 and rate.max() <= speed + 1e-6
    assert np.abs(np.gradient(rate, time)).max() <= 1.0 + 1e-3


@pytest.mark.parametrize("groups", [EVERY, frozenset({9, 10, 11, 12})])
def test_path_pauses_between_moves_in_valid_poses_of_its_groups(groups):
    series = draw_pose_path(world(), 60.0, np.random.default_rng(5), groups)
    assert series.shape == (6000, 6)
    change = np.abs(np.diff(series, axis=0)).max(axis=1)
    assert change.max() <= 0.8 * STEP + 1e-9
    moving = change > 1e-9
    assert 0.1 < moving.mean() < 0.98
    assert compute_clearances(series[::3]).min() > 1e-3
    paused = series[:-1][~moving][::20]
    assert are_collision_free(world(), world().poses(paused)).all()
    assert {compute_pose_group(world(), q) for q in paused} <= groups


@pytest.mark.parametrize(("first", "delay"), [(50, 0.2), (-60, 0.2), (0, np.inf)])
def test_hand_lags_by_the_displacement_of_an_even_motion(first, delay):
    """A hand with an endless delay slides as far as the link."""
    # The skin of the ring moves along s alone.
    speed = 0.4
    ring = find_ring()
    press = build_press(ring, 100, first)
    moved = follow_with_delay(press, world(), turn_wrist(speed, 200), delay)
    slid = (moved.centre - press.centre)[:, 0]
    until = np.minimum(STEP * np.arange(100), delay)
    expected = world().charts[ring].radius * np.sin(speed * until)
    np.testing.assert_allclose(np.abs(slid), expected, atol=1e-9)
    assert len(np.unique(np.sign(slid[1:]))) == 1
    assert moved.force is press.force and moved.pads is press.pads


def build_chart(surface: Surface) -> Chart:
    """Return a chart without taxels, whose surface goes on without end."""
    nothing = np.zeros((0, 2))
    taxels = np.zeros(0, np.int64)
    return Chart("link", surface, taxels, nothing, np.zeros((0, 2, 2)))


def translate(offsets):
    """Return T_world_link of a link that is only translated, by offsets [m]."""
    T = np.tile(np.eye(4), (len(offsets), 1, 1))
    T[:, :3, 3] = offsets
    return T


def find_axes(surface):
    """Return the point of the surface at the site, and s, t and the normal there."""
    found = surface.wrap(SITE)
    normal = found.normals[0]
    s_axis = found.tangents[0]
    return found.positions[0], s_axis, np.cross(normal, s_axis), normal


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("axis", [0, 1])
def test_contact_with_what_stands_travels_against_the_motion_of_the_link(surface, axis):
    p_world, *axes, _ = find_axes(surface)
    way = 0.002 * np.arange(8)
    path, height, _ = drag_past(
        build_chart(surface), p_world, translate(way[:, None] * axes[axis])
    )
    np.testing.assert_allclose(path[:, 1 - axis], 0.0, atol=1e-12)
    if isinstance(surface, Dome) or (isinstance(surface, Tube) and axis == 0):
        arc = surface.radius * np.arctan(way / surface.radius)
        above = np.hypot(surface.radius, way) - surface.radius
    else:
        arc = way
        above = np.zeros(len(way))
    np.testing.assert_allclose(path[:, axis], -arc, atol=1e-12)
    np.testing.assert_allclose(height, above, atol=1e-12)


@pytest.mark.parametrize("surface", SURFACES)
def test_height_of_what_stands_is_the_way_along_the_normal(surface):
    p_world, _, _, normal = find_axes(surface)
    way = np.linspace(-0.01, 0.01, 5)
    moved = translate(-way[:, None] * normal)
    path, height, _ = drag_past(build_chart(surface), p_world, moved)
    np.testing.assert_allclose(height, way, atol=1e-12)
    np.testing.assert_allclose(path, 0.0, atol=1e-12)


def test_tube_that_rolls_keeps_contact_with_what_stands():
    surface = Tube(0.05, np.eye(4))
    turns = np.linspace(0.0, 1.0, 5)
    T = np.stack(
        [make_transform(rpy_to_matrix(np.array([0, 0, a])), np.zeros(3)) for a in turns]
    )
    path, height, _ = drag_past(build_chart(surface), np.array([0.05, 0.0, 0.0]), T)
    np.testing.assert_allclose(path[:, 0], -0.05 * turns, atol=1e-12)
    np.testing.assert_allclose(height, 0.0, atol=1e-12)


def build_standing_press(chart, steps, **changes):
    """Return the press of a body that stands, evenly at 1 N while the robot does."""
    anchor = WorldAnchor((0.0, 0.0), (-0.2, 0.2), 0.01, 3.0, 0.0, 0.3, 0.02)
    return replace(build_press(chart, steps), anchor=replace(anchor, **changes))


def find_forearm():
    """Return the first chart on the forearm."""
    return [chart.link for chart in world().charts].index("forearm_link")


def test_press_of_what_stands_is_unchanged_on_an_arm_that_stands():
    still = np.tile(poses(1)[0], (50, 1))
    press = build_standing_press(find_forearm(), 50)
    assert follow_with_delay(press, world(), still, 0.2) is press


def test_body_that_stands_stays_in_the_world_until_contact_ends():
    chart = find_forearm()
    surface = world().charts[chart].surface
    ended = 0
    pushed = 0
    for _, series in draw_motions(20):
        press = build_standing_press(chart, len(series), give=0.01, most=2.0)
        moved = follow_with_delay(press, world(), series, 0.2)
        T = world().poses(series)[:, world().links[chart]]
        found = surface.wrap(moved.centre)
        normal = rotate(T, found.normals)
        away = apply(T[0], found.positions[0]) - apply(T, found.positions)
        gap = np.sum(away * normal, axis=1)
        assert moved.force.min() >= 0.0
        assert moved.force.max() <= 2.0 * 1.3 + 1e-9
        if gap.min() < -0.01:
            pushed += 1
            continue
        # The body is straight above the place of the surface that it touches.
        np.testing.assert_allclose(away, gap[:, None] * normal, atol=1e-9)
        assert not moved.force[gap > 0.01].any()
        ended += moved.force[-1] == 0.0
    assert ended > 3 and pushed > 3


@pytest.mark.parametrize("surface", SURFACES)
def test_surface_pushes_a_body_ahead_from_its_greatest_depth_on(surface):
    p_world, s_axis, _, normal = find_axes(surface)
    way = 0.004 * np.arange(10)
    there_and_back = np.concatenate([way, way[::-1]])
    moved = translate(there_and_back[:, None] * normal)
    path, height, p_end = drag_past(build_chart(surface), p_world, moved, 0.0, 0.01)
    np.testing.assert_allclose(path, 0.0, atol=1e-12)
    np.testing.assert_allclose(height[:10], -np.minimum(way, 0.01), atol=1e-12)
    np.testing.assert_allclose(p_end, p_world + (way[-1] - 0.01) * normal, atol=1e-12)
    np.testing.assert_allclose(height[-1], way[-1] - 0.01, atol=1e-12)


@pytest.mark.parametrize("dragged", [0.0, 0.4, 1.0])
def test_body_that_is_dragged_follows_its_share_of_the_way(dragged):
    p_world, _, t_axis, _ = find_axes(SURFACES[1])
    moved = translate(0.002 * np.arange(8)[:, None] * t_axis)
    path, _, p_end = drag_past(build_chart(SURFACES[1]), p_world, moved, dragged)
    way = 0.002 * 7
    np.testing.assert_allclose(p_end, p_world + dragged * way * t_axis, atol=1e-12)
    steps = np.diff(path[:, 1])
    np.testing.assert_allclose(steps[1:], (dragged - 1.0) * 0.002, atol=1e-12)


def test_force_is_zero_where_the_run_ends():
    chart = find_forearm()
    series = draw_motions(1)[0][1]
    free, short = (
        follow_with_delay(
            build_standing_press(chart, 200, run=run), world(), series, 0.0
        )
        for run in ((-0.2, 0.2), (-0.001, 0.001))
    )
    off = np.abs(free.centre[:, 1]) > 0.001
    assert off.any() and not short.force[off].any()
    np.testing.assert_array_equal(short.force[~off], free.force[~off])
