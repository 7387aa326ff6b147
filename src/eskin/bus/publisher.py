"""This module publishes a stream as ROS 2 messages, over whatever carries them."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.bus.messages import (
    ARROW,
    COMMAND_EVENT,
    CONTACTS,
    DIAGNOSTICS,
    ERROR,
    MARKERS,
    OK,
    PRESSURE,
    ROBOT_DESCRIPTION,
    SPHERE_LIST,
    TAXELS,
    TEXT,
    TRANSFORMS,
    WARN,
    WRENCH,
    DiagnosticStatus,
    Marker,
    pack_command_event,
    pack_contacts,
    pack_diagnostics,
    pack_markers,
    pack_pressure,
    pack_taxels,
    pack_transforms,
    pack_wrench,
)
from eskin.drivers import Event
from eskin.live import Detection
from eskin.recording.cdr import Topic
from eskin.recording.messages import (
    DETECTION,
    EVENT,
    JOINT_STATES,
    READING,
    pack_detection,
    pack_event,
    pack_joint_state,
    pack_reading,
)
from eskin.skin import MountedSkin, Skin
from eskin.skin.colours import ColourScale
from eskin.stream import CommandEvent, Context, Listener, Message, RecognitionState
from eskin.stream.listener import Drop
from eskin.touch import Scan, TouchState
from eskin.transforms import invert, matrix_to_quaternion
from eskin.units import NS_PER_S

MAX_MARKER_RATE = 25
"""Largest rate of markers and transforms [1/s]."""
MARKER_SECONDS = 0.2
"""Time for which a contact is shown unless it is sent again [s]."""
DETECTION_SECONDS = 2.0
"""Time for which a detection is shown [s]."""
MAX_SHOWN_PRESSURE = 60.0
"""Pressure of the lightest colour [kPa]."""
METRES_PER_NEWTON = 0.02
MAX_ARROW = 0.25
"""Length of the arrow of a contact by its force, and its largest length [m]."""
PASCAL = 1000.0
"""Pascal in a kPa."""
RED = (0.85, 0.2, 0.15, 0.9)
WHITE = (1.0, 1.0, 1.0, 1.0)

PUBLISHED = (
    READING,
    PRESSURE,
    CONTACTS,
    DETECTION,
    EVENT,
    COMMAND_EVENT,
    DIAGNOSTICS,
    MARKERS,
    TAXELS,
    WRENCH,
)
"""Topics that every bus carries."""
SENSOR_TOPICS = (READING, PRESSURE, CONTACTS, MARKERS, TAXELS, WRENCH, JOINT_STATES)
"""Topics at the rate of the skin, with the quality of service of sensor data."""
LEFT_TO_ROS = (TRANSFORMS, ROBOT_DESCRIPTION)
"""Topics that `robot_state_publisher` publishes in a system of ROS 2."""


class Bus(ABC):
    """A bus carries encoded messages of topics to other programs.

    Attributes:
        name: name of the listener that publishes on it.
    """

    name: str

    @abstractmethod
    def open(self, topics: tuple[Topic, ...]) -> None:
        """Declare the topics that will be published.

        Raises:
            DeviceError: the bus is not available.
        """

    @abstractmethod
    def wants(self, topic: Topic) -> bool:
        """Return whether the bus carries a topic and anybody receives it now."""

    @abstractmethod
    def send(self, topic: Topic, stamp: int, data: bytes) -> None:
        """Send a message in CDR; it does not wait for receivers.

        Args:
            topic: one of those that were declared.
            stamp: time that the message is about [ns since the epoch].
            data: the message.
        """

    @abstractmethod
    def close(self) -> None:
        """Withdraw all topics; may be called twice."""


@final
class Publisher(Listener):
    """Publishes scans, contacts, detections, commands and what became of the skin.

    What nobody receives is not encoded. Markers and transforms are sent up to 25 times
    a second, diagnostics once.
    """

    message_types = (Scan, RecognitionState, Detection, Event, CommandEvent)
    size = 512

    def __init__(
        self,
        bus: Bus,
        mounted: MountedSkin,
        gestures: tuple[str, ...],
        received_joints: Callable[[], DiagnosticStatus] | None = None,
        drop: Drop = "oldest",
    ) -> None:
        """Prepare to publish.

        Args:
            bus: what carries the messages; it is closed with the listener.
            mounted: skin on its robot.
            gestures: vocabulary of the model.
            received_joints: function that returns the state of the joint positions
                where they come from the bus, and are not published on it.
            drop: what is dropped when messages come faster than they are published.
        """
        self.name = bus.name
        self.drop = drop
        self.bus = bus
        self.mounted = mounted
        self.gestures = gestures
        self.received_joints = received_joints
        self.joints = received_joints is None and bool(mounted.robot.joint_names)
        self.painter = MarkerPainter(mounted)
        self.frames = find_frames(mounted)
        self.loaded: set[int] = set()
        self.shown_at = self.diagnosed_at = self.readings = 0

    @property
    def root(self) -> str:
        """Name of the robot's root link, whose frame is the world."""
        return self.mounted.robot.link_names[0]

    def start(self, context: Context) -> None:
        """Declare the topics, and describe the robot."""
        self.skin_name = context.info.skin.name
        own = (JOINT_STATES,) if self.joints else ()
        self.bus.open((*PUBLISHED, *own, TRANSFORMS, ROBOT_DESCRIPTION))
        urdf = self.mounted.robot.urdf.decode(errors="replace")
        self.bus.send(
            ROBOT_DESCRIPTION, context.clock.now(), ROBOT_DESCRIPTION.pack(urdf)
        )

    def on_message(self, item: Message) -> None:
        """Publish a message on its topics."""
        match item:
            case Scan():
                self.publish_scan(item)
            case RecognitionState():
                self.publish_state(item)
            case Detection():
                self.painter.note(item)
                data = pack_detection(item.record(), self.root)
                self.bus.send(DETECTION, item.stamp, data)
            case Event():
                data = pack_event(item.record(), self.skin_name)
                self.bus.send(EVENT, item.stamp, data)
            case CommandEvent():
                data = pack_command_event(item, self.skin_name)
                self.bus.send(COMMAND_EVENT, item.stamp, data)

    def publish_scan(self, scan: Scan) -> None:
        """Publish counts and joint positions."""
        if self.joints and self.bus.wants(JOINT_STATES):
            names = self.mounted.robot.joint_names
            data = pack_joint_state(scan.stamp, names, scan.q)
            self.bus.send(JOINT_STATES, scan.stamp, data)
        if self.bus.wants(READING):
            self.bus.send(READING, scan.stamp, pack_reading(scan, self.skin_name))

    def publish_state(self, recognised: RecognitionState) -> None:
        """Publish pressure and contacts; markers and diagnostics when they are due."""
        reading = recognised.state.reading
        stamp = reading.stamp
        if self.bus.wants(PRESSURE):
            self.bus.send(PRESSURE, stamp, pack_pressure(reading, self.skin_name))
        if self.bus.wants(CONTACTS):
            data = pack_contacts(recognised, self.gestures, self.root)
            self.bus.send(CONTACTS, stamp, data)
        if self.bus.wants(WRENCH):
            self.publish_wrenches(recognised.state)
        if stamp - self.shown_at >= NS_PER_S / MAX_MARKER_RATE:
            self.shown_at = stamp
            self.publish_scene(recognised)
        self.readings += 1
        if stamp - self.diagnosed_at >= NS_PER_S:
            self.diagnosed_at = stamp
            skin = self.mounted.skin
            statuses = diagnose(skin, recognised.state, self.readings)
            self.readings = 0
            if self.received_joints is not None:
                statuses.append(self.received_joints())
            data = pack_diagnostics(stamp, statuses, self.skin_name)
            self.bus.send(DIAGNOSTICS, stamp, data)

    def publish_wrenches(self, state: TouchState) -> None:
        """Publish the wrench of each link in contact, and a last one, of zero."""
        links = self.mounted.robot.link_names
        stamp = state.reading.stamp
        wrenches = compute_wrenches(self.mounted, state)
        zero = np.zeros(3), np.zeros(3)
        for link in sorted(self.loaded | wrenches.keys()):
            data = pack_wrench(stamp, *wrenches.get(link, zero), links[link])
            self.bus.send(WRENCH, stamp, data)
        self.loaded = set(wrenches)

    def publish_scene(self, recognised: RecognitionState) -> None:
        """Publish link poses and markers."""
        reading = recognised.state.reading
        if self.bus.wants(TRANSFORMS):
            poses = compute_frame_poses(self.mounted, reading.q)
            data = pack_transforms(reading.stamp, self.frames, poses)
            self.bus.send(TRANSFORMS, reading.stamp, data)
        if self.bus.wants(TAXELS):
            places, _ = self.mounted.place_taxels(reading.q)
            pressure = np.where(reading.valid, reading.pressure, np.nan)
            data = pack_taxels(reading.stamp, places, pressure, self.root)
            self.bus.send(TAXELS, reading.stamp, data)
        if self.bus.wants(MARKERS):
            markers = self.painter.paint(recognised, self.gestures)
            data = pack_markers(reading.stamp, markers, self.root)
            self.bus.send(MARKERS, reading.stamp, data)

    def close(self) -> None:
        """Withdraw the topics."""
        self.bus.close()


