"""This module writes recordings: MCAP, profile ros2, CDR, zstd chunks of less than 1 s.

Name, skin, calibration and metadata come first, then chunks, so a truncated file can be
used up to its last whole chunk.
"""

import json
import logging
import os
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from mcap.writer import Writer

from eskin.errors import RecordingError
from eskin.files import atomic_path, rename_new
from eskin.recording.cdr import Topic
from eskin.recording.messages import (
    DETECTION,
    EVENT,
    JOINT_STATES,
    LABEL,
    READING,
    TOPICS,
    TRUTH,
    pack_detection,
    pack_event,
    pack_joint_state,
    pack_joint_states,
    pack_label,
    pack_reading,
    pack_readings,
    pack_truth,
)
from eskin.recording.reader import Recording
from eskin.recording.records import (
    CALIBRATION_NAME,
    FORMAT,
    RECORD_NAME,
    SKIN_NAME,
    DetectionRecord,
    EventRecord,
    Label,
    Metadata,
    TruthRecord,
    describe_rate,
    sort_labels,
)
from eskin.skin import (
    KeptRobot,
    Skin,
    load_robot_for_skin,
    require_robot,
    skin_to_bytes,
)
from eskin.skin.files import ROBOT_URDF
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

logger = logging.getLogger(__name__)

RATED_SCANS = 100
"""Number of scans after which their rate is checked, or at the end of fewer."""
Annotation = Label | DetectionRecord | EventRecord

encode_skin = lru_cache(maxsize=8)(skin_to_bytes)
"""Encode a skin; cached, since many recordings share one skin."""


