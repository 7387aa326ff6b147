"""This module converts the six messages of a recording to and from CDR."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Integer, UInt8

from eskin.errors import RecordingError
from eskin.recording.cdr import COUNT, STAMP, align, check_stamps, define_topic
from eskin.recording.records import DetectionRecord, EventRecord, Label, TruthRecord
from eskin.touch import Scan
from eskin.units import NS_PER_S

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
NO_NUMBERS = np.empty(0)
ENCAPSULATED_STAMP = slice(4, 4 + STAMP.size)
"""Bytes of a message with a header that hold its stamp."""


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
    counts = to_16_bits(scan.counts, np.dtype("<u2"), "counts")
    shear = NO_NUMBERS
    if scan.shear is not None:
        shear = to_16_bits(scan.shear.reshape(-1), np.dtype("<i2"), "shear counts")
    return READING.pack((scan.stamp, frame_id), counts, scan.received, shear)


def to_16_bits(
    values: Int[np.ndarray, "*item"], dtype: np.dtype, what: str
) -> Integer[np.ndarray, "*item"]:
    """Convert integers to 16 bits; raise an error with their range if too wide."""
    limits = np.iinfo(dtype)
    if values.size and (values.min() < limits.min or values.max() > limits.max):
        raise RecordingError(
            f"{what} from {values.min()} to {values.max()} cannot be recorded; allowed "
            f"are {limits.min} to {limits.max}; scale them to the device's resolution"
        )
    return values.astype(dtype)


def unpack_reading(data: bytes) -> ReadingMessage:
    """Decode a message of `/eskin/reading`."""
    (stamp, _), counts, received, shear = READING.unpack(data)
    if len(received) != len(counts) or len(shear) not in (0, 2 * len(counts)):
        raise RecordingError(
            f"reading at {stamp} ns has {len(counts)} counts, {len(received)} received "
            f"and {len(shear)} shear; allowed are n, n and 0 or 2 n"
        )
    pairs = shear.astype(np.int32).reshape(-1, 2) if len(shear) else None
    return ReadingMessage(stamp, counts.astype(np.int32), received, pairs)


def pack_joint_state(
    stamp: int, names: tuple[str, ...], q: Float[np.ndarray, "joint"]
) -> bytes:
    """Encode a message of `/joint_states` with positions [rad] and nothing else."""
    return JOINT_STATES.pack((stamp, ""), names, q, NO_NUMBERS, NO_NUMBERS)


def unpack_joint_state(
    data: bytes,
) -> tuple[int, tuple[str, ...], Float[np.ndarray, "joint"]]:
    """Decode a message of `/joint_states`: stamp [ns], joint names, positions [rad]."""
    (stamp, _), names, positions, *_ = JOINT_STATES.unpack(data)
    return stamp, names, positions.astype(np.float64)


def pack_label(label: Label) -> bytes:
    """Encode a message of `/eskin/label`."""
    return LABEL.pack(label.start, label.end, label.gesture, label.source)


def unpack_label(data: bytes) -> Label:
    """Decode a message of `/eskin/label`."""
    start, end, gesture, source = LABEL.unpack(data)
    if source not in ("true", "range", "auto"):
        raise RecordingError(
            f"label '{gesture}' has source '{source}'; allowed are true, range, auto"
        )
    return Label(start, end, gesture, source)


def pack_detection(record: DetectionRecord, frame_id: str = WORLD_FRAME) -> bytes:
    """Encode a message of `/eskin/detection`; `frame_id` names the world."""
    stamp, *others = vars(record).values()
    return DETECTION.pack((stamp, frame_id), *others)


def unpack_detection(data: bytes) -> DetectionRecord:
    """Decode a message of `/eskin/detection`."""
    (stamp, _), *others = DETECTION.unpack(data)
    return DetectionRecord(stamp, *others)


def pack_truth(record: TruthRecord) -> bytes:
    """Encode a message of `/eskin/truth`."""
    stamp, *others = vars(record).values()
    return TRUTH.pack((stamp, WORLD_FRAME), *others)


def unpack_truth(data: bytes) -> TruthRecord:
    """Decode a message of `/eskin/truth`."""
    (stamp, _), *others = TRUTH.unpack(data)
    return TruthRecord(stamp, *others)


def pack_event(record: EventRecord, frame_id: str) -> bytes:
    """Encode a message of `/eskin/event`."""
    places = record.row, record.column, record.taxel
    numbers = (NOT_GIVEN if place is None else place for place in places)
    patch = record.patch or ""
    return EVENT.pack(
        (record.stamp, frame_id), record.kind, record.text, patch, *numbers
    )


def unpack_event(data: bytes) -> EventRecord:
    """Decode a message of `/eskin/event`."""
    (stamp, _), kind, text, patch, *numbers = EVENT.unpack(data)
    places = (None if number == NOT_GIVEN else number for number in numbers)
    return EventRecord(stamp, kind, text, patch or None, *places)


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
    narrow = to_16_bits(counts, np.dtype("<u2"), "counts")
    template = READING.pack((0, frame_id), narrow[0], received[0], NO_NUMBERS)
    messages = repeat_message(template, stamps)
    start = ENCAPSULATED_STAMP.stop + COUNT.size + len(frame_id.encode()) + 1
    for values in (narrow, received):
        start = align(start, COUNT.size) + COUNT.size
        content = np.ascontiguousarray(values).view(np.uint8)
        messages[:, start : start + content.shape[1]] = content
        start += content.shape[1]
    return split_messages(messages)


def pack_joint_states(
    stamps: Int[np.ndarray, "reading"],
    names: tuple[str, ...],
    q: Float[np.ndarray, "reading joint"],
) -> list[bytes]:
    """Encode many messages of `/joint_states` with positions [rad] and nothing else."""
    messages = repeat_message(pack_joint_state(0, names, q[0]), stamps)
    content = q.astype("<f8", order="C").view(np.uint8)
    # Velocities and efforts follow the positions, each of them an empty sequence.
    end = messages.shape[1] - 2 * COUNT.size
    messages[:, end - content.shape[1] : end] = content
    return split_messages(messages)


def repeat_message(
    template: bytes, stamps: Int[np.ndarray, "reading"]
) -> UInt8[np.ndarray, "reading byte"]:
    """Repeat a message with a header for all stamps.

    All messages of one skin have the same length, so many of them form the rows of one
    array, which is several times as fast as encoding them one by one.
    """
    check_stamps(int(stamps.min()), int(stamps.max()))
    messages = np.empty((len(stamps), len(template)), np.uint8)
    messages[:] = np.frombuffer(template, np.uint8)
    times = np.stack(np.divmod(stamps, NS_PER_S), axis=1).astype("<u4")
    messages[:, ENCAPSULATED_STAMP] = times.view(np.uint8)
    return messages


def split_messages(messages: UInt8[np.ndarray, "reading byte"]) -> list[bytes]:
    """Return each message as bytes."""
    whole = messages.tobytes()
    size = messages.shape[1]
    return [whole[i : i + size] for i in range(0, len(whole), size)]
