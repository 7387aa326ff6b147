"""This module simulates an arm at its task, with kinematic or dynamic joints."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import RLock
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.arms.dynamics import Dynamics, ServoConfig, Wrench
from eskin.arms.task import FRAME_TASK, Task, TaskArm, TaskExecutor, refuse_release
from eskin.arms.trajectory import MotionConfig
from eskin.command.arm import ArmState
from eskin.command.reasons import Problem
from eskin.drivers import Clock, HostClock, JointHistory
from eskin.errors import ArmError
from eskin.registry import ArmDriver
from eskin.units import NS_PER_S

HISTORY_SIZE = 2500
"""Number of joint positions that are kept."""


class Plant(ABC):
    """A plant moves the joints of a simulated arm along the executor's set-points.

    Attributes:
        q: present joint positions [rad].
        period: step in which time advances [ns]; any step where None.
        stopped: whether it is in protective stop.
        moving: whether a joint moves, whatever the executor says.
    """

    q: Float[np.ndarray, "joint"]
    period: int | None = None
    stopped: bool = False
    moving: bool = False

    @abstractmethod
    def advance(self, executor: TaskExecutor, seconds: float) -> None:
        """Advance the executor and the joints by a time [s]."""

    @abstractmethod
    def apply_wrenches(self, wrenches: Sequence[Wrench]) -> None:
        """Apply these wrenches, and no others, until the next call."""

    @abstractmethod
    def unlock(self) -> None:
        """End a protective stop."""


@final
class KinematicPlant(Plant):
    """A kinematic plant puts its joints exactly at the set-points, whatever pushes."""

    def __init__(self, q: Float[np.ndarray, "joint"]) -> None:
        """Stand at joint positions [rad]."""
        self.q = q

    def advance(self, executor: TaskExecutor, seconds: float) -> None:
        """Advance the executor and the joints by a time [s]."""
        executor.advance(seconds)
        self.q = executor.trajectory.q

    def apply_wrenches(self, wrenches: Sequence[Wrench]) -> None:
        """Ignore wrenches: nothing moves these joints."""

    def unlock(self) -> None:
        """Do nothing: it is never in protective stop."""


@dataclass(frozen=True)
class ProtectiveStopConfig:
    """A protective-stop configuration says when an arm goes into protective stop.

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
    """Speed above which a joint moves [rad/s]."""


