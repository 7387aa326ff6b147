"""Laws of motion: limits, continuity, and a clock that never runs ahead."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.command import MotionConfig, Trajectory

CONFIG = MotionConfig()
FINE = 0.001
JOINTS = 3
goals = st.lists(st.floats(-2.0, 2.0), min_size=JOINTS, max_size=JOINTS)
shares = st.floats(0.0, 1.0)
orders = st.lists(
    st.one_of(
        st.tuples(st.just("go"), goals),
        st.tuples(st.just("share"), shares),
        st.tuples(st.just("stop"), st.none()),
        st.tuples(st.just("pass"), st.floats(0.0, 1.0)),
    ),
    max_size=12,
)


def run(orders, step=FINE):
    """Positions and speeds at every step of a sequence of orders."""
    trajectory, share = Trajectory(np.zeros(JOINTS)), 1.0
    positions, speeds = [trajectory.q], [trajectory.velocity]
    for kind, value in [*orders, ("pass", 0.2)]:
        if kind == "go":
            trajectory.go_to(np.array(value))
        elif kind == "share":
            share = value
        elif kind == "stop":
            share = 0.0
        for _ in range(round(value / step) if kind == "pass" else 0):
            trajectory.advance(step, share)
            positions.append(trajectory.q)
            speeds.append(trajectory.velocity)
    return np.array(positions), np.array(speeds)


@settings(max_examples=12, deadline=None)
@given(orders)
def test_speed_and_acceleration_hold_at_every_instant_whatever_is_asked(orders):
    positions, speeds = run(orders)
    assert np.abs(speeds).max() <= CONFIG.speed * (1 + 1e-9)
    assert np.abs(np.diff(positions, axis=0)).max() <= CONFIG.speed * FINE * (1 + 1e-9)
    most = CONFIG.max_acceleration * (1 + 1e-6)
    assert np.abs(np.diff(speeds, axis=0)).max() <= most * FINE + 1e-8


@settings(max_examples=12, deadline=None)
@given(orders)
def test_speed_is_the_change_of_position(orders):
    positions, speeds = run(orders)
    between = (speeds[1:] + speeds[:-1]) / 2
    change = np.diff(positions, axis=0) / FINE
    most = CONFIG.max_acceleration * FINE
    assert np.abs(change - between).max(initial=0.0) <= most


@settings(max_examples=12, deadline=None)
@given(goals, st.floats(0.0, 1.0), st.floats(0.01, 3.0))
def test_motion_is_the_same_however_time_is_cut(goal, share, seconds):
    whole, parts = Trajectory(np.zeros(JOINTS)), Trajectory(np.zeros(JOINTS))
    for trajectory in (whole, parts):
        trajectory.go_to(np.array(goal))
    whole.advance(seconds, share)
    for _ in range(50):
        parts.advance(seconds / 50, share)
    assert np.allclose(whole.q, parts.q, atol=1e-6)


@settings(max_examples=12, deadline=None)
@given(goals, st.floats(0.0, 3.0), st.floats(0.0, 5.0))
def test_stopped_for_however_long_it_goes_on_from_where_it_stands(goal, before, pause):
    trajectory = Trajectory(np.zeros(JOINTS))
    trajectory.go_to(np.array(goal))
    trajectory.advance(before, 1.0)
    trajectory.advance(CONFIG.brake_seconds, 0.0)
    stood, clock = trajectory.q, trajectory.time
    trajectory.advance(pause, 0.0)
    assert np.array_equal(trajectory.q, stood) and trajectory.time == clock
    assert not trajectory.velocity.any()
    trajectory.advance(FINE, 1.0)
    assert np.abs(trajectory.velocity).max() <= CONFIG.speed * FINE / 0.5
    trajectory.advance(10.0, 1.0)
    assert np.allclose(trajectory.q, goal, atol=1e-9)


def test_from_full_speed_it_stands_within_the_time_of_a_brake():
    trajectory = Trajectory(np.zeros(JOINTS))
    trajectory.go_to(np.full(JOINTS, 3.0))
    trajectory.advance(1.5, 1.0)
    assert np.isclose(trajectory.velocity.max(), CONFIG.speed)
    trajectory.advance(CONFIG.brake_seconds - 1e-3, 0.0)
    assert trajectory.velocity.max() > 0
    trajectory.advance(2e-3, 0.0)
    assert not trajectory.velocity.any()


def test_a_new_goal_in_the_middle_is_gone_to_from_where_it_stopped():
    trajectory = Trajectory(np.zeros(1))
    trajectory.go_to(np.array([2.0]))
    trajectory.advance(1.5, 1.0)
    turned = trajectory.q
    trajectory.go_to(np.array([0.0]))
    trajectory.advance(CONFIG.brake_seconds + 1e-6, 1.0)
    brake = CONFIG.speed * CONFIG.brake_seconds / 2
    assert np.isclose(trajectory.segment.start[0], turned[0] + brake, atol=2e-3)
    trajectory.advance(10.0, 1.0)
    assert trajectory.arrived and np.allclose(trajectory.q, 0.0)


def test_a_share_of_speed_is_that_share():
    trajectory = Trajectory(np.zeros(1))
    trajectory.go_to(np.array([3.0]))
    trajectory.advance(3.5, 0.3)
    assert np.isclose(trajectory.velocity[0], 0.3 * CONFIG.speed)


def test_found_elsewhere_it_goes_to_the_same_goal_from_there():
    trajectory = Trajectory(np.zeros(1))
    trajectory.go_to(np.array([1.0]))
    trajectory.advance(0.5, 1.0)
    trajectory.restart_from(np.array([-0.5]))
    assert trajectory.q == -0.5 and not trajectory.velocity.any()
    trajectory.advance(10.0, 1.0)
    assert np.allclose(trajectory.q, 1.0)
