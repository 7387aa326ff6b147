"""This module finds recordings on disk and reads them, also truncated ones."""

import hashlib
import json
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from struct import error as StructError

import numpy as np
from jaxtyping import Bool, Float, Int
from mcap.records import Attachment
from mcap.records import Metadata as MetadataItem

from eskin.errors import (
    DeviceError,
    RecordingError,
    SkinError,
    SkinMismatchError,
    warn_once,
)
from eskin.files import read_file
from eskin.recording.cdr import MAX_STRINGS
from eskin.recording.label_check import MAX_LABELS, LabelSet
from eskin.recording.mcap_file import MAGIC, MCAP_SUFFIX, McapReader, TopicMessage
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
    Gap,
    Label,
    Metadata,
    TruthRecord,
    describe_rate,
    find_gap_limit,
    sort_labels,
)
from eskin.robot import Robot
from eskin.skin import (
    KeptRobot,
    Skin,
    describe_robot,
    load_robot_for_skin,
    require_robot,
    skin_from_bytes,
)
from eskin.skin.files import ROBOT_URDF
from eskin.touch import MAX_CALIBRATION_BYTES, Calibration, Scan
from eskin.units import NS_PER_S, format_count, format_duration

MAX_DETECTIONS = MAX_EVENTS = 100_000
"""Largest numbers of detections and events that are read into memory."""
MAX_METADATA_BYTES = 1 << 20
"""Largest size of the metadata, whose names and values are kept [bytes]."""

parse_shared_skin = lru_cache(maxsize=8)(skin_from_bytes)
"""Parse the skin of an attachment; equal attachments share one object."""


def is_recording(path: Path) -> bool:
    """Return whether a file is a recording by its name, or by its first bytes.

    A recording of another name is one, and so is a damaged one.

    Raises:
        OSError: it cannot be read.
    """
    if not path.is_file():
        return False
    if path.suffix == MCAP_SUFFIX:
        return True
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def list_recordings(folder: Path) -> list[Path]:
    """Return the recordings below a folder, which are told by their names, sorted."""
    return sorted(folder.rglob(f"*{MCAP_SUFFIX}"))


def find_recordings(places: Iterable[Path | str]) -> tuple[Path, ...]:
    """Find the files given, and all `.mcap` files below the folders given, sorted.

    Raises:
        RecordingError: a place does not exist, or a folder holds no recording.
    """
    found: list[Path] = []
    for place in map(Path, places):
        if place.is_dir():
            inside = list_recordings(place)
            if not inside:
                raise RecordingError(
                    f"no .mcap file below {place}; convert or record some first"
                )
            found += inside
        elif place.exists():  # Reading it says if it is no file.
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
    """Holds all scans of a recording as arrays with one row a scan."""

    stamps: Int[np.ndarray, "reading"]
    """Times of the scans [ns since the epoch]."""
    counts: Int[np.ndarray, "reading taxel"]
    """Raw counts of the device."""
    received: Bool[np.ndarray, "reading taxel"]
    """False for taxels without fresh data."""
    q: Float[np.ndarray, "reading joint"]
    """Joint positions [rad]."""
    shear: Int[np.ndarray, "reading taxel 2"] | None
    """Counts along each taxel's two tangents; None unless every scan has them."""