@final
class DynamicPlant(Plant):
    """A dynamic plant has masses and servos; it follows set-points and yields.

    Where a joint is overloaded for too long, all brakes engage, the executor is held,
    and nothing but `unlock` ends that.

    Attributes:
        dynamics: dynamics of the robot.
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
        start = np.array(task.waypoints[0].q, np.float64)
        self.dynamics = Dynamics(task.robot_name, start, servo)
        self.protective = protective or ProtectiveStopConfig()
        self.q = start
        self.period = round(self.dynamics.config.step * NS_PER_S)
        self.overload_seconds = np.zeros(len(start))

    def advance(self, executor: TaskExecutor, seconds: float) -> None:
        """Advance the executor and the joints by one step [s]."""
        executor.advance(seconds)
        trajectory = executor.trajectory
        dynamics = self.dynamics
        if self.stopped:
            trajectory.restart_from(self.q)
        dynamics.step(trajectory.q, trajectory.velocity)
        self.q = dynamics.q
        speed = np.abs(dynamics.velocity).max()
        self.moving = bool(speed > self.protective.moving)
        if not self.stopped and self.is_overloaded(executor, seconds):
            self.stop(executor)

    def is_overloaded(self, executor: TaskExecutor, seconds: float) -> bool:
        """Return whether a joint is too far off, or at its limit, for too long."""
        dynamics = self.dynamics
        limits = self.protective
        far = np.abs(executor.trajectory.q - self.q) > limits.deviation
        at_limit = np.abs(dynamics.torque) >= dynamics.effort
        longer = self.overload_seconds + seconds
        self.overload_seconds = np.where(far | at_limit, longer, 0.0)
        return bool(self.overload_seconds.max() > limits.seconds)

    def stop(self, executor: TaskExecutor) -> None:
        """Go into protective stop."""
        self.stopped = True
        self.dynamics.engage_brakes()
        executor.hold(Problem.PROTECTIVE_STOP.reason())

    def apply_wrenches(self, wrenches: Sequence[Wrench]) -> None:
        """Apply these wrenches, and no others, until the next call."""
        self.dynamics.apply_wrenches(wrenches)

    def unlock(self) -> None:
        """End a protective stop; the executor is still held."""
        if self.stopped:
            self.stopped = False
            self.overload_seconds[:] = 0.0
            self.dynamics.release_brakes()


@final
class SimulatedArm(TaskArm):
    """A simulated arm runs its task on any clock, within the limits of motion.

    Its joints are exactly at the set-points, or where its plant moves them. It has no
    thread: whenever it is asked or told something, the time since then passes first.
    What it does depends on what it is told and when, never on who looks.
    """

    def __init__(
        self,
        task: Task = FRAME_TASK,
        clock: Clock | None = None,
        motion: MotionConfig | None = None,
        plant: Plant | None = None,
    ) -> None:
        """Start with the task at once.

        Args:
            task: the task that it runs.
            clock: the clock that it goes by; this computer's unless given.
            motion: its limits of motion.
            plant: its joints; kinematic ones unless given.
        """
        self.name = task.robot_name
        self.joint_names = task.joint_names
        self.clock = clock or HostClock()
        self.executor = TaskExecutor(task, motion=motion)
        self.plant = plant or KinematicPlant(self.executor.trajectory.q)
        self.lock = RLock()
        self.time = self.clock.now()
        self.history = JointHistory(self.time, self.plant.q, HISTORY_SIZE)

    def catch_up(self, stamp: int | None = None) -> None:
        """Advance to a stamp [ns since the epoch]; to the present where None."""
        stamp = self.clock.now() if stamp is None else stamp
        period = self.plant.period or max(stamp - self.time, 1)
        while self.time + period <= stamp:
            self.plant.advance(self.executor, period / NS_PER_S)
            self.time += period
            self.history.add_positions(self.time, self.plant.q)

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the joint positions at a time [rad], interpolated between updates."""
        with self.lock:
            self.catch_up(stamp)
            return self.history.at(stamp)

    def state(self) -> ArmState:
        """Return the present state."""
        with self.present_executor() as executor:
            state = executor.state(self.time, self.plant.stopped)
            moving = state.moving or self.plant.moving
            return replace(state, q=self.plant.q, moving=moving)

    def apply_wrenches(self, wrenches: Sequence[Wrench]) -> None:
        """Apply these wrenches, and no others, until the next call."""
        with self.present_executor():
            self.plant.apply_wrenches(wrenches)

    def unlock(self) -> None:
        """End a protective stop, as a person does at the robot; it stays held."""
        with self.present_executor():
            self.plant.unlock()

    def release(self) -> None:
        """End a hold.

        Raises:
            ArmError: it is in protective stop.
        """
        with self.present_executor() as executor:
            if self.plant.stopped:
                refuse_release(Problem.PROTECTIVE_STOP.reason())
            executor.release()

    def close(self) -> None:
        """Stop for good."""
        self.hold(Problem.CLOSED.reason())


def open_simulated_arm(
    uri: str, clock: Clock | None, gripper_output: int
) -> SimulatedArm:
    """Open the simulated arm of the frame task, which has no outputs.

    Raises:
        ArmError: the task is for another robot.
    """
    if uri != f"sim:{FRAME_TASK.robot_name}":
        raise ArmError(
            f"robot is '{uri}'; allowed is sim:{FRAME_TASK.robot_name}, whose task "
            "this is"
        )
    return SimulatedArm(FRAME_TASK, clock)


DRIVER = ArmDriver(open_simulated_arm, "sim:ROBOT", is_real=False)
"""Driver of simulated arms, as its entry point names it."""
