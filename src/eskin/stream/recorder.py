"""This module provides the listener that writes a recording."""

import errno
import logging
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from glob import escape
from pathlib import Path
from time import perf_counter
from typing import final

from eskin.drivers import Event, SourceInfo
from eskin.errors import RecordingError
from eskin.live import Detection
from eskin.recording import (
    Label,
    Metadata,
    RecordingWriter,
    check_new_recording,
)
from eskin.skin import describe_robot
from eskin.stream.listener import (
    Context,
    Correction,
    Drop,
    DurationHistogram,
    Listener,
    Message,
)
from eskin.touch import Scan
from eskin.units import NS_PER_S

DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT)

logger = logging.getLogger(__name__)


@final
class RecordingFiles:
    """Opens the files of a recording one after the other.

    Attributes:
        writer: writer of the open file; None before the first and after the last.
        files: paths of the finished files.
    """

    def __init__(self, path: Path, metadata: Metadata, piece_bytes: int | None) -> None:
        """Store the settings, see `Recorder` and `RecorderConfig`; open nothing yet."""
        self.path = path
        self.metadata = metadata
        self.piece_bytes = piece_bytes
        self.count = 0
        self.writer: RecordingWriter | None = None
        self.files: list[Path] = []

    def check(self) -> None:
        """Raise a RecordingError if a recording of that name exists, whole or cut."""
        check_new_recording(self.path)
        stem = escape(self.path.stem)
        suffix = escape(self.path.suffix)
        pieces = f"{stem}-[0-9][0-9][0-9][0-9]{suffix}"
        for pattern in (pieces, f"{pieces}.part"):
            for other in self.path.parent.glob(pattern):
                check_new_recording(other)

    def begin(self, info: SourceInfo) -> None:
        """Open the next file; raise a RecordingError if it cannot be written."""
        self.count += 1
        path = self.path
        metadata = self.metadata
        if self.piece_bytes is not None:
            path = path.with_name(f"{path.stem}-{self.count:04d}{path.suffix}")
            notes = metadata.notes | {"piece": str(self.count)}
            metadata = replace(metadata, notes=notes)
        self.writer = RecordingWriter(
            path,
            info.robot_name,
            info.skin,
            info.calibration,
            metadata,
            info.joint_names,
            describe_robot(info.mounted.robot).urdf,
        )

    @property
    def is_full(self) -> bool:
        """Return whether the open file has reached the size of a piece."""
        return (
            self.piece_bytes is not None
            and self.writer is not None
            and self.writer.file.tell() >= self.piece_bytes
        )

    def finish(self) -> None:
        """Finish the open file, if there is one."""
        if self.writer is not None:
            self.writer.close()
            self.files.append(self.writer.path)
            self.writer = None

    def abandon(self) -> None:
        """Close the file as it is, since the disk is full; it stays a `.part` file."""
        if self.writer is not None:
            with suppress(OSError):
                self.writer.file.close()
            self.writer = None


def free_bytes(folder: Path) -> int:
    """Return the free space of a folder's disk [bytes]."""
    return shutil.disk_usage(folder).free


@dataclass(frozen=True)
class RecorderConfig:
    """Configures how a recorder writes."""

    chunk_seconds: float = 0.5
    """Duration of the scans in one chunk [s]."""
    least_free: int = 500_000_000
    """Free space of the disk below which recording stops [bytes]."""
    piece_bytes: int | None = None
    """Size above which a new file is begun [bytes]; None writes one file."""


