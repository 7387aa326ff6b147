"""This module commands a robot of Universal Robots."""

import logging
from dataclasses import replace
from enum import unique
from importlib.util import find_spec
from threading import Event as Flag
from threading import RLock, Thread
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.arms.task import FRAME_TASK, Task, TaskArm, TaskExecutor, refuse_release
from eskin.arms.trajectory import MotionConfig
from eskin.arms.ur import (
    PERIOD,
    UR_OUTPUTS,
    ControllerLink,
    LinkProblem,
    UrCommand,
    UrLink,
    UrStatus,
)
from eskin.command.arm import ArmState
from eskin.command.reasons import Problem
from eskin.drivers import Clock, HostClock, JointHistory
from eskin.errors import ArmError
from eskin.reasons import Cause, Reason
from eskin.registry import ArmDriver, advise_install
from eskin.units import NS_PER_S

MAX_FOLLOWING_ERROR = 0.2
"""How far the robot may be from where it is sent [rad]."""
CONNECT_TIMEOUT = 30.0
"""How long the first connection may take [s]."""
logger = logging.getLogger(__name__)


@unique
class UrProblem(Cause):
    """A problem of a UR arm is why it is held, beside those of every arm."""

    NOT_STARTED = ("not started", "release the arm")
    LOST_CONNECTION = ("lost connection: {problem}", "{remedy}")
    EMERGENCY_STOP = ("emergency stop", "unlock it at the robot")
    SLIDER_AT_ZERO = ("speed slider at zero", "set it higher at the robot")
    NOT_FOLLOWING = ("the robot does not follow", "look for what holds it back")
    FAILED_LOOP = ("the arm's loop failed: {error}", "start the command again")


