"""Simulated arms: kinematic or dynamic joints that run a task."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import RLock
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.command.arm import Arm, ArmState, JointHistory
from eskin.command.task import FRAME_TASK, Task, TaskExecutor
from eskin.command.trajectory import MotionConfig
from eskin.drivers import Clock, HostClock
from eskin.errors import ArmError
from eskin.robot import Wrench
from eskin.robot.dynamics import Dynamics, ServoConfig
from eskin.units import NS_PER_S

PROTECTIVE_STOP = "protective stop"


class Plant(ABC):
    """The joints of a simulated arm.

    Attributes:
        q: where they are [rad].
        period: time always passes in steps of this length [ns]; in one where None.
        stopped: whether it is in protective stop.
        moving: whether a joint moves, whatever the routine says.
    """

    q: Float[np.ndarray, "joint"]
    period: int | None = None
    stopped: bool = False
    moving: bool = False

    @abstractmethod
    def advance(self, routine: TaskExecutor, seconds: float) -> None:
        """Let time pass, for the routine and the joints."""

    @abstractmethod
    def push(self, wrenches: Sequence[Wrench]) -> None:
        """Be pushed so, and not otherwise, until told anew."""

    @abstractmethod
    def unlock(self) -> None:
        """End a protective stop."""


@final
class KinematicPlant(Plant):
    """Joints that are where they are to be, whatever pushes."""

    def __init__(self, q: Float[np.ndarray, "joint"]) -> None:
        """Stand at joint positions [rad]."""
        self.q = q

    def advance(self, routine: TaskExecutor, seconds: float) -> None:
        """Let time pass, for the routine and the joints."""
        routine.advance(seconds)
        self.q = routine.trajectory.q

    def push(self, wrenches: Sequence[Wrench]) -> None:
        """Nothing moves them."""

    def unlock(self) -> None:
        """They are never in protective stop."""


@dataclass(frozen=True)
class ProtectiveStopConfig:
    """When an arm goes into protective stop.

    A UR5 that is pushed with up to 100 N deviates from its way and stops above that
    (CoRo, ETS Montreal, 2014, on what its end does). With the stiffness of the servos,
    100 N at 0.85 m turn a joint by 0.04 rad.
    """

    deviation: float = 0.05
    """How far a joint may be from its set-point [rad]; as far as the safety system of a
    UR5 lets a joint that is to stand be moved (user manual of CB3, 5.3.1)."""

    seconds: float = 0.1
    """How long a joint may be farther, or at its greatest torque [s]; as long as that
    safety system takes to detect that a joint is out of its limits (5.1)."""

    moving: float = 0.02
    """From which speed on a joint moves [rad/s]."""


@final
class DynamicPlant(Plant):
    """Joints that follow set-points as their servos manage, and yield to a push.

    Where one is held off for too long, all brakes fall in, the routine is held, and
    nothing but `unlock` ends that.

    Attributes:
        dynamics: of the robot.
    """

    def __init__(
        self,
        task: Task = FRAME_TASK,
        servo: ServoConfig | None = None,
        protective: ProtectiveStopConfig | None = None,
    ) -> None:
        """Stand where a task begins.

        Raises:
            RobotError: the task's robot has no masses.
            ExtraError: MuJoCo is not installed.
        """
        begin = np.array(task.waypoints[0].q, np.float64)
        self.dynamics = Dynamics(task.robot_name, begin, servo)
        self.protective = protective or ProtectiveStopConfig()
        self.q = begin
        self.period = round(self.dynamics.config.step * NS_PER_S)
        self.held_off = np.zeros(len(begin))

    def advance(self, routine: TaskExecutor, seconds: float) -> None:
        """Let one step pass, for the routine and the joints."""
        routine.advance(seconds)
        trajectory, dynamics = routine.trajectory, self.dynamics
        if self.stopped:
            trajectory.stand_at(self.q)
        dynamics.step(trajectory.q, trajectory.velocity)
        self.q, speed = dynamics.q, np.abs(dynamics.velocity).max()
        self.moving = bool(speed > self.protective.moving)
        if not self.stopped and self.is_held_off(routine, seconds):
            self.stop(routine)

    def is_held_off(self, routine: TaskExecutor, seconds: float) -> bool:
        """Whether a joint has been too far off, or at its limit, for too long."""
        dynamics, limits = self.dynamics, self.protective
        far = np.abs(routine.trajectory.q - self.q) > limits.deviation
        spent = np.abs(dynamics.torque) >= dynamics.effort
        self.held_off = np.where(far | spent, self.held_off + seconds, 0.0)
        return bool(self.held_off.max() > limits.seconds)

    def stop(self, routine: TaskExecutor) -> None:
        """Go into protective stop."""
        self.stopped = True
        self.dynamics.brake()
        routine.hold(PROTECTIVE_STOP)

    def push(self, wrenches: Sequence[Wrench]) -> None:
        """Be pushed so, and not otherwise, until told anew."""
        self.dynamics.push(wrenches)

    def unlock(self) -> None:
        """End a protective stop; the routine is still held."""
        if self.stopped:
            self.stopped = False
            self.held_off[:] = 0.0
            self.dynamics.release()


HISTORY_SIZE = 2500
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
        self.routine = TaskExecutor(task, motion=motion)
        self.plant = plant or KinematicPlant(self.routine.trajectory.q)
        self.lock = RLock()
        self.time = self.clock.now()
        self.past = JointHistory(self.time, self.plant.q, HISTORY_SIZE)

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
                    f"the arm stays held: {PROTECTIVE_STOP}; allowed is to go on once that is "
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
