"""This module is a node of ROS 2 without an installation of it, by Cyclone DDS."""

import os
import threading
from graphlib import TopologicalSorter
from struct import error as StructError
from typing import Any, final

import numpy as np
from jaxtyping import Float

from eskin.bus.messages import (
    OK,
    STALE,
    WARN,
    DiagnosticStatus,
    compute_type_hash,
)
from eskin.bus.publisher import LEFT_TO_ROS, SENSOR_TOPICS, Bus
from eskin.drivers import Clock, JointSource
from eskin.drivers.joints import MAX_AGE, POLL, ReceivedJoints, check_positions
from eskin.errors import DeviceError, RecordingError
from eskin.progress import Closing
from eskin.recording.cdr import MessageField, Topic, Types
from eskin.recording.messages import JOINT_STATES, unpack_joint_state
from eskin.registry import find_package
from eskin.robot import Robot
from eskin.units import NS_PER_S

core, domain, idl, types, pub, qos, sub, topics = (
    find_package(f"cyclonedds.{name}", "Cyclone DDS", "ros2", "--ros2")
    for name in ("core", "domain", "idl", "idl.types", "pub", "qos", "sub", "topic")
)

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
MAX_DOMAIN = 232
"""Largest number of a domain, whose ports are below 65,536."""
SENSOR_DEPTH = 5
DEPTH = 10
RELIABLE_DEPTH = 1000
"""Numbers of messages that are kept for a slow receiver: of sensor data and of other
topics, as ROS 2 has them by default, and of sensor data that is sent reliably."""
MAX_TAKEN = 64
"""Largest number of joint states that are taken at a time."""
BLOCKING_SECONDS = 0.1
"""Longest time that sending waits for a slow receiver of a reliable topic [s]."""


@final
class Ros2Node(Closing):
    """A participant of the domain in `ROS_DOMAIN_ID`, which is 0 by default."""

    def __init__(self) -> None:
        """Join the domain.

        Raises:
            DeviceError: the domain has no such number, or cannot be joined.
        """
        number = read_domain()
        try:
            self.participant = domain.DomainParticipant(number)
        except core.DDSException as error:
            raise DeviceError(
                f"domain {number} cannot be joined ({error}); allowed is a network "
                "interface that Cyclone DDS can use; check CYCLONEDDS_URI"
            ) from error

    def create_writer(self, topic: Topic, reliable: bool) -> Any:  # noqa: ANN401
        """Create the writer of a topic."""
        return pub.DataWriter(
            self.participant,
            self.create_topic(topic),
            qos=self.build_qos(topic, reliable),
        )

    def create_reader(self, topic: Topic) -> Any:  # noqa: ANN401
        """Create the reader of a topic, which takes whatever reliability is offered."""
        return sub.DataReader(
            self.participant,
            self.create_topic(topic),
            qos=self.build_qos(topic, reliable=False),
        )

    def create_topic(self, topic: Topic) -> Any:  # noqa: ANN401
        """Create a topic under the names that ROS 2 gives to it and to its type."""
        data_type = build_type(topic)
        return topics.Topic(self.participant, f"rt{topic.name}", data_type)

    def build_qos(self, topic: Topic, reliable: bool) -> Any:  # noqa: ANN401
        """Build the quality of service of a topic, with the hash of its type."""
        policy = qos.Policy
        sensor = topic in SENSOR_TOPICS
        depth = SENSOR_DEPTH if sensor else DEPTH
        if sensor and reliable:
            depth = RELIABLE_DEPTH
        wait = round(BLOCKING_SECONDS * NS_PER_S)
        is_reliable = reliable or not sensor
        kind = policy.Reliability
        return qos.Qos(
            kind.Reliable(wait) if is_reliable else kind.BestEffort,
            policy.Durability.Volatile,
            policy.History.KeepLast(depth),
            policy.DataRepresentation(use_cdrv0_representation=True),
            policy.Userdata(f"typehash={compute_type_hash(topic)};".encode()),
        )

    def close(self) -> None:
        """Leave the domain; what was created for it is of no use any more."""
        self.participant = None


def build_type(topic: Topic) -> Any:  # noqa: ANN401
    """Build the type of a topic's messages, which stay encoded.

    Cyclone DDS describes the type to others; an instance holds a message as `encoded`.
    """
    built: dict[str, Any] = {"string": str, "bool": bool}
    for name, fields in sort_by_use(topic.types):
        package, _, short = name.split("/")
        kinds = {field.name: find_type(field, built) for field in fields}
        built[name] = idl.make_idl_struct(
            f"{short}_", f"{package}::msg::dds_::{short}_", kinds
        )
    own = built[topic.type_name]
    own.serialize = lambda self, **_: self.encoded
    own.deserialize = classmethod(wrap_message)
    return own


def sort_by_use(types: Types) -> list[tuple[str, tuple[MessageField, ...]]]:
    """Return the types of a topic, each after those that it uses."""
    uses = {
        name: {field.type_name for field in fields if field.is_nested}
        for name, fields in types.items()
    }
    order = TopologicalSorter(uses).static_order()
    return [(name, types[name]) for name in order]


def find_type(field: MessageField, built: dict[str, Any]) -> Any:  # noqa: ANN401
    """Return the type of a field, given the types of messages that it may hold."""
    kind = built.get(field.type_name) or getattr(types, field.type_name)
    return types.sequence[kind] if field.is_sequence else kind


