"""This module encodes live messages beside the topics of a recording."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, UInt8

from eskin.recording.cdr import MessageField, Topic, define_topic
from eskin.recording.messages import HEADER, NO_NUMBERS, POINT, TIME, VECTOR
from eskin.stream import CommandEvent, RecognitionState
from eskin.touch import Reading
from eskin.units import NS_PER_S

FIELD_TYPE_IDS = {
    "int8": 2,
    "uint8": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
"""Numbers of the basic types in `type_description_interfaces/msg/FieldType`."""
NESTED_TYPE_ID = 1
SEQUENCE_OFFSET = 144
"""Difference of the numbers of an unbounded sequence of a type and of that type."""

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

COMMAND_EVENT = define_topic(
    "/eskin/command_event",
    "eskin_msgs/msg/CommandEvent",
    """
# A decision about the motion of the arm that touches command. frame_id is the skin's
# name.
std_msgs/Header header
# What it is about, such as pause or resume; with ask, the arm asks whether it is to do
# more, and the next one that is about the same touch tells how that ended.
string action
# Whether it was done.
bool accepted
# Why it was, or was not; with ask, the question.
string why
# Touch that led to it, its gesture, first contact and patch; 0 and empty without one.
uint32 touch
string gesture
builtin_interfaces/Time onset
string patch
""",
    HEADER,
    TIME,
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

TAXELS = define_topic(
    "/eskin/taxels",
    "sensor_msgs/msg/PointCloud2",
    """
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense
""",
    HEADER,
    TIME,
    (
        "sensor_msgs/PointField",
        "string name\nuint32 offset\nuint8 datatype\nuint32 count",
    ),
)

WRENCH = define_topic(
    "/eskin/wrench",
    "geometry_msgs/msg/WrenchStamped",
    "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    HEADER,
    TIME,
    (
        "geometry_msgs/Wrench",
        "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    ),
    VECTOR,
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

FLOAT32 = 7
"""Type of a number in `sensor_msgs/msg/PointField`."""

ARROW = 0
SPHERE_LIST = 7
TEXT = 9
"""Types of markers, as `visualization_msgs/msg/Marker` numbers them."""
NO_POINTS = np.zeros((0, 3))
NO_COLOURS = np.zeros((0, 3), np.uint8)
ADD = 0
"""Action of a marker that is new, or replaces one of its namespace and number."""


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
    points: Float[np.ndarray, "point 3"] = field(default_factory=lambda: NO_POINTS)
    """Both ends of an arrow, or centres of spheres [m]; empty for text."""
    colours: UInt8[np.ndarray, "point 3"] = field(default_factory=lambda: NO_COLOURS)
    """Colour of each sphere; empty otherwise."""
    text: str = ""
    """Text; its centre is `position`."""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of text [m]."""


def pack_pressure(reading: Reading, frame_id: str) -> bytes:
    """Encode a message of `/eskin/pressure`."""
    pressure = np.where(reading.valid, reading.pressure, 0.0)
    return PRESSURE.pack((reading.stamp, frame_id), pressure, reading.valid)


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
    touch_of = {track: touch.id for touch in state.touches for track in touch.tracks}
    contacts = []
    for track in state.tracks:
        if track.last == stamp and not track.ended:
            touch = touch_of.get(track.id, 0)
            contact = track.contact
            probabilities = recognised.probabilities.get(touch, NO_NUMBERS)
            contacts.append(
                (
                    track.id,
                    touch,
                    contact.link,
                    contact.patch,
                    contact.p_world,
                    contact.n_world,
                    contact.force,
                    contact.area,
                    contact.peak,
                    contact.taxels,
                    probabilities,
                )
            )
    return CONTACTS.pack((stamp, frame_id), gestures, contacts)


def pack_command_event(event: CommandEvent, frame_id: str) -> bytes:
    """Encode a message of `/eskin/command_event`; `frame_id` is the skin's name."""
    return COMMAND_EVENT.pack(
        (event.stamp, frame_id),
        event.action,
        event.accepted,
        event.why,
        event.touch or 0,
        event.gesture or "",
        event.onset or 0,
        event.patch or "",
    )


