"""A UR at its task: on a link broken on purpose, and through the real client."""

import time
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from benchmarks.ur_stand_in import StandIn

from eskin.app import open_arm
from eskin.command import FRAME_TASK, MotionConfig, Policy, PolicyConfig, UrArm
from eskin.drivers import ManualClock
from eskin.errors import ArmError
from eskin.stream import Context
from eskin.ur import PERIOD, ControllerLink, UrLink, UrStatus
from helpers.commands import INFO, VOCABULARY, Scene

SECOND = 1_000_000_000
START = np.array(FRAME_TASK.waypoints[0].q) + (1.5, 0, 0, 0, 0, 0)
WELL = UrStatus(
    q=tuple(START),
    running=True,
    protective_stop=False,
    emergency_stop=False,
    scaling=1.0,
    gripper_closed=False,
)
LIMIT = MotionConfig().speed


class ToldLink(ControllerLink):
    """A robot that is at once where it is told to be."""

    problem = ""

    def __init__(self):
        self.status, self.orders, self.closed = WELL, [], False

    def exchange(self, order):
        self.orders.append(order)
        if self.status is None:
            return None
        if order.q is not None and self.status.running:
            self.status = replace(self.status, q=order.q)
        if order.gripper_closed is not None:
            self.status = replace(self.status, gripper_closed=order.gripper_closed)
        return self.status

    def close(self):
        self.closed = True


def told_arm(release=True):
    link, clock = ToldLink(), ManualClock()
    arm = UrArm(link, clock=clock, threaded=False)
    ticks(arm, 0.1)
    if release:
        arm.release()
        ticks(arm, 1.0)
    return arm, link


def ticks(arm, seconds):
    """Positions while time passes."""
    positions = []
    for _ in range(round(seconds / PERIOD)):
        arm.clock.sleep(PERIOD)
        arm.update()
        positions.append(np.array(arm.status.q))
    return np.array(positions)


def test_it_begins_held_where_the_robot_stands():
    arm, link = told_arm(release=False)
    assert arm.state().hold_reason == "not started"
    positions = ticks(arm, 1.0)
    assert np.array_equal(positions, np.tile(START, (len(positions), 1)))
    arm.release()
    assert np.abs(ticks(arm, 1.0)[-1] - START).max() > 0.1


def test_a_robot_that_has_a_part_in_its_gripper_keeps_it():
    link = ToldLink()
    link.status = replace(WELL, gripper_closed=True)
    arm = UrArm(link, clock=ManualClock(), threaded=False)
    assert arm.state().gripper == "closed"
    ticks(arm, 0.5)
    assert all(order.gripper_closed is None for order in link.orders)


FAULTS = {
    "lost connection": None,
    "protective stop": {"protective_stop": True},
    "emergency stop": {"emergency_stop": True},
    "the robot's program has ended": {"running": False},
    "speed slider at zero": {"scaling": 0.0},
}


@pytest.mark.parametrize("why", FAULTS)
def test_what_stops_the_robot_holds_it_at_once_and_never_ends_by_itself(why):
    arm, link = told_arm()
    before = link.status
    assert arm.state().moving
    fault = FAULTS[why]
    link.status = None if fault is None else replace(before, **fault)
    ticks(arm, PERIOD)
    assert arm.state().hold_reason == why
    ticks(arm, 0.15 - PERIOD)
    assert not arm.state().moving
    last = link.orders[-1].q
    ticks(arm, 3.0)
    assert link.orders[-1].q == last and not arm.state().moving
    with pytest.raises(ArmError, match=f"stays held: {why}"):
        arm.release()
    link.status = replace(before, q=link.orders[-1].q or before.q)
    stood = ticks(arm, 3.0)
    assert np.array_equal(stood, np.tile(stood[0], (len(stood), 1)))
    assert arm.state().hold_reason == why
    arm.release()
    arm.resume()
    assert np.abs(np.diff(ticks(arm, 1.0), axis=0)).max() <= LIMIT * PERIOD * 1.001
    assert arm.state().hold_reason is None