class RecordingWriter:
    """Writes `<path>.part` and renames it to `path` when it is closed.

    It never replaces a file: delete a recording that is to be made again. After an
    exception inside `with`, the `.part` file stays and can be read up to the last scan
    that was written.
    """

    def __init__(
        self,
        path: Path | str,
        robot_name: str,
        skin: Skin,
        calibration: Calibration,
        metadata: Metadata,
        joint_names: tuple[str, ...] | None = None,
        urdf: bytes = b"",
    ) -> None:
        """Open the file and write everything that stays the same for all scans.

        Args:
            path: path of the finished recording, which must be new; its folder must
                exist.
            robot_name: name of the robot that the skin is mounted on; `table` for none.
            skin: skin that is recorded.
            calibration: calibration of that skin.
            metadata: origin of the recording.
            joint_names: names in the order of `Scan.q`; None takes the robot's names.
            urdf: URDF of the robot; empty for a preset, whose name says enough.

        Raises:
            RecordingError: a recording of that name exists, whole or `.part`, or none
                can be written there.
            RobotError: joint names are not given, and the robot's are not known.
        """
        self.path = Path(path)
        self.part = name_part(self.path)
        check_new_recording(self.path)
        self.skin = skin
        if joint_names is None:
            kept = KeptRobot(robot_name, urdf, f"URDF of robot {robot_name!r:.40}")
            told = f"robot {robot_name!r:.40} is given without its URDF"
            robot = require_robot(load_robot_for_skin(kept), told)
            joint_names = robot.joint_names
        self.joint_names = tuple(joint_names)
        self.first_stamp: int | None = None
        self.last_stamp: int | None = None
        self.count = 0
        self.chunk_start: int | None = None
        try:
            self.file = self.part.open("xb")
        except OSError as error:
            raise RecordingError(
                f"cannot write {self.part}: {error.strerror}; give a path in a folder "
                "that exists and can be written to"
            ) from error
        self.mcap = Writer(self.file)
        try:
            self.write_header(robot_name, urdf, calibration, metadata)
        except BaseException:
            self.file.close()
            self.part.unlink()
            raise

    def write_header(
        self, robot_name: str, urdf: bytes, calibration: Calibration, metadata: Metadata
    ) -> None:
        """Write metadata and attachments and declare the topics."""
        self.mcap.start("ros2", "eskin")
        facts = {"format": FORMAT, "robot": robot_name, "skin": self.skin.name}
        facts["joints"] = json.dumps(self.joint_names)
        self.mcap.add_metadata(RECORD_NAME, facts | metadata.to_record())
        self.add_attachment(SKIN_NAME, "application/yaml", encode_skin(self.skin))
        self.add_attachment(
            CALIBRATION_NAME, "application/json", calibration.to_bytes()
        )
        if urdf:
            self.add_attachment(ROBOT_URDF, "application/xml", urdf)
        self.channels: dict[str, int] = {}
        for topic in TOPICS:
            if topic != JOINT_STATES or self.joint_names:
                self.declare_topic(topic)
        self.mcap.flush()

    def add_attachment(self, name: str, media_type: str, content: bytes) -> None:
        """Write an attachment without a time, so that equal ones have equal bytes."""
        self.mcap.add_attachment(0, 0, name, media_type, content)

    def declare_topic(self, topic: Topic) -> None:
        """Add a channel for a topic to the file."""
        schema = self.mcap.register_schema(
            topic.type_name, "ros2msg", topic.definition.encode()
        )
        metadata = {"offered_qos_profiles": ""}
        self.channels[topic.name] = self.mcap.register_channel(
            topic.name, "cdr", schema, metadata
        )

    def write(self, scan: Scan) -> None:
        """Append one scan; stamps must increase.

        Raises:
            RecordingError: it does not fit the skin or the robot, or is not later than
                the scan before.
        """
        self.check_next_scan(scan.counts.shape, scan.q.shape, scan.stamp)
        reading = pack_reading(scan, self.skin.name)
        state = pack_joint_state(scan.stamp, self.joint_names, scan.q)
        self.append_scan(scan.stamp, reading, state)

    def write_block(
        self,
        stamps: Int[np.ndarray, "reading"],
        counts: Int[np.ndarray, "reading taxel"],
        received: Bool[np.ndarray, "reading taxel"],
        q: Float[np.ndarray, "reading joint"],
    ) -> None:
        """Append many scans without shear at once, faster than one by one.

        Raises:
            RecordingError: as for `write`; then none of them is written.
        """
        if not len(stamps):
            return
        if (np.diff(stamps) <= 0).any():
            raise RecordingError("stamps of a block must increase; use one clock")
        self.check_next_scan(counts.shape[1:], q.shape[1:], int(stamps[0]))
        readings = pack_readings(stamps, counts, received, self.skin.name)
        states = pack_joint_states(stamps, self.joint_names, q)
        for stamp, reading, state in zip(
            stamps.tolist(), readings, states, strict=True
        ):
            self.append_scan(stamp, reading, state)

    def append_scan(self, stamp: int, reading: bytes, state: bytes) -> None:
        """Append the messages of one scan; start a new chunk after one second."""
        if self.chunk_start is None or stamp - self.chunk_start >= NS_PER_S:
            self.mcap.flush()
            self.chunk_start = stamp
        if self.joint_names:
            self.append_message(JOINT_STATES, stamp, state)
        self.append_message(READING, stamp, reading)
        self.last_stamp = stamp
        if self.first_stamp is None:
            self.first_stamp = stamp
        self.count += 1
        if self.count == RATED_SCANS:
            self.check_rate()

    def check_rate(self) -> None:
        """Warn if the scans so far come faster than any skin sends."""
        if self.first_stamp is None or self.last_stamp is None or self.count < 2:
            return
        period = (self.last_stamp - self.first_stamp) // (self.count - 1)
        wrong = describe_rate(period)
        if wrong is not None:
            logger.warning("%s: %s", self.path, wrong)

    def check_next_scan(
        self, counts: tuple[int, ...], joints: tuple[int, ...], first: int
    ) -> None:
        """Raise if scans of these shapes cannot follow the scan before."""
        if counts != (self.skin.count,):
            raise RecordingError(
                f"scan has {counts[0]} counts, skin '{self.skin.name}' has "
                f"{self.skin.count} taxels; record each skin in its own file"
            )
        if joints != (len(self.joint_names),):
            raise RecordingError(
                f"scan has {joints[0]} joint positions, the robot has "
                f"{len(self.joint_names)} joints; record with the robot it came from"
            )
        if self.last_stamp is not None and first <= self.last_stamp:
            raise RecordingError(
                f"scan at {first} ns comes after one at {self.last_stamp} ns; "
                "stamps must increase; use one clock"
            )

    def write_label(self, label: Label) -> None:
        """Append a label; the latest scan gives its log time."""
        self.append_message(LABEL, self.log_time(label.start), pack_label(label))

    def write_detection(self, record: DetectionRecord) -> None:
        """Append a detection; the latest scan gives its log time."""
        stamp = self.log_time(record.stamp)
        self.append_message(DETECTION, stamp, pack_detection(record))

    def write_truth(self, record: TruthRecord) -> None:
        """Append the ground truth of one touch."""
        self.append_message(TRUTH, record.stamp, pack_truth(record))

    def write_event(self, record: EventRecord) -> None:
        """Append an event; the latest scan gives its log time."""
        data = pack_event(record, self.skin.name)
        self.append_message(EVENT, self.log_time(record.stamp), data)

    def log_time(self, default: int) -> int:
        """Return the stamp of the latest scan [ns], or `default` before the first."""
        return default if self.last_stamp is None else self.last_stamp

    def append_message(self, topic: Topic, stamp: int, data: bytes) -> None:
        """Append one message to the chunk, after declaring its topic if needed."""
        if topic.name not in self.channels:
            self.declare_topic(topic)
        channel = self.channels[topic.name]
        self.mcap.add_message(channel, stamp, data, publish_time=stamp)

    def sync(self) -> None:
        """End the chunk and wait until everything so far is on the disk."""
        self.mcap.flush()
        os.fsync(self.file.fileno())

    def close(self) -> None:
        """Finish the file and rename it to its final name.

        Raises:
            RecordingError: another file has got that name meanwhile.
        """
        if self.file.closed:
            return
        if self.count < RATED_SCANS:
            self.check_rate()
        self.mcap.finish()
        self.file.flush()
        os.fsync(self.file.fileno())
        self.file.close()
        try:
            rename_new(self.part, self.path)
        except FileExistsError:
            raise RecordingError(
                f"{self.path} has been made by another program meanwhile; the "
                f"recording is whole in {self.part}; give that another name"
            ) from None

    def abandon(self) -> None:
        """Stop and leave what was written in the `.part` file, without an index."""
        if not self.file.closed:
            self.mcap.flush()
            self.file.close()

    def __enter__(self) -> "RecordingWriter":
        """Return the writer itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file, or keep the `.part` file after an exception."""
        if kind is None:
            self.close()
        else:
            self.abandon()