@dataclass(frozen=True)
class Recording:
    """A recording on disk, whose scans are read when needed; the rest is in memory."""

    path: Path
    """Path of the file."""
    robot_name: str
    """Name of the robot that the skin is mounted on."""
    urdf: bytes
    """URDF of that robot; empty in recordings of presets, and in older ones."""
    joint_names: tuple[str, ...]
    """Names of the joints in the order of `Scan.q`."""
    skin: Skin
    """Skin that was recorded."""
    calibration: Calibration
    """Calibration of that skin."""
    metadata: Metadata
    """Origin of the recording."""
    labels: tuple[Label, ...]
    """Labels sorted by start."""
    detections: tuple[DetectionRecord, ...]
    """Detections in the order in which they were made."""
    events: tuple[EventRecord, ...]
    """Events in the order in which they were noticed."""
    count: int
    """Number of scans."""
    start: int
    """Stamp of the first scan [ns since the epoch]; 0 without scans."""
    end: int
    """Stamp of the last scan [ns since the epoch]; 0 without scans."""
    truncated: bool
    """Whether the end of the file is missing or damaged."""
    period: int = 0
    """Median time between scans [ns]; 0 with fewer than two."""
    gaps: tuple[Gap, ...] = ()
    """Times without scans that are longer than `find_gap_limit`, in order."""
    given_robot: Robot | None = None
    """Robot that was given in place of the recorded one; `robot_name`, `urdf` and
    `joint_names` are its own then."""

    def __repr__(self) -> str:
        """Describe the recording in a line."""
        return (
            f"<Recording {self.path}: {format_count(self.count, 'reading')} in "
            f"{self.seconds:.1f} s, {format_count(len(self.labels), 'label')}, "
            f"skin '{self.skin.name}' on {self.robot_name}>"
        )

    @property
    def runs(self) -> tuple[tuple[int, int], ...]:
        """Return the stamps of the first and last scan of each part without a gap."""
        starts = [self.start, *(gap.end for gap in self.gaps)]
        ends = [*(gap.start for gap in self.gaps), self.end]
        return tuple(zip(starts, ends, strict=True)) if self.count else ()

    @property
    def seconds(self) -> float:
        """Return how long scans were recorded, without the gaps [s]."""
        return sum(end - start for start, end in self.runs) / NS_PER_S

    @property
    def label_set(self) -> LabelSet:
        """Return its labels, with what they must agree with."""
        simulated = self.metadata.simulated
        return LabelSet(self.path, self.labels, self.start, self.end, simulated)

    def describe_gaps(self) -> str:
        """Return number and place of the gaps, for messages; empty without any."""
        if not self.gaps:
            return ""
        longest = max(self.gaps, key=lambda gap: gap.seconds)
        after = format_duration((longest.start - self.start) / NS_PER_S)
        which = ", the longest" if len(self.gaps) > 1 else ""
        return (
            f"{format_count(len(self.gaps), 'gap')}{which} of "
            f"{format_duration(longest.seconds)} without readings {after} after the "
            "first"
        )

    def load_robot(self) -> Robot:
        """Load the robot that the skin is mounted on.

        Raises:
            RobotError: the recording is not of a preset and lacks the URDF, or the URDF
                cannot be used.
        """
        place = f"{self.path}, URDF of the recorded robot {self.robot_name!r:.40}"
        kept = KeptRobot(self.robot_name, self.urdf, place)
        robot = load_robot_for_skin(kept, self.given_robot)
        told = f"{self.path} is of robot {self.robot_name!r:.40} and lacks its URDF"
        return require_robot(robot, told)

    def with_robot(self, robot: Robot) -> "Recording":
        """Return the recording on another robot, with the positions of its joints.

        Raises:
            SkinMismatchError: positions of joints of the robot were not recorded.
        """
        if missing := set(robot.joint_names) - set(self.joint_names):
            raise SkinMismatchError(
                f"{self.path} has joints {', '.join(self.joint_names) or 'none'}, and "
                f"robot '{robot.name}' also {', '.join(sorted(missing))}; allowed are "
                "those that were recorded; give the robot of the recording"
            )
        return replace(
            self,
            robot_name=robot.name,
            urdf=describe_robot(robot).urdf,
            joint_names=robot.joint_names,
            given_robot=robot,
        )

    def scans(self) -> Iterator[Scan]:
        """Read all scans from disk, up to the last whole chunk."""
        q = np.empty(0)
        for message in McapReader(self.path):
            if not isinstance(message, TopicMessage):
                continue
            try:
                if message.topic == JOINT_STATES.name:
                    q = self.parse_joint_positions(message.data)
                elif message.topic == READING.name:
                    yield self.build_scan(message.data, q)
            except (StructError, ValueError) as error:
                raise unusable_message(self.path, message, error) from error

    def truths(self) -> Iterator[TruthRecord]:
        """Read the ground truth of all touches from disk, if there is any."""
        for message in McapReader(self.path):
            if isinstance(message, TopicMessage) and message.topic == TRUTH.name:
                try:
                    yield unpack_truth(message.data)
                except (StructError, ValueError) as error:
                    raise unusable_message(self.path, message, error) from error

    def parse_joint_positions(self, data: bytes) -> Float[np.ndarray, "joint"]:
        """Decode joint positions [rad] in the order of `joint_names`."""
        _, names, positions = unpack_joint_state(data)
        if names == self.joint_names and len(positions) == len(names):
            return positions
        known = dict(zip(names, positions.tolist(), strict=False))
        missing = [name for name in self.joint_names if name not in known]
        if missing:
            raise RecordingError(f"no position for joint '{missing[0]}'")
        return np.array([known[name] for name in self.joint_names])

    def build_scan(self, data: bytes, q: Float[np.ndarray, "joint"]) -> Scan:
        """Build a scan from its message and the latest joint positions [rad]."""
        reading = unpack_reading(data)
        if len(reading.counts) != self.skin.count:
            raise RecordingError(
                f"{len(reading.counts)} counts, the skin has {self.skin.count} taxels"
            )
        if len(q) != len(self.joint_names):
            raise RecordingError(f"no joint positions yet at {reading.stamp} ns")
        return Scan(reading.stamp, reading.counts, reading.received, q, reading.shear)

    def arrays(self) -> ScanArrays:
        """Read all scans into memory."""
        scans = list(self.scans())
        shears = [scan.shear for scan in scans if scan.shear is not None]
        taxels = self.skin.count
        joints = len(self.joint_names)
        has_shear = bool(scans) and len(shears) == len(scans)
        return ScanArrays(
            np.array([scan.stamp for scan in scans], dtype=np.int64),
            stack_rows([scan.counts for scan in scans], (taxels,), np.int32),
            stack_rows([scan.received for scan in scans], (taxels,), np.bool_),
            stack_rows([scan.q for scan in scans], (joints,), np.float64),
            stack_rows(shears, (taxels, 2), np.int32) if has_shear else None,
        )


