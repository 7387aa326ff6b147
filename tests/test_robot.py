"""Tests of robots: each is one tree of links, and presets have the published sizes."""

import numpy as np
import pytest

from eskin.robot import (
    ROBOT_PRESETS,
    Box,
    Kinematics,
    Mimic,
    load_robot,
)
from eskin.transforms import exp_so3, make_transform
from helpers.robots import build_joint, build_robot

X, _, Z = np.eye(3)
UR10_DH = [
    (0.1273, 0.0, np.pi / 2),
    (0.0, -0.612, 0.0),
    (0.0, -0.5723, 0.0),
    (0.163941, 0.0, np.pi / 2),
    (0.1157, 0.0, -np.pi / 2),
    (0.0922, 0.0, 0.0),
]
"""d [m], a [m] and alpha [rad] of each joint, as published by the maker."""


@pytest.mark.parametrize("name", ROBOT_PRESETS)
def test_preset_is_loaded_by_its_name(name):
    assert load_robot(name).name == name


def test_ur5_has_the_usual_names_and_the_published_limits():
    ur5 = load_robot("ur5")
    links = "base shoulder upper_arm forearm wrist_1 wrist_2 wrist_3".split()
    assert ur5.link_names == (*(f"{name}_link" for name in links), "tool0")
    joints = "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3".split()
    assert ur5.joint_names == tuple(f"{name}_joint" for name in joints)
    assert load_robot("ur10").joint_names == ur5.joint_names
    np.testing.assert_array_equal(ur5.velocity, [3.15] * 3 + [3.2] * 3)
    np.testing.assert_allclose(ur5.upper, np.pi * np.array([2, 2, 1, 2, 2, 2]))
    np.testing.assert_array_equal(ur5.lower, -ur5.upper)


def test_ur10_moves_its_tool_by_the_published_dimensions():
    ur10 = load_robot("ur10")
    rng = np.random.default_rng(0)
    tool = ur10.link_index("tool0")
    for q in rng.uniform(-np.pi, np.pi, (5, 6)):
        # The published frame looks the other way.
        T_base_tool = np.diag([-1.0, -1.0, 1.0, 1.0])
        for angle, (d, a, alpha) in zip(q, UR10_DH, strict=True):
            turn = make_transform(exp_so3(angle * Z), d * Z)
            T_base_tool = T_base_tool @ turn @ make_transform(exp_so3(alpha * X), a * X)
        got = Kinematics(ur10).poses(q)[tool]
        np.testing.assert_allclose(got[:3, 3], T_base_tool[:3, 3], atol=1e-9)


def test_top_of_the_table_is_at_zero():
    ((geom,),) = (link.geoms for link in load_robot("table").links)
    assert geom.shape == Box((1.0, 1.0, 0.05))
    assert geom.T_link_shape[2, 3] + 0.05 / 2 == 0


def test_q_consists_of_the_joints_that_move_by_themselves():
    robot = build_robot(
        "abcd",
        build_joint("weld", "a", "b", "fixed"),
        build_joint("lead", "b", "c", lower=-1.0, upper=2.0, velocity=3.0),
        build_joint("follow", "b", "d", mimic=Mimic("lead")),
    )
    assert robot.joint_names == ("lead",)
    assert [*robot.lower, *robot.upper, *robot.velocity] == [-1, 2, 3]
    assert [robot.link_index(name) for name in "abcd"] == [0, 1, 2, 3]
