"""The six messages of a recording, to CDR and back; definitions are in `schemas`."""

from dataclasses import dataclass
from functools import lru_cache
from struct import Struct
from typing import cast

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from eskin.errors import RecordingError
from eskin.recording.cdr import CdrPacker, CdrUnpacker
from eskin.recording.detection import DetectionRecord, Vector
from eskin.recording.event import EventRecord
from eskin.recording.labels import Label
from eskin.recording.truth import TruthRecord
from eskin.touch.reading import Scan

WORLD = "world"
NOWHERE = -1
TRUTH_COUNT = 5
TRUTH_NUMBERS = Struct(f"<{TRUTH_COUNT}d")


@dataclass(frozen=True)
class ReadingMessage:
    """What `/eskin/reading` holds: a scan without the joints."""

    stamp: int
    """When it was taken [ns since the epoch]."""
    counts: Int[np.ndarray, "taxel"]
    """As the device gave them."""
    received: Bool[np.ndarray, "taxel"]
    """False where no fresh data came."""
    shear: Int[np.ndarray, "taxel 2"] | None
    """Counts along the taxel's tangents, where measured."""


def pack_reading(scan: Scan, frame_id: str) -> bytes:
    """Message of `/eskin/reading`.

    Raises:
        RecordingError: when a count does not fit its 16 bits.
    """
    packer = CdrPacker()
    packer.stamp(scan.stamp)
    packer.string(frame_id)
    packer.sequence(to_16_bits(scan.counts, np.dtype("<u2"), "counts"))
    packer.sequence(scan.received)
    shear = np.empty(0, np.int64) if scan.shear is None else scan.shear.reshape(-1)
    packer.sequence(to_16_bits(shear, np.dtype("<i2"), "shear counts"))
    return packer.bytes()


def to_16_bits(
    values: Int[np.ndarray, "item"], dtype: np.dtype, what: str
) -> Integer[np.ndarray, "item"]:
    """The same integers in 16 bits, or an error that says which do not fit."""
    limits = np.iinfo(dtype)
    if len(values) and (values.min() < limits.min or values.max() > limits.max):
        raise RecordingError(
            f"{what} from {values.min()} to {values.max()} cannot be recorded; allowed "
            f"are {limits.min} to {limits.max}; scale them to the device's resolution"
        )
    return values.astype(dtype)


def unpack_reading(data: bytes) -> ReadingMessage:
    """Contents of a message of `/eskin/reading`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.stamp()
    unpacker.string()
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
    """Message of `/joint_states` with positions [rad] and nothing else."""
    packer = CdrPacker()
    packer.stamp(stamp)
    packer.string("")
    packer.strings(names)
    packer.sequence(q.astype(np.float64))
    packer.unsigned(0)
    packer.unsigned(0)
    return packer.bytes()


def unpack_joint_state(
    data: bytes,
) -> tuple[int, tuple[str, ...], Float[np.ndarray, "joint"]]:
    """Stamp [ns], joint names and positions [rad] of a message of `/joint_states`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.stamp()
    unpacker.string()
    names = unpacker.strings()
    return stamp, names, unpacker.sequence("<f8").astype(np.float64)


def pack_label(label: Label) -> bytes:
    """Message of `/eskin/label`."""
    packer = CdrPacker()
    packer.stamp(label.start)
    packer.stamp(label.end)
    packer.string(label.gesture)
    packer.string(label.source)
    return packer.bytes()


def unpack_label(data: bytes) -> Label:
    """Contents of a message of `/eskin/label`."""
    unpacker = CdrUnpacker(data)
    start, end = unpacker.stamp(), unpacker.stamp()
    gesture, source = unpacker.string(), unpacker.string()
    if source not in ("true", "range", "auto"):
        raise RecordingError(
            f"label '{gesture}' has source '{source}'; allowed are true, range, auto"
        )
    return Label(start, end, gesture, source)


def pack_detection(record: DetectionRecord) -> bytes:
    """Message of `/eskin/detection`."""
    packer = CdrPacker()
    packer.stamp(record.stamp)
    packer.string(WORLD)
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
    """Contents of a message of `/eskin/detection`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.stamp()
    unpacker.string()
    gesture, confidence = unpacker.string(), unpacker.number("f")
    onset, end = unpacker.stamp(), unpacker.stamp()
    link, patch = unpacker.string(), unpacker.string()
    point, normal, direction = (
        cast(Vector, tuple(unpacker.number() for _ in range(3))) for _ in range(3)
    )
    return DetectionRecord(
        stamp,
        gesture,
        confidence,
        onset,
        end,
        link,
        patch,
        point,
        normal,
        direction,
        unpacker.number("f"),
    )


def pack_truth(record: TruthRecord) -> bytes:
    """Message of `/eskin/truth`."""
    packer = CdrPacker()
    packer.stamp(record.stamp)
    words = truth_words(record.touch, record.gesture, record.kind, record.link)
    numbers = TRUTH_NUMBERS.pack(record.force, record.area, *record.p_world)
    return packer.bytes() + words + numbers


@lru_cache(maxsize=64)
def truth_words(touch: int, gesture: str, kind: str, link: str) -> bytes:
    """What all messages of one touch share: all between the stamp and the numbers."""
    packer = CdrPacker()
    packer.stamp(0)
    before = len(packer.buffer)
    packer.string(WORLD)
    packer.unsigned(touch)
    for text in (gesture, kind, link):
        packer.string(text)
    packer.align(TRUTH_NUMBERS.size // TRUTH_COUNT)
    return packer.bytes()[before:]


def unpack_truth(data: bytes) -> TruthRecord:
    """Contents of a message of `/eskin/truth`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.stamp()
    unpacker.string()
    touch = unpacker.unsigned()
    gesture, kind, link = (unpacker.string() for _ in range(3))
    force, area, *point = (unpacker.number() for _ in range(5))
    return TruthRecord(
        stamp, touch, gesture, kind, link, force, area, cast(Vector, tuple(point))
    )


def pack_event(record: EventRecord, frame_id: str) -> bytes:
    """Message of `/eskin/event`."""
    packer = CdrPacker()
    packer.stamp(record.stamp)
    for text in (frame_id, record.kind, record.text, record.patch or ""):
        packer.string(text)
    for place in (record.row, record.column, record.taxel):
        packer.signed(NOWHERE if place is None else place)
    return packer.bytes()


def unpack_event(data: bytes) -> EventRecord:
    """Contents of a message of `/eskin/event`."""
    unpacker = CdrUnpacker(data)
    stamp = unpacker.stamp()
    unpacker.string()
    kind, text, patch = (unpacker.string() for _ in range(3))
    places = (unpacker.signed() for _ in range(3))
    row, column, taxel = (None if n == NOWHERE else n for n in places)
    return EventRecord(stamp, kind, text, patch or None, row, column, taxel)