def stack_rows(
    rows: list[np.ndarray], shape: tuple[int, ...], dtype: type
) -> np.ndarray:
    """Stack rows of one shape into an array, even if there are none."""
    return np.array(rows, dtype=dtype).reshape(len(rows), *shape)


def unusable_message(
    path: Path, message: TopicMessage, error: Exception
) -> RecordingError:
    """Build the error for a message that cannot be used."""
    return RecordingError(
        f"{path}: message on {message.topic} at {message.log_time} ns cannot be used: "
        f"{' '.join(str(error).split())}; record or convert it again"
    )


@dataclass(frozen=True)
class Overrides:
    """Overrides are used in place of what recordings hold."""

    calibration: Calibration | None = None
    """Calibration of the skin; None for the recorded one."""
    robot: Robot | None = None
    """Robot that wears the skin; None for the recorded one."""

    @property
    def digest(self) -> str:
        """Digest of the overrides; empty for none."""
        parts = {}
        if self.calibration is not None:
            parts["calibration"] = self.calibration.to_bytes()
        if self.robot is not None:
            parts["urdf"] = self.robot.urdf
        return " ".join(
            f"{name} {hashlib.sha256(part).hexdigest()}" for name, part in parts.items()
        )


NO_OVERRIDES = Overrides()


GROUPED = 2
"""Ratio of the mean time between readings to the median from which they come in groups:
less is due to readings that are lost."""


