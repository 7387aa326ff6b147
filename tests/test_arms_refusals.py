"""What an arm cannot be asked to do is refused, each in one line that says why.

What an arm refuses while it is held or moves is tested with it.
"""

import pytest

from eskin.app import open_arm
from eskin.arms import SimulatedArm, Task, Waypoint
from eskin.drivers import ManualClock
from eskin.errors import ArmError
from helpers.refusals import REFUSALS, check_refusal, refusal

SPEED = SimulatedArm.set_speed
SPEED_LIMIT = SimulatedArm.limit_speed


def uri(text, part):
    """Return the row of a text that names no arm."""
    return refusal(
        f"arm {text}", ArmError, lambda: open_arm(text), f"robot is '{text}'", part
    )


def share(order, value, name):
    """Return the row of an order with a share of the speed."""

    def call():
        order(SimulatedArm(clock=ManualClock()), value)

    return refusal(f"{name} {value}", ValueError, call, f"{name} is {value}")


def task(second, part):
    """Return the row of a task with a first waypoint `a` and another one."""

    def call():
        waypoints = (Waypoint("a", (0.0,)), Waypoint(second, (0.0, 1.0)))
        Task("t", "r", ("j",), waypoints)

    return refusal(f"second waypoint {second}", ValueError, call, part)


def output(arm, gripper, question, *parts):
    """Return the row of outputs of an arm that cannot show a question."""
    return refusal(
        f"outputs {gripper} and {question} of {arm}",
        ArmError,
        lambda: open_arm(arm, gripper_output=gripper, question_output=question),
        f"output {question} of {arm}",
        *parts,
    )


ROWS = [
    uri("sim:ur10", "allowed is sim:ur5"),
    uri("ur:host", "allowed is ur://HOST"),
    uri("ur://", "allowed is ur://HOST"),
    uri("ur://a/b", "allowed is ur://HOST"),
    uri("udp://a:1", "allowed is sim:ROBOT or ur://HOST"),
    uri("ur5", "allowed is sim:ROBOT or ur://HOST"),
    share(SPEED, 0.0, "speed"),
    share(SPEED, 1.1, "speed"),
    share(SPEED_LIMIT, -0.1, "speed limit"),
    share(SPEED_LIMIT, 1.1, "speed limit"),
    task("a", "a, a"),
    task("b", "'b' has 2"),
    output("ur://127.0.0.1", 0, 0, "0 to 7 except 0, the gripper's"),
    output("ur://127.0.0.1", 5, 5, "0 to 7 except 5, the gripper's"),
    output("ur://127.0.0.1", 0, 8, "0 to 7 except 0"),
    output("ur://127.0.0.1", 0, -1, "0 to 7 except 0"),
    output("sim:ur5", 0, 3, "none, since it has no outputs"),
]


@pytest.mark.parametrize(REFUSALS, ROWS)
def test_wrong_order_to_an_arm_is_refused_in_one_line(error, call, parts):
    check_refusal(error, call, parts)
