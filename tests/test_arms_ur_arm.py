"""Tests of the UR arm, on a stub of its link and through the real client."""

import re
import subprocess
import sys
import time
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from eskin.app import open_arm
from eskin.arms import MotionConfig, UrArm
from eskin.arms.ur import (
    PERIOD,
    LinkProblem,
    UrCommand,
    UrLink,
    name_client_error,
)
from eskin.arms.ur_arm import UrProblem
from eskin.command import Policy, PolicyConfig, Problem
from eskin.drivers import ManualClock
from eskin.errors import ArmError
from eskin.registry import advise_install
from eskin.stream import Context
from helpers.commands import (
    DEFAULT,
    HELD,
    INFO,
    SECOND,
    VOCABULARY,
    WELL,
    StubLink,
    is_held_for,
    make_ur_arm,
    pass_ur_time,
)
from lab.ur_stand_in import StandIn

pytestmark = pytest.mark.slow

LIMIT = MotionConfig().speed
QUESTION = 3
"""Digital output that shows a question."""


def start_policy(arm, **config):
    policy = Policy(arm, DEFAULT, VOCABULARY, PolicyConfig(**config))
    policy.start(Context(INFO, arm.clock, lambda item: None))
    return policy


def test_arm_begins_held_where_robot_stands():
    arm, _ = make_ur_arm(release=False)
    assert arm.state().hold_reason == UrProblem.NOT_STARTED.reason()
    assert (pass_ur_time(arm, 1.0) == WELL.q).all()
    arm.release()
    assert np.abs(pass_ur_time(arm, 1.0)[-1] - WELL.q).max() > 0.1


def test_robot_keeps_part_in_its_gripper():
    status = replace(WELL, gripper_closed=True)
    arm, link = make_ur_arm(release=False, status=status)
    assert arm.state().gripper == "closed"
    assert all(command.gripper_closed is None for command in link.commands)


def test_question_is_shown_whatever_stops_the_robot():
    arm, link = make_ur_arm()
    assert link.commands[0].question_shown is None
    assert not any(command.question_shown for command in link.commands)
    arm.show_question(True)
    well = link.status
    for status in (well, replace(well, running=False, protective_stop=True)):
        link.status = status
        pass_ur_time(arm, 2 * PERIOD)
        assert link.commands[-1].question_shown
    arm.show_question(False)
    pass_ur_time(arm, PERIOD)
    assert link.commands[-1].question_shown is False


@pytest.mark.parametrize(
    ("cause", "fault"),
    [
        (UrProblem.LOST_CONNECTION, None),
        (Problem.PROTECTIVE_STOP, {"protective_stop": True}),
        (UrProblem.EMERGENCY_STOP, {"emergency_stop": True}),
        (Problem.PROGRAM_ENDED, {"running": False}),
        (UrProblem.SLIDER_AT_ZERO, {"scaling": 0.0}),
    ],
)
def test_fault_holds_arm_until_release(cause, fault):
    arm, link = make_ur_arm()
    before = link.status
    assert arm.state().moving
    link.status = None if fault is None else replace(before, **fault)
    pass_ur_time(arm, PERIOD)
    held = arm.state().hold_reason
    assert held.cause is cause
    pass_ur_time(arm, 0.15 - PERIOD)
    assert not arm.state().moving
    last = link.commands[-1].q
    moves = (UrProblem.SLIDER_AT_ZERO, UrProblem.LOST_CONNECTION)
    assert last is None or cause in moves
    pass_ur_time(arm, 1.0)
    assert link.commands[-1].q == last and not arm.state().moving
    with pytest.raises(ArmError, match=held.what):
        arm.release()
    link.status = replace(before, q=last or before.q)
    stood = pass_ur_time(arm, 1.0)
    assert (stood == stood[0]).all() and arm.state().hold_reason == held
    arm.release()
    arm.resume()
    steps = np.abs(np.diff(pass_ur_time(arm, 1.0), axis=0))
    assert 0 < steps.max() <= LIMIT * PERIOD * 1.001
    assert arm.state().hold_reason is None