def write_all(
    writer: RecordingWriter,
    scans: Iterable[Scan],
    labels: Iterable[Label],
    detections: Iterable[DetectionRecord] = (),
    truths: Iterable[TruthRecord] = (),
    events: Iterable[EventRecord] = (),
) -> int:
    """Write scans and their annotations in the order of time; return the scan count.

    A label comes after its last scan, so that no part of a file says more about a touch
    than was known by then. Truths keep their order.
    """
    annotations: list[tuple[int, Annotation]] = [
        *((label.end, label) for label in sort_labels(labels)),
        *((record.stamp, record) for record in detections),
        *((record.stamp, record) for record in events),
    ]
    annotations.sort(key=lambda entry: entry[0])
    count = written = 0
    remaining_truths = iter(truths)
    truth = next(remaining_truths, None)
    for scan in scans:
        while written < len(annotations) and annotations[written][0] <= scan.stamp:
            write_annotation(writer, annotations[written][1])
            written += 1
        writer.write(scan)
        count += 1
        while truth is not None and truth.stamp <= scan.stamp:
            writer.write_truth(truth)
            truth = next(remaining_truths, None)
    for _, annotation in annotations[written:]:
        write_annotation(writer, annotation)
    return count


def write_annotation(writer: RecordingWriter, annotation: Annotation) -> None:
    """Write a label, a detection or an event."""
    if isinstance(annotation, Label):
        writer.write_label(annotation)
    elif isinstance(annotation, DetectionRecord):
        writer.write_detection(annotation)
    else:
        writer.write_event(annotation)


def name_part(path: Path) -> Path:
    """Return the path of a recording while it is written."""
    return path.with_name(path.name + ".part")


def check_new_recording(path: Path) -> None:
    """Raise if there is a file where a new recording would be written.

    Raises:
        RecordingError: there is one, or the rest of a recording that was stopped.
    """
    for other in (path, name_part(path)):
        if other.exists():
            raise RecordingError(
                f"cannot record to {path}: {other.name} is there already; allowed is a "
                "new name; move it away or give another"
            )


def rewrite_recording(
    recording: Recording,
    path: Path | str | None = None,
    labels: Iterable[Label] | None = None,
    detections: Iterable[DetectionRecord] | None = None,
) -> None:
    """Write a copy of a recording with other labels or detections.

    The copy is written whole or not at all.

    Args:
        recording: recording to copy.
        path: path of the copy, a new one; None, or the recording's own path, replaces
            the recording once its copy is complete.
        labels: all labels of the copy; None keeps the recording's.
        detections: all detections of the copy; None keeps the recording's.

    Raises:
        RecordingError: a truncated recording, or another file, would be replaced.
    """
    target = recording.path if path is None else Path(path)
    check_copy(recording, target)
    if labels is None:
        labels = recording.labels
    if detections is None:
        detections = recording.detections
    if is_same_path(recording, target):
        with atomic_path(target) as part:
            write_copy(recording, part, labels, detections)
    else:
        write_copy(recording, target, labels, detections)


def write_copy(
    recording: Recording,
    path: Path,
    labels: Iterable[Label],
    detections: Iterable[DetectionRecord],
) -> None:
    """Write a new recording with these labels and detections; none if that fails."""
    writer = RecordingWriter(
        path,
        recording.robot_name,
        recording.skin,
        recording.calibration,
        recording.metadata,
        recording.joint_names,
        recording.urdf,
    )
    try:
        with writer:
            scans = recording.scans()
            truths = recording.truths()
            write_all(writer, scans, labels, detections, truths, recording.events)
    except BaseException:
        writer.part.unlink(missing_ok=True)
        raise


def check_copy(recording: Recording, target: Path) -> None:
    """Raise if a copy of a recording would replace data that must not be lost.

    Raises:
        RecordingError: a truncated recording would be replaced by its readable part,
            or another file would be.
    """
    if not is_same_path(recording, target):
        check_new_recording(target)
    elif recording.truncated:
        raise RecordingError(
            f"{recording.path} is cut short and would be replaced by what is left; "
            "write the copy elsewhere"
        )


def is_same_path(recording: Recording, target: Path) -> bool:
    """Return whether a path is the path of a recording."""
    return target.resolve() == recording.path.resolve()


def write_calibration(path: Path, calibration: Calibration) -> None:
    """Write a calibration file, whole or not at all; missing folders are created."""
    with atomic_path(path, durable=True) as part:
        part.write_bytes(calibration.to_bytes())
