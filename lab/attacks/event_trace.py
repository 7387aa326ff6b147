"""This module keeps what a policy is told of an event, to tell it again.

A trace is text: a line of JSON of each reading, compressed. It holds of each touch what
policies use, the pressure of its taxels, probabilities, detections and faults.
"""

import json
import zlib
from base64 import b64decode, b64encode
from collections.abc import Iterator
from typing import Any, final

import numpy as np

from eskin.live import Detection
from eskin.skin import MountedSkin
from eskin.stream import RecognitionState
from eskin.touch import Reading, TouchRecord, TouchState
from eskin.touch.faults import Fault
from eskin.touch.records import NO_CONTACT, NO_TAXELS, TrackingResult

Packed = dict[str, Any]
"""Something in terms of JSON."""
LISTS = ("open", "closed", "held")
"""Lists of touches of a reading."""
PLAIN = ("id", "onset", "last", "merged_into", "closed", "confirmed", "contacts") + (
    "force",
    "peak_force",
    "peak",
)
"""Fields of a touch that are kept as they are."""
TAXELS = ("taxels", "held")
"""Fields of a touch that are indices of taxels."""
VECTORS = ("p_world", "n_world", "direction_world")
"""Fields of a detection that are vectors."""
LASTING = ("invalid", "faults")
"""Parts of a reading that are written when they change."""


def pack_touch(row: TouchRecord) -> Packed:
    """Return a touch in terms of JSON."""
    plain = {name: getattr(row, name) for name in (*PLAIN, *TAXELS)}
    return plain | {"patch": row.contact.patch}


def unpack_touch(packed: Packed) -> TouchRecord:
    """Return a touch from terms of JSON."""
    values: Packed = {name: packed[name] for name in PLAIN}
    values |= {name: np.array(packed[name], np.int64) for name in TAXELS}
    return TouchRecord(contact=NO_CONTACT._replace(patch=packed["patch"]), **values)


def unpack_detection(packed: Packed) -> Detection:
    """Return a detection from terms of JSON."""
    vectors = {name: np.array(packed[name], np.float64) for name in VECTORS}
    values: Packed = {**packed, **vectors}
    return Detection(**values)


def pack_state(recognition: RecognitionState) -> Packed:
    """Return a reading in terms of JSON."""
    state = recognition.state
    rows = {name: getattr(state.tracking, name) for name in LISTS}
    every = [row for some in rows.values() for row in some]
    felt = [part for row in every for part in (row.taxels, row.held)]
    taxels = np.unique(np.concatenate([NO_TAXELS, *felt]))
    return {
        "stamp": state.reading.stamp,
        **{name: [pack_touch(row) for row in some] for name, some in rows.items()},
        "taxels": taxels.tolist(),
        # The shortest numbers that are the same in single precision.
        "pressure": [float(str(one)) for one in state.reading.pressure[taxels]],
        "invalid": np.flatnonzero(~state.reading.valid).tolist(),
        "faults": [vars(fault) for fault in state.faults],
        "chances": list(recognition.probabilities.items()),
        "detections": [vars(one) for one in recognition.detections],
    }


def unpack_state(packed: Packed, mounted: MountedSkin) -> RecognitionState:
    """Return a reading of a skin on its robot from terms of JSON."""
    pressure = np.zeros(mounted.skin.count, np.float32)
    pressure[packed["taxels"]] = packed["pressure"]
    valid = np.ones(mounted.skin.count, bool)
    valid[packed["invalid"]] = False
    rows: Packed = {name: tuple(map(unpack_touch, packed[name])) for name in LISTS}
    state = TouchState(
        Reading(
            packed["stamp"], pressure, valid, np.zeros(len(mounted.robot.joint_names))
        ),
        tuple(Fault(**fault) for fault in packed["faults"]),
        np.zeros(mounted.skin.count, bool),
        TrackingResult(**rows),
        mounted,
    )
    chances = {number: np.array(some) for number, some in packed["chances"]}
    detections = tuple(map(unpack_detection, packed["detections"]))
    return RecognitionState(state, chances, detections)


@final
class TraceWriter:
    """A writer collects the readings of one event."""

    def __init__(self, start: int) -> None:
        """Start at a time [ns since the epoch]."""
        self.lines = [json.dumps(start)]
        self.lasting: Packed = {}

    def push(self, recognition: RecognitionState) -> None:
        """Add a reading."""
        packed = pack_state(recognition)
        same = [name for name in LASTING if self.lasting.get(name) == packed[name]]
        self.lasting = {name: packed[name] for name in LASTING}
        kept = {name: one for name, one in packed.items() if name not in same}
        self.lines.append(json.dumps(kept, default=lambda one: one.tolist()))

    def finish(self) -> str:
        """Return the text of the trace."""
        return b64encode(zlib.compress("\n".join(self.lines).encode(), 6)).decode()


def read_trace(
    trace: str, mounted: MountedSkin
) -> tuple[int, Iterator[RecognitionState]]:
    """Return when an event began [ns since the epoch], and its readings."""
    start, *lines = zlib.decompress(b64decode(trace)).decode().split("\n")

    def read() -> Iterator[RecognitionState]:
        packed: Packed = {}
        for line in lines:
            packed = packed | json.loads(line)
            yield unpack_state(packed, mounted)

    return json.loads(start), read()
