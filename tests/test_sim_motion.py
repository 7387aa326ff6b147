"""These tests check motion of the robot, and how hands follow it late."""

from functools import cache

import numpy as np
import pytest

from eskin.sim import Press, SoftTissue
from eskin.sim.scene import are_collision_free
from eskin.sim.scene.motion import (
    build_speed_profile,
    draw_motion,
    draw_pose_path,
    follow_with_delay,
)
from eskin.sim.scene.poses import compute_pose_group
from helpers.contacts import TIP
from helpers.worlds import EVERY, poses, world

STEP = 0.01
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
    centres, angles = np.tile(np.array(centre), (steps, 1)), np.full(steps, angle)
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
    robot, constants = world().mounted.robot, world().constants
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
    """What hangs in the world, with an endless delay, slides as far as the link."""
    # The skin of the ring moves along s alone.
    speed, ring = 0.4, find_ring()
    press = build_press(ring, 100, first)
    moved = follow_with_delay(press, world(), turn_wrist(speed, 200), delay)
    slid = (moved.centre - press.centre)[:, 0]
    until = np.minimum(STEP * np.arange(100), delay)
    expected = world().charts[ring].radius * np.sin(speed * until)
    np.testing.assert_allclose(np.abs(slid), expected, atol=1e-9)
    assert len(np.unique(np.sign(slid[1:]))) == 1
    assert moved.force is press.force and moved.pads is press.pads
