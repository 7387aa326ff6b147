"""This module connects to a UR controller, through `ur_rtde` in a process of its own.

The client of `ur_rtde` holds the GIL while it waits, reconnects at any time, and ends
its process where a connection breaks at the wrong moment. None of this may affect the
process that monitors the skin. The module imports little, so that the client's process
starts quickly.
"""

import math
import os
import signal
import sys
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import unique
from multiprocessing import get_context
from multiprocessing.connection import Connection
from time import monotonic
from typing import final

from eskin.reasons import Cause, Reason

PERIOD = 0.008
"""Period of a controller of the first series [s]; later ones interpolate."""
LOOKAHEAD = 0.05
"""Time over which the controller smooths positions [s]."""
GAIN = 300.0
"""Gain with which the controller follows positions; 100 to 2000."""
WATCHDOG_RATE = 10.0
"""Rate of inputs below which the controller ends its program [1/s]."""
ANSWER_TIMEOUT = 0.05
"""Longest time that the controller may take to answer [s]."""
CONNECT_TIMEOUT = 20.0
"""Longest time that the controller may take to connect [s]."""
RETRY_PERIOD = 1.0
"""Time between two attempts to connect [s]."""
UR_OUTPUTS = 8
"""Number of standard digital outputs of a controller."""
VARIABLES = """
    timestamp actual_q robot_mode safety_mode safety_status_bits robot_status_bits
    runtime_state speed_scaling target_speed_fraction actual_digital_output_bits
""".split()


@unique
class LinkProblem(Cause):
    """A problem of a link is why its connection is lost, or not made."""

    INTERFACE_IN_USE = (
        "{error}",
        "switch off EtherNet/IP, PROFINET and MODBUS in the robot's installation, and "
        "end other programs and URCaps that use its RTDE interface",
    )
    PROGRAM_NOT_STARTED = (
        "{error}",
        "switch the robot on, release its brakes, set it to remote control, and end "
        "the program that it runs",
    )
    FAILED_CLIENT = (
        "{error}",
        "check its address and cable, that it is switched on, and that its security "
        "settings allow RTDE, port 30004",
    )
    ENDED_CLIENT = (
        "the client of the robot's controller has ended",
        "connect again; if it ends again, install ur_rtde anew",
    )
    UNREACHABLE = (
        f"its controller has not answered for {CONNECT_TIMEOUT:g} s",
        "check its address and cable, that it is switched on, and that its security "
        "settings allow RTDE, port 30004",
    )
    NO_ANSWER = (
        "the robot's controller does not answer",
        "check its cable, and that it is switched on",
    )
    SILENT_CONTROLLER = (
        "the robot's controller has stopped sending",
        "check its cable, and that it is switched on",
    )
    NOT_FINITE = (
        "it sends numbers that are not finite",
        "restart the robot's controller",
    )


CLIENT_WORDS = {
    "already in use": LinkProblem.INTERFACE_IN_USE,
    "control script": LinkProblem.PROGRAM_NOT_STARTED,
}
"""Words of errors of `ur_rtde`, which differ in nothing but their texts, with what they
mean."""


def name_client_error(error: BaseException) -> Reason:
    """Return which problem an error in the client is."""
    if isinstance(error, ConnectionError):
        return LinkProblem.SILENT_CONTROLLER.reason()
    text = " ".join(f"{error}".split()).rstrip(".") or type(error).__name__
    found = [problem for words, problem in CLIENT_WORDS.items() if words in text]
    problem = found[0] if found else LinkProblem.FAILED_CLIENT
    return problem.reason(error=text)


@dataclass(frozen=True)
class UrCommand:
    """A command that a controller carries out until the next one."""

    q: tuple[float, ...] | None
    """Joint set-points [rad]; None moves nothing."""
    gripper_closed: bool | None
    """Whether the gripper is to be closed; None leaves it as it is."""
    question_shown: bool | None
    """Whether the output of the question is to be on; None leaves it as it is."""


