"""A robot is one tree of links, and the presets have the sizes they were made to."""

import numpy as np
import pytest

from eskin.errors import RobotError
from eskin.robot import (
    ROBOT_PRESETS,
    Box,
    Cylinder,
    Joint,
    Kinematics,
    Link,
    Mimic,
    Robot,
    load_robot,
)

HERE = np.eye(4)
X = np.array([1.0, 0.0, 0.0])


def hinge(name, parent, child, **more):
    return Joint(name, "revolute", parent, child, HERE, X, **more)


def robot_of(links, *joints):
    return Robot("toy", tuple(Link(name) for name in links), joints)


@pytest.mark.parametrize("name", ROBOT_PRESETS)
def test_every_preset_loads_by_its_name(name):
    assert load_robot(name).name == name


def test_the_ur5_has_the_usual_names_and_the_published_limits():
    ur5 = load_robot("ur5")
    assert ur5.link_names == (
        "base_link",
        "shoulder_link",
        "upper_arm_link",
        "forearm_link",
        "wrist_1_link",
        "wrist_2_link",
        "wrist_3_link",
        "tool0",
    )
    assert ur5.joint_names == (
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    )
    np.testing.assert_array_equal(ur5.velocity, [3.15] * 3 + [3.2] * 3)
    np.testing.assert_allclose(ur5.upper, np.pi * np.array([2, 2, 1, 2, 2, 2]))
    np.testing.assert_array_equal(ur5.lower, -ur5.upper)


UR10_DH = [
    (0.1273, 0.0, np.pi / 2),
    (0.0, -0.612, 0.0),
    (0.0, -0.5723, 0.0),
    (0.163941, 0.0, np.pi / 2),
    (0.1157, 0.0, -np.pi / 2),
    (0.0922, 0.0, 0.0),
]
"""d [m], a [m] and alpha [rad] of each joint, as published by the maker."""


def test_the_ur10_moves_its_tool_as_the_published_dimensions_say():
    ur10, rng = load_robot("ur10"), np.random.default_rng(0)
    assert ur10.joint_names == load_robot("ur5").joint_names
    tool = ur10.link_index("tool0")
    for q in rng.uniform(-np.pi, np.pi, (5, 6)):
        # The published frame looks the other way.
        T_base_tool = np.diag([-1.0, -1.0, 1.0, 1.0])
        for angle, (d, a, alpha) in zip(q, UR10_DH, strict=True):
            turn, lean = np.eye(4), np.eye(4)
            turn[:2, :2] = rotation(angle)
            lean[1:3, 1:3] = rotation(alpha)
            turn[2, 3], lean[0, 3] = d, a
            T_base_tool = T_base_tool @ turn @ lean
        got = Kinematics(ur10).poses(q)[tool]
        np.testing.assert_allclose(got[:3, 3], T_base_tool[:3, 3], atol=1e-9)


def rotation(angle):
    """In the plane."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize(
    "link, radius, low, high",
    [
        ("upper_arm_link", 0.0505, 0.09, 0.335),
        ("forearm_link", 0.0375, 0.075, 0.355),
    ],
)
def test_the_ur5_has_tubes_of_the_measured_size_along_z(link, radius, low, high):
    ur5 = load_robot("ur5")
    tubes = [
        (body.T_link_shape[2, 3], body.shape)
        for body in ur5.links[ur5.link_index(link)].geoms
        if isinstance(body.shape, Cylinder) and body.shape.radius == radius
    ]
    ((centre, tube),) = tubes
    np.testing.assert_allclose(
        centre + tube.length * np.array([-0.5, 0.5]), [low, high]
    )


def test_the_table_is_a_box_with_its_top_at_zero():
    ((body,),) = (link.geoms for link in load_robot("table").links)
    assert isinstance(body.shape, Box)
    assert body.shape.size == (1.0, 1.0, 0.05)
    assert body.T_link_shape[2, 3] + 0.05 / 2 == 0


def test_the_values_of_q_are_the_joints_that_move_by_themselves():
    robot = robot_of(
        "abcd",
        Joint("weld", "fixed", "a", "b", HERE, X),
        hinge("lead", "b", "c", lower=-1.0, upper=2.0, velocity=3.0),
        hinge("follow", "b", "d", mimic=Mimic("lead")),
    )
    assert robot.joint_names == ("lead",)
    assert [*robot.lower, *robot.upper, *robot.velocity] == [-1, 2, 3]
    assert [robot.link_index(name) for name in "abcd"] == [0, 1, 2, 3]


def refusal(make):
    with pytest.raises(RobotError) as caught:
        make()
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    "links, joints, message",
    [
        ("", [], "robot 'toy' has no links; at least one is needed"),
        ("aa", [], "robot 'toy' has link 'a' twice; rename one"),
        (
            "abc",
            [("j", "a", "b"), ("j", "b", "c")],
            "robot 'toy' has joint 'j' twice; rename one",
        ),
        (
            "ab",
            [("j", "x", "b")],
            "robot 'toy': joint 'j' has unknown parent link 'x'; allowed: a, b",
        ),
        (
            "ab",
            [("j", "a", "x")],
            "robot 'toy': joint 'j' has unknown child link 'x'; allowed: a, b",
        ),
        (
            "abc",
            [("j", "a", "c"), ("k", "b", "c")],
            "robot 'toy': link 'c' hangs from several joints (j, k); allowed: one",
        ),
        (
            "abc",
            [("j", "a", "c")],
            "robot 'toy' has several roots (a, b); join them with fixed joints "
            "to leave one",
        ),
        (
            "abc",
            [("j", "b", "c"), ("k", "c", "b")],
            "robot 'toy': links b, c hang in a cycle; remove the joint that closes it",
        ),
        (
            "a",
            [("j", "a", "a")],
            "robot 'toy': links a hang in a cycle; remove the joint that closes it",
        ),
    ],
)
def test_what_is_not_one_tree_is_refused(links, joints, message):
    assert refusal(lambda: robot_of(links, *(hinge(*j) for j in joints))) == message


@pytest.mark.parametrize("leader", ["weld", "follow", "nobody"])
def test_a_joint_follows_only_one_with_a_value_of_its_own(leader):
    message = refusal(
        lambda: robot_of(
            "abcd",
            Joint("weld", "fixed", "a", "b", HERE, X),
            hinge("lead", "a", "c"),
            hinge("follow", "a", "d", mimic=Mimic(leader)),
        )
    )
    assert message == (
        f"robot 'toy': joint 'follow' follows '{leader}', which is no moving joint "
        "with a value of its own; allowed: lead"
    )


def test_an_unknown_link_is_answered_with_the_known_ones():
    robot = robot_of("ab", hinge("j", "a", "b"))
    message = refusal(lambda: robot.link_index("hand"))
    assert message == "robot 'toy' has no link 'hand'; allowed: a, b"


def test_an_unknown_robot_is_answered_with_the_known_ones():
    assert refusal(lambda: load_robot("ur6")) == (
        "no robot 'ur6'; allowed: ur5, ur10, base, post, table, tube, "
        "or the path of a .urdf file"
    )
