"""This module encodes what is published live beside the topics of a recording."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from eskin.recording.cdr import CdrPacker
from eskin.recording.messages import HEADER, POINT, TIME, VECTOR, define_topic
from eskin.stream import RecognitionState
from eskin.touch import Contact, Reading

QUATERNION = (
    "geometry_msgs/Quaternion",
    "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
)
COLOUR = ("std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a")
CONTACT = (
    "eskin_msgs/Contact",
    """
# A connected set of active taxels at one instant.
# Track that it belongs to, which keeps its number from reading to reading.
uint32 track
# Touch of that track; 0 while it is not known to be one.
uint32 touch
# Link and patch of the most loaded taxel.
string link
string patch
# Centre, weighted by force [m], and mean outward normal.
geometry_msgs/Point point
geometry_msgs/Vector3 normal
# Force [N], area [m2] and greatest pressure [kPa].
float32 force
float32 area
float32 peak
# Indices of its taxels in the skin.
uint32[] taxels
# Probability of each of the gestures for its touch; empty where it is of none.
float32[] probabilities
""",
)

PRESSURE = define_topic(
    "/eskin/pressure",
    "eskin_msgs/msg/Pressure",
    """
# One instant of the whole skin, calibrated. frame_id is the skin's name.
std_msgs/Header header
# Pressure on each taxel [kPa], in the order of the skin; 0 where it is not valid.
float32[] pressure
# False where no new data came, or the data cannot be trusted.
bool[] valid
""",
    HEADER,
    TIME,
)

CONTACTS = define_topic(
    "/eskin/contacts",
    "eskin_msgs/msg/Contacts",
    """
# All contacts of one reading. frame_id is the robot's root link.
std_msgs/Header header
# Names of the gestures, in the order of the probabilities of each contact.
string[] gestures
eskin_msgs/Contact[] contacts
""",
    HEADER,
    TIME,
    CONTACT,
    POINT,
    VECTOR,
)

DIAGNOSTICS = define_topic(
    "/diagnostics",
    "diagnostic_msgs/msg/DiagnosticArray",
    "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
    HEADER,
    TIME,
    (
        "diagnostic_msgs/DiagnosticStatus",
        """