@dataclass(frozen=True)
class UrStatus:
    """A status reports what a controller measures and allows."""

    q: tuple[float, ...]
    """Measured joint positions [rad]."""
    running: bool
    """Whether the program that executes commands runs."""
    protective_stop: bool
    """Whether the robot's safety functions have stopped it."""
    emergency_stop: bool
    """Whether the emergency stop is pressed."""
    scaling: float
    """Fraction of the speed that slider and controller allow, 0 to 1."""
    gripper_closed: bool
    """Whether the digital output of the gripper is on."""

    @property
    def is_finite(self) -> bool:
        """Whether all its numbers are finite."""
        return all(map(math.isfinite, (*self.q, self.scaling)))


class ControllerLink(ABC):
    """Connects to one controller, and again by itself when the connection is lost."""

    problem: Reason | None
    """Why the connection was last lost or not made; None before. A link that is closed
    keeps it."""

    @abstractmethod
    def exchange(self, command: UrCommand) -> UrStatus | None:
        """Send a command; return the robot's status, or None without an answer.

        It never takes longer than a few hundredths of a second.
        """

    @abstractmethod
    def close(self) -> None:
        """Disconnect from the robot, whose program ends."""


def run_client(
    host: str,
    gripper_output: int,
    question_output: int | None,
    time_factor: float,
    pipe: Connection,
) -> None:
    """Run the client of a controller until commands end or it fails.

    Args:
        host: address of the controller.
        gripper_output: standard digital output that closes the gripper.
        question_output: standard digital output that shows a question; None for none.
        time_factor: factor on all timeouts.
        pipe: receives `UrCommand`s; sends `UrStatus`es, or the reason why it failed.
    """
    # The client prints to stdout and stderr, which belong to the main process.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    os.dup2(1, 2)
    # Ctrl-C is for the main process, which stops the robot in an orderly way.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        controller = RtdeController(host, gripper_output, question_output, time_factor)
        pipe.send(controller.status())
        while (command := pipe.recv()) is not None:
            controller.execute(command)
            pipe.send(controller.status())
        controller.stop()
    except EOFError:
        pass
    except BaseException as error:
        pipe.send(name_client_error(error))
    finally:
        # The client's own shutdown may hang or abort.
        os._exit(0)


@final
class RtdeController:
    """This class wraps the three interfaces of `ur_rtde`."""

    def __init__(
        self,
        host: str,
        gripper_output: int,
        question_output: int | None,
        time_factor: float,
    ) -> None:
        """Connect, start the program, and set the watchdog on the robot's side."""
        from rtde_control import RTDEControlInterface
        from rtde_io import RTDEIOInterface
        from rtde_receive import RTDEReceiveInterface

        self.receive = RTDEReceiveInterface(host, -1.0, VARIABLES)
        self.control = RTDEControlInterface(host)
        self.io = RTDEIOInterface(host)
        self.control.setWatchdog(WATCHDOG_RATE / time_factor)
        self.gripper_output = gripper_output
        self.question_output = question_output
        self.timeout = ANSWER_TIMEOUT * time_factor
        self.timestamp = self.receive.getTimestamp()
        self.last_answer = monotonic()

    def execute(self, command: UrCommand) -> None:
        """Send a command; without a running program, only a question's command."""
        if command.question_shown is not None:
            self.show_question(command.question_shown)
        if not self.control.isProgramRunning():
            return
        if command.gripper_closed is not None:
            self.io.setStandardDigitalOut(self.gripper_output, command.gripper_closed)
        if command.q is None:
            self.control.kickWatchdog()
        else:
            self.control.servoJ(list(command.q), 0, 0, PERIOD, LOOKAHEAD, GAIN)

    def show_question(self, shown: bool) -> None:
        """Switch the output of the question, if there is one, unless it is right."""
        output = self.question_output
        if output is not None and self.receive.getDigitalOutState(output) != shown:
            self.io.setStandardDigitalOut(output, shown)

    def status(self) -> UrStatus:
        """Return the status; raise a ConnectionError if the controller is silent."""
        receive = self.receive
        now = monotonic()
        timestamp = receive.getTimestamp()
        if timestamp != self.timestamp:
            self.timestamp = timestamp
            self.last_answer = now
        connected = receive.isConnected() and self.control.isConnected()
        if not connected or now - self.last_answer > self.timeout:
            raise ConnectionError
        return UrStatus(
            q=tuple(receive.getActualQ()),
            running=self.control.isProgramRunning(),
            protective_stop=receive.isProtectiveStopped(),
            emergency_stop=receive.isEmergencyStopped(),
            scaling=min(receive.getTargetSpeedFraction(), receive.getSpeedScaling()),
            gripper_closed=receive.getDigitalOutState(self.gripper_output),
        )

    def stop(self) -> None:
        """Switch the output of the question off, stop the arm and end the program."""
        if self.question_output is not None:
            # The state that was received last may be older than the latest command.
            self.io.setStandardDigitalOut(self.question_output, False)
        self.control.servoStop()
        self.control.stopScript()


