"""Tests of jogs: a stroke moves the tool of a paused arm by a step."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.arms import MotionConfig, SimulatedArm
from eskin.arms.task import JOG_SPEED
from eskin.command import CommandMap, Rule
from eskin.drivers import ManualClock
from eskin.errors import JogError
from eskin.robot import DampedLeastSquaresIK, Kinematics, load_robot
from helpers.commands import (
    DIRECTION,
    HELD,
    make_map,
    make_paused_scene,
    make_ur_arm,
    pass_ur_time,
)

pytestmark = pytest.mark.slow

CONFIG = MotionConfig()
UR5 = load_robot("ur5")
KINEMATICS = Kinematics(UR5)
JOG = CommandMap(
    commands=[
        *make_map(poke="pause", stroke="jog").commands,
        Rule(gesture="stroke", action="jog", link="forearm_link", step=0.02),
    ]
)
STEP = np.array([0.02, 0.0, 0.0])


def tool_pose(q):
    return KINEMATICS.poses(np.asarray(q))[..., -1, :, :]


def draw_direction(rng):
    direction = rng.standard_normal(3)
    return direction / np.linalg.norm(direction)


def pass_time(arm, seconds):
    """Return the states of an arm, simulated or UR, while time passes."""
    states = []
    step = 0.01 if isinstance(arm, SimulatedArm) else 0.008
    for _ in range(round(seconds / step)):
        if isinstance(arm, SimulatedArm):
            arm.clock.sleep(step)
        else:
            pass_ur_time(arm, step)
        states.append(arm.state())
    return states


@pytest.fixture(params=["sim", "ur"])
def arm(request):
    return make_paused_arm(request.param)


def make_paused_arm(kind="sim"):
    """Return an arm that was paused on its way and stands."""
    arm = SimulatedArm(clock=ManualClock()) if kind == "sim" else make_ur_arm()[0]
    pass_time(arm, 4.0)
    arm.pause()
    pass_time(arm, 0.5)
    assert arm.state().paused and not arm.state().moving
    return arm


def test_jog_moves_tool_straight_by_step_and_arm_stays_paused(arm):
    rng = np.random.default_rng(0)
    target = arm.state().target
    for _ in range(4):
        before = tool_pose(arm.state().q)
        step = 0.03 * draw_direction(rng)
        arm.jog(step)
        states = pass_time(arm, 2.0)
        assert all(state.paused for state in states) and states[5].jogging
        assert not states[-1].moving and not states[-1].jogging
        poses = tool_pose([state.q for state in states])
        path = poses[:, :3, 3] - before[:3, 3]
        np.testing.assert_allclose(path[-1], step, atol=1e-4)
        np.testing.assert_allclose(poses[-1, :3, :3], before[:3, :3], atol=1e-3)
        aside = path - np.outer(path @ step, step) / (step @ step)
        assert np.linalg.norm(aside, axis=1).max() < 2e-3
        assert states[-1].target == target
    arm.resume()
    states = pass_time(arm, 6.0)
    assert any(state.moving for state in states)
    assert any(state.target != target for state in states)


@settings(max_examples=8, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(
        st.tuples(
            st.sampled_from(("jog", "pause", "resume", "hold", "release", "next")),
            st.floats(0.0, 1.5),
        ),
        max_size=8,
    ),
)
def test_jogs_keep_limits_of_motion(seed, orders):
    rng = np.random.default_rng(seed)
    arm = make_paused_arm()
    execute = {
        "jog": lambda: arm.jog(0.1 * draw_direction(rng)),
        "hold": lambda: arm.hold(HELD),
        "next": arm.next_waypoint,
    }
    q = [arm.state().q]
    for name, seconds in orders:
        try:
            execute.get(name, getattr(arm, name, None))()
        except JogError:
            continue
        states = pass_time(arm, seconds)
        q += [state.q for state in states]
        jogged = np.array([state.q for state in states if state.jogging])
        speed = np.abs(np.diff(jogged, axis=0)).max(initial=0) / 0.01
        assert speed <= JOG_SPEED * CONFIG.speed * (1 + 1e-6)
    speeds = np.diff(q, axis=0) / 0.01
    assert np.abs(speeds).max(initial=0) <= CONFIG.speed * (1 + 1e-6)
    changes = np.abs(np.diff(speeds, axis=0)) / 0.01
    assert changes.max(initial=0) <= CONFIG.max_acceleration * (1 + 1e-6)


@pytest.mark.parametrize("stop", ["hold", "pause"])
def test_stop_ends_jog_for_good(arm, stop):
    arm.jog(2 * STEP)
    pass_time(arm, 0.4)
    assert arm.state().moving
    arm.hold(HELD) if stop == "hold" else arm.pause()
    assert not arm.state().jogging
    pass_time(arm, CONFIG.brake_seconds + 0.02)
    stood = arm.state().q
    arm.release()
    assert not any(state.moving for state in pass_time(arm, 1.0))
    np.testing.assert_array_equal(arm.state().q, stood)


def test_only_paused_standing_arm_jogs(arm):
    arm.jog(STEP)
    with pytest.raises(JogError, match="moves"):
        arm.jog(STEP)
    pass_time(arm, 2.0)
    arm.hold(HELD)
    with pytest.raises(JogError, match="held: test"):
        arm.jog(STEP)
    arm.release()
    arm.resume()
    with pytest.raises(JogError, match="not paused"):
        arm.jog(STEP)


@pytest.mark.parametrize("direction", ["outward", "down"])
def test_jog_out_of_reach_is_refused(direction):
    arm = make_paused_arm()
    axis = np.array([0.0, 0.0, -1.0])
    if direction == "outward":
        axis = tool_pose(arm.state().q)[:3, 3] * [1, 1, 0]
    with pytest.raises(JogError, match="out of reach or below 0.1 m"):
        for _ in range(30):
            before = arm.state().q
            arm.jog(0.1 * axis / np.linalg.norm(axis))
            pass_time(arm, 4.0)
    assert not any(state.moving for state in pass_time(arm, 1.0))
    np.testing.assert_array_equal(arm.state().q, before)
    assert tool_pose(before)[2, 3] >= 0.1


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_inverse_kinematics_solves_step_within_joint_limits(seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-3, 3, 6)
    step = 0.05 * draw_direction(rng)
    found = DampedLeastSquaresIK(UR5, "tool0").solve_step(q, step)
    if found is None:
        return
    wanted = tool_pose(q)
    wanted[:3, 3] += step
    np.testing.assert_allclose(tool_pose(found)[:3, 3], wanted[:3, 3], atol=2e-5)
    np.testing.assert_allclose(tool_pose(found)[:3, :3], wanted[:3, :3], atol=1e-4)
    assert np.abs(found - q).max() <= 0.5
    assert (found >= UR5.lower).all() and (found <= UR5.upper).all()


def test_stroke_jogs_paused_arm_once_it_is_answered():
    scene = make_paused_scene(JOG)
    scene.touch("stroke")
    scene.wait(0.5)
    assert "jog" not in scene.arm.orders
    scene.touch("poke")
    scene.wait(0.3)
    assert scene.accepted == ["pause", "jog"] and scene.arm.paused
    np.testing.assert_allclose(scene.arm.steps, [0.02 * DIRECTION])