def wrap_message(data_type: Any, data: bytes, **_: object) -> Any:  # noqa: ANN401
    """Return an instance of a type built by a node that holds an encoded message."""
    sample = data_type.__new__(data_type)
    sample.encoded = data
    return sample


def read_domain() -> int:
    """Return the number in `ROS_DOMAIN_ID`, or 0.

    Raises:
        DeviceError: it is no number of a domain.
    """
    text = os.environ.get(DOMAIN_VARIABLE, "") or "0"
    if not (text.isdecimal() and int(text) <= MAX_DOMAIN):
        raise DeviceError(
            f"{DOMAIN_VARIABLE} is '{text}'; allowed are 0 to {MAX_DOMAIN}"
        )
    return int(text)


@final
class Ros2Bus(Bus):
    """Publishes on topics of ROS 2.

    Attributes:
        unsent: number of messages that a slow receiver of a reliable topic refused.
    """

    name = "ros2"

    def __init__(self, node: Ros2Node, reliable: bool = False) -> None:
        """Prepare to publish as a node.

        Args:
            node: node that publishes.
            reliable: whether readings, pressure, contacts, markers and joint states are
                sent again when they are lost. Sensor data is not, as in ROS 2; a
                subscriber that asks for reliable delivery then gets none of it.
        """
        self.node = node
        self.reliable = reliable
        self.writers: dict[str, Any] = {}
        self.unsent = 0

    def open(self, topics: tuple[Topic, ...]) -> None:
        """Create the writers of the topics that are not left to ROS 2."""
        for topic in topics:
            if topic not in LEFT_TO_ROS:
                self.writers[topic.name] = self.node.create_writer(topic, self.reliable)

    def wants(self, topic: Topic) -> bool:
        """Return whether a subscriber of the topic is known."""
        writer = self.writers.get(topic.name)
        if writer is None:
            return False
        return writer.get_publication_matched_status().current_count > 0

    def send(self, topic: Topic, stamp: int, data: bytes) -> None:
        """Publish a message; its source timestamp is the time of sending."""
        writer = self.writers.get(topic.name)
        if writer is not None:
            try:
                writer.write(wrap_message(writer.data_type, data))
            except core.DDSException as error:
                if error.code != core.DDSException.DDS_RETCODE_TIMEOUT:
                    raise
                self.unsent += 1

    def close(self) -> None:
        """Delete the writers."""
        self.writers.clear()


@final
class Ros2Joints(JointSource, Closing):
    """Receives the joint positions of a robot from `/joint_states`.

    A message may hold some of the joints, and joints of others. It counts from its
    arrival on, for which a thread waits: its own stamp is by the clock of another
    computer.

    Attributes:
        received: positions that have arrived, and what was refused.
    """

    def __init__(
        self,
        node: Ros2Node,
        robot: Robot,
        clock: Clock,
    ) -> None:
        """Subscribe to the topic of joint states.

        Args:
            node: node that subscribes.
            robot: robot whose joints are received.
            clock: clock that stamps arrivals.
        """
        self.reader = node.create_reader(JOINT_STATES)
        self.robot = robot
        self.clock = clock
        self.received = ReceivedJoints(robot)
        self.lock = threading.Lock()
        self.closed = False
        self.arrival = core.WaitSet(node.participant)
        any_state = core.ViewState.Any | core.InstanceState.Any
        unread = core.SampleState.NotRead | any_state
        self.arrival.attach(core.ReadCondition(self.reader, unread))
        self.thread = threading.Thread(target=self.receive, daemon=True)
        self.thread.start()

    def receive(self) -> None:
        """Push messages as they arrive, until it is closed."""
        while not self.closed:
            self.arrival.wait(round(POLL * NS_PER_S))
            for sample in self.reader.take(MAX_TAKEN):
                self.push_message(sample)

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the joint positions at a time [rad].

        Raises:
            JointsError: the received positions of a joint are over 0.1 s away.
        """
        with self.lock:
            return self.received.q_at(stamp)

    def push_message(self, sample: Any) -> None:  # noqa: ANN401
        """Take the positions of a message that arrives, or count it as refused."""
        encoded = getattr(sample, "encoded", None)
        if encoded is None:  # A publisher that has left.
            return
        now = self.clock.now()
        with self.lock:
            try:
                _, names, positions = unpack_joint_state(encoded)
                pairs = zip(names, positions, strict=True)
                own = {name: q for name, q in pairs if name in self.received.index}
                q = check_positions(list(own.values()), self.robot, list(own))
            except (RecordingError, StructError, ValueError) as error:
                self.received.refuse(str(error))
                return
            self.received.merge_positions(dict(zip(own, q, strict=True)), now)

    def diagnose(self) -> DiagnosticStatus:
        """Return whether the positions of all joints arrive."""
        level = OK
        message = "ok"
        with self.lock:
            age = self.received.compute_age(self.clock.now())
            missing = self.received.missing
            refused = self.received.refused
        if missing:
            level = WARN
            message = f"never received: {', '.join(missing)}"
        elif age > MAX_AGE:
            level = STALE
            message = f"nothing received for {age:.1f} s"
        values = (("age [s]", f"{age:.3f}"), ("refused", str(refused)))
        return DiagnosticStatus(level, "eskin: joint states", message, values)

    def close(self) -> None:
        """End the thread."""
        self.closed = True
        self.thread.join()
