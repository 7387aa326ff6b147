"""This module converts the six messages of a recording to and from CDR."""

from dataclasses import dataclass
from functools import lru_cache
from struct import Struct
from typing import cast

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from eskin.errors import RecordingError
from eskin.recording.cdr import ENCAPSULATION, LATEST_STAMP, CdrPacker, CdrUnpacker
from eskin.recording.records import (
    DetectionRecord,
    EventRecord,
    Label,
    TruthRecord,
    Vector,
)
from eskin.touch import Scan
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class Topic:
    """A topic of a recording has a name, a type of message and its definition."""

    name: str
    """Name of the topic."""
    type_name: str
    """ROS 2 type of its messages."""
    definition: str
    """Definition of that type, with those of all types that it refers to."""


def define_topic(name: str, kind: str, own: str, *others: tuple[str, str]) -> Topic:
    """Define a topic; its definition and those of `others` are joined as by rosbag2."""
    rule = "=" * 80
    parts = [own.strip()]
    parts += [f"{rule}\nMSG: {name}\n{text.strip()}" for name, text in others]
    return Topic(name, kind, "\n".join(parts) + "\n")


TIME = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec")
HEADER = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id")
POINT = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z")
VECTOR = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z")

READING = define_topic(
    "/eskin/reading",
    "eskin_msgs/msg/Reading",
    """
# One instant of the whole skin, before calibration. frame_id is the skin's name.
std_msgs/Header header
# One count a taxel, in the order of the attached skin.
uint16[] counts
# False where no fresh data came.
bool[] received
# Counts along each taxel's tangent x and y in turn; empty where shear is not measured.
int16[] shear
""",
    HEADER,
    TIME,
)

JOINT_STATES = define_topic(
    "/joint_states",
    "sensor_msgs/msg/JointState",
    """
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
""",
    HEADER,
    TIME,
)

LABEL = define_topic(
    "/eskin/label",
    "eskin_msgs/msg/Label",
    """
# One gesture from start until just before end. source: true, range or auto.
builtin_interfaces/Time start
builtin_interfaces/Time end
string gesture
string source
""",
    TIME,
)

DETECTION = define_topic(
    "/eskin/detection",
    "eskin_msgs/msg/Detection",
    """
# What was recognised of one touch, when it was said. frame_id is world.
std_msgs/Header header
string gesture
float32 confidence
builtin_interfaces/Time onset
builtin_interfaces/Time end
string link
string patch
geometry_msgs/Point point
geometry_msgs/Vector3 normal
# Unit direction of travel; zero where the touch stood still.
geometry_msgs/Vector3 direction
# Largest force of the touch [N].
float32 peak_force
""",
    HEADER,
    TIME,
    POINT,
    VECTOR,
)

TRUTH = define_topic(
    "/eskin/truth",
    "eskin_msgs/msg/Truth",
    """
# What one touch really was at one reading, while in contact; known where the skin is
# simulated. frame_id is world.
std_msgs/Header header
# Counts the touches of the file.
uint32 touch
string gesture
# Variant of the gesture.
string kind
# Link that bears most of it.
string link
# Total force on the skin [N].
float64 force
# Contact area [m2].
float64 area
# Centre of the force [m].
geometry_msgs/Point centroid
""",
    HEADER,
    TIME,
    POINT,
)

EVENT = define_topic(
    "/eskin/event",
    "eskin_msgs/msg/Event",
    """
# Something that happened to the skin. frame_id is the skin's name.
std_msgs/Header header
string kind
# The same as a sentence.
string text
# Empty where it is of no one patch.
string patch
# -1 where it is of no one row, column or taxel.
int32 row
int32 column
int32 taxel
""",
    HEADER,
    TIME,
)

TOPICS = (READING, JOINT_STATES, LABEL, DETECTION)
"""Topics of every recording; `TRUTH` and `EVENT` are declared when first used."""

WORLD_FRAME = "world"
NOT_GIVEN = -1
TRUTH_NUMBERS = Struct("<5d")


