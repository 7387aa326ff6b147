"""This module finds recordings on disk and reads them, whole or cut."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from struct import error as StructError

import numpy as np
from jaxtyping import Bool, Float, Int
from mcap.records import Attachment
from mcap.records import Metadata as MetadataItem

from eskin.errors import RecordingError, SkinError
from eskin.recording.labels import Label, sort_labels
from eskin.recording.mcap_file import McapReader, TopicMessage
from eskin.recording.messages import (
    DETECTION,
    EVENT,
    JOINT_STATES,
    LABEL,
    READING,
    TRUTH,
    unpack_detection,
    unpack_event,
    unpack_joint_state,
    unpack_label,
    unpack_reading,
    unpack_truth,
)
from eskin.recording.records import (
    CALIBRATION_NAME,
    FORMAT,
    RECORD_NAME,
    SKIN_NAME,
    DetectionRecord,
    EventRecord,
    Metadata,
    TruthRecord,
)
from eskin.skin.files import skin_from_bytes
from eskin.skin.skin import Skin
from eskin.touch.calibration import Calibration
from eskin.touch.reading import Scan


def find_recordings(places: Iterable[Path | str]) -> tuple[Path, ...]:
    """The files given, and all `.mcap` files below the folders given, sorted.

    Raises:
        RecordingError: when a place does not exist or a folder holds no recording.
    """
    found: list[Path] = []
    for place in map(Path, places):
        if place.is_dir():
            inside = sorted(place.rglob("*.mcap"))
            if not inside:
                raise RecordingError(
                    f"no .mcap file below {place}; convert or record some first"
                )
            found += inside
        elif place.is_file():
            found.append(place)
        else:
            raise RecordingError(
                f"no recording at {place}; give .mcap files or folders that hold some"
            )
    once: dict[Path, Path] = {}
    for path in found:
        once.setdefault(path.resolve(), path)
    return tuple(once.values())


@dataclass(frozen=True)
class ScanArrays:
    """All scans of a recording, one row a scan."""

    stamps: Int[np.ndarray, "reading"]
    """When each was taken [ns since the epoch]."""
    counts: Int[np.ndarray, "reading taxel"]
    """As the device gave them."""
    received: Bool[np.ndarray, "reading taxel"]
    """False where no fresh data came."""
    q: Float[np.ndarray, "reading joint"]
    """Joint positions [rad]."""
    shear: Int[np.ndarray, "reading taxel 2"] | None
    """Counts along the taxels' tangents, where every scan has them."""


@dataclass(frozen=True)
class Recording:
    """A recording on disk: what never changes in it, its labels, and its scans."""

    path: Path
    """The file."""
    robot_name: str
    """Preset or URDF that the skin is on."""
    joint_names: tuple[str, ...]
    """In the order of `Scan.q`."""
    skin: Skin
    """Whose taxels the scans count."""
    calibration: Calibration
    """Of that skin."""
    metadata: Metadata
    """Who and what was recorded."""
    labels: tuple[Label, ...]
    """Sorted by start."""
    detections: tuple[DetectionRecord, ...]
    """In the order in which they were said."""
    events: tuple[EventRecord, ...]
    """In the order in which they were noticed."""
    count: int
    """Number of scans."""
    start: int
    """Stamp of the first scan [ns since the epoch]; 0 without scans."""
    end: int
    """Stamp of the last scan [ns since the epoch]; 0 without scans."""
    truncated: bool
    """Whether the end of the file is missing or damaged."""

    @property
    def period(self) -> int:
        """Mean time between scans [ns]; 0 with fewer than two."""
        return (self.end - self.start) // (self.count - 1) if self.count > 1 else 0

    def scans(self) -> Iterator[Scan]:
        """Every scan up to the last whole chunk, from disk."""
        q = np.empty(0)
        for message in McapReader(self.path):
            if not isinstance(message, TopicMessage):
                continue
            try:
                if message.topic == JOINT_STATES.name:
                    q = self.joint_positions(message.data)
                elif message.topic == READING.name:
                    yield self.scan(message.data, q)
            except (StructError, ValueError) as error:
                raise broken(self.path, message, error) from error

    def truths(self) -> Iterator[TruthRecord]:
        """Every touch as it really was, from disk; none where that is not known."""
        for message in McapReader(self.path):
            if isinstance(message, TopicMessage) and message.topic == TRUTH.name:
                try:
                    yield unpack_truth(message.data)
                except (StructError, ValueError) as error:
                    raise broken(self.path, message, error) from error

    def joint_positions(self, data: bytes) -> Float[np.ndarray, "joint"]:
        """Positions [rad] in the order of `joint_names`."""
        _, names, positions = unpack_joint_state(data)
        if names == self.joint_names and len(positions) == len(names):
            return positions
        known = dict(zip(names, positions.tolist(), strict=False))
        missing = [name for name in self.joint_names if name not in known]
        if missing:
            raise RecordingError(f"no position for joint '{missing[0]}'")
        return np.array([known[name] for name in self.joint_names])

    def scan(self, data: bytes, q: Float[np.ndarray, "joint"]) -> Scan:
        """One scan from its message and the latest joint positions."""
        reading = unpack_reading(data)
        if len(reading.counts) != self.skin.count:
            raise RecordingError(
                f"{len(reading.counts)} counts, the skin has {self.skin.count} taxels"
            )
        if len(q) != len(self.joint_names):
            raise RecordingError(f"no joint positions yet at {reading.stamp} ns")
        return Scan(reading.stamp, reading.counts, reading.received, q, reading.shear)

    def arrays(self) -> ScanArrays:
        """All scans at once, in memory."""
        scans = list(self.scans())
        shears = [scan.shear for scan in scans if scan.shear is not None]
        taxels, joints = self.skin.count, len(self.joint_names)
        everywhere = bool(scans) and len(shears) == len(scans)
        return ScanArrays(
            np.array([scan.stamp for scan in scans], dtype=np.int64),
            stack([scan.counts for scan in scans], (taxels,), np.int32),
            stack([scan.received for scan in scans], (taxels,), np.bool_),
            stack([scan.q for scan in scans], (joints,), np.float64),
            stack(shears, (taxels, 2), np.int32) if everywhere else None,
        )