byte level
string name
string message
string hardware_id
diagnostic_msgs/KeyValue[] values
""",
    ),
    ("diagnostic_msgs/KeyValue", "string key\nstring value"),
)

MARKERS = define_topic(
    "/eskin/markers",
    "visualization_msgs/msg/MarkerArray",
    "visualization_msgs/Marker[] markers",
    (
        "visualization_msgs/Marker",
        """
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials
""",
    ),
    HEADER,
    TIME,
    (
        "geometry_msgs/Pose",
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    ),
    POINT,
    QUATERNION,
    VECTOR,
    COLOUR,
    ("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec"),
    (
        "sensor_msgs/CompressedImage",
        "std_msgs/Header header\nstring format\nuint8[] data",
    ),
    ("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v"),
    ("visualization_msgs/MeshFile", "string filename\nuint8[] data"),
)

TRANSFORMS = define_topic(
    "/tf",
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/TransformStamped[] transforms",
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/Transform transform",
    ),
    HEADER,
    TIME,
    (
        "geometry_msgs/Transform",
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    ),
    VECTOR,
    QUATERNION,
)

ROBOT_DESCRIPTION = define_topic(
    "/robot_description", "std_msgs/msg/String", "string data"
)

OK, WARN, ERROR, STALE = range(4)
"""Levels of `diagnostic_msgs/msg/DiagnosticStatus`."""

ARROW, SPHERE_LIST, TEXT = 0, 7, 9
"""Types of markers, as `visualization_msgs/msg/Marker` numbers them."""
ADD = 0
"""Action of a marker that is added, or replaces that of its namespace and number."""


@dataclass(frozen=True)
class DiagnosticStatus:
    """The state of a part of the skin, as one line of a diagnostics viewer."""

    level: int
    """One of `OK`, `WARN`, `ERROR` and `STALE`."""
    name: str
    """Name of the part."""
    message: str
    """State in words."""
    values: tuple[tuple[str, str], ...] = ()
    """Figures by name."""


@dataclass(frozen=True, eq=False)
class Marker:
    """A marker draws one thing, in the frame of the robot's root link."""

    namespace: str
    """What it shows."""
    number: int
    """Number in its namespace; a marker replaces the one of the same number."""
    kind: int
    """One of `ARROW`, `SPHERE_LIST` and `TEXT`."""
    scale: tuple[float, float, float]
    """Size [m]: diameters of shaft and head and length of the head of an arrow,
    diameters of spheres, height of text (the last)."""
    colour: tuple[float, float, float, float]
    """Red, green, blue and opacity, from 0 to 1."""
    lifetime: float
    """Time after which it vanishes [s]; 0 for never."""
    points: Float[np.ndarray, "point 3"]
    """Both ends of an arrow, or centres of spheres [m]; empty for text."""
    colours: UInt8[np.ndarray, "point 3"]
    """Colour of each sphere; empty otherwise."""
    text: str = ""
    """Text; its centre is `position`."""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of text [m]."""


def pack_pressure(reading: Reading, frame_id: str) -> bytes:
    """Encode a message of `/eskin/pressure`."""
    packer = CdrPacker()
    packer.header(reading.stamp, frame_id)
    pressure = np.where(reading.valid, reading.pressure, 0.0)
    packer.sequence(pressure.astype(np.float32))
    packer.sequence(reading.valid)
    return packer.bytes()


def pack_contacts(
    recognised: RecognitionState, gestures: tuple[str, ...], frame_id: str
) -> bytes:
    """Encode a message of `/eskin/contacts`.

    Args:
        recognised: state of the recognition.
        gestures: vocabulary of the model.
        frame_id: name of the robot's root link.
    """
    state = recognised.state
    stamp = state.reading.stamp
    packer = CdrPacker()
    packer.header(stamp, frame_id)
    packer.strings(gestures)
    touch_of = {track: touch.id for touch in state.touches for track in touch.tracks}
    tracks = [t for t in state.tracks if t.last == stamp and not t.ended]
    packer.unsigned(len(tracks))
    for track in tracks:
        touch = touch_of.get(track.id, 0)
        packer.unsigned(track.id)
        packer.unsigned(touch)
        pack_contact(packer, track.contact)
        probabilities = recognised.probabilities.get(touch, np.empty(0))
        packer.sequence(probabilities.astype(np.float32))
    return packer.bytes()


def pack_contact(packer: CdrPacker, contact: Contact) -> None:
    """Append what a contact is, from its link to its taxels."""
    packer.string(contact.link)
    packer.string(contact.patch)
    packer.numbers(contact.p_world.astype(np.float64))
    packer.numbers(contact.n_world.astype(np.float64))
    packer.numbers(np.array([contact.force, contact.area, contact.peak], np.float32))
    packer.sequence(contact.taxels.astype(np.uint32))


def pack_diagnostics(
    stamp: int, statuses: Iterable[DiagnosticStatus], hardware_id: str
) -> bytes:
    """Encode a message of `/diagnostics`.

    Args:
        stamp: time [ns since the epoch].
        statuses: states of all parts.
        hardware_id: name of the skin.
    """
    statuses = tuple(statuses)
    packer = CdrPacker()
    packer.header(stamp, "")
    packer.unsigned(len(statuses))
    for status in statuses:
        packer.byte(status.level)
        for text in (status.name, status.message, hardware_id):
            packer.string(text)
        packer.unsigned(len(status.values))
        for key, value in status.values:
            packer.string(key)
            packer.string(value)
    return packer.bytes()


def pack_markers(stamp: int, markers: Iterable[Marker], frame_id: str) -> bytes:
    """Encode a message of `/eskin/markers`.

    Args:
        stamp: time of the reading [ns since the epoch].
        markers: what is drawn.
        frame_id: name of the robot's root link.
    """
    markers = tuple(markers)
    packer = CdrPacker()
    packer.unsigned(len(markers))
    for marker in markers:
        pack_marker(packer, stamp, marker, frame_id)
    return packer.bytes()


def pack_marker(packer: CdrPacker, stamp: int, marker: Marker, frame_id: str) -> None:
    """Append one marker; it has no texture and no mesh."""
    packer.header(stamp, frame_id)
    packer.string(marker.namespace)
    for value in (marker.number, marker.kind, ADD):
        packer.signed(value)
    packer.numbers(np.array([*marker.position, 0.0, 0.0, 0.0, 1.0]))
    packer.numbers(np.array(marker.scale))
    packer.numbers(np.array(marker.colour, np.float32))
    packer.stamp(round(marker.lifetime * 1e9))
    packer.byte(False)
    packer.sequence(marker.points)
    rgb = marker.colours.astype(np.float32) / 255
    packer.sequence(np.concatenate([rgb, np.ones_like(rgb[:, :1])], axis=1))
    packer.string("")
    packer.header(0, "")
    packer.string("")
    for _ in ("data", "uv_coordinates"):
        packer.unsigned(0)
    packer.string(marker.text)
    packer.string("")
    packer.string("")
    packer.unsigned(0)
    packer.byte(False)


def pack_transforms(
    stamp: int,
    frames: tuple[tuple[str, str], ...],
    poses: Float[np.ndarray, "frame 7"],
) -> bytes:
    """Encode a message of `/tf`.

    Args:
        stamp: time [ns since the epoch].
        frames: names of parent and child of each pose.
        poses: position [m], then quaternion xyzw, of each child in its parent.
    """
    packer = CdrPacker()
    packer.unsigned(len(frames))
    for (parent, child), pose in zip(frames, poses, strict=True):
        packer.header(stamp, parent)
        packer.string(child)
        packer.numbers(pose)
    return packer.bytes()


def pack_text(text: str) -> bytes:
    """Encode a message of `/robot_description`."""
    packer = CdrPacker()
    packer.string(text)
    return packer.bytes()