def compute_period(stamps: Int[np.ndarray, "reading"]) -> int:
    """Return the usual time between two readings [ns]; 0 for fewer than two.

    It is the median, which readings that are lost do not change. Where readings come in
    groups the median is the time within a group: it is the mean, without gaps.
    """
    steps = np.diff(stamps)
    if not len(steps):
        return 0
    median = int(np.median(steps))
    mean = int(steps[steps <= find_gap_limit(median)].mean())
    return mean if mean > GROUPED * median else median


def find_gaps(stamps: Int[np.ndarray, "reading"], period: int) -> tuple[Gap, ...]:
    """Return the gaps between readings with some stamps, of a usual period [ns]."""
    before = np.flatnonzero(np.diff(stamps) > find_gap_limit(period)).tolist()
    return tuple(Gap(int(stamps[n]), int(stamps[n + 1])) for n in before)


def read_recording(path: Path | str, overrides: Overrides = NO_OVERRIDES) -> Recording:
    """Read everything but the scans, which `Recording.scans` reads.

    Args:
        path: path of the recording.
        overrides: what to use in place of what it holds.

    Raises:
        RecordingError: there is no such file, or nothing in it can be used.
        SkinMismatchError: the calibration is not of the recorded skin, or positions of
            joints of the robot that is given were not recorded.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"no recording at {path}; give an .mcap file")
    if path.is_dir():
        raise RecordingError(
            f"{path} is a folder; allowed is one recording, an .mcap file; list those "
            "below a folder with eskin.find_recordings"
        )
    stream = McapReader(path)
    parser = RecordingParser(path)
    for item in stream:
        parser.add_item(item)
    recording = parser.build_recording(stream.truncated)
    if overrides.robot is not None:
        recording = recording.with_robot(overrides.robot)
    calibration = overrides.calibration
    if calibration is None:
        return recording
    if len(calibration.gain) != recording.skin.count:
        raise SkinMismatchError(
            f"calibration has {len(calibration.gain)} taxels, skin "
            f"'{recording.skin.name}' of {path} has {recording.skin.count}; allowed is "
            "one gain a taxel; use the skin's own"
        )
    return replace(recording, calibration=calibration)


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Raises:
        RecordingError: the file is no calibration.
        DeviceError: the file cannot be read.
    """
    try:
        data = read_file(path, MAX_CALIBRATION_BYTES)
    except OSError as error:
        raise DeviceError(
            f"calibration {path} cannot be read ({error.strerror}); allowed is a JSON "
            "file as eskin calibrate writes it"
        ) from error
    return parse_calibration(data, path)


def parse_calibration(data: bytes, path: Path) -> Calibration:
    """Parse the calibration that a file is or holds.

    Raises:
        RecordingError: the bytes are no calibration; the message names the file.
    """
    try:
        return Calibration.from_bytes(data)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def check_room(found: Sequence[object], limit: int, what: str) -> None:
    """Raise where as many things as allowed have been read already."""
    if len(found) >= limit:
        raise RecordingError(f"there are more than {limit:,} {what}; allowed are fewer")


ATTACHMENTS = {SKIN_NAME, CALIBRATION_NAME, ROBOT_URDF}
"""Names of the attachments that are kept in memory."""