def test_robot_moved_by_others_continues_from_there():
    arm, link = make_ur_arm()
    link.status = replace(link.status, protective_stop=True)
    pass_ur_time(arm, 0.2)
    moved = tuple(np.array(link.status.q) + 0.5)
    link.status = replace(link.status, protective_stop=False, q=moved)
    pass_ur_time(arm, 0.2)
    assert np.allclose(link.status.q, moved)
    arm.release()
    assert np.abs(pass_ur_time(arm, 0.5)[0] - moved).max() < 0.01


def test_task_runs_no_faster_than_slowed_robot():
    arm, link = make_ur_arm()
    link.status = replace(link.status, scaling=0.25)
    pass_ur_time(arm, 0.2)
    step = np.abs(np.diff(pass_ur_time(arm, 0.1), axis=0)).max()
    assert np.isclose(step, LIMIT * PERIOD / 4, rtol=0.01)


def test_missed_time_is_not_made_up_for():
    arm, link = make_ur_arm()
    before = np.array(link.commands[-1].q)
    arm.clock.sleep(5.0)
    arm.update()
    pass_ur_time(arm, PERIOD)
    assert np.abs(np.array(link.commands[-1].q) - before).max() <= LIMIT * 4 * PERIOD


def test_robot_that_does_not_follow_is_held():
    arm, _ = make_ur_arm(follows=False)
    pass_ur_time(arm, 1.0)
    assert arm.state().hold_reason == UrProblem.NOT_FOLLOWING.reason()


@pytest.mark.parametrize(
    "numbers",
    [
        {"scaling": np.nan},
        {"scaling": -np.inf},
        {"q": (np.nan, *WELL.q[1:])},
        {"q": (*WELL.q[:-1], np.inf)},
    ],
)
def test_number_that_is_not_finite_holds_arm(numbers):
    arm, link = make_ur_arm()
    before = link.status
    link.follows = False
    link.status = replace(before, **numbers)
    pass_ur_time(arm, PERIOD)
    assert arm.state().hold_reason.values["problem"] == LinkProblem.NOT_FINITE.what
    assert np.isfinite(pass_ur_time(arm, 1.0)).all() and not arm.state().moving
    link.status = before
    link.follows = True
    assert (pass_ur_time(arm, 1.0) == before.q).all()
    with pytest.raises(ArmError, match="not reached"):
        UrArm(StubLink(replace(WELL, **numbers)), clock=ManualClock(), threaded=False)


@pytest.mark.parametrize("distance", [0.3, -1.0, 3.0])
def test_arm_that_was_pushed_away_stays_there(distance):
    arm, link = make_ur_arm()
    arm.pause()
    pass_ur_time(arm, 0.5)
    pushed = np.array(link.status.q) + distance
    link.status = replace(link.status, q=tuple(pushed))
    link.follows = False
    pass_ur_time(arm, PERIOD)
    link.follows = True
    assert np.allclose(pass_ur_time(arm, 1.0), pushed)
    assert arm.state().hold_reason == UrProblem.NOT_FOLLOWING.reason()
    arm.release()
    arm.resume()
    steps = np.abs(np.diff(pass_ur_time(arm, 1.0), axis=0))
    assert 0 < steps.max() <= LIMIT * PERIOD * 1.001


def test_stale_skin_holds_arm_within_150_ms():
    arm, _ = make_ur_arm()
    policy = start_policy(arm, check_period=None)
    began = arm.clock.now()
    while not arm.state().hold_reason:
        pass_ur_time(arm, PERIOD)
        policy.check_skin()
    assert arm.clock.now() - began <= 0.12 * SECOND
    pass_ur_time(arm, 0.144)
    assert not arm.state().moving


