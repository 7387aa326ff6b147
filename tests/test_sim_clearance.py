"""Distances between links: capsules first, cylinders where those leave it open."""

from functools import lru_cache

import numpy as np
import pytest

from eskin.robot import Box, Geom, Link, Robot, compute_surface_distance, load_robot
from eskin.sim.constants import MM
from eskin.sim.scene import are_collision_free, compute_joint_limits
from eskin.sim.scene.collision import build_collision_model
from eskin.sim.scene.validity import are_poses_valid
from eskin.transforms import apply, invert
from helpers.worlds import poses, surface_points, world

ROBOT = load_robot("ur5")


@lru_cache(maxsize=1)
def sampled():
    """Points on the surface of each link."""
    return {link.name: surface_points(link) for link in ROBOT.links if link.geoms}


def joined():
    return {frozenset((joint.parent, joint.child)) for joint in ROBOT.joints}


def sampled_gap(T_world_link):
    """Least distance of links that share no joint, by points on the one."""
    least = np.inf
    for a, points in sampled().items():
        for b in sampled():
            if a != b and frozenset((a, b)) not in joined():
                T_a, T_b = (T_world_link[ROBOT.link_index(name)] for name in (a, b))
                there = apply(invert(T_b) @ T_a, points)
                link = ROBOT.links[ROBOT.link_index(b)]
                least = min(least, compute_surface_distance(link, there)[0].min())
    return least


def sampled_height(T_world_link):
    return min(
        apply(T_world_link[ROBOT.link_index(name)], points)[:, 2].min()
        for name, points in sampled().items()
        if name not in ("base_link", "shoulder_link")
    )


def random_poses(count, seed):
    low, high = compute_joint_limits(world())
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


def test_accepted_poses_keep_their_distance_by_points_on_the_surfaces():
    value = world().constants.value
    for T in world().poses(poses(25, seed=1)):
        assert sampled_gap(T) >= value("robot.clearance") * MM
        assert sampled_height(T) >= value("robot.table_clearance") * MM
        assert T[ROBOT.link_index("tool0"), 2, 3] >= value("robot.tool_height")


def test_a_clearance_is_never_too_large_and_seldom_much_too_small():
    T = world().poses(random_poses(60, seed=2))
    told = world().collision.compute_clearance(T, 10.0)[:, 0]
    found = np.maximum([sampled_gap(each) for each in T], 0.0)
    # Points on a surface miss the nearest ones by some tenths of their spacing.
    assert np.all(told <= found + 1e-4)
    assert np.median(found - told) < 1.5e-3


def test_height_above_the_table_is_that_of_the_lowest_point():
    T = world().poses(random_poses(40, seed=3))
    told = world().collision.compute_clearance(T, 0.0)[:, 1]
    found = np.array([sampled_height(each) for each in T])
    assert np.all(told <= found + 1e-9)
    assert np.all(found - told < 2e-3)


def test_what_is_far_need_not_be_measured_but_is_known_to_be_far():
    T = world().poses(random_poses(200, seed=4))
    exact = world().collision.compute_clearance(T, 10.0)[:, 0]
    quick = world().collision.compute_clearance(T, 0.02)[:, 0]
    near = exact < 0.02
    np.testing.assert_allclose(quick[near], exact[near], atol=5e-5)
    assert np.all(quick[~near] >= 0.02 - 1e-9)


def test_turning_the_base_changes_no_clearance():
    q = random_poses(100, seed=5)
    turned = q + np.random.default_rng(0).uniform(-3, 3, (100, 1)) * np.eye(6)[0]
    solids = world().collision
    one, other = (
        solids.compute_clearance(world().poses(each), 0.05) for each in (q, turned)
    )
    np.testing.assert_allclose(one, other, atol=5e-5)
    np.testing.assert_array_equal(
        are_poses_valid(world(), q), are_poses_valid(world(), turned)
    )


def test_a_pose_folded_into_itself_or_the_table_is_refused():
    into_table = np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    upright = np.deg2rad([0.0, -90.0, 0.0, -90.0, 0.0, 0.0])
    np.testing.assert_array_equal(
        are_collision_free(world(), world().poses(np.array([into_table, upright]))),
        [False, True],
    )


def test_room_is_the_distance_to_all_other_links_and_the_table():
    T = world().poses(poses(1, seed=6))[0]
    forearm = ROBOT.link_index("forearm_link")
    points = np.random.default_rng(0).uniform([-1, -1, 0], 1, (200, 3))
    told = world().collision.compute_free_distance(T, points, forearm)
    found = points[:, 2].copy()
    for name in sampled():
        if name != "forearm_link":
            index = ROBOT.link_index(name)
            there = apply(invert(T[index]), points)
            found = np.minimum(
                found, compute_surface_distance(ROBOT.links[index], there)[0]
            )
    np.testing.assert_allclose(told, np.maximum(found, 0.0), atol=1e-9)


def test_a_robot_of_boxes_is_refused_with_the_remedy():
    box = Geom(Box((0.1, 0.1, 0.1)), np.eye(4))
    with pytest.raises(ValueError, match="describe its collision geoms as such"):
        build_collision_model(Robot("crate", (Link("crate", (box,)),), ()))