def test_a_stopped_robot_is_given_no_positions():
    arm, link = told_arm()
    link.status = replace(link.status, protective_stop=True)
    ticks(arm, 0.1)
    assert all(order.q is None for order in link.orders[-5:])


def test_a_robot_that_was_moved_meanwhile_goes_on_from_there():
    arm, link = told_arm()
    link.status = replace(link.status, protective_stop=True)
    ticks(arm, 0.2)
    moved = tuple(np.array(link.status.q) + 0.5)
    link.status = replace(link.status, protective_stop=False, q=moved)
    ticks(arm, 0.2)
    assert np.allclose(link.status.q, moved)
    arm.release()
    positions = ticks(arm, 0.5)
    assert np.abs(positions[0] - moved).max() < 0.01


def test_the_clock_of_the_task_waits_for_a_slow_robot():
    fast, _ = told_arm()
    slow, link = told_arm()
    assert np.allclose(fast.status.q, slow.status.q)
    link.status = replace(link.status, scaling=0.25)
    ticks(slow, 0.2)
    step = np.abs(np.diff(ticks(slow, 0.1), axis=0)).max()
    assert np.isclose(step, LIMIT * PERIOD / 4, rtol=0.01)


def test_time_that_was_missed_is_never_made_up_for():
    arm, link = told_arm()
    before = np.array(link.orders[-1].q)
    arm.clock.sleep(5.0)
    arm.update()
    arm.clock.sleep(PERIOD)
    arm.update()
    assert np.abs(np.array(link.orders[-1].q) - before).max() <= LIMIT * 4 * PERIOD


def test_a_robot_that_does_not_follow_is_held():
    class Stubborn(ToldLink):
        def exchange(self, order):
            self.orders.append(order)
            return self.status

    arm = UrArm(Stubborn(), clock=ManualClock(), threaded=False)
    arm.release()
    ticks(arm, 2.0)
    assert arm.state().hold_reason == "the robot does not follow"


def test_a_stale_skin_holds_it_within_150_ms():
    arm, link = told_arm()
    policy = Policy(
        arm, Scene().policy.commands, VOCABULARY, PolicyConfig(check_period=None)
    )
    policy.start(Context(INFO, arm.clock, lambda item: None))
    began = arm.clock.now()
    while not arm.state().hold_reason:
        ticks(arm, PERIOD)
        policy.check_skin()
    visible = arm.clock.now()
    assert visible - began <= 0.12 * SECOND
    ticks(arm, 0.144)
    assert not arm.state().moving


def test_a_robot_that_is_not_reached_is_refused_and_let_go():
    link = ToldLink()
    link.status, link.problem = None, "no answer"
    with pytest.raises(ArmError, match="not reached .no answer.; allowed is a UR"):
        UrArm(link, clock=ManualClock())
    assert link.closed


def test_a_loop_that_fails_holds_it_for_good(caplog):
    link = ToldLink()
    arm = UrArm(link)
    link.exchange = None
    arm.thread.join(5)
    assert arm.state().hold_reason and link.closed
    with pytest.raises(ArmError, match="loop failed"):
        arm.release()
    arm.close()


@pytest.mark.skipif(find_spec("rtde_control") is not None, reason="ur_rtde is there")
def test_without_its_driver_it_is_refused():
    with pytest.raises(ArmError, match="pip install 'eskin.ur.'"):
        open_arm("ur://127.0.0.1")


@pytest.fixture(scope="module")
def robot():
    if find_spec("rtde_control") is None:
        pytest.skip("no ur_rtde; pip install 'eskin[ur]'")
    with StandIn(list(START)) as stand_in:
        # How fast a fault is seen is measured in benchmarks, on a quiet machine.
        with UrArm(UrLink(stand_in.host, 0, time_factor=20.0)) as arm:
            yield stand_in, arm


