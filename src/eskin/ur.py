"""ControllerLink to a UR controller."""

import os
import signal
import sys
from abc import ABC, abstractmethod
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from time import monotonic
from typing import final


@dataclass(frozen=True)
class UrCommand:
    """What a controller is to do until it hears more."""

    q: tuple[float, ...] | None
    """Joint positions to be at [rad]; None moves nothing."""

    closed: bool | None
    """Whether the gripper is to be closed; None leaves it as it is."""


@dataclass(frozen=True)
class UrStatus:
    """What a controller says."""

    q: tuple[float, ...]
    """Joint positions [rad]."""

    running: bool
    """Whether the program runs that obeys orders."""

    protective_stop: bool
    """Whether the robot's safety functions have stopped it."""

    emergency_stop: bool
    """Whether somebody has."""

    scaling: float
    """Share of speed that slider and controller allow, 0 to 1."""

    closed: bool
    """Whether the output of the gripper is on."""


class ControllerLink(ABC):
    """Reaches one controller; lost, it tries again by itself.

    Attributes:
        why: what was wrong when it was last lost; empty before.
    """

    why: str

    @abstractmethod
    def exchange(self, order: UrCommand) -> UrStatus | None:
        """Give an order; what the robot says, or None where it is not heard.

        Takes no more than a few hundredths of a second, whatever happens.
        """

    @abstractmethod
    def close(self) -> None:
        """Let the robot go; its program ends."""


PERIOD = 0.008
"""Of a controller of the first series [s]; later ones interpolate."""
LOOKAHEAD = 0.05
"""Over which the controller smooths positions [s]."""
GAIN = 300.0
"""With which it follows them; 100 to 2000."""
WATCHDOG = 10.0
"""Inputs a second below which the controller ends its program [1/s]."""
ANSWER = 0.05
"""How long the controller may take to answer [s]."""
OPENING = 20.0
"""How long it may take to connect [s]."""
AGAIN = 1.0
"""Until the next try [s]."""
VARIABLES = [
    "timestamp",
    "actual_q",
    "robot_mode",
    "safety_mode",
    "safety_status_bits",
    "robot_status_bits",
    "runtime_state",
    "speed_scaling",
    "target_speed_fraction",
    "actual_digital_output_bits",
]


def serve(host: str, output: int, patience: float, orders: Connection) -> None:
    """Be the client of a controller: obey orders until they end or something breaks.

    Args:
        host: of the controller.
        output: standard digital output that closes the gripper.
        patience: times as long as usual everything may take.
        orders: gives `UrCommand`s and takes `UrStatus`es, or a text: what broke.
    """
    # The client prints where it likes; the terminal belongs to others.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    os.dup2(1, 2)
    # Ctrl-C is for the other process, which lets the robot go in good order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        controller = Controller(host, output, patience)
        orders.send(controller.status())
        while (order := orders.recv()) is not None:
            controller.obey(order)
            orders.send(controller.status())
        controller.stop()
    except EOFError:
        pass
    except BaseException as error:
        orders.send(" ".join(f"{error}".split()) or type(error).__name__)
    finally:
        # The client's own end may hang or abort.
        os._exit(0)


@final
class Controller:
    """The three interfaces of `ur_rtde` as one."""

    def __init__(self, host: str, output: int, patience: float) -> None:
        """Connect, start the program, and set the watchdog on the robot's side."""
        from rtde_control import RTDEControlInterface
        from rtde_io import RTDEIOInterface
        from rtde_receive import RTDEReceiveInterface

        self.receive = RTDEReceiveInterface(host, -1.0, VARIABLES)
        self.control = RTDEControlInterface(host)
        self.io = RTDEIOInterface(host)
        self.control.setWatchdog(WATCHDOG / patience)
        self.output = output
        self.silence = ANSWER * patience
        self.time = self.receive.getTimestamp()
        self.heard = monotonic()

    def obey(self, order: UrCommand) -> None:
        """Pass on an order; nothing is sent to a program that does not run."""
        if not self.control.isProgramRunning():
            return
        if order.closed is not None:
            self.io.setStandardDigitalOut(self.output, order.closed)
        if order.q is None:
            self.control.kickWatchdog()
        else:
            self.control.servoJ(list(order.q), 0, 0, PERIOD, LOOKAHEAD, GAIN)

    def status(self) -> UrStatus:
        """What the controller says.

        Raises:
            ConnectionError: it says nothing more.
        """
        receive, now = self.receive, monotonic()
        time = receive.getTimestamp()
        if time != self.time:
            self.time, self.heard = time, now
        connected = receive.isConnected() and self.control.isConnected()
        if not connected or now - self.heard > self.silence:
            raise ConnectionError("the robot's controller is not heard any more")
        return UrStatus(
            q=tuple(receive.getActualQ()),
            running=self.control.isProgramRunning(),
            protective_stop=receive.isProtectiveStopped(),
            emergency_stop=receive.isEmergencyStopped(),
            scaling=min(receive.getTargetSpeedFraction(), receive.getSpeedScaling()),
            closed=receive.getDigitalOutState(self.output),
        )

    def stop(self) -> None:
        """Stop the arm and end the program."""
        self.control.servoStop()
        self.control.stopScript()


@final
class UrLink(ControllerLink):
    """Starts the client's process, and a new one whenever that is gone."""

    def __init__(self, host: str, output: int, patience: float = 1.0) -> None:
        """Nothing is started before the first `exchange`.

        Args:
            host: of the controller.
            output: standard digital output that closes the gripper.
            patience: times as long as usual the controller may be silent, and the
                computer before the robot's watchdog stops it; above 1 where neither
                keeps time, as in tests.
        """
        self.host = host
        self.output = output
        self.patience = patience
        self.why = ""
        self.context = get_context("spawn")
        self.process = None
        self.ready = False
        self.since = -AGAIN

    def exchange(self, order: UrCommand) -> UrStatus | None:
        """Give an order; what the robot says, or None where it is not heard."""
        try:
            if self.process is None:
                self.begin()
                return None
            if not self.ready:
                return self.first()
            self.pipe.send(order)
            if not self.pipe.poll(ANSWER * self.patience):
                return self.lose("the robot's controller does not answer")
            return self.answer()
        except (OSError, EOFError):
            return self.lose("the client of the robot's controller has ended")

    def begin(self) -> None:
        """Start a client, unless one was started just now."""
        if monotonic() - self.since < AGAIN:
            return
        self.since = monotonic()
        self.pipe, theirs = self.context.Pipe()
        values = (self.host, self.output, self.patience, theirs)
        self.process = self.context.Process(target=serve, args=values, daemon=True)
        self.process.start()
        theirs.close()

    def first(self) -> UrStatus | None:
        """The first word of a client that is connecting."""
        if self.pipe.poll():
            status = self.answer()
            self.ready = status is not None
            return status
        if monotonic() - self.since > OPENING:
            return self.lose("the robot's controller cannot be reached")
        return None

    def answer(self) -> UrStatus | None:
        """What has come from the client."""
        got = self.pipe.recv()
        return got if isinstance(got, UrStatus) else self.lose(str(got))

    def lose(self, why: str) -> None:
        """End the client; the robot's own watchdog stops the robot."""
        self.why, self.ready, self.since = why, False, monotonic()
        if self.process is not None:
            self.pipe.close()
            self.process.kill()
            self.process.join()
            self.process.close()
            self.process = None

    def close(self) -> None:
        """Let the robot go; its program ends."""
        if self.process is not None and self.ready:
            try:
                self.pipe.send(None)
                self.process.join(1.0)
            except OSError:
                pass
        self.lose("closed")
