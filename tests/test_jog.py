"""A stroke moves the tool of a paused arm a step its way, and nothing else does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.command import CommandMap, MotionConfig, Rule, SimulatedArm, UrArm
from eskin.command.task import JOG_SPEED
from eskin.drivers import ManualClock
from eskin.errors import ArmError, JogError
from eskin.robot import DampedLeastSquaresIK, Kinematics, load_robot
from helpers.commands import WAY, Scene
from test_ur_arm import ToldLink

CONFIG = MotionConfig()
UR5 = load_robot("ur5")
KINEMATICS = Kinematics(UR5)
JOG = CommandMap(
    commands=[
        Rule(gesture="poke", action="toggle_pause"),
        Rule(gesture="stroke", action="jog"),
        Rule(gesture="stroke", action="jog", link="forearm_link", step=0.02),
    ]
)


def tool(q):
    return KINEMATICS.poses(np.asarray(q))[..., -1, :, :]


def unit(rng):
    way = rng.standard_normal(3)
    return way / np.linalg.norm(way)


def paused(kind, seconds=4.0):
    """An arm that was paused on its way, and how to let time pass for it."""
    clock = ManualClock()
    if kind == "sim":
        arm = SimulatedArm(clock=clock)

        def go(seconds, step=0.01):
            for _ in range(round(seconds / step)):
                clock.sleep(step)
                yield arm.state()
    else:
        arm = UrArm(ToldLink(), clock=clock, threaded=False)
        arm.update()
        arm.release()

        def go(seconds, step=0.008):
            for _ in range(round(seconds / step)):
                clock.sleep(step)
                arm.update()
                yield arm.state()

    list(go(seconds))
    arm.pause()
    list(go(1.0))
    assert arm.state().paused and not arm.state().moving
    return arm, go


@pytest.mark.parametrize("kind", ["sim", "ur"])
def test_the_tool_goes_the_step_turned_as_it_was_and_the_arm_stays_paused(kind):
    rng, target = np.random.default_rng(0), None
    arm, go = paused(kind)
    for _ in range(6):
        before = arm.state()
        target = target or before.target
        step = 0.03 * unit(rng)
        arm.jog(step)
        states = list(go(3.0))
        assert all(state.paused for state in states) and states[5].jogging
        assert not states[-1].moving and not states[-1].jogging
        was, now = tool(before.q), tool(states[-1].q)
        np.testing.assert_allclose(now[:3, 3] - was[:3, 3], step, atol=1e-4)
        np.testing.assert_allclose(now[:3, :3], was[:3, :3], atol=1e-3)
        path = tool([state.q for state in states])[:, :3, 3] - was[:3, 3]
        aside = path - np.outer(path @ step, step) / (step @ step)
        assert np.linalg.norm(aside, axis=1).max() < 2e-3
        assert states[-1].target == target
    arm.resume()
    states = list(go(6.0))
    assert any(state.moving for state in states)
    assert any(state.target != target for state in states)


@settings(max_examples=10, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(
        st.tuples(
            st.sampled_from(("jog", "pause", "resume", "hold", "release", "next")),
            st.floats(0.0, 1.5),
        ),
        max_size=10,
    ),
)
def test_no_jog_breaks_the_limits_or_makes_the_arm_jump(seed, orders):
    rng = np.random.default_rng(seed)
    arm, go = paused("sim")
    q = [arm.state().q]
    for name, seconds in orders:
        if name == "jog":
            try:
                arm.jog(0.1 * unit(rng))
            except JogError:
                continue
        elif name == "hold":
            arm.hold("test")
        elif name == "next":
            arm.next_waypoint()
        else:
            getattr(arm, name)()
        states = list(go(seconds))
        q += [state.q for state in states]
        if any(state.jogging for state in states):
            speed = np.abs(np.diff([s.q for s in states if s.jogging], axis=0)) / 0.01
            assert speed.max(initial=0) <= JOG_SPEED * CONFIG.speed * (1 + 1e-6)
    speeds = np.diff(q, axis=0) / 0.01
    assert np.abs(speeds).max(initial=0) <= CONFIG.speed * (1 + 1e-6)
    changes = np.abs(np.diff(speeds, axis=0)) / 0.01
    assert changes.max(initial=0) <= CONFIG.max_acceleration * (1 + 1e-6)


@pytest.mark.parametrize("kind", ["sim", "ur"])
@pytest.mark.parametrize("stop", ["hold", "pause"])
def test_what_stops_the_arm_ends_a_jog_for_good(kind, stop):
    arm, go = paused(kind)
    arm.jog(np.array([0.05, 0.0, 0.0]))
    list(go(0.4))
    assert arm.state().moving
    arm.hold("test") if stop == "hold" else arm.pause()
    assert not arm.state().jogging
    list(go(CONFIG.brake_seconds + 0.02))
    stood = arm.state().q
    arm.release()
    assert not any(state.moving for state in go(1.0))
    np.testing.assert_array_equal(arm.state().q, stood)


@pytest.mark.parametrize("kind", ["sim", "ur"])
def test_only_an_arm_that_is_paused_and_stands_jogs(kind):
    arm, go = paused(kind)
    step = np.array([0.02, 0.0, 0.0])
    arm.jog(step)
    with pytest.raises(JogError, match="the arm or its gripper moves"):
        arm.jog(step)
    list(go(3.0))
    arm.hold("test")
    with pytest.raises(JogError, match="the arm is held: test"):
        arm.jog(step)
    arm.release()
    arm.resume()
    with pytest.raises(JogError, match="the arm is not paused"):
        arm.jog(step)


def test_where_the_arm_does_not_reach_it_stands_as_it_did():
    arm, go = paused("sim")
    outward = tool(arm.state().q)[:3, 3] * [1, 1, 0]
    outward /= np.linalg.norm(outward)
    for way in (outward, np.array([0.0, 0.0, -1.0])):
        refused, before = False, arm.state().q
        for _ in range(30):
            before = arm.state().q
            try:
                arm.jog(0.05 * way)
            except JogError as error:
                assert "out of reach or below 0.1 m" in str(error)
                refused = True
                break
            list(go(6.0))
        assert refused
        assert not any(state.moving for state in go(1.0))
        np.testing.assert_array_equal(arm.state().q, before)
        assert tool(before)[2, 3] >= 0.1


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_whatever_is_found_is_a_step_away_and_within_the_joints(seed):
    rng = np.random.default_rng(seed)
    q, step = rng.uniform(-3, 3, 6), 0.05 * unit(rng)
    found = DampedLeastSquaresIK(UR5, "tool0").solve_step(q, step)
    if found is None:
        return
    np.testing.assert_allclose(
        tool(found)[:3, 3], tool(q)[:3, 3] + step, rtol=0, atol=2e-5
    )
    np.testing.assert_allclose(tool(found)[:3, :3], tool(q)[:3, :3], atol=1e-4)
    assert np.abs(found - q).max() <= 0.5
    assert (found >= UR5.lower).all() and (found <= UR5.upper).all()


def paused_scene():
    scene = Scene(JOG)
    scene.whole("poke")
    scene.rest(1.0)
    assert scene.arm.paused
    return scene


def jogs(said):
    return [one.accepted for one in said if one.action == "jog"]


def test_a_stroke_on_a_paused_arm_jogs_it_once_the_hand_has_gone():
    scene = paused_scene()
    number = scene.touch("stroke")
    scene.rest(0.3)
    scene.detect(number)
    scene.rest(0.5)
    assert "jog" not in scene.arm.told
    scene.lift(number)
    scene.rest(0.2)
    assert scene.arm.told[-1] == "jog" and scene.arm.paused
    np.testing.assert_allclose(scene.arm.steps, [0.02 * WAY])
    assert jogs(scene.said) == [True]


def test_a_touch_while_it_jogs_stops_it_and_sets_nothing_in_motion():
    for gesture in ("poke", "stroke"):
        scene = paused_scene()
        scene.whole("stroke")
        assert scene.arm.jogging
        scene.rest(0.6)
        said = scene.whole(gesture)
        assert not scene.arm.jogging and scene.arm.paused
        assert [one.accepted for one in said] == [True, False]
        assert said[0].why == "touched while it jogs"
        assert said[1].why == "the touch began before the pause"


def test_no_stroke_jogs_an_arm_that_moves_or_is_held_or_that_it_is_unsure_of():
    scene = Scene(JOG)
    (said,) = scene.whole("stroke")
    assert said.why == "nobody has paused it"
    scene = paused_scene()
    (said,) = scene.whole("stroke", sure=0.94)
    assert said.why == "confidence 0.94 is below 0.95"
    scene.arm.hold("test")
    (said,) = scene.whole("stroke")
    assert said.why.startswith("the arm is held: test")
    scene.arm.hold_reason = None
    number = scene.touch("stroke")
    scene.touches[number]["way"] = np.zeros(3)
    scene.moment()
    (said,) = scene.detect(number)
    assert said.why == "the touch did not travel"
    scene.close(number)
    number = scene.touch("stroke")
    scene.moment()
    (said,) = scene.detect(number, age=0.12)
    assert said.why == "it was felt 120 ms ago"
    assert "jog" not in scene.arm.told


def test_a_jog_that_is_refused_holds_nothing_and_an_arm_that_fails_is_held():
    for broken, held in ((JogError("no jog"), False), (ArmError("lost"), True)):
        scene = paused_scene()
        scene.arm.broken = broken
        said = scene.whole("stroke")
        assert jogs(said) == [False] and said[-1].why == str(broken)
        assert (scene.arm.hold_reason is not None) == held