@dataclass(frozen=True)
class ReadingMessage:
    """A message of `/eskin/reading`, which is a scan without joint positions."""

    stamp: int
    """Time of the scan [ns since the epoch]."""
    counts: Int[np.ndarray, "taxel"]
    """Raw counts of the device."""
    received: Bool[np.ndarray, "taxel"]
    """False for taxels without fresh data."""
    shear: Int[np.ndarray, "taxel 2"] | None
    """Counts along each taxel's two tangents, where measured."""


def pack_reading(scan: Scan, frame_id: str) -> bytes:
    """Encode a message of `/eskin/reading`.

    Raises:
        RecordingError: when a count does not fit into 16 bits.
    """
    packer = CdrPacker()
    packer.header(scan.stamp, frame_id)
    packer.sequence(to_16_bits(scan.counts, np.dtype("<u2"), "counts"))
    packer.sequence(scan.received)
    shear = np.empty(0, np.int64) if scan.shear is None else scan.shear.reshape(-1)
    packer.sequence(to_16_bits(shear, np.dtype("<i2"), "shear counts"))
    return packer.bytes()


def to_16_bits(
    values: Int[np.ndarray, "item"], dtype: np.dtype, what: str
) -> Integer[np.ndarray, "item"]:
    """Convert integers to 16 bits; raise an error with their range if too wide."""
    limits = np.iinfo(dtype)
    if len(values) and (values.min() < limits.min or values.max() > limits.max):
        raise RecordingError(
            f"{what} from {values.min()} to {values.max()} cannot be recorded; allowed "
            f"are {limits.min} to {limits.max}; scale them to the device's resolution"
        )
    return values.astype(dtype)


def unpack_reading(data: bytes) -> ReadingMessage:
    """Decode a message of `/eskin/reading`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.header()
    counts = unpacker.sequence("<u2").astype(np.int32)
    received = unpacker.sequence("u1") != 0
    shear = unpacker.sequence("<i2").astype(np.int32)
    if len(received) != len(counts) or len(shear) not in (0, 2 * len(counts)):
        raise RecordingError(
            f"reading at {stamp} ns has {len(counts)} counts, {len(received)} received "
            f"and {len(shear)} shear; allowed are n, n and 0 or 2 n"
        )
    pairs = shear.reshape(-1, 2) if len(shear) else None
    return ReadingMessage(stamp, counts, received, pairs)


def pack_joint_state(
    stamp: int, names: tuple[str, ...], q: Float[np.ndarray, "joint"]
) -> bytes:
    """Encode a message of `/joint_states` with positions [rad] and nothing else."""
    packer = CdrPacker()
    packer.header(stamp, "")
    packer.strings(names)
    packer.sequence(q.astype(np.float64))
    packer.unsigned(0)
    packer.unsigned(0)
    return packer.bytes()


def unpack_joint_state(
    data: bytes,
) -> tuple[int, tuple[str, ...], Float[np.ndarray, "joint"]]:
    """Decode a message of `/joint_states`: stamp [ns], joint names, positions [rad]."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.header()
    names = unpacker.strings()
    return stamp, names, unpacker.sequence("<f8").astype(np.float64)


def pack_label(label: Label) -> bytes:
    """Encode a message of `/eskin/label`."""
    packer = CdrPacker()
    packer.stamp(label.start)
    packer.stamp(label.end)
    packer.string(label.gesture)
    packer.string(label.source)
    return packer.bytes()


def unpack_label(data: bytes) -> Label:
    """Decode a message of `/eskin/label`."""
    unpacker = CdrUnpacker(data)
    start, end = unpacker.stamp(), unpacker.stamp()
    gesture, source = unpacker.string(), unpacker.string()
    if source not in ("true", "range", "auto"):
        raise RecordingError(
            f"label '{gesture}' has source '{source}'; allowed are true, range, auto"
        )
    return Label(start, end, gesture, source)