@final
class UrArm(TaskArm):
    """A UR arm sends a robot along its task, position by position.

    The clock of the task runs no faster than the robot's speed slider allows, stops
    while the robot is stopped, and never makes up for time. It begins held: `release`
    starts it. Whatever stops the robot holds the task, and nothing but `release` ends
    that. The speed slider is read and never set.
    """

    def __init__(
        self,
        link: ControllerLink,
        task: Task = FRAME_TASK,
        clock: Clock | None = None,
        motion: MotionConfig | None = None,
        threaded: bool = True,
    ) -> None:
        """Connect, and start from where the robot is.

        Args:
            link: link to the robot's controller; it is closed with the arm.
            task: the task that it runs.
            clock: the clock that it goes by; this computer's unless given.
            motion: its limits of motion.
            threaded: whether a thread updates it; else others call `update`.

        Raises:
            ArmError: the robot cannot be reached, or executes no commands.
        """
        self.name = task.robot_name
        self.joint_names = task.joint_names
        self.clock = clock or HostClock()
        self.link = link
        self.lock = RLock()
        self.closed = Flag()
        self.failure: BaseException | None = None
        self.question_shown = False
        self.status = self.connect()
        self.loss: Reason | None = None
        self.time = self.clock.now()
        self.executor = TaskExecutor(task, np.array(self.status.q), motion)
        self.executor.gripper = "closed" if self.status.gripper_closed else "open"
        self.executor.hold(UrProblem.NOT_STARTED.reason())
        self.history = JointHistory(self.time, np.array(self.status.q))
        self.thread = None
        if threaded:
            self.thread = Thread(target=self.run, name="eskin arm", daemon=True)
            self.thread.start()

    def connect(self) -> UrStatus:
        """Wait for the first status of the robot, and return it.

        Raises:
            ArmError: none comes, or the program that executes commands does not run.
        """
        status = self.await_status()
        if status is not None and status.running:
            return status
        self.link.close()
        if status is not None:
            raise ArmError(
                "the robot is reached, but its program, which executes commands, does "
                "not run; allowed is a UR in remote control without a protective or "
                "emergency stop; clear the stop at the robot, then connect again"
            )
        problem = self.link.problem or LinkProblem.UNREACHABLE.reason()
        raise ArmError(
            f"the robot is not reached ({problem.what}); allowed is a UR in remote "
            f"control that is switched on; {problem.remedy}"
        )

    def await_status(self) -> UrStatus | None:
        """Return the first status of the robot, or None where the link has failed."""
        end = self.clock.now() + round(CONNECT_TIMEOUT * NS_PER_S)
        while self.clock.now() < end and not self.link.problem:
            status, _ = self.exchange(UrCommand(None, None, None))
            if status is not None:
                return status
            self.clock.sleep(PERIOD)
        return None

    def run(self) -> None:
        """Update until it is closed; hold the arm where an update fails."""
        due = self.clock.now()
        while not self.closed.is_set():
            try:
                self.update()
            except BaseException as error:
                logger.exception("the arm's loop has failed")
                self.failure = error
                name = type(error).__name__
                self.hold(UrProblem.FAILED_LOOP.reason(error=name))
                self.link.close()
                return
            now = self.clock.now()
            due = max(due + round(PERIOD * NS_PER_S), now)
            self.closed.wait((due - now) / NS_PER_S)

    def update(self) -> None:
        """Send the robot its set-points, receive its status, and advance the task."""
        with self.lock:
            command = self.build_command()
            ready = self.is_ready()
        status, loss = self.exchange(command)
        with self.lock:
            now = self.clock.now()
            passed = min((now - self.time) / NS_PER_S, 2 * PERIOD)
            self.time = now
            self.loss = loss
            self.status = status or self.status
            problem = self.find_problem()
            if problem is not None:
                self.executor.hold(problem)
            if status is not None:
                self.history.add_positions(now, np.array(status.q))
            if ready and problem is None:
                self.executor.advance(max(passed, 0.0), self.scaling)
            else:
                self.executor.trajectory.restart_from(np.array(self.status.q))

    def exchange(self, command: UrCommand) -> tuple[UrStatus | None, Reason | None]:
        """Send the robot a command; return its status, or why there is none."""
        status = self.link.exchange(command)
        if status is None:
            return None, self.link.problem or LinkProblem.UNREACHABLE.reason()
        if not status.is_finite:
            return None, LinkProblem.NOT_FINITE.reason()
        return status, None

    def build_command(self) -> UrCommand:
        """Return what the robot is to do now."""
        executor = self.executor
        if not self.is_ready():
            return UrCommand(None, None, self.question_shown)
        grip = executor.gripping
        closed = None if grip is None else grip == "closed"
        q = tuple(executor.trajectory.q.tolist())
        return UrCommand(q, closed, self.question_shown)

    def is_ready(self) -> bool:
        """Return whether the robot executes commands."""
        status = self.status
        stopped = status.protective_stop or status.emergency_stop
        return self.loss is None and status.running and not stopped

    @property
    def scaling(self) -> float:
        """Share of speed that the robot allows."""
        return min(max(self.status.scaling, 0.0), 1.0)

    def find_problem(self) -> Reason | None:
        """Return why the robot must not go on, or None where it may."""
        status = self.status
        if self.loss is not None:
            return UrProblem.LOST_CONNECTION.reason(
                problem=self.loss.what, remedy=self.loss.remedy
            )
        if status.emergency_stop:
            return UrProblem.EMERGENCY_STOP.reason()
        if status.protective_stop:
            return Problem.PROTECTIVE_STOP.reason()
        if not status.running:
            return Problem.PROGRAM_ENDED.reason()
        if self.scaling <= 0:
            return UrProblem.SLIDER_AT_ZERO.reason()
        error = np.abs(self.executor.trajectory.q - status.q).max()
        if error <= MAX_FOLLOWING_ERROR:
            return None
        return UrProblem.NOT_FOLLOWING.reason()

    def show_question(self, shown: bool) -> None:
        """Switch the digital output that shows a question, if its link has one."""
        with self.lock:
            self.question_shown = shown

    def catch_up(self) -> None:
        """Do nothing: `update` alone advances the task."""

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the measured joint positions at a time [rad]; the last known."""
        with self.lock:
            return self.history.at(stamp)

    def state(self) -> ArmState:
        """Return the present state."""
        with self.lock:
            status = self.status
            stop = status.protective_stop or status.emergency_stop
            state = self.executor.state(self.time, stop, self.loss is None)
            return replace(state, running=status.running)

    def release(self) -> None:
        """End a hold, and start from where the robot is.

        Raises:
            ArmError: the reason for it is still there, or the arm is closed.
        """
        with self.lock:
            problem = self.find_problem()
            if self.closed.is_set():
                problem = Problem.CLOSED.reason()
            if self.failure is not None:
                problem = UrProblem.FAILED_LOOP.reason(error=self.failure)
            if problem is not None:
                refuse_release(problem)
            if self.executor.trajectory.stopped:
                self.executor.trajectory.restart_from(np.array(self.status.q))
            self.executor.release()

    def close(self) -> None:
        """Stop, and disconnect from the robot; may be called twice."""
        self.hold(Problem.CLOSED.reason())
        if self.thread is not None and not self.closed.is_set():
            self.stop_smoothly()
        self.closed.set()
        if self.thread is not None:
            self.thread.join()
        self.link.close()

    def stop_smoothly(self) -> None:
        """Wait until the arm is at rest, as long as a stop takes."""
        end = self.clock.now() + NS_PER_S // 2
        while self.state().moving and self.clock.now() < end:
            self.clock.sleep(PERIOD)


def open_ur_arm(
    uri: str,
    clock: Clock | None,
    gripper_output: int,
    question_output: int | None,
) -> UrArm:
    """Open the arm of a UR controller, which works on the frame task.

    Raises:
        ArmError: the URI has no host, ur_rtde is missing, or nothing answers there.
    """
    rest = uri.partition(":")[2]
    host = rest.removeprefix("//")
    if not rest.startswith("//") or not host or "/" in host:
        raise ArmError(
            f"robot is '{uri}'; allowed is ur://HOST, such as ur://192.168.1.10"
        )
    if find_spec("rtde_control") is None:
        raise ArmError(
            f"robot is '{uri}', but ur_rtde is missing; allowed is with it installed; "
            + advise_install("ur")
        )
    link = UrLink(host, gripper_output, question_output=question_output)
    return UrArm(link, FRAME_TASK, clock)


DRIVER = ArmDriver(open_ur_arm, "ur://HOST", outputs=UR_OUTPUTS)
"""Driver of UR arms, as its entry point names it."""
