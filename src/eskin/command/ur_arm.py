"""A robot of Universal Robots at its task."""

import logging
from threading import Event as Flag
from threading import RLock, Thread
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.command.arm import Arm, ArmState, JointHistory
from eskin.command.task import FRAME_TASK, Task, TaskExecutor
from eskin.command.trajectory import MotionConfig
from eskin.drivers import Clock, HostClock
from eskin.errors import ArmError
from eskin.units import NS_PER_S
from eskin.ur import PERIOD, ControllerLink, UrCommand, UrStatus

MAX_FOLLOWING_ERROR = 0.2
"""How far the robot may be from where it is sent [rad]."""
CONNECT_TIMEOUT = 30.0
"""How long the first connection may take [s]."""
NOT_STARTED = "not started"
logger = logging.getLogger(__name__)


@final
class UrArm(Arm):
    """Sends a UR along its task, position by position, on a clock that waits for it.

    The clock of the task runs no faster than the robot's speed slider allows, stands
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
        """Connect, and stand where the robot stands.

        Args:
            link: to the robot's controller; it is closed with the arm.
            task: what it does.
            clock: it goes by; this computer's unless given.
            motion: how fast it goes.
            threaded: whether it goes by itself; else `tick` is called by others.

        Raises:
            ArmError: the robot cannot be reached.
        """
        self.name = task.robot_name
        self.joint_names = task.joint_names
        self.clock = clock or HostClock()
        self.link = link
        self.lock = RLock()
        self.closed = Flag()
        self.failure: BaseException | None = None
        self.status = self.connect()
        self.connected = True
        self.time = self.clock.now()
        self.routine = TaskExecutor(task, np.array(self.status.q), motion)
        self.routine.gripper = "closed" if self.status.closed else "open"
        self.routine.hold(NOT_STARTED)
        self.past = JointHistory(self.time, np.array(self.status.q))
        self.thread = None
        if threaded:
            self.thread = Thread(target=self.run, name="eskin arm", daemon=True)
            self.thread.start()

    def connect(self) -> UrStatus:
        """The first word of the robot."""
        end = self.clock.now() + round(CONNECT_TIMEOUT * NS_PER_S)
        while self.clock.now() < end:
            status = self.link.exchange(UrCommand(None, None))
            if status is not None:
                return status
            if self.link.why:
                break
            self.clock.sleep(PERIOD)
        self.link.close()
        raise ArmError(
            f"the robot is not reached ({self.link.why or 'it says nothing'}); allowed "
            "is a UR in remote control that is switched on; check its address and cable"
        )

    def run(self) -> None:
        """Tick until it is closed; what goes wrong holds the arm."""
        due = self.clock.now()
        while not self.closed.is_set():
            try:
                self.tick()
            except BaseException as error:
                logger.exception("the arm's loop has failed")
                self.failure = error
                self.hold(f"the arm's loop failed: {type(error).__name__}")
                self.link.close()
                return
            now = self.clock.now()
            due = max(due + round(PERIOD * NS_PER_S), now)
            self.closed.wait((due - now) / NS_PER_S)

    def tick(self) -> None:
        """Let time pass: tell the robot where to be, and hear where it is."""
        with self.lock:
            order, obeyed = self.order(), self.obeys()
        status = self.link.exchange(order)
        with self.lock:
            now = self.clock.now()
            passed = min((now - self.time) / NS_PER_S, 2 * PERIOD)
            self.time = now
            self.connected = status is not None
            self.status = status or self.status
            trouble = self.trouble()
            if trouble is not None:
                self.routine.hold(trouble)
            if status is not None:
                self.past.add(now, np.array(status.q))
            if obeyed and self.obeys() and self.scaling > 0:
                self.routine.advance(max(passed, 0.0), self.scaling)
            else:
                self.routine.trajectory.stand_at(np.array(self.status.q))

    def order(self) -> UrCommand:
        """What the robot is to do now."""
        routine = self.routine
        if not self.obeys():
            return UrCommand(None, None)
        closed = None if routine.gripping is None else routine.gripping == "closed"
        return UrCommand(tuple(routine.trajectory.q.tolist()), closed)

    def obeys(self) -> bool:
        """Whether the robot does what it is told."""
        status = self.status
        stopped = status.protective_stop or status.emergency_stop
        return self.connected and status.running and not stopped

    @property
    def scaling(self) -> float:
        """Share of speed that the robot allows."""
        return min(max(self.status.scaling, 0.0), 1.0)

    def trouble(self) -> str | None:
        """Why the robot must not go on; None where it may."""
        status = self.status
        if not self.connected:
            return "lost connection"
        if status.emergency_stop:
            return "emergency stop"
        if status.protective_stop:
            return "protective stop"
        if not status.running:
            return "the robot's program has ended"
        if self.scaling <= 0:
            return "speed slider at zero"
        if np.abs(self.routine.trajectory.q - status.q).max() > MAX_FOLLOWING_ERROR:
            return "the robot does not follow"
        return None

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Joint positions at a time [rad], as the robot tells them; the last known."""
        with self.lock:
            return self.past.at(stamp)

    def state(self) -> ArmState:
        """What it does now."""
        with self.lock:
            status = self.status
            stop = status.protective_stop or status.emergency_stop
            return self.routine.state(self.time, stop, self.connected)

    def pause(self) -> None:
        """Stop, because a person wants it."""
        with self.lock:
            self.routine.pause()

    def resume(self) -> None:
        """End a pause: speed up from where it stands."""
        with self.lock:
            self.routine.resume()

    def hold(self, why: str) -> None:
        """Stop, though nobody asked for it; the first reason is kept."""
        with self.lock:
            self.routine.hold(why)

    def release(self) -> None:
        """End a hold, and start from where the robot stands.

        Raises:
            ArmError: the reason for it is still there, or the arm is closed.
        """
        with self.lock:
            trouble = "closed" if self.closed.is_set() else self.trouble()
            if self.failure is not None:
                trouble = f"the arm's loop failed: {self.failure}"
            if trouble is not None:
                raise ArmError(
                    f"the arm stays held: {trouble}; allowed is to go on once that is "
                    "over; see to it at the robot, then release the arm again"
                )
            if self.routine.trajectory.stands:
                self.routine.trajectory.stand_at(np.array(self.status.q))
            self.routine.release()

    def next_waypoint(self) -> None:
        """Go to the next waypoint from where it is."""
        with self.lock:
            self.routine.next_waypoint()

    def previous_waypoint(self) -> None:
        """Go back to the waypoint before, then on as the task says."""
        with self.lock:
            self.routine.previous_waypoint()

    def jog(self, step_world: Float[np.ndarray, "3"]) -> None:
        """Move the tool a step [m] while paused, turned as it is, and stay paused."""
        with self.lock:
            self.routine.jog(step_world)

    def open_gripper(self) -> None:
        """Open the gripper; the arm stands meanwhile."""
        with self.lock:
            self.routine.grip("open")

    def close_gripper(self) -> None:
        """Close the gripper; the arm stands meanwhile."""
        with self.lock:
            self.routine.grip("closed")

    def set_speed(self, share: float) -> None:
        """Go at a share of full speed from now on."""
        with self.lock:
            self.routine.set_speed(share)

    def close(self) -> None:
        """Stop and let the robot go; may be called twice."""
        self.hold("closed")
        if self.thread is not None and not self.closed.is_set():
            self.stop_smoothly()
        self.closed.set()
        if self.thread is not None:
            self.thread.join()
        self.link.close()

    def stop_smoothly(self) -> None:
        """Wait until the arm stands, as long as a stop takes."""
        end = self.clock.now() + NS_PER_S // 2
        while self.state().moving and self.clock.now() < end:
            self.clock.sleep(PERIOD)