@final
class Recorder(Listener):
    """Writes scans, detections and events; the stream goes on when the disk is full.

    Every half second of scans is one chunk, which is written and fsynced on this
    listener's own thread before more is written; twice the duration of the latest fsync
    where that is longer. If the process is killed or power fails, the scans of that
    time and the queued messages are lost. The file is `<path>.part` until it is closed
    and renamed; if power fails just then, it may keep that name.

    When less than `least_free` is left on the disk, the recording is finished and an
    event published. If the disk is full before that, the event is published and a
    `.part` file stays. Any other error of the disk stops the stream.

    A correction is written as a true label once another touch is corrected, or at the
    end, since a person may correct a touch again.

    Attributes:
        pieces: the files.
        unrecorded: number of scans that came after recording had stopped.
        sync: durations of writing a chunk to the disk.
    """

    name = "recorder"
    message_types = (Scan, Detection, Event, Correction)

    def __init__(
        self,
        path: Path | str,
        metadata: Metadata,
        config: RecorderConfig | None = None,
        size: int = 2000,
        drop: Drop = "newest",
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        """Store the settings; nothing is written before the stream starts.

        Args:
            path: path of the recording; the pieces of `name.mcap` are named
                `name-0001.mcap` and so on, each a recording with all metadata and its
                number as a note.
            metadata: metadata of the recording.
            config: how to write.
            size: capacity of the queue.
            drop: policy of a full queue.
            free: function that returns the free space of a folder's disk [bytes].
        """
        self.path = Path(path)
        self.config = config or RecorderConfig()
        self.size = size
        self.drop = drop
        self.free = free
        self.pieces = RecordingFiles(self.path, metadata, self.config.piece_bytes)
        self.chunk: int | None = None
        self.unrecorded = 0
        self.correction: Correction | None = None
        self.sync = DurationHistogram()
        self.latest_sync = 0.0

    def start(self, context: Context) -> None:
        """Open the first file; raise a RecordingError if it cannot be written."""
        self.context = context
        self.pieces.check()
        if self.path.parent.is_dir() and self.disk_full():
            text = f"cannot record to {self.path}: {self.describe_space()}"
            raise RecordingError(text)
        self.pieces.begin(context.info)

    def on_message(self, item: Message) -> None:
        """Write one message, unless recording has stopped."""
        try:
            if isinstance(item, Scan):
                self.end_chunk(item.stamp)
            self.write(item)
        except OSError as error:
            if error.errno not in DISK_FULL_ERRORS:
                raise
            self.pieces.abandon()
            self.unrecorded += isinstance(item, Scan)
            self.report_stop("its disk is full; free some space")

    def write(self, item: Message) -> None:
        """Pass one message to the writer."""
        writer = self.pieces.writer
        if writer is None:
            self.unrecorded += isinstance(item, Scan)
        elif isinstance(item, Scan):
            writer.write(item)
        elif isinstance(item, Detection):
            writer.write_detection(item.record())
        elif isinstance(item, Event):
            writer.write_event(item.record())
        elif isinstance(item, Correction):
            if self.correction is not None and self.correction.start != item.start:
                self.write_correction()
            self.correction = item

    def write_correction(self) -> None:
        """Write the latest correction as a label, if there is one."""
        correction = self.correction
        self.correction = None
        if correction is not None and self.pieces.writer is not None:
            label = Label(correction.start, correction.end, correction.gesture)
            self.pieces.writer.write_label(label)

    def end_chunk(self, stamp: int) -> None:
        """Sync the file if a scan with this stamp begins a new chunk."""
        if self.chunk is None:
            self.chunk = stamp
        passed = (stamp - self.chunk) / NS_PER_S
        # A slow disk is synced less often, so that neither queue nor end wait for it.
        least = max(self.config.chunk_seconds, 2 * self.latest_sync)
        if self.pieces.writer is None or passed < least:
            return
        self.chunk = stamp
        began = perf_counter()
        self.pieces.writer.sync()
        self.latest_sync = perf_counter() - began
        self.sync.add_duration(self.latest_sync)
        if self.disk_full():
            self.pieces.finish()
            self.report_stop(self.describe_space())
        elif self.pieces.is_full:
            self.write_correction()
            self.pieces.finish()
            self.begin_piece()

    def begin_piece(self) -> None:
        """Open the next file; raise an OSError where the disk is full."""
        try:
            self.pieces.begin(self.context.info)
        except RecordingError as error:
            if isinstance(error.__cause__, OSError):
                raise error.__cause__ from None
            raise

    def disk_full(self) -> bool:
        """Return whether less space is free than required."""
        return self.free(self.path.parent) < self.config.least_free

    def describe_space(self) -> str:
        """Describe the free space, and the remedy."""
        free = self.free(self.path.parent)
        least = self.config.least_free
        return (
            f"its disk has {free / 1e6:.0f} MB left; allowed are {least / 1e6:.0f} MB "
            "or more; free some space"
        )

    def report_stop(self, why: str) -> None:
        """Publish that recording has stopped."""
        text = f"recording {self.path} has stopped, all else goes on: {why}"
        logger.warning("%s", text)
        self.context.publish(Event(self.context.clock.now(), "unrecorded", text))

    def close(self) -> None:
        """Finish the recording."""
        try:
            self.write_correction()
            self.pieces.finish()
        finally:
            self.pieces.abandon()
