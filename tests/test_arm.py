"""An arm at its task: where it goes, and what stops it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.app import open_arm
from eskin.command import (
    FRAME_TASK,
    MotionConfig,
    SimulatedArm,
    Task,
    TaskExecutor,
    Waypoint,
)
from eskin.drivers import ManualClock
from eskin.errors import ArmError
from eskin.robot import Kinematics, load_robot
from eskin.sim.constants import load_constants
from eskin.sim.scene.collision import build_collision_model

SECOND = 1_000_000_000
NAMES = [waypoint.name for waypoint in FRAME_TASK.waypoints]
CONFIG = MotionConfig()
ORDERS = (
    "pause",
    "resume",
    "hold",
    "release",
    "next_waypoint",
    "previous_waypoint",
    "open_gripper",
    "close_gripper",
    "slow",
)


def order(arm, name):
    if name == "hold":
        arm.hold("test")
    elif name == "slow":
        arm.set_speed(0.3)
    else:
        getattr(arm, name)()


def arm_and_clock():
    clock = ManualClock()
    return SimulatedArm(clock=clock), clock


def passed(arm, clock, seconds, step=0.02):
    """States while time passes."""
    states = []
    for _ in range(round(seconds / step)):
        clock.sleep(step)
        states.append(arm.state())
    return states


def test_it_goes_to_and_fro_and_brings_parts_until_told_otherwise():
    arm, clock = arm_and_clock()
    states = passed(arm, clock, 60)
    targets = [state.target for state in states]
    changes = [b for a, b in zip(targets, targets[1:], strict=False) if a != b]
    start = NAMES.index(changes[0])
    assert changes == [NAMES[(start + i) % len(NAMES)] for i in range(len(changes))]
    assert states[-1].delivered >= 3
    at_frame = [state for state in states if state.carrying]
    assert at_frame and all(state.gripper == "closed" for state in at_frame)


def test_every_pose_on_the_way_is_free_and_the_tool_points_down():
    robot = load_robot("ur5")
    kinematics, solids, constants = (
        Kinematics(robot),
        build_collision_model(robot),
        load_constants(),
    )
    ways = [np.array(waypoint.q) for waypoint in FRAME_TASK.waypoints]
    lines = [np.linspace(a, b, 100) for a in ways for b in ways]
    q = np.concatenate(lines)
    T_world_link = kinematics.poses(q)
    gap, height = solids.compute_clearance(T_world_link, 0.1).T
    assert gap.min() >= constants.value("robot.clearance") / 1000
    assert height.min() >= constants.value("robot.table_clearance") / 1000
    tool = T_world_link[:, -1]
    assert tool[:, 2, 3].min() >= constants.value("robot.tool_height")
    assert tool[:, 2, 2].max() < -0.99
    assert (q >= robot.lower).all() and (q <= robot.upper).all()
    assert robot.joint_names == FRAME_TASK.joint_names


def test_the_motion_is_within_what_the_robot_can_do():
    assert CONFIG.speed <= load_robot("ur5").velocity.min()
    with pytest.raises(ValueError, match="speed is 0.0; allowed is above 0"):
        SimulatedArm().set_speed(0.0)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(ORDERS), st.floats(0.0, 2.0)), max_size=12))
def test_no_order_breaks_the_limits_or_makes_the_arm_jump(orders):
    arm, clock = arm_and_clock()
    q = [arm.state().q]
    for name, seconds in orders:
        order(arm, name)
        q += [state.q for state in passed(arm, clock, seconds, 0.01)]
    speeds = np.diff(q, axis=0) / 0.01
    assert np.abs(speeds).max(initial=0) <= CONFIG.speed * (1 + 1e-6)
    changes = np.abs(np.diff(speeds, axis=0)) / 0.01
    assert changes.max(initial=0) <= CONFIG.max_acceleration * (1 + 1e-6)


@settings(max_examples=15, deadline=None)
@given(
    st.sampled_from(("pause", "hold")),
    st.lists(
        st.sampled_from([n for n in ORDERS if n not in ("resume", "release")]),
        max_size=6,
    ),
    st.floats(0.0, 10.0),
)
def test_what_is_stopped_stands_whatever_else_is_asked(stop, orders, seconds):
    arm, clock = arm_and_clock()
    clock.sleep(seconds)
    order(arm, stop)
    clock.sleep(CONFIG.brake_seconds + 0.01)
    stood = arm.state().q
    for name in orders:
        order(arm, name)
        clock.sleep(0.5)
        assert not arm.state().moving
    assert np.array_equal(arm.state().q, stood)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.0, 10.0), st.floats(0.0, 5.0))
def test_a_pause_never_moves_the_goal(seconds, pause):
    arm, clock = arm_and_clock()
    clock.sleep(seconds)
    arm.pause()
    clock.sleep(1.0)
    before = arm.state()
    clock.sleep(pause)
    after = arm.state()
    assert (after.target, after.delivered) == (before.target, before.delivered)
    assert np.array_equal(after.q, before.q)
    goal = FRAME_TASK.waypoints[NAMES.index(after.target)].q
    assert np.array_equal(arm.executor.trajectory.goal, goal)


def test_pause_and_hold_must_both_be_over():
    arm, clock = arm_and_clock()
    clock.sleep(1.0)
    arm.pause()
    arm.hold("first")
    arm.hold("second")
    clock.sleep(0.5)
    assert arm.state().hold_reason == "first" and arm.state().stopped
    arm.resume()
    assert not any(state.moving for state in passed(arm, clock, 1.0))
    arm.release()
    assert any(state.moving for state in passed(arm, clock, 1.0))


def test_the_next_waypoint_in_mid_move_is_gone_to_from_where_it_is():
    arm, clock = arm_and_clock()
    while arm.state().target != "over the frame":
        clock.sleep(0.02)
    clock.sleep(1.2)
    between = arm.state()
    assert between.moving
    arm.next_waypoint()
    states = passed(arm, clock, 0.5)
    assert states[0].target == "frame"
    assert np.abs(states[-1].q - between.q).max() < 0.3
    arm.previous_waypoint()
    assert arm.state().target == "over the frame"


def test_a_gripper_takes_time_and_the_arm_stands_meanwhile():
    arm, clock = arm_and_clock()
    while arm.state().target != "rack":
        clock.sleep(0.02)
    clock.sleep(0.4)
    arm.close_gripper()
    clock.sleep(0.3)
    assert arm.state().gripper == "open" and not arm.state().moving
    clock.sleep(0.35)
    assert arm.state().gripper == "closed"
    assert passed(arm, clock, 1.0)[-1].moving


def test_a_part_let_go_on_the_way_is_not_delivered():
    arm, clock = arm_and_clock()
    while not arm.state().carrying:
        clock.sleep(0.02)
    clock.sleep(0.3)
    arm.open_gripper()
    clock.sleep(0.7)
    assert not arm.state().carrying
    while arm.state().target != "back off":
        clock.sleep(0.02)
    assert arm.state().delivered == 0


def test_a_held_arm_grips_nothing():
    arm, clock = arm_and_clock()
    arm.hold("test")
    arm.close_gripper()
    clock.sleep(2.0)
    assert arm.state().gripper == "open"


def test_positions_are_told_for_times_gone_by():
    arm, clock = arm_and_clock()
    clock.sleep(1.0)
    q, stamp = arm.q_at(clock.now()), clock.now()
    clock.sleep(0.1)
    later = arm.q_at(clock.now())
    middle = arm.q_at(stamp + SECOND // 20)
    assert np.array_equal(arm.q_at(stamp), q)
    assert np.allclose(middle, (q + later) / 2)


def test_what_it_does_depends_on_no_one_looking():
    (arm, clock), (other, others) = arm_and_clock(), arm_and_clock()
    passed(arm, clock, 7.0, 0.008)
    others.sleep(7.0)
    assert np.allclose(arm.state().q, other.state().q, atol=1e-2)


def test_arms_are_opened_by_their_uri():
    with open_arm("sim:ur5", clock=ManualClock()) as arm:
        assert arm.name == "ur5"
    assert arm.state().hold_reason == "closed"
    for uri in ("sim:ur10", "ur:host", "ur://", "ur://a/b", "udp://a:1", "ur5"):
        with pytest.raises(ArmError, match="allowed is sim:ur5 or ur://HOST"):
            open_arm(uri)


def test_a_task_that_cannot_be_gone_through_is_refused():
    one, two = Waypoint("a", (0.0,)), Waypoint("b", (0.0, 1.0))
    with pytest.raises(ValueError, match="waypoints a, a; allowed are two or more"):
        Task("t", "r", ("j",), (one, one))
    with pytest.raises(ValueError, match="'b' has 2 positions; allowed are 1"):
        Task("t", "r", ("j",), (one, two))


def test_a_robot_that_allows_no_speed_stops_the_clock():
    executor = TaskExecutor(FRAME_TASK)
    executor.advance(6.0)
    executor.advance(CONFIG.brake_seconds, 0.0)
    clock = executor.trajectory.time
    executor.advance(5.0, 0.0)
    assert executor.trajectory.time == clock and executor.trajectory.still