def compute_wrenches(
    mounted: MountedSkin, state: TouchState
) -> dict[int, tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]]:
    """Compute the wrench of all contacts on each link, by the link's index.

    It is what pressure along the normals of the taxels exerts: force [N], and torque
    about the link's origin [N m], both in the link's frame.
    """
    skin = mounted.skin
    robot = mounted.robot
    found = {}
    taxels = np.concatenate(
        [np.zeros(0, np.int64), *(contact.taxels for contact in state.contacts)]
    )
    for patch in np.unique(skin.patch_index[taxels]).tolist():
        own = taxels[skin.patch_index[taxels] == patch]
        size = PASCAL * state.reading.pressure[own] * skin.areas[own]
        forces = -size[:, None] * skin.normals[own]
        torques = np.cross(skin.positions[own], forces)
        index = robot.link_index(skin.patches[patch].link)
        before = found.get(index, (0.0, 0.0))
        found[index] = before[0] + forces.sum(axis=0), before[1] + torques.sum(axis=0)
    return found


def find_frames(mounted: MountedSkin) -> tuple[tuple[str, str], ...]:
    """Return parent and child link of every joint."""
    return tuple((joint.parent, joint.child) for joint in mounted.robot.joints)


def compute_frame_poses(
    mounted: MountedSkin, q: Float[np.ndarray, "joint"]
) -> Float[np.ndarray, "frame 7"]:
    """Return position [m] and quaternion xyzw of each joint's child in its parent."""
    T_world_link = mounted.kinematics.poses(q)
    names = mounted.robot.link_names
    joints = mounted.robot.joints
    if not joints:
        return np.zeros((0, 7))
    parents = [names.index(joint.parent) for joint in joints]
    children = [names.index(joint.child) for joint in joints]
    T = invert(T_world_link[parents]) @ T_world_link[children]
    wxyz = matrix_to_quaternion(T[:, :3, :3])
    return np.concatenate([T[:, :3, 3], np.roll(wxyz, -1, axis=1)], axis=1)