def stack(rows: list[np.ndarray], shape: tuple[int, ...], dtype: type) -> np.ndarray:
    """Rows of one shape as one array, also where there are none."""
    return np.array(rows, dtype=dtype).reshape(len(rows), *shape)


def broken(path: Path, message: TopicMessage, error: Exception) -> RecordingError:
    """The error that says which message could not be used."""
    return RecordingError(
        f"{path}: message on {message.topic} at {message.log_time} ns cannot be used: "
        f"{' '.join(str(error).split())}; record or convert it again"
    )


def read_recording(path: Path | str) -> Recording:
    """Read all but the scans; these come from `Recording.scans`.

    Raises:
        RecordingError: when there is no such file or nothing in it can be used.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(f"no recording at {path}; give an .mcap file")
    stream = McapReader(path)
    found = Findings(path)
    for item in stream:
        found.take(item)
    return found.recording(stream.truncated)


@lru_cache(maxsize=8)
def shared_skin(data: bytes) -> Skin:
    """The skin of an attachment; recordings with the same bytes share one object."""
    return skin_from_bytes(data)


class Findings:
    """What one pass over a file finds in it."""

    def __init__(self, path: Path) -> None:
        """Start with nothing."""
        self.path = path
        self.facts: dict[str, str] = {}
        self.attachments: dict[str, bytes] = {}
        self.labels: list[Label] = []
        self.detections: list[DetectionRecord] = []
        self.events: list[EventRecord] = []
        self.stamps: list[int] = []
        self.count = 0

    def take(self, item: object) -> None:
        """Note one item."""
        if isinstance(item, MetadataItem) and item.name == RECORD_NAME:
            self.facts = item.metadata
        elif isinstance(item, Attachment):
            self.attachments[item.name] = item.data
        elif isinstance(item, TopicMessage):
            try:
                self.take_message(item)
            except (StructError, ValueError) as error:
                raise broken(self.path, item, error) from error

    def take_message(self, message: TopicMessage) -> None:
        """Note one message; scans are only counted."""
        if message.topic == READING.name:
            self.count += 1
            self.stamps = [*self.stamps[:1], message.log_time]
        elif message.topic == LABEL.name:
            self.labels.append(unpack_label(message.data))
        elif message.topic == DETECTION.name:
            self.detections.append(unpack_detection(message.data))
        elif message.topic == EVENT.name:
            self.events.append(unpack_event(message.data))

    def recording(self, truncated: bool) -> Recording:
        """The recording, when its beginning is there."""
        if self.facts and self.facts.get("format") != FORMAT:
            raise RecordingError(
                f"{self.path} has recording format {self.facts.get('format')!r:.40}; "
                f"allowed is '{FORMAT}'; use the version of eskin that wrote it"
            )
        skin = self.attachment(SKIN_NAME, truncated)
        calibration = self.attachment(CALIBRATION_NAME, truncated)
        return Recording(
            path=self.path,
            robot_name=self.robot_name(),
            joint_names=self.joint_names(),
            skin=self.skin(skin),
            calibration=Calibration.from_bytes(calibration),
            metadata=Metadata.from_record(self.facts),
            labels=sort_labels(self.labels),
            detections=tuple(self.detections),
            events=tuple(self.events),
            count=self.count,
            start=self.stamps[0] if self.stamps else 0,
            end=self.stamps[-1] if self.stamps else 0,
            truncated=truncated,
        )

    def robot_name(self) -> str:
        """What the metadata says the skin is on."""
        if "robot" not in self.facts:
            raise RecordingError(
                f"{self.path} does not say its robot; allowed is metadata with 'robot'"
                "; copy it again from where it was recorded"
            )
        return self.facts["robot"]

    def joint_names(self) -> tuple[str, ...]:
        """What the metadata says of the joints; none where it says nothing."""
        text = self.facts.get("joints", "[]")
        try:
            names = json.loads(text)
        except (ValueError, RecursionError):
            names = None
        if isinstance(names, list) and all(isinstance(name, str) for name in names):
            return tuple(names)
        raise RecordingError(
            f"{self.path} has joints {text!r:.60}; allowed is a JSON list of names; "
            "copy it again from where it was recorded"
        )

    def skin(self, data: bytes) -> Skin:
        """The skin of the attachment with these bytes."""
        try:
            return shared_skin(data)
        except SkinError as error:
            raise RecordingError(
                f"{self.path} has a skin that cannot be used: {error}"
            ) from error

    def attachment(self, name: str, truncated: bool) -> bytes:
        """An attachment, or an error that says why it is not there."""
        if self.facts and name in self.attachments:
            return self.attachments[name]
        missing = f"its {name}" if self.facts else "its eskin metadata"
        if truncated:
            raise RecordingError(
                f"{self.path} is cut before {missing}, nothing in it can be used; "
                "copy it again from where it was recorded"
            )
        raise RecordingError(
            f"{self.path} lacks {missing}; give a recording made by eskin"
        )