def pack_detection(record: DetectionRecord, frame_id: str = WORLD_FRAME) -> bytes:
    """Encode a message of `/eskin/detection`; `frame_id` names the world."""
    packer = CdrPacker()
    packer.header(record.stamp, frame_id)
    packer.string(record.gesture)
    packer.number(record.confidence, "f")
    packer.stamp(record.onset)
    packer.stamp(record.end)
    packer.string(record.link)
    packer.string(record.patch)
    for vector in (record.p_world, record.n_world, record.direction_world):
        for value in vector:
            packer.number(value)
    packer.number(record.peak_force, "f")
    return packer.bytes()


def unpack_detection(data: bytes) -> DetectionRecord:
    """Decode a message of `/eskin/detection`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.header()
    gesture, confidence = unpacker.string(), unpacker.number("f")
    onset, end = unpacker.stamp(), unpacker.stamp()
    link, patch = unpacker.string(), unpacker.string()
    vectors = [
        cast(Vector, tuple(unpacker.number() for _ in range(3))) for _ in range(3)
    ]
    head = (stamp, gesture, confidence, onset, end, link, patch)
    return DetectionRecord(*head, *vectors, peak_force=unpacker.number("f"))


def pack_truth(record: TruthRecord) -> bytes:
    """Encode a message of `/eskin/truth`."""
    packer = CdrPacker()
    packer.stamp(record.stamp)
    text = pack_truth_text(record.touch, record.gesture, record.kind, record.link)
    numbers = TRUTH_NUMBERS.pack(record.force, record.area, *record.p_world)
    return packer.bytes() + text + numbers


@lru_cache(maxsize=64)
def pack_truth_text(touch: int, gesture: str, kind: str, link: str) -> bytes:
    """Encode what all messages of one touch share, between stamp and numbers."""
    packer = CdrPacker()
    packer.stamp(0)
    before = len(packer.buffer)
    packer.string(WORLD_FRAME)
    packer.unsigned(touch)
    for text in (gesture, kind, link):
        packer.string(text)
    packer.align(np.dtype("<f8").itemsize)
    return packer.bytes()[before:]


def unpack_truth(data: bytes) -> TruthRecord:
    """Decode a message of `/eskin/truth`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.header()
    touch = unpacker.unsigned()
    gesture, kind, link = (unpacker.string() for _ in range(3))
    force, area, *point = (unpacker.number() for _ in range(5))
    return TruthRecord(
        stamp, touch, gesture, kind, link, force, area, cast(Vector, tuple(point))
    )


def pack_event(record: EventRecord, frame_id: str) -> bytes:
    """Encode a message of `/eskin/event`."""
    packer = CdrPacker()
    packer.header(record.stamp, frame_id)
    for text in (record.kind, record.text, record.patch or ""):
        packer.string(text)
    for index in (record.row, record.column, record.taxel):
        packer.signed(NOT_GIVEN if index is None else index)
    return packer.bytes()