@final
class MarkerPainter:
    """Draws taxels by their pressure, contacts as arrows, gestures as text."""

    def __init__(self, mounted: MountedSkin) -> None:
        """Start without detections."""
        self.mounted = mounted
        self.colours = ColourScale(MAX_SHOWN_PRESSURE)
        self.diameter = float(np.sqrt(np.median(mounted.skin.areas)))
        self.detections: list[Detection] = []

    def note(self, detection: Detection) -> None:
        """Keep a detection for the next markers."""
        self.detections.append(detection)

    def paint(
        self, recognised: RecognitionState, gestures: tuple[str, ...]
    ) -> list[Marker]:
        """Return the markers of a state, with the detections since the last call.

        Args:
            recognised: state of the recognition.
            gestures: vocabulary of the model.
        """
        state = recognised.state
        markers = [self.paint_taxels(state)]
        for number, contact in enumerate(state.contacts):
            length = min(METRES_PER_NEWTON * contact.force, MAX_ARROW)
            ends = [contact.p_world + length * contact.n_world, contact.p_world]
            size = (0.006, 0.014, min(0.02, length / 2))
            markers.append(
                Marker(
                    "contacts", number, ARROW, size, RED, MARKER_SECONDS, np.array(ends)
                )
            )
        for touch in state.touches:
            probabilities = recognised.probabilities.get(touch.id)
            if probabilities is not None:
                best = int(probabilities.argmax())
                text = f"{gestures[best]} {probabilities[best]:.0%}"
                place = touch.contact.p_world + 0.08 * touch.contact.n_world
                markers.append(
                    build_text("touches", touch.id, text, place, MARKER_SECONDS)
                )
        for found in self.detections:
            place = found.p_world + 0.12 * found.n_world
            text = found.gesture.upper()
            markers.append(
                build_text("detections", found.touch, text, place, DETECTION_SECONDS)
            )
        self.detections.clear()
        return markers

    def paint_taxels(self, state: TouchState) -> Marker:
        """Return the marker of all taxels."""
        reading = state.reading
        points, _ = self.mounted.place_taxels(reading.q)
        scale = (self.diameter, self.diameter, self.diameter)
        colours = self.colours.colours(reading.pressure, reading.valid)
        return Marker("taxels", 0, SPHERE_LIST, scale, WHITE, 0.0, points, colours)


def build_text(
    namespace: str,
    number: int,
    text: str,
    place: Float[np.ndarray, "3"],
    lifetime: float,
) -> Marker:
    """Build the marker of a text, 3 cm high, at a place [m]."""
    x, y, z = place.tolist()
    scale = (0.0, 0.0, 0.03)
    return Marker(
        namespace, number, TEXT, scale, WHITE, lifetime, text=text, position=(x, y, z)
    )


def diagnose(skin: Skin, state: TouchState, readings: int) -> list[DiagnosticStatus]:
    """Return how the skin as a whole is, then each of its patches.

    Args:
        skin: the skin.
        state: the latest state.
        readings: number of readings since the last diagnosis.
    """
    faults = Counter(fault.patch for fault in state.faults)
    out = {fault.patch for fault in state.faults if fault.kind == "patch"}
    statuses = []
    for index, patch in enumerate(skin.patches):
        level = OK
        message = "ok"
        if patch.id in out:
            level = ERROR
            message = "out or silent"
        elif faults[patch.id]:
            level = WARN
            message = f"{faults[patch.id]} faults"
        valid = state.reading.valid[skin.patch_index == index].mean()
        values = (("valid taxels", f"{valid:.1%}"),)
        name = f"eskin: patch {patch.id}"
        statuses.append(DiagnosticStatus(level, name, message, values))
    worst = max((status.level for status in statuses), default=OK)
    message = f"{len(state.contacts)} contacts, {len(state.faults)} faults"
    values = (("readings since the last message", str(readings)),)
    return [DiagnosticStatus(worst, "eskin: skin", message, values), *statuses]