def pack_taxels(
    stamp: int,
    places: Float[np.ndarray, "taxel 3"],
    pressure: Float[np.ndarray, "taxel"],
    frame_id: str,
) -> bytes:
    """Encode a message of `/eskin/taxels`, a cloud with the fields x, y, z, pressure.

    Args:
        stamp: time of the reading [ns since the epoch].
        places: centres of the taxels [m].
        pressure: pressure [kPa]; NaN where it is not valid.
        frame_id: name of the robot's root link.
    """
    points = np.column_stack([places, pressure]).astype("<f4")
    names = ("x", "y", "z", "pressure")
    fields = [(name, 4 * n, FLOAT32, 1) for n, name in enumerate(names)]
    step = 4 * len(names)
    data = np.frombuffer(points.tobytes(), np.uint8)
    head = ((stamp, frame_id), 1, len(points), fields, False)
    return TAXELS.pack(*head, step, len(data), data, False)


def pack_wrench(
    stamp: int,
    force: Float[np.ndarray, "3"],
    torque: Float[np.ndarray, "3"],
    frame_id: str,
) -> bytes:
    """Encode a message of `/eskin/wrench`.

    Args:
        stamp: time of the reading [ns since the epoch].
        force: force on a link in its frame [N].
        torque: torque about its origin, in its frame [N m].
        frame_id: name of the link.
    """
    return WRENCH.pack((stamp, frame_id), (force, torque))


def pack_diagnostics(
    stamp: int, statuses: Iterable[DiagnosticStatus], hardware_id: str
) -> bytes:
    """Encode a message of `/diagnostics`.

    Args:
        stamp: time [ns since the epoch].
        statuses: states of all parts.
        hardware_id: name of the skin.
    """
    parts = [(s.level, s.name, s.message, hardware_id, s.values) for s in statuses]
    return DIAGNOSTICS.pack((stamp, ""), parts)


def pack_markers(stamp: int, markers: Iterable[Marker], frame_id: str) -> bytes:
    """Encode a message of `/eskin/markers`, which have no texture and no mesh.

    Args:
        stamp: time of the reading [ns since the epoch].
        markers: what is drawn.
        frame_id: name of the robot's root link.
    """
    no_texture = ((0, ""), "", NO_NUMBERS)
    no_mesh = ("", NO_NUMBERS)
    rows = []
    for marker in markers:
        rgb = marker.colours.astype(np.float32) / 255
        rows.append(
            (
                (stamp, frame_id),
                marker.namespace,
                marker.number,
                marker.kind,
                ADD,
                (marker.position, (0.0, 0.0, 0.0, 1.0)),
                marker.scale,
                marker.colour,
                round(marker.lifetime * NS_PER_S),
                False,
                marker.points,
                np.concatenate([rgb, np.ones_like(rgb[:, :1])], axis=1),
                "",
                no_texture,
                NO_NUMBERS,
                marker.text,
                "",
                no_mesh,
                False,
            )
        )
    return MARKERS.pack(rows)


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
    return TRANSFORMS.pack(
        [
            ((stamp, parent), child, (pose[:3], pose[3:]))
            for (parent, child), pose in zip(frames, poses, strict=True)
        ]
    )


def compute_type_hash(topic: Topic) -> str:
    """Return the hash of a topic's type as ROS 2 Iron and later state it.

    It is the SHA-256 of the type's description in JSON (REP 2016).
    """
    own, *others = [
        {"type_name": name, "fields": list(map(describe_field, fields))}
        for name, fields in topic.types.items()
    ]
    others.sort(key=lambda description: str(description["type_name"]))
    whole = {"type_description": own, "referenced_type_descriptions": others}
    return "RIHS01_" + hashlib.sha256(json.dumps(whole).encode()).hexdigest()


def describe_field(field: MessageField) -> dict[str, object]:
    """Return the description of a field, in the order of keys that is hashed."""
    number = FIELD_TYPE_IDS.get(field.type_name, NESTED_TYPE_ID)
    return {
        "name": field.name,
        "type": {
            "type_id": number + SEQUENCE_OFFSET * field.is_sequence,
            "capacity": 0,
            "string_capacity": 0,
            "nested_type_name": field.type_name if field.is_nested else "",
        },
    }