def unpack_event(data: bytes) -> EventRecord:
    """Decode a message of `/eskin/event`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.header()
    kind, text, patch = (unpacker.string() for _ in range(3))
    indices = (unpacker.signed() for _ in range(3))
    row, column, taxel = (None if n == NOT_GIVEN else n for n in indices)
    return EventRecord(stamp, kind, text, patch or None, row, column, taxel)


Field = tuple[str, str] | tuple[str, str, int]
"""Name and type of a field, and its length where it is an array."""


def build_message_dtype(*fields: Field) -> np.dtype:
    """Build the dtype of a message; fields align to their own size unless empty.

    All messages of one skin have the same length, so many of them form the rows of one
    array, which is several times as fast as encoding them one by one.
    """
    names, formats, offsets = ["encapsulation"], [np.dtype("S4")], [0]
    end = len(ENCAPSULATION)
    for name, code, *length in fields:
        item = np.dtype(code)
        alignment = 1 if item.kind == "S" or length == [0] else item.itemsize
        end += -(end - len(ENCAPSULATION)) % alignment
        names.append(name)
        formats.append(np.dtype((code, tuple(length))) if length else item)
        offsets.append(end)
        end += formats[-1].itemsize
    return np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": end}
    )


STAMP: tuple[Field, ...] = (("seconds", "<i4"), ("nanoseconds", "<u4"))


def string_fields(name: str, content: str) -> tuple[Field, ...]:
    """Return the two fields of a string: its length and its bytes."""
    size = len(content.encode()) + 1
    return ((f"{name}_length", "<u4"), (name, f"S{size}"))


@lru_cache(maxsize=8)
def build_reading_template(frame_id: str, taxels: int) -> np.ndarray:
    """Build one message of `/eskin/reading` without shear and without values."""
    message = build_message_dtype(
        *STAMP,
        *string_fields("frame", frame_id),
        ("counts_length", "<u4"),
        ("counts", "<u2", taxels),
        ("received_length", "<u4"),
        ("received", "?", taxels),
        ("shear_length", "<u4"),
    )
    template = np.zeros(1, message)
    set_string(template, "frame", frame_id)
    template["counts_length"] = template["received_length"] = taxels
    return template


@lru_cache(maxsize=8)
def build_joint_state_template(names: tuple[str, ...]) -> np.ndarray:
    """Build one message of `/joint_states` without values."""
    message = build_message_dtype(
        *STAMP,
        *string_fields("frame", ""),
        ("names_length", "<u4"),
        *(f for i, name in enumerate(names) for f in string_fields(f"name{i}", name)),
        ("positions_length", "<u4"),
        ("positions", "<f8", len(names)),
        ("velocities_length", "<u4"),
        ("efforts_length", "<u4"),
    )
    template = np.zeros(1, message)
    set_string(template, "frame", "")
    template["names_length"] = template["positions_length"] = len(names)
    for i, name in enumerate(names):
        set_string(template, f"name{i}", name)
    return template


def set_string(template: np.ndarray, name: str, content: str) -> None:
    """Fill in a string and its length."""
    template[name] = content.encode()
    template[f"{name}_length"] = len(content.encode()) + 1


def stamp_messages(
    template: np.ndarray, stamps: Int[np.ndarray, "reading"]
) -> np.ndarray:
    """Repeat a template for all stamps and fill in encapsulation and stamp."""
    messages = np.repeat(template, len(stamps))
    seconds, nanoseconds = np.divmod(stamps, NS_PER_S)
    messages["encapsulation"] = ENCAPSULATION
    messages["seconds"], messages["nanoseconds"] = seconds, nanoseconds
    return messages


def pack_readings(
    stamps: Int[np.ndarray, "reading"],
    counts: Int[np.ndarray, "reading taxel"],
    received: Bool[np.ndarray, "reading taxel"],
    frame_id: str,
) -> list[bytes]:
    """Encode many messages of `/eskin/reading` without shear, in the order of stamps.

    Raises:
        RecordingError: when a stamp or a count cannot be written.
    """
    if len(stamps) and not (0 <= stamps.min() and stamps.max() < LATEST_STAMP):
        raise RecordingError(
            f"stamps from {stamps.min()} to {stamps.max()} ns cannot be written; "
            "allowed are 0 to 2^31 s since the epoch; give nanoseconds of Unix time"
        )
    messages = stamp_messages(build_reading_template(frame_id, counts.shape[1]), stamps)
    narrow = to_16_bits(counts.reshape(-1), np.dtype("<u2"), "counts")
    messages["counts"] = narrow.reshape(counts.shape)
    messages["received"] = received
    return split_messages(messages)


def pack_joint_states(
    stamps: Int[np.ndarray, "reading"],
    names: tuple[str, ...],
    q: Float[np.ndarray, "reading joint"],
) -> list[bytes]:
    """Encode many messages of `/joint_states` with positions [rad] and nothing else."""
    messages = stamp_messages(build_joint_state_template(names), stamps)
    messages["positions"] = q
    return split_messages(messages)


def split_messages(messages: np.ndarray) -> list[bytes]:
    """Return each message as bytes."""
    whole, size = messages.tobytes(), messages.itemsize
    return [whole[i : i + size] for i in range(0, len(whole), size)]
