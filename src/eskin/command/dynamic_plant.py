"""Joints with masses and servos, and what stops them of itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from eskin.command.plant import STOP, Plant
from eskin.command.routine import Routine
from eskin.command.task import FRAME_TASK, Task
from eskin.robot import Wrench
from eskin.robot.dynamics import Dynamics, ServoConfig
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class ProtectiveConfig:
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
        protective: ProtectiveConfig | None = None,
    ) -> None:
        """Stand where a task begins.

        Raises:
            RobotError: the task's robot has no masses.
            ExtraError: MuJoCo is not installed.
        """
        begin = np.array(task.waypoints[0].q, np.float64)
        self.dynamics = Dynamics(task.robot_name, begin, servo)
        self.protective = protective or ProtectiveConfig()
        self.q = begin
        self.period = round(self.dynamics.config.step * NS_PER_S)
        self.held_off = np.zeros(len(begin))

    def advance(self, routine: Routine, seconds: float) -> None:
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

    def is_held_off(self, routine: Routine, seconds: float) -> bool:
        """Whether a joint has been too far off, or at its limit, for too long."""
        dynamics, limits = self.dynamics, self.protective
        far = np.abs(routine.trajectory.q - self.q) > limits.deviation
        spent = np.abs(dynamics.torque) >= dynamics.effort
        self.held_off = np.where(far | spent, self.held_off + seconds, 0.0)
        return bool(self.held_off.max() > limits.seconds)

    def stop(self, routine: Routine) -> None:
        """Go into protective stop."""
        self.stopped = True
        self.dynamics.brake()
        routine.hold(STOP)

    def push(self, wrenches: Sequence[Wrench]) -> None:
        """Be pushed so, and not otherwise, until told anew."""
        self.dynamics.push(wrenches)

    def unlock(self) -> None:
        """End a protective stop; the routine is still held."""
        if self.stopped:
            self.stopped = False
            self.held_off[:] = 0.0
            self.dynamics.release()
