"""This module provides the joint positions of a robot: fixed, called for, or by UDP."""

import json
import threading
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import final

import numpy as np
from jaxtyping import Bool, Float

from eskin.drivers.clock import Clock, HostClock
from eskin.drivers.events import EventLog
from eskin.drivers.udp_transport import PEER_TIMEOUT, bind_udp
from eskin.errors import DeviceError, JointsError
from eskin.progress import Closing
from eskin.robot import Robot
from eskin.units import NS_PER_S

MAX_AGE = 0.1
"""Age from which joint positions are not used any more [s]."""
FIRST_TIMEOUT = 3.0
"""Longest wait for the first joint positions [s]."""
MAX_MESSAGE_BYTES = 16 << 10
"""Largest datagram with joint positions [bytes]."""
LIMIT_MARGIN = 0.5
"""Distance beyond the limits of a joint up to which a position is believed [rad]."""
MAX_POSITION = 1e6
"""Largest position of a joint without limits [rad]."""
POLL = 0.1
"""Longest wait for a datagram before it is checked whether to stop [s]."""

JointFunction = Callable[[int], Sequence[float] | Float[np.ndarray, "joint"] | None]
"""Function of a stamp [ns since the epoch] that returns the joint positions [rad] in
the order of the robot's joints, or None where it does not know them."""


class JointSource(ABC):
    """Provides the joint positions of a robot at a time."""

    @abstractmethod
    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the joint positions [rad] at a time [ns since the epoch].

        Raises:
            JointsError: they are not known at that time.
        """


@final
class FixedJoints(JointSource):
    """Provides the joint positions of a robot that does not move."""

    def __init__(self, q: Float[np.ndarray, "joint"]) -> None:
        """Keep the joint positions `q` [rad]."""
        self.q = np.array(q, np.float64)

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the same joint positions at all times."""
        return self.q


@final
class CalledJoints(JointSource):
    """Provides the joint positions that a function returns.

    The function is called once a scan, in the thread that reads the source, some 20 ms
    after the time that it is called for.
    """

    def __init__(self, function: JointFunction, robot: Robot) -> None:
        """Keep the function, and the robot whose joints it knows."""
        self.function = function
        self.robot = robot
        self.last = np.zeros(len(robot.joint_names))

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return what the function returns.

        Raises:
            JointsError: it returns None.
            DeviceError: it returns something else than a finite number a joint.
        """
        given = self.function(stamp)
        if given is None:
            raise JointsError("the function of joint positions gives none", self.last)
        try:
            self.last = check_positions(given, self.robot)
        except ValueError as error:
            raise DeviceError(f"the function of joint positions: {error}") from error
        return self.last


@final
class JointHistory:
    """A joint history keeps the latest joint positions and interpolates linearly."""

    def __init__(
        self, stamp: int, q: Float[np.ndarray, "joint"], size: int = 250
    ) -> None:
        """Start with positions [rad] at a time; keep at most `size` of them."""
        self.stamps = deque([stamp], size)
        self.positions = deque([np.array(q, np.float64)], size)

    def add_positions(self, stamp: int, q: Float[np.ndarray, "joint"]) -> None:
        """Add positions [rad] at a time later than the last [ns since the epoch]."""
        if stamp > self.stamps[-1]:
            self.stamps.append(stamp)
            self.positions.append(np.array(q, np.float64))

    def at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the positions at a time [rad]; the nearest outside the history."""
        if stamp >= self.stamps[-1]:
            return self.positions[-1]
        index = bisect_right(self.stamps, stamp)
        if index == 0:
            return self.positions[0]
        before = self.stamps[index - 1]
        after = self.stamps[index]
        q = self.positions[index - 1]
        q_after = self.positions[index]
        return q + (q_after - q) * ((stamp - before) / (after - before))


