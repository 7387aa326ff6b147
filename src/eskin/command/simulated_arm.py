"""An arm that only exists as numbers."""

from collections.abc import Sequence
from dataclasses import replace
from threading import RLock
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.command.arm import Arm, ArmState
from eskin.command.joint_history import JointHistory
from eskin.command.plant import STOP, KinematicPlant, Plant
from eskin.command.routine import Routine
from eskin.command.task import FRAME_TASK, Task
from eskin.command.trajectory import MotionConfig
from eskin.drivers import Clock, HostClock
from eskin.errors import ArmError
from eskin.robot import Wrench
from eskin.units import NS_PER_S

KEPT = 2500
"""Joint positions that are kept."""


@final
class SimulatedArm(Arm):
    """Goes where its task takes it, on any clock, within the limits of motion.

    It goes there exactly, or as its plant does. It has no thread: whenever it is asked
    or told something, the time since then passes first. What it does depends on what it
    is told and when, never on who looks.
    """

    def __init__(
        self,
        task: Task = FRAME_TASK,
        clock: Clock | None = None,
        motion: MotionConfig | None = None,
        plant: Plant | None = None,
    ) -> None:
        """Begin with the task at once.

        Args:
            task: what it does.
            clock: it goes by; this computer's unless given.
            motion: how fast it goes.
            plant: its joints; they go exactly where they are to be unless given.
        """
        self.name = task.robot_name
        self.joint_names = task.joint_names
        self.clock = clock or HostClock()
        self.routine = Routine(task, motion=motion)
        self.plant = plant or KinematicPlant(self.routine.trajectory.q)
        self.lock = RLock()
        self.time = self.clock.now()
        self.past = JointHistory(self.time, self.plant.q, KEPT)

    def catch_up(self, stamp: int | None = None) -> None:
        """Let the time until a stamp pass, until now where None."""
        stamp = self.clock.now() if stamp is None else stamp
        period = self.plant.period or max(stamp - self.time, 1)
        while self.time + period <= stamp:
            self.plant.advance(self.routine, period / NS_PER_S)
            self.time += period
            self.past.add(self.time, self.plant.q)

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Joint positions at a time [rad]; between those it was asked for, a line."""
        with self.lock:
            self.catch_up(stamp)
            return self.past.at(stamp)

    def state(self) -> ArmState:
        """What it does now."""
        with self.lock:
            self.catch_up()
            state = self.routine.state(self.time, self.plant.stopped)
            moving = state.moving or self.plant.moving
            return replace(state, q=self.plant.q, moving=moving)

    def push(self, wrenches: Sequence[Wrench]) -> None:
        """Be pushed so, and not otherwise, until told anew."""
        with self.lock:
            self.catch_up()
            self.plant.push(wrenches)

    def unlock(self) -> None:
        """End a protective stop, as a person does at the robot; it stays held."""
        with self.lock:
            self.catch_up()
            self.plant.unlock()

    def pause(self) -> None:
        """Stop, because a person wants it."""
        with self.lock:
            self.catch_up()
            self.routine.pause()

    def resume(self) -> None:
        """End a pause: speed up from where it stands."""
        with self.lock:
            self.catch_up()
            self.routine.resume()

    def hold(self, why: str) -> None:
        """Stop, though nobody asked for it; the first reason is kept."""
        with self.lock:
            self.catch_up()
            self.routine.hold(why)

    def release(self) -> None:
        """End a hold.

        Raises:
            ArmError: it is in protective stop.
        """
        with self.lock:
            self.catch_up()
            if self.plant.stopped:
                raise ArmError(
                    f"the arm stays held: {STOP}; allowed is to go on once that is "
                    "over; unlock the arm, then release it again"
                )
            self.routine.release()

    def next_waypoint(self) -> None:
        """Go to the next waypoint from where it is."""
        with self.lock:
            self.catch_up()
            self.routine.next_waypoint()

    def previous_waypoint(self) -> None:
        """Go back to the waypoint before, then on as the task says."""
        with self.lock:
            self.catch_up()
            self.routine.previous_waypoint()

    def jog(self, step_world: Float[np.ndarray, "3"]) -> None:
        """Move the tool a step [m] while paused, turned as it is, and stay paused."""
        with self.lock:
            self.catch_up()
            self.routine.jog(step_world)

    def open_gripper(self) -> None:
        """Open the gripper; the arm stands meanwhile."""
        with self.lock:
            self.catch_up()
            self.routine.grip("open")

    def close_gripper(self) -> None:
        """Close the gripper; the arm stands meanwhile."""
        with self.lock:
            self.catch_up()
            self.routine.grip("closed")

    def set_speed(self, share: float) -> None:
        """Go at a share of full speed from now on."""
        with self.lock:
            self.catch_up()
            self.routine.set_speed(share)

    def close(self) -> None:
        """Stop for good."""
        self.hold("closed")