@final
class UrLink(ControllerLink):
    """Starts the client's process, and a new one whenever that has ended."""

    def __init__(
        self,
        host: str,
        gripper_output: int,
        time_factor: float = 1.0,
        question_output: int | None = None,
    ) -> None:
        """Start nothing before the first `exchange`.

        Args:
            host: address of the controller.
            gripper_output: standard digital output that closes the gripper.
            time_factor: factor on how long the controller may be silent, and the
                computer before the robot's watchdog stops it; above 1 where both are
                slow, as in tests.
            question_output: standard digital output that shows a question; None for
                none.
        """
        self.host = host
        self.gripper_output = gripper_output
        self.question_output = question_output
        self.time_factor = time_factor
        self.problem: Reason | None = None
        self.context = get_context("spawn")
        self.process = None
        self.ready = False
        self.changed_at = -RETRY_PERIOD

    def exchange(self, command: UrCommand) -> UrStatus | None:
        """Send a command; return the robot's status, or None without an answer."""
        try:
            if self.process is None:
                self.start_client()
                return None
            if not self.ready:
                return self.await_client()
            self.pipe.send(command)
            if not self.pipe.poll(ANSWER_TIMEOUT * self.time_factor):
                return self.disconnect(LinkProblem.NO_ANSWER.reason())
            return self.receive()
        except (OSError, EOFError):
            return self.disconnect(LinkProblem.ENDED_CLIENT.reason())

    def start_client(self) -> None:
        """Start a client, unless one was started just now."""
        if monotonic() - self.changed_at < RETRY_PERIOD:
            return
        self.changed_at = monotonic()
        self.pipe, theirs = self.context.Pipe()
        values = (
            self.host,
            self.gripper_output,
            self.question_output,
            self.time_factor,
            theirs,
        )
        self.process = self.context.Process(target=run_client, args=values, daemon=True)
        self.process.start()
        theirs.close()

    def await_client(self) -> UrStatus | None:
        """Return the first status of a client, or None while it connects."""
        if self.pipe.poll():
            status = self.receive()
            self.ready = status is not None
            return status
        if monotonic() - self.changed_at > CONNECT_TIMEOUT:
            return self.disconnect(LinkProblem.UNREACHABLE.reason())
        return None

    def receive(self) -> UrStatus | None:
        """Receive a status from the client; disconnect where it reports a problem."""
        got = self.pipe.recv()
        return got if isinstance(got, UrStatus) else self.disconnect(got)

    def disconnect(self, problem: Reason) -> None:
        """Keep why the connection is lost, and end the client."""
        self.problem = problem
        self.end_client()

    def end_client(self) -> None:
        """End the client; the robot's own watchdog stops the robot."""
        self.ready = False
        self.changed_at = monotonic()
        if self.process is not None:
            self.pipe.close()
            self.process.kill()
            self.process.join()
            self.process.close()
            self.process = None

    def close(self) -> None:
        """Disconnect from the robot, whose program ends."""
        if self.process is not None and self.ready:
            try:
                self.pipe.send(None)
                self.process.join(1.0)
            except OSError:
                pass
        self.end_client()