@final
class ReceivedJoints:
    """Received joints are the positions that arrive, and are used for 0.1 s.

    Positions count from their arrival on; between two arrivals they are interpolated.

    Attributes:
        history: positions of all joints; None before every joint was received.
        last_received: time at which each joint was last received [ns since the epoch].
        accepted, refused: numbers of messages that were used, and that were not.
    """

    def __init__(self, robot: Robot) -> None:
        """Start without positions of the robot's joints."""
        self.robot = robot
        self.index = {name: i for i, name in enumerate(robot.joint_names)}
        self.q = np.zeros(len(robot.joint_names))
        self.history: JointHistory | None = None
        self.last_received: dict[str, int] = {}
        self.accepted = self.refused = 0
        self.reason = ""

    def merge_positions(self, given: Mapping[str, float], now: int) -> None:
        """Add positions of some joints [rad] that arrived at a time [ns].

        Args:
            given: positions that `check_positions` has accepted, by names of joints.
            now: time of arrival [ns since the epoch].
        """
        self.accepted += 1
        for name, position in given.items():
            self.q[self.index[name]] = position
            self.last_received[name] = now
        if not self.missing:
            self.history = self.history or JointHistory(now, self.q)
            self.history.add_positions(now, self.q)

    def refuse(self, reason: str) -> None:
        """Count a message that cannot be used."""
        self.refused += 1
        self.reason = reason

    @property
    def missing(self) -> list[str]:
        """Names of the joints that were not received so far."""
        return [name for name in self.index if name not in self.last_received]

    def compute_age(self, stamp: int) -> float:
        """Return how far the nearest positions of every joint are from a time [s].

        It is infinite before every joint was received.
        """
        if self.history is None:
            return float("inf")
        late = stamp - min(self.last_received.values(), default=stamp)
        return max(late, self.history.stamps[0] - stamp) / NS_PER_S

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the joint positions at a time [rad].

        Raises:
            JointsError: the nearest that were received are more than 0.1 s away.
        """
        if self.history is None:
            text = "no joint positions have come"
            if self.last_received:
                text = f"no position of joint '{self.missing[0]}' has come"
            raise JointsError(f"{text}{self.describe_refused()}", self.q.copy())
        q = self.history.at(stamp)
        if self.compute_age(stamp) > MAX_AGE:
            text = f"no joint positions for {MAX_AGE:g} s{self.describe_refused()}"
            raise JointsError(text, q)
        return q

    def describe_refused(self) -> str:
        """Describe how many messages were refused so far, and why the last one."""
        if not self.refused:
            return ""
        return f" ({self.refused} messages refused, the last: {self.reason})"


@final
class UdpJoints(JointSource, Closing):
    """Receives joint positions as JSON, one object a datagram, and interpolates them.

    The fields are as in `sensor_msgs/JointState`: `position` [rad], and `name`, the
    joints that they are of. Without `name` there is one position for each joint of the
    robot, in its order.

    Attributes:
        received: positions that have arrived, and what was refused.
    """

    def __init__(
        self,
        robot: Robot,
        host: str = "127.0.0.1",
        port: int = 0,
        clock: Clock | None = None,
        allow_remote: bool = False,
    ) -> None:
        """Listen on a port.

        Args:
            robot: robot whose joint positions are received.
            host: IP address of this computer to listen on.
            port: port number; 0 takes any free one.
            clock: clock that stamps arrivals; this computer's unless given.
            allow_remote: whether datagrams of other computers are accepted.

        Raises:
            DeviceError: the port cannot be bound, or the address is not loopback.
        """
        self.robot = robot
        self.clock = clock or HostClock()
        self.socket = bind_udp(host, port, allow_remote)
        self.uri = f"udp://{host}:{self.socket.getsockname()[1]}"
        self.received = ReceivedJoints(robot)
        self.sender: tuple[str, int] | None = None
        self.lock = threading.Lock()
        self.arrived = threading.Event()
        self.closed = False
        self.socket.settimeout(POLL)
        self.thread = threading.Thread(target=self.receive, daemon=True)
        self.thread.start()

    def receive(self) -> None:
        """Push datagrams until the socket is closed."""
        while not self.closed:
            try:
                data, address = self.socket.recvfrom(MAX_MESSAGE_BYTES + 1)
            except TimeoutError:
                continue
            except OSError:
                return
            self.push_datagram(data, address[:2], self.clock.now())

    def push_datagram(self, data: bytes, sender: tuple[str, int], now: int) -> None:
        """Use a datagram that arrived at a time [ns], or count it as refused."""
        with self.lock:
            try:
                self.check_sender(sender, now)
                q = parse_positions(data, self.robot)
            except ValueError as error:
                self.received.refuse(str(error))
                return
            self.sender = sender
            self.received.merge_positions(
                dict(zip(self.robot.joint_names, q, strict=True)), now
            )
        self.arrived.set()

    def check_sender(self, sender: tuple[str, int], now: int) -> None:
        """Refuse a second sender while the first one sends."""
        history = self.received.history
        if history is None or sender == self.sender:
            return
        if now - history.stamps[-1] < PEER_TIMEOUT:
            raise ValueError("a second program sends joint positions; stop one of them")

    def wait(self, seconds: float = FIRST_TIMEOUT) -> None:
        """Wait for the first joint positions.

        Raises:
            DeviceError: none came in time.
        """
        if not self.arrived.wait(seconds):
            raise DeviceError(
                f"no joint positions came on {self.uri} within {seconds:g} s"
                f"{self.received.describe_refused()}; allowed is JSON such as "
                f"{describe_example(self.robot)} at least 20 times a second; start "
                "what sends them first"
            )

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the joint positions at a time [rad].

        Raises:
            JointsError: the nearest that were received are more than 0.1 s away.
        """
        with self.lock:
            return self.received.q_at(stamp)

    def close(self) -> None:
        """Close the socket and end the thread."""
        if not self.closed:
            self.closed = True
            self.thread.join()
            self.socket.close()


