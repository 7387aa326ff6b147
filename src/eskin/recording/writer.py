"""Writing a recording: MCAP, profile ros2, CDR, zstd chunks of less than 1 s.

Name, skin, calibration and metadata come first, then chunks, so that a file cut
anywhere can be used up to its last whole chunk.
"""

import json
import os
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from types import TracebackType

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import RecordingError
from eskin.recording.labels import Label, sort_labels
from eskin.recording.mcap_file import McapWriter
from eskin.recording.messages import (
    DETECTION,
    EVENT,
    JOINT_STATES,
    LABEL,
    READING,
    TOPICS,
    TRUTH,
    Topic,
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
    Metadata,
    TruthRecord,
)
from eskin.robot.presets import load_robot
from eskin.skin.files import skin_to_bytes
from eskin.skin.skin import Skin
from eskin.touch.calibration import Calibration
from eskin.touch.reading import Scan

CHUNK_NS = 1_000_000_000

Word = Label | DetectionRecord | EventRecord


class RecordingWriter:
    """Writes `<path>.part` and renames it to `path` when closed.

    After an exception inside `with` the `.part` file stays, readable up to the last
    scan that was written.
    """

    def __init__(
        self,
        path: Path | str,
        robot_name: str,
        skin: Skin,
        calibration: Calibration,
        metadata: Metadata,
        joint_names: tuple[str, ...] | None = None,
    ) -> None:
        """Open the file and write all that does not change.

        Args:
            path: of the finished recording; its folder must exist.
            robot_name: preset or URDF that the skin is on; `table` for none.
            skin: whose taxels the scans count.
            calibration: of that skin.
            metadata: who and what is recorded.
            joint_names: in the order of `Scan.q`; None asks the robot of that name.
        """
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        self.skin = skin
        if joint_names is None:
            joint_names = load_robot(robot_name).joint_names
        self.joint_names = tuple(joint_names)
        self.last_stamp: int | None = None
        self.chunk_start: int | None = None
        try:
            self.file = self.part.open("wb")
        except OSError as error:
            raise RecordingError(
                f"cannot write {self.part}: {error.strerror}; give a path in a folder "
                "that exists and can be written to"
            ) from error
        self.mcap = McapWriter(self.file, "ros2", "eskin")
        try:
            self.begin(robot_name, calibration, metadata)
        except BaseException:
            self.file.close()
            self.part.unlink()
            raise

    def begin(
        self, robot_name: str, calibration: Calibration, metadata: Metadata
    ) -> None:
        """Write header, metadata and attachments and declare the topics."""
        facts = {"format": FORMAT, "robot": robot_name, "skin": self.skin.name}
        facts["joints"] = json.dumps(self.joint_names)
        self.mcap.add_metadata(RECORD_NAME, facts | metadata.to_record())
        self.attach(SKIN_NAME, "application/yaml", skin_text(self.skin))
        self.attach(CALIBRATION_NAME, "application/json", calibration.to_bytes())
        self.channels: dict[str, int] = {}
        for topic in TOPICS:
            if topic != JOINT_STATES or self.joint_names:
                self.declare(topic)
        self.file.flush()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Write one attachment."""
        self.mcap.add_attachment(name, media_type, data)

    def declare(self, topic: Topic) -> None:
        """Make a topic known to the file."""
        self.channels[topic.name] = self.mcap.add_channel(
            topic.name, topic.type_name, topic.definition
        )

    def write(self, scan: Scan) -> None:
        """Append one scan; stamps must increase.

        Raises:
            RecordingError: when it does not fit the skin, the robot or its time.
        """
        self.check(scan.counts.shape, scan.q.shape, scan.stamp)
        reading = pack_reading(scan, self.skin.name)
        state = pack_joint_state(scan.stamp, self.joint_names, scan.q)
        self.append(scan.stamp, reading, state)

    def write_block(
        self,
        stamps: Int[np.ndarray, "reading"],
        counts: Int[np.ndarray, "reading taxel"],
        received: Bool[np.ndarray, "reading taxel"],
        q: Float[np.ndarray, "reading joint"],
    ) -> None:
        """Append many scans without shear: the same file as one by one, but sooner.

        Raises:
            RecordingError: when they do not fit the skin, the robot or their time;
                then none of them is written.
        """
        if not len(stamps):
            return
        if (np.diff(stamps) <= 0).any():
            raise RecordingError("stamps of a block must increase; use one clock")
        self.check(counts.shape[1:], q.shape[1:], int(stamps[0]))
        readings = pack_readings(stamps, counts, received, self.skin.name)
        states = pack_joint_states(stamps, self.joint_names, q)
        for stamp, reading, state in zip(
            stamps.tolist(), readings, states, strict=True
        ):
            self.append(stamp, reading, state)

    def append(self, stamp: int, reading: bytes, state: bytes) -> None:
        """Append the messages of one scan; a second begins a chunk."""
        if self.chunk_start is None or stamp - self.chunk_start >= CHUNK_NS:
            self.mcap.end_chunk()
            self.chunk_start = stamp
        if self.joint_names:
            self.add(JOINT_STATES.name, stamp, state)
        self.add(READING.name, stamp, reading)
        self.last_stamp = stamp

    def check(
        self, counts: tuple[int, ...], joints: tuple[int, ...], first: int
    ) -> None:
        """Raise when scans of these shapes cannot follow the one before."""
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

    def label(self, label: Label) -> None:
        """Append a label; logged at the latest scan, wherever its own time lies."""
        self.add(LABEL.name, self.now(label.start), pack_label(label))

    def detection(self, record: DetectionRecord) -> None:
        """Append a detection; logged at the latest scan."""
        self.add(DETECTION.name, self.now(record.stamp), pack_detection(record))

    def truth(self, record: TruthRecord) -> None:
        """Append what was really done; only a file that has some knows the topic."""
        if TRUTH.name not in self.channels:
            self.declare(TRUTH)
        self.add(TRUTH.name, record.stamp, pack_truth(record))

    def event(self, record: EventRecord) -> None:
        """Append an event; logged at the latest scan, as a label is."""
        if EVENT.name not in self.channels:
            self.declare(EVENT)
        data = pack_event(record, self.skin.name)
        self.add(EVENT.name, self.now(record.stamp), data)

    def now(self, otherwise: int) -> int:
        """Stamp of the latest scan [ns], `otherwise` before the first."""
        return otherwise if self.last_stamp is None else self.last_stamp

    def add(self, topic: str, stamp: int, data: bytes) -> None:
        """Append one message."""
        self.mcap.add_message(self.channels[topic], stamp, data)

    def sync(self) -> None:
        """End the chunk, and come back once all so far is on the disk itself."""
        self.mcap.end_chunk()
        os.fsync(self.file.fileno())

    def close(self) -> None:
        """Finish the file and give it its name."""
        if self.file.closed:
            return
        self.mcap.finish()
        self.file.flush()
        os.fsync(self.file.fileno())
        self.file.close()
        self.part.replace(self.path)

    def abandon(self) -> None:
        """Stop; what was written stays in the `.part` file, without an index."""
        if not self.file.closed:
            self.mcap.end_chunk()
            self.file.close()

    def __enter__(self) -> "RecordingWriter":
        """The writer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close, or keep the `.part` file after an exception."""
        if kind is None:
            self.close()
        else:
            self.abandon()


@lru_cache(maxsize=8)
def skin_text(skin: Skin) -> bytes:
    """The attachment of a skin, kept since sets of recordings share one skin."""
    return skin_to_bytes(skin)


def write_all(
    writer: RecordingWriter,
    scans: Iterable[Scan],
    labels: Iterable[Label],
    detections: Iterable[DetectionRecord] = (),
    truths: Iterable[TruthRecord] = (),
    events: Iterable[EventRecord] = (),
) -> int:
    """Write scans, with labels, detections, truths and events among them at their time.

    A label comes after its last scan, so that no part of a file says more of a touch
    than was known by then. Truths keep their order. Returns the number of scans.
    """
    words: list[tuple[int, Word]] = [
        *((label.end, label) for label in sort_labels(labels)),
        *((record.stamp, record) for record in detections),
        *((record.stamp, record) for record in events),
    ]
    words.sort(key=lambda word: word[0])
    count = done = 0
    known = iter(truths)
    truth = next(known, None)
    for scan in scans:
        while done < len(words) and words[done][0] <= scan.stamp:
            write_word(writer, words[done][1])
            done += 1
        writer.write(scan)
        count += 1
        while truth is not None and truth.stamp <= scan.stamp:
            writer.write_truth(truth)
            truth = next(known, None)
    for _, word in words[done:]:
        write_word(writer, word)
    return count


def write_word(writer: RecordingWriter, word: Word) -> None:
    """Write a label, a detection or an event."""
    if isinstance(word, Label):
        writer.write_label(word)
    elif isinstance(word, DetectionRecord):
        writer.write_detection(word)
    else:
        writer.write_event(word)


def rewrite_recording(
    recording: Recording,
    path: Path | str | None = None,
    labels: Iterable[Label] | None = None,
    detections: Iterable[DetectionRecord] | None = None,
) -> None:
    """Write a copy of a recording with other labels or detections, whole or not at all.

    Args:
        recording: what to copy.
        path: of the copy; None replaces the recording once its copy is whole.
        labels: all labels of the copy; None keeps the recording's.
        detections: all detections of the copy; None keeps the recording's.

    Raises:
        RecordingError: when a recording that is cut short would be replaced.
    """
    target = recording.path if path is None else Path(path)
    check_target(recording, target)
    writer = RecordingWriter(
        target,
        recording.robot_name,
        recording.skin,
        recording.calibration,
        recording.metadata,
        recording.joint_names,
    )
    try:
        with writer:
            write_all(
                writer,
                recording.scans(),
                recording.labels if labels is None else labels,
                recording.detections if detections is None else detections,
                recording.truths(),
                recording.events,
            )
    except BaseException:
        writer.part.unlink(missing_ok=True)
        raise


def check_target(recording: Recording, target: Path) -> None:
    """Refuse to replace a recording by less than there was of it.

    Raises:
        RecordingError: when it is cut short and would be replaced.
    """
    if recording.truncated and target.resolve() == recording.path.resolve():
        raise RecordingError(
            f"{recording.path} is cut short and would be replaced by what is left; "
            "write the copy elsewhere"
        )