@pytest.mark.parametrize("cause", LinkProblem)
def test_robot_that_is_not_reached_is_refused_with_cause_and_remedy(cause):
    problem = cause.reason(error="no way")
    link = StubLink(None, problem=problem)
    with pytest.raises(ArmError) as refused:
        UrArm(link, clock=ManualClock())
    assert problem.what in str(refused.value) and problem.remedy in str(refused.value)
    assert link.closed


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (
            RuntimeError("RTDE input registers are already in use!"),
            LinkProblem.INTERFACE_IN_USE,
        ),
        (
            RuntimeError("Failed to start control script, before timeout"),
            LinkProblem.PROGRAM_NOT_STARTED,
        ),
        (RuntimeError("connect: Connection refused"), LinkProblem.FAILED_CLIENT),
        (RuntimeError(), LinkProblem.FAILED_CLIENT),
        (ConnectionError(), LinkProblem.SILENT_CONTROLLER),
    ],
)
def test_error_of_the_client_is_named_by_its_kind_and_words(error, cause):
    problem = name_client_error(error)
    assert problem.cause is cause and problem.what


FAKE_CLIENT = {
    "rtde_receive": "def RTDEReceiveInterface(host, rate, names): {}",
    "rtde_control": "RTDEControlInterface = None",
    "rtde_io": "RTDEIOInterface = None",
}
"""Modules that stand in for `ur_rtde`, whose client fails."""


@pytest.mark.parametrize(
    ("fails", "problem"),
    [
        (
            "raise OSError('no\\n way')",
            LinkProblem.FAILED_CLIENT.reason(error="no way"),
        ),
        ("__import__('os').abort()", LinkProblem.ENDED_CLIENT.reason()),
    ],
)
def test_link_that_is_closed_keeps_why_its_client_failed(
    fails, problem, tmp_path, monkeypatch
):
    for name, text in FAKE_CLIENT.items():
        (tmp_path / f"{name}.py").write_text(text.format(fails))
    monkeypatch.syspath_prepend(tmp_path)
    link = UrLink("127.0.0.1", 0)
    wait_until(lambda: link.exchange(UrCommand(None, None, None)) or link.problem)
    assert link.problem == problem
    link.close()
    assert link.problem == problem


def test_robot_whose_program_does_not_run_is_refused():
    link = StubLink(replace(WELL, running=False))
    with pytest.raises(ArmError, match="reached, but its program"):
        UrArm(link, clock=ManualClock())
    assert link.closed


def test_touch_is_not_told_to_pause_a_robot_whose_program_has_ended():
    arm, link = make_ur_arm()
    link.status = replace(link.status, running=False)
    pass_ur_time(arm, PERIOD)
    assert arm.state().problem == Problem.PROGRAM_ENDED.reason()


def test_failure_of_thread_holds_arm_for_good(caplog):
    link = StubLink()
    arm = UrArm(link)
    link.exchange = None
    arm.thread.join(5)
    assert arm.state().hold_reason and link.closed
    with pytest.raises(ArmError, match="loop failed"):
        arm.release()
    arm.close()


@pytest.mark.skipif(find_spec("rtde_control") is not None, reason="ur_rtde is there")
def test_missing_driver_is_refused():
    with pytest.raises(ArmError, match=re.escape(advise_install("ur"))):
        open_arm("ur://127.0.0.1")


@pytest.fixture(scope="module")
def robot():
    if find_spec("rtde_control") is None:
        pytest.skip("no ur_rtde; pip install 'eskin[ur]'")
    with StandIn(list(WELL.q)) as stand_in:
        # How fast a fault is seen is measured in benchmarks, on a quiet machine.
        link = UrLink(stand_in.host, 0, time_factor=20.0, question_output=QUESTION)
        with UrArm(link) as arm:
            yield stand_in, arm


@pytest.fixture
def working(robot):
    """The stand-in of a controller and its arm, which moves."""
    stand_in, arm = robot
    stand_in.order("protective", False)
    stand_in.order("slider", 1.0)
    wait_until(lambda: arm.state().connected and not arm.state().protective_stop)
    wait_until(lambda: arm.status.scaling == 1 and not arm.state().moving)
    arm.set_speed(1.0)
    arm.release()
    arm.resume()
    wait_until(lambda: measure_speed(stand_in) > 0.2)
    return stand_in, arm


