"""Tests of the simulated arm, its trajectory and its task."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.app import open_arm
from eskin.arms import (
    FRAME_TASK,
    MotionConfig,
    SimulatedArm,
    Trajectory,
)
from eskin.command import Problem, resolve_action
from eskin.drivers import ManualClock
from eskin.robot import Kinematics, load_robot
from eskin.sim.constants import load_constants
from eskin.sim.scene.collision import build_collision_model
from helpers.commands import HELD

SECOND = 1_000_000_000
NAMES = [waypoint.name for waypoint in FRAME_TASK.waypoints]
CONFIG = MotionConfig()
FINE = 0.001
JOINTS = 3

goals = st.lists(st.floats(-2.0, 2.0), min_size=JOINTS, max_size=JOINTS)
motions = st.lists(
    st.one_of(
        st.tuples(st.just("go"), goals),
        st.tuples(st.just("share"), st.floats(0.0, 1.0)),
        st.tuples(st.just("wait"), st.floats(0.0, 1.0)),
    ),
    max_size=10,
)


def make_trajectory(goal):
    trajectory = Trajectory(np.zeros(len(goal)))
    trajectory.go_to(np.array(goal))
    return trajectory


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(motions)
def test_trajectory_keeps_limits_and_integrates_its_velocity(motions):
    trajectory = Trajectory(np.zeros(JOINTS))
    share = 1.0
    q = [trajectory.q]
    velocity = [trajectory.velocity]
    for kind, value in [*motions, ("wait", 0.2)]:
        if kind == "go":
            trajectory.go_to(np.array(value))
        elif kind == "share":
            share = value
        for _ in range(round(value / FINE) if kind == "wait" else 0):
            trajectory.advance(FINE, share)
            q.append(trajectory.q)
            velocity.append(trajectory.velocity)
    q = np.array(q)
    velocity = np.array(velocity)
    assert np.abs(velocity).max() <= CONFIG.speed * (1 + 1e-9)
    limit = CONFIG.max_acceleration * FINE
    assert np.abs(np.diff(velocity, axis=0)).max() <= limit * (1 + 1e-6) + 1e-8
    mean = (velocity[1:] + velocity[:-1]) / 2
    assert np.abs(np.diff(q, axis=0) / FINE - mean).max() <= limit


@settings(max_examples=12, deadline=None)
@given(goals, st.floats(0.0, 1.0), st.floats(0.01, 3.0))
def test_trajectory_is_independent_of_time_steps(goal, share, seconds):
    whole = make_trajectory(goal)
    parts = make_trajectory(goal)
    whole.advance(seconds, share)
    for _ in range(50):
        parts.advance(seconds / 50, share)
    assert np.allclose(whole.q, parts.q, atol=1e-6)


@settings(max_examples=12, deadline=None)
@given(goals, st.floats(0.0, 3.0), st.floats(0.0, 5.0))
def test_stopped_trajectory_continues_from_where_it_stands(goal, before, pause):
    trajectory = make_trajectory(goal)
    trajectory.advance(before, 1.0)
    trajectory.advance(CONFIG.brake_seconds, 0.0)
    stood = trajectory.q
    trajectory.advance(pause, 0.0)
    assert np.array_equal(trajectory.q, stood) and not trajectory.velocity.any()
    trajectory.advance(FINE, 1.0)
    assert np.abs(trajectory.velocity).max() <= CONFIG.speed * FINE / 0.5
    trajectory.advance(10.0, 1.0)
    assert np.allclose(trajectory.q, goal, atol=1e-9)


def test_trajectory_brakes_from_full_speed_in_stated_time():
    trajectory = make_trajectory(np.full(JOINTS, 3.0))
    trajectory.advance(1.5, 1.0)
    assert np.isclose(trajectory.velocity.max(), CONFIG.speed)
    trajectory.advance(CONFIG.brake_seconds - 1e-3, 0.0)
    assert trajectory.velocity.max() > 0
    trajectory.advance(2e-3, 0.0)
    assert not trajectory.velocity.any()


def test_trajectory_moves_at_share_of_speed():
    trajectory = make_trajectory([3.0])
    trajectory.advance(3.5, 0.3)
    assert np.isclose(trajectory.velocity[0], 0.3 * CONFIG.speed)


def test_trajectory_takes_up_new_goal_and_new_start():
    trajectory = make_trajectory([2.0])
    trajectory.advance(1.5, 1.0)
    turned = trajectory.q
    trajectory.go_to(np.array([0.0]))
    trajectory.advance(CONFIG.brake_seconds + 1e-6, 1.0)
    brake = CONFIG.speed * CONFIG.brake_seconds / 2
    assert np.isclose(trajectory.q[0], turned[0] + brake, atol=2e-3)
    trajectory.restart_from(np.array([-0.5]))
    assert trajectory.q == -0.5 and not trajectory.velocity.any()
    trajectory.advance(10.0, 1.0)
    assert trajectory.arrived and np.allclose(trajectory.q, 0.0)


ORDERS = {
    "pause": lambda arm: arm.pause(),
    "resume": lambda arm: arm.resume(),
    "hold": lambda arm: arm.hold(HELD),
    "release": lambda arm: arm.release(),
    "next": lambda arm: arm.next_waypoint(),
    "previous": lambda arm: arm.previous_waypoint(),
    "open": lambda arm: arm.open_gripper(),
    "close": lambda arm: arm.close_gripper(),
    "slow": lambda arm: arm.set_speed(0.3),
}
STARTING = ("resume", "release")


@pytest.fixture
def arm():
    return make_arm()


def make_arm():
    return SimulatedArm(clock=ManualClock())


def pass_time(arm, seconds, step=0.02):
    """Return the states of an arm while time passes."""
    states = []
    for _ in range(round(seconds / step)):
        arm.clock.sleep(step)
        states.append(arm.state())
    return states


def wait_for_target(arm, name, seconds=0.0):
    while arm.state().target != name:
        arm.clock.sleep(0.02)
    arm.clock.sleep(seconds)


def test_arm_cycles_through_waypoints_and_delivers_parts(arm):
    states = pass_time(arm, 40, 0.05)
    targets = [state.target for state in states]
    changes = [b for a, b in zip(targets, targets[1:], strict=False) if a != b]
    start = NAMES.index(changes[0])
    assert changes == [NAMES[(start + i) % len(NAMES)] for i in range(len(changes))]
    assert states[-1].delivered >= 2
    carrying = [state for state in states if state.carrying]
    assert carrying and all(state.gripper == "closed" for state in carrying)


def test_task_keeps_clear_of_robot_and_table_with_tool_down():
    robot = load_robot("ur5")
    constants = load_constants()
    solids = build_collision_model(robot, 0.005)
    waypoints = [np.array(waypoint.q) for waypoint in FRAME_TASK.waypoints]
    lines = [np.linspace(a, b, 50) for a in waypoints for b in waypoints]
    q = np.concatenate(lines)
    T_world_link = Kinematics(robot).poses(q)
    gap, height = solids.compute_clearance(T_world_link, 0.1).T
    assert gap.min() >= constants.value("robot.clearance") / 1000
    assert height.min() >= constants.value("robot.table_clearance") / 1000
    tool = T_world_link[:, -1]
    assert tool[:, 2, 3].min() >= constants.value("robot.tool_height")
    assert tool[:, 2, 2].max() < -0.99
    assert (q >= robot.lower).all() and (q <= robot.upper).all()
    assert robot.joint_names == FRAME_TASK.joint_names
    assert CONFIG.speed <= robot.velocity.min()


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(list(ORDERS)), st.floats(0, 2)), max_size=10))
def test_orders_keep_limits_of_motion(orders):
    arm = make_arm()
    q = [arm.state().q]
    for name, seconds in orders:
        ORDERS[name](arm)
        q += [state.q for state in pass_time(arm, seconds, 0.01)]
    speeds = np.diff(q, axis=0) / 0.01
    assert np.abs(speeds).max(initial=0) <= CONFIG.speed * (1 + 1e-6)
    changes = np.abs(np.diff(speeds, axis=0)) / 0.01
    assert changes.max(initial=0) <= CONFIG.max_acceleration * (1 + 1e-6)


@settings(max_examples=10, deadline=None)
@given(
    st.sampled_from(("pause", "hold")),
    st.lists(st.sampled_from([n for n in ORDERS if n not in STARTING]), max_size=6),
    st.floats(0.0, 10.0),
)
def test_stopped_arm_stands_whatever_else_is_ordered(stop, orders, seconds):
    arm = make_arm()
    arm.clock.sleep(seconds)
    ORDERS[stop](arm)
    arm.clock.sleep(CONFIG.brake_seconds + 0.01)
    stood = arm.state()
    arm.clock.sleep(1.0)
    assert arm.state().target == stood.target
    for name in orders:
        ORDERS[name](arm)
        arm.clock.sleep(0.5)
        assert not arm.state().moving
    assert np.array_equal(arm.state().q, stood.q)


def test_pause_and_hold_must_both_end(arm):
    arm.clock.sleep(1.0)
    arm.pause()
    arm.hold(HELD)
    arm.hold(Problem.ENDED_STREAM.reason())
    arm.clock.sleep(0.5)
    assert arm.state().hold_reason == HELD and arm.state().stopped
    arm.resume()
    assert not any(state.moving for state in pass_time(arm, 1.0))
    arm.release()
    assert any(state.moving for state in pass_time(arm, 1.0))


def test_waypoint_changes_in_mid_move_from_present_position(arm):
    wait_for_target(arm, "over the frame", 1.2)
    between = arm.state()
    assert between.moving
    arm.next_waypoint()
    states = pass_time(arm, 0.5)
    assert states[0].target == "frame"
    assert np.abs(states[-1].q - between.q).max() < 0.3
    arm.previous_waypoint()
    assert arm.state().target == "over the frame"


def test_arm_stands_while_gripper_moves(arm):
    wait_for_target(arm, "rack", 0.4)
    arm.close_gripper()
    arm.clock.sleep(0.3)
    assert arm.state().gripper == "open" and not arm.state().moving
    arm.clock.sleep(0.35)
    assert arm.state().gripper == "closed"
    assert pass_time(arm, 1.0)[-1].moving


def test_toggle_of_gripper_that_moves_undoes_the_move(arm):
    assert resolve_action("toggle_gripper", arm.state()) == "close_gripper"
    arm.close_gripper()
    assert resolve_action("toggle_gripper", arm.state()) == "open_gripper"
    arm.clock.sleep(1.0)
    assert resolve_action("toggle_gripper", arm.state()) == "open_gripper"
    arm.open_gripper()
    assert resolve_action("toggle_gripper", arm.state()) == "close_gripper"


def test_held_arm_moves_no_gripper(arm):
    arm.hold(HELD)
    arm.close_gripper()
    arm.clock.sleep(2.0)
    assert arm.state().gripper == "open"


def test_part_dropped_on_the_way_is_not_delivered(arm):
    while not arm.state().carrying:
        arm.clock.sleep(0.02)
    arm.clock.sleep(0.3)
    arm.open_gripper()
    arm.clock.sleep(0.7)
    assert not arm.state().carrying
    wait_for_target(arm, "up from the frame")
    assert arm.state().delivered == 0


def test_past_positions_are_interpolated(arm):
    arm.clock.sleep(1.0)
    q = arm.q_at(arm.clock.now())
    stamp = arm.clock.now()
    arm.clock.sleep(0.1)
    later = arm.q_at(arm.clock.now())
    assert np.array_equal(arm.q_at(stamp), q)
    assert np.allclose(arm.q_at(stamp + SECOND // 20), (q + later) / 2)


def test_motion_is_independent_of_queries(arm):
    other = make_arm()
    pass_time(arm, 7.0, 0.008)
    other.clock.sleep(7.0)
    assert np.allclose(arm.state().q, other.state().q, atol=1e-2)


def test_arm_opens_by_uri():
    with open_arm("sim:ur5", clock=ManualClock()) as arm:
        assert arm.name == "ur5"
    assert arm.state().hold_reason == Problem.CLOSED.reason()


def test_speed_limit_slows_as_fast_as_a_stop(arm):
    arm.clock.sleep(0.6)
    arm.limit_speed(0.3)
    arm.clock.sleep(CONFIG.brake_seconds)
    arm.state()
    assert arm.executor.trajectory.scale == pytest.approx(0.3)


def test_arm_limited_to_no_speed_begins_nothing():
    arm = SimulatedArm(clock=ManualClock(SECOND))
    arm.limit_speed(0.0)
    arm.clock.sleep(2.0)
    assert arm.state().target == NAMES[0]


def test_speed_limit_of_none_lets_arm_stand_and_gives_commanded_speed_back(arm):
    arm.set_speed(0.8)
    arm.clock.sleep(0.3)
    arm.limit_speed(0.0)
    arm.clock.sleep(CONFIG.brake_seconds)
    state = arm.state()
    assert not state.moving and not state.stopped and state.speed_limit == 0.0
    arm.clock.sleep(5.0)
    np.testing.assert_array_equal(arm.state().q, state.q)
    arm.limit_speed(1.0)
    arm.clock.sleep(0.3)
    assert arm.state().moving and arm.state().speed == 0.8