@pytest.fixture
def working(robot):
    """The stand-in and its arm, at work between rack and frame."""
    stand_in, arm = robot
    stand_in.order("protective", False)
    stand_in.order("slider", 1.0)
    until(lambda: arm.state().connected and not arm.state().protective_stop)
    until(lambda: arm.status.scaling == 1 and not arm.state().moving)
    arm.set_speed(1.0)
    arm.release()
    arm.resume()
    until(lambda: speed(stand_in) > 0.2)
    return stand_in, arm


def until(true, seconds=15.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.005)


def speed(stand_in):
    return np.abs(stand_in.ask("qd")).max()


def stays(stand_in):
    """Whether the robot stands and goes on standing."""
    until(lambda: speed(stand_in) < 0.01)
    before = stand_in.ask("q")
    time.sleep(0.3)
    return np.abs(stand_in.ask("q") - before).max() < 0.01


def test_the_real_client_does_every_action(working):
    stand_in, arm = working
    arm.pause()
    assert stays(stand_in)
    arm.close_gripper()
    until(lambda: arm.state().gripper == "closed" and stand_in.ask("outputs") & 1)
    arm.open_gripper()
    until(lambda: arm.state().gripper == "open" and not stand_in.ask("outputs") & 1)
    target = arm.state().target
    arm.next_waypoint()
    assert arm.state().target != target and stays(stand_in)
    arm.previous_waypoint()
    assert arm.state().target == target
    arm.set_speed(0.1)
    arm.resume()
    until(lambda: speed(stand_in) > 0.02)
    assert stand_in.ask("slider") == 1.0
    assert np.abs(arm.q_at(arm.clock.now()) - stand_in.ask("q")).max() < 0.1
    arm.hold("test")
    assert stays(stand_in) and arm.state().hold_reason == "test"


def test_the_real_client_is_held_by_a_protective_stop(working):
    stand_in, arm = working
    stand_in.order("protective", True)
    until(lambda: arm.state().hold_reason == "protective stop")
    assert stays(stand_in)
    stand_in.order("protective", False)
    assert stays(stand_in) and arm.state().hold_reason


def test_the_real_client_is_held_by_a_slider_at_zero(working):
    stand_in, arm = working
    stand_in.order("slider", 0.0)
    until(lambda: arm.state().hold_reason == "speed slider at zero")
    assert stays(stand_in) and stand_in.ask("slider") == 0.0
    stand_in.order("slider", 0.5)
    assert stays(stand_in) and arm.state().hold_reason


def test_the_real_client_is_held_by_a_stale_skin(working):
    stand_in, arm = working
    policy = Policy(arm, Scene().policy.commands, VOCABULARY)
    policy.start(Context(INFO, arm.clock, lambda item: None))
    until(lambda: (arm.state().hold_reason or "").startswith("stale skin"))
    assert stays(stand_in)
    policy.close()


def test_the_watchdog_on_the_robot_stops_it_when_nothing_comes(working):
    stand_in, arm = working
    stand_in.order("mute", True)
    until(lambda: not stand_in.ask("running"))
    until(lambda: arm.state().hold_reason)
    assert stays(stand_in)
    stand_in.order("mute", False)
    until(lambda: arm.state().connected)
    assert stays(stand_in) and arm.state().hold_reason


def test_the_real_client_that_loses_its_robot_never_resumes_by_itself(working):
    stand_in, arm = working
    stand_in.order("hang_up")
    until(lambda: arm.state().hold_reason == "lost connection")
    assert stays(stand_in)
    with pytest.raises(ArmError, match="stays held: lost connection"):
        arm.release()
    stand_in.order("come_back")
    until(lambda: arm.state().connected)
    assert stays(stand_in)
    arm.release()
    until(lambda: speed(stand_in) > 0.2)


def test_the_real_client_whose_process_dies_is_a_lost_connection(working):
    stand_in, arm = working
    arm.link.process.kill()
    until(lambda: arm.state().hold_reason == "lost connection")
    assert stays(stand_in)
    until(lambda: arm.state().connected)