def wait_until(condition, seconds=15.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "too late"
        time.sleep(0.005)


def measure_speed(stand_in):
    return np.abs(stand_in.ask("qd")).max()


def stands(stand_in):
    """Return whether the robot comes to stand and remains where it is."""
    wait_until(lambda: measure_speed(stand_in) < 0.01)
    before = stand_in.ask("q")
    time.sleep(0.2)
    return np.abs(stand_in.ask("q") - before).max() < 0.01


def test_client_executes_every_action(working):
    stand_in, arm = working
    arm.pause()
    assert stands(stand_in)
    arm.close_gripper()
    wait_until(lambda: arm.state().gripper == "closed" and stand_in.ask("outputs") & 1)
    arm.open_gripper()
    wait_until(
        lambda: arm.state().gripper == "open" and not stand_in.ask("outputs") & 1
    )
    target = arm.state().target
    arm.next_waypoint()
    assert arm.state().target != target and stands(stand_in)
    arm.previous_waypoint()
    assert arm.state().target == target
    arm.set_speed(0.1)
    arm.resume()
    wait_until(lambda: measure_speed(stand_in) > 0.02)
    assert stand_in.ask("slider") == 1.0
    assert np.abs(arm.q_at(arm.clock.now()) - stand_in.ask("q")).max() < 0.1
    arm.hold(HELD)
    assert stands(stand_in) and arm.state().hold_reason == HELD


def shows_question(stand_in):
    return bool(stand_in.ask("outputs") & 1 << QUESTION)


def test_client_switches_output_of_question_and_no_other(working):
    stand_in, arm = working
    others = stand_in.ask("outputs")
    for fault in (("protective", False), ("protective", True)):
        stand_in.order(*fault)
        arm.show_question(True)
        wait_until(lambda: shows_question(stand_in))
        assert stand_in.ask("outputs") == others | 1 << QUESTION
        arm.show_question(False)
        wait_until(lambda: not shows_question(stand_in))
        assert stand_in.ask("outputs") == others


@pytest.mark.parametrize(
    ("fault", "end", "cause"),
    [
        (("protective", True), ("protective", False), Problem.PROTECTIVE_STOP),
        (("slider", 0.0), ("slider", 0.5), UrProblem.SLIDER_AT_ZERO),
        (("hang_up",), ("come_back",), UrProblem.LOST_CONNECTION),
    ],
)
def test_client_is_held_by_fault_until_release(working, fault, end, cause):
    stand_in, arm = working
    stand_in.order(*fault)
    wait_until(lambda: is_held_for(arm, cause))
    held = arm.state().hold_reason
    assert stands(stand_in)
    with pytest.raises(ArmError, match=held.what):
        arm.release()
    stand_in.order(*end)
    wait_until(lambda: arm.state().connected)
    assert stands(stand_in) and arm.state().hold_reason == held


def test_client_is_held_by_stale_skin(working):
    stand_in, arm = working
    policy = start_policy(arm)
    wait_until(lambda: is_held_for(arm, Problem.STALE_SKIN))
    assert stands(stand_in)
    policy.close()


def test_watchdog_of_robot_stops_it_without_commands(working):
    stand_in, arm = working
    stand_in.order("mute", True)
    wait_until(lambda: not stand_in.ask("running"))
    wait_until(lambda: arm.state().hold_reason)
    assert stands(stand_in)
    stand_in.order("mute", False)
    wait_until(lambda: arm.state().connected)
    assert stands(stand_in) and arm.state().hold_reason


def test_client_process_that_dies_is_lost_connection(working):
    stand_in, arm = working
    arm.link.process.kill()
    wait_until(lambda: is_held_for(arm, UrProblem.LOST_CONNECTION))
    ended = LinkProblem.ENDED_CLIENT.reason()
    assert arm.state().hold_reason.values["problem"] == ended.what
    assert stands(stand_in)
    wait_until(lambda: arm.state().connected)


def test_client_process_imports_little():
    code = "import sys, eskin.arms.ur; sys.exit('numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_closed_arm_leaves_no_question_on(working):
    """It closes the arm of this file, so it is the last test."""
    stand_in, arm = working
    arm.show_question(True)
    wait_until(lambda: shows_question(stand_in))
    arm.close()
    wait_until(lambda: not shows_question(stand_in))