class RecordingParser:
    """Collects the items of one file and builds its recording."""

    def __init__(self, path: Path) -> None:
        """Start without any item."""
        self.path = path
        self.facts: dict[str, str] = {}
        self.attachments: dict[str, bytes] = {}
        self.labels: list[Label] = []
        self.detections: list[DetectionRecord] = []
        self.events: list[EventRecord] = []
        self.stamps = array("q")

    def add_item(self, item: object) -> None:
        """Add one item of the file."""
        if isinstance(item, MetadataItem) and item.name == RECORD_NAME:
            self.facts = item.metadata
            size = sum(len(key) + len(value) for key, value in self.facts.items())
            if size > MAX_METADATA_BYTES:
                raise RecordingError(
                    f"{self.path} has {size:,} characters of metadata; allowed are "
                    f"{MAX_METADATA_BYTES:,}; record it again"
                )
        elif isinstance(item, Attachment) and item.name in ATTACHMENTS:
            self.attachments[item.name] = item.data
        elif isinstance(item, TopicMessage):
            try:
                self.add_message(item)
            except (StructError, ValueError) as error:
                raise unusable_message(self.path, item, error) from error

    def add_message(self, message: TopicMessage) -> None:
        """Add one message; of scans only the stamps are kept."""
        if message.topic == READING.name:
            self.stamps.append(message.log_time)
        elif message.topic == LABEL.name:
            check_room(self.labels, MAX_LABELS, "labels")
            self.labels.append(unpack_label(message.data))
        elif message.topic == DETECTION.name:
            check_room(self.detections, MAX_DETECTIONS, "detections")
            self.detections.append(unpack_detection(message.data))
        elif message.topic == EVENT.name:
            check_room(self.events, MAX_EVENTS, "events")
            self.events.append(unpack_event(message.data))

    def build_recording(self, truncated: bool) -> Recording:
        """Build the recording; raise a RecordingError unless its header is complete."""
        if self.facts and self.facts.get("format") != FORMAT:
            raise RecordingError(
                f"{self.path} has recording format {self.facts.get('format')!r:.40}; "
                f"allowed is '{FORMAT}'; use the version of eskin that wrote it"
            )
        skin = self.find_attachment(SKIN_NAME, truncated)
        calibration = self.find_attachment(CALIBRATION_NAME, truncated)
        stamps = np.array(self.stamps, np.int64)
        period = compute_period(stamps)
        wrong = describe_rate(period) if len(stamps) > 1 else None
        if wrong is not None:
            warn_once(f"{self.path}: {wrong}")
        return Recording(
            path=self.path,
            robot_name=self.parse_robot_name(),
            urdf=self.attachments.get(ROBOT_URDF, b""),
            joint_names=self.parse_joint_names(),
            skin=self.parse_skin(skin),
            calibration=parse_calibration(calibration, self.path),
            metadata=Metadata.from_record(self.facts),
            labels=sort_labels(self.labels),
            detections=tuple(self.detections),
            events=tuple(self.events),
            count=len(stamps),
            start=int(stamps[0]) if len(stamps) else 0,
            end=int(stamps[-1]) if len(stamps) else 0,
            truncated=truncated,
            period=period,
            gaps=find_gaps(stamps, period),
        )

    def parse_robot_name(self) -> str:
        """Return the robot's name from the metadata."""
        if "robot" not in self.facts:
            raise RecordingError(
                f"{self.path} does not say its robot; allowed is metadata with 'robot'"
                "; copy it again from where it was recorded"
            )
        return self.facts["robot"]

    def parse_joint_names(self) -> tuple[str, ...]:
        """Return the joints' names from the metadata; none if it has no entry."""
        text = self.facts.get("joints", "[]")
        try:
            names = json.loads(text)
        except (ValueError, RecursionError):
            names = None
        if isinstance(names, list) and all(isinstance(name, str) for name in names):
            if len(names) <= MAX_STRINGS:
                return tuple(names)
        raise RecordingError(
            f"{self.path} has joints {text!r:.60}; allowed is a JSON list of names; "
            "copy it again from where it was recorded"
        )

    def parse_skin(self, data: bytes) -> Skin:
        """Parse the skin's attachment."""
        try:
            return parse_shared_skin(data)
        except SkinError as error:
            raise RecordingError(
                f"{self.path} has a skin that cannot be used: {error}"
            ) from error

    def find_attachment(self, name: str, truncated: bool) -> bytes:
        """Return an attachment; raise a RecordingError where it is missing."""
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