@final
class PoseLog:
    """Reads joint positions for scans, and logs when they are not known.

    Attributes:
        joints: source of the joint positions.
    """

    def __init__(self, joints: JointSource, log: EventLog) -> None:
        """Start with positions that are known."""
        self.joints = joints
        self.log = log
        self.is_known = True

    def read(
        self, stamp: int, received: Bool[np.ndarray, "taxel"]
    ) -> tuple[Float[np.ndarray, "joint"], Bool[np.ndarray, "taxel"]]:
        """Return the joint positions of a scan [rad], and which taxels are used.

        Where positions are not known no taxel is, and the positions are the last ones.

        Args:
            stamp: time of the scan [ns since the epoch].
            received: whether each taxel has new data.
        """
        try:
            q = self.joints.q_at(stamp)
            problem = None
        except JointsError as error:
            q = error.q
            problem = str(error)
            received = np.zeros_like(received)
        if self.is_known != (problem is None):
            self.is_known = problem is None
            self.report(stamp, problem)
        return q, received

    def report(self, stamp: int, problem: str | None) -> None:
        """Log why joint positions are not known, or that they are again."""
        if problem is None:
            self.log.log_event(stamp, "posed", "joint positions arrive again")
            return
        text = f"{problem}; no taxel is used before they come; check what sends them"
        self.log.log_event(stamp, "unposed", text)


def parse_positions(data: bytes, robot: Robot) -> Float[np.ndarray, "joint"]:
    """Parse a datagram with joint positions; return them in the robot's order [rad].

    Raises:
        ValueError: it is not of the form that `UdpJoints` describes.
    """
    if len(data) > MAX_MESSAGE_BYTES:
        raise ValueError(f"it has more than {MAX_MESSAGE_BYTES} bytes")
    try:
        message = json.loads(data)
    except (ValueError, RecursionError):
        raise ValueError("it is no JSON") from None
    if not isinstance(message, dict) or not isinstance(message.get("position"), list):
        raise ValueError("it has no list 'position'")
    position = message["position"]
    names = message.get("name")
    if names is None:
        return check_positions(position, robot)
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError("'name' is no list of names")
    if len(names) != len(position) or len(set(names)) < len(names):
        raise ValueError(
            f"{len(names)} names for {len(position)} positions; allowed is one each, "
            "every name once"
        )
    missing = [name for name in robot.joint_names if name not in names]
    if missing:
        raise ValueError(
            f"joint '{missing[0]}' is missing; allowed are all of "
            f"{', '.join(robot.joint_names)}"
        )
    return check_positions([position[names.index(n)] for n in robot.joint_names], robot)


def check_positions(
    given: Sequence[object] | Float[np.ndarray, "joint"],
    robot: Robot,
    names: Sequence[str] | None = None,
) -> Float[np.ndarray, "joint"]:
    """Return joint positions as an array [rad].

    Args:
        given: positions, one a joint.
        robot: the robot.
        names: joints that they are of, in order; None for all of the robot's.

    Raises:
        ValueError: they are not one finite number for each joint, within its limits.
    """
    names = robot.joint_names if names is None else names
    wrong = [value for value in given if not is_position(value)]
    if wrong or len(given) != len(names):
        got = (
            f"the position {str(wrong[0])[:20]!r}" if wrong else f"{len(given)} of them"
        )
        raise ValueError(
            f"it has {got}; allowed is one finite number for each of "
            f"{', '.join(names)} [rad]"
        )
    q = np.array(given, np.float64)
    own = [robot.joint_names.index(name) for name in names]
    lower, upper = robot.lower[own], robot.upper[own]
    beyond = (q < lower - LIMIT_MARGIN) | (q > upper + LIMIT_MARGIN)
    if beyond.any():
        first = int(np.flatnonzero(beyond)[0])
        raise ValueError(
            f"'{names[first]}' is {q[first]:g}; allowed is {lower[first]:.2f} to "
            f"{upper[first]:.2f} rad; send radians, not degrees"
        )
    return q


def is_position(value: object) -> bool:
    """Return whether a value is a number that is small enough for a position."""
    if not isinstance(value, int | float | np.floating) or isinstance(value, bool):
        return False
    return bool(abs(value) < MAX_POSITION)


def describe_example(robot: Robot) -> str:
    """Describe a message that would be used."""
    names = list(robot.joint_names)
    return json.dumps({"name": names, "position": [0.0] * len(names)})
