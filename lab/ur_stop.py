"""Measure how soon a UR is at rest after a fault.

    python -m lab.ur_stop [--times N]

The real client of `ur_rtde` talks to a stand-in controller on loopback, which moves
within the limits of a UR5. Each fault is injected while the arm moves at full speed.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import tyro

from eskin.arms import FRAME_TASK, MotionConfig, Task, UrArm, Waypoint
from eskin.arms.ur import UrLink
from eskin.command import (
    CommandMap,
    Policy,
    PolicyConfig,
    Problem,
    Rule,
    SkinMonitorConfig,
)
from eskin.drivers import SourceInfo
from eskin.errors import ArmError
from eskin.skin import mount_skin
from eskin.stream import Context
from eskin.touch import Calibration
from lab.ur_stand_in import StandIn

ASKED = Problem.TOLD.reason(text="asked")
"""Why an arm is held that is asked to."""

FAR = Task(
    "to and fro",
    "ur5",
    FRAME_TASK.joint_names,
    (
        Waypoint("right", (-2.5, -1.56, 1.693, -1.703, -1.571, 0.0)),
        Waypoint("left", (2.5, -1.56, 1.693, -1.703, -1.571, 0.0)),
    ),
)
STANDING = 0.01
"""Speed below which a joint is at rest [rad/s]."""


@dataclass(frozen=True)
class Command:
    """Inject faults while an arm moves, and measure how soon it stops."""

    times: int = 20
    """Number of times that each fault is injected."""
    time_factor: float = 1.0
    """Factor on how long controller and computer may be silent; above 1 on a computer
    that is too busy for the robot's watchdog, where stops by it take as much longer."""


def main() -> None:
    """Measure and print."""
    command = tyro.cli(Command)
    print("fault                     held p50  max   stands p50  max  [ms]")
    with StandIn(FAR.waypoints[0].q) as stand_in:
        with UrArm(UrLink(stand_in.host, 0, command.time_factor), FAR) as arm:
            for name, (inject, remove) in faults(stand_in, arm).items():
                rows = [
                    measure_fault(stand_in, arm, inject, remove)
                    for _ in range(command.times)
                ]
                held, stands = 1e3 * np.array(rows).T
                print(
                    f"{name:25} {np.median(held):8.0f} {held.max():4.0f} "
                    f"{np.median(stands):11.0f} {stands.max():4.0f}",
                    flush=True,
                )


def faults(
    stand_in: StandIn, arm: UrArm
) -> dict[str, tuple[Callable[[], Any], Callable[[], Any]]]:
    """List the functions that inject and remove each fault."""

    def order(name: str, value: object) -> Callable[[], Any]:
        return lambda: stand_in.order(name, value)

    watching: list[Policy] = []

    def kill_client() -> None:
        arm.link.process.kill()  # pyright: ignore[reportAttributeAccessIssue]

    return {
        "connection closed": (order("hang_up", True), order("come_back", True)),
        "connection mute": (order("mute", True), order("mute", False)),
        "client killed": (kill_client, lambda: None),
        "protective stop": (order("protective", True), order("protective", False)),
        "speed slider at zero": (order("slider", 0.0), order("slider", 1.0)),
        "stale skin": (
            lambda: watching.append(watch(arm)),
            lambda: watching.pop().close(),
        ),
        "asked to hold": (lambda: arm.hold(ASKED), lambda: None),
    }


def watch(arm: UrArm) -> Policy:
    """Start a policy that monitors a silent skin, which becomes stale."""
    mounted = mount_skin("ur5")
    calibration = Calibration.uniform(mounted.skin.count, 4095, 100.0)
    info = SourceInfo("sim:none", mounted, calibration, 50.0)
    rules = CommandMap(commands=[Rule(gesture="poke", action="pause")])
    policy = Policy(arm, rules, ("none", "poke"), PolicyConfig(SkinMonitorConfig()))
    policy.start(Context(info, arm.clock, lambda item: None))
    # From here the newest reading is as old as it may be.
    policy.monitor.latest -= 100_000_000
    return policy


def measure_fault(
    stand_in: StandIn,
    arm: UrArm,
    inject: Callable[[], Any],
    remove: Callable[[], Any],
) -> tuple[float, float]:
    """Measure the time from a fault to the hold, and to rest [s]."""
    release_at_full_speed(stand_in, arm)
    began = time.monotonic()
    inject()
    wait_until(lambda: arm.state().hold_reason is not None)
    held = time.monotonic() - began
    wait_until(lambda: np.abs(stand_in.ask("qd")).max() < STANDING)
    stands = time.monotonic() - began
    remove()
    return held, stands


def release_at_full_speed(stand_in: StandIn, arm: UrArm) -> None:
    """Wait until the arm moves at full speed; release it meanwhile where it is held."""
    full = 0.9 * MotionConfig().speed
    while np.abs(stand_in.ask("qd")).max() < full:
        if arm.state().hold_reason is not None:
            wait_until(lambda: arm.find_problem() is None)
            time.sleep(0.3)
            with suppress(ArmError):
                arm.release()
        time.sleep(0.01)


def wait_until(true: Callable[[], Any]) -> None:
    """Wait until a condition is true."""
    end = time.monotonic() + 60
    while not true():
        if time.monotonic() > end:
            raise TimeoutError("the condition was not met within 60 s")
        time.sleep(0.001)


if __name__ == "__main__":
    main()
