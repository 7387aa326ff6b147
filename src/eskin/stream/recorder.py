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
from eskin.recording import Metadata, RecordingWriter
from eskin.stream.listener import Context, Listener
from eskin.stream.messages import Message
from eskin.stream.queue import Drop
from eskin.stream.timing import DurationHistogram
from eskin.touch import Scan
from eskin.units import NS_PER_S


@final
class RecordingFiles:
    """Opens the files of a recording one after the other.

    Attributes:
        writer: of the file that is open; None before the first and after the last.
        files: those that are finished.
    """

    def __init__(self, path: Path, metadata: Metadata, piece_bytes: int | None) -> None:
        """Nothing is opened yet.

        Args:
            path: of the recording; pieces of `name.mcap` are `name-0001.mcap` and on.
            metadata: of all of them; each piece has its number as a note besides.
            piece_bytes: size from which a file is finished; None makes one file.
        """
        self.path = path
        self.metadata = metadata
        self.piece_bytes = piece_bytes
        self.count = 0
        self.writer: RecordingWriter | None = None
        self.files: list[Path] = []

    def check(self) -> None:
        """Refuse to write over a recording.

        Raises:
            RecordingError: one of that name is there, whole or cut.
        """
        stem, suffix = escape(self.path.stem), escape(self.path.suffix)
        for name in (stem + suffix, f"{stem}-[0-9][0-9][0-9][0-9]{suffix}"):
            for pattern in (name, f"{name}.part"):
                for other in self.path.parent.glob(pattern):
                    raise RecordingError(
                        f"cannot record to {self.path}: {other.name} is there already; "
                        "allowed is a new name; move it away or give another"
                    )

    def begin(self, info: SourceInfo) -> None:
        """Open the next file.

        Raises:
            RecordingError: it cannot be written.
        """
        self.count += 1
        path, metadata = self.path, self.metadata
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
        )

    @property
    def large(self) -> bool:
        """Whether it is time for another file."""
        return (
            self.piece_bytes is not None
            and self.writer is not None
            and self.writer.file.tell() >= self.piece_bytes
        )

    def finish(self) -> None:
        """Finish the file that is open, if there is one."""
        writer = self.writer
        if writer is not None:
            writer.close()
            self.files.append(writer.path)
            self.writer = None

    def break_off(self) -> None:
        """Let the file go as it is on a disk that takes no more; it stays `.part`."""
        if self.writer is not None:
            with suppress(OSError):
                self.writer.file.close()
            self.writer = None


FULL = (errno.ENOSPC, errno.EDQUOT)

logger = logging.getLogger(__name__)


def free_bytes(folder: Path) -> int:
    """What may still be written below a folder [bytes]."""
    return shutil.disk_usage(folder).free


@dataclass(frozen=True)
class RecorderConfig:
    """How a recorder writes."""

    chunk_seconds: float = 0.5
    """Time of scans that is held before it is written [s]."""

    least_free: int = 500_000_000
    """Recording stops before less than this is free on the disk [bytes]."""

    piece_bytes: int | None = None
    """Size from which a new file is begun [bytes]; None writes one file."""


@final
class Recorder(Listener):
    """Writes scans, detections and events; the stream goes on where it cannot.

    Every half second of scans is one chunk, which is handed to the system and then
    fsynced, on this listener's own thread, before more is written. A process that is
    killed and a computer that loses power lose the last half second of scans and what
    waits in the queue. The file is `<path>.part` until it is closed and renamed; a
    computer that loses power just then may keep it under that name.

    When less than `least_free` would be left on the disk, the recording is finished and
    an event told; so it is when the disk is full all the same, when a `.part` file
    stays. Any other error of the disk stops the stream.

    Attributes:
        pieces: the files.
        unrecorded: scans that came when recording stopped and after it had.
        sync: how long each chunk takes until it is on the disk.
    """

    name = "recorder"
    message_types = (Scan, Detection, Event)

    def __init__(
        self,
        path: Path | str,
        metadata: Metadata,
        config: RecorderConfig | None = None,
        size: int = 2000,
        drop: Drop = "newest",
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        """Nothing is written before the stream starts.

        Args:
            path: of the recording; pieces of `name.mcap` are `name-0001.mcap` and on,
                each a recording of its own with all metadata and its number as a note.
            metadata: who and what is recorded.
            config: how it is written.
            size: what may wait to be written.
            drop: what happens when more waits.
            free: tells what may still be written below a folder [bytes].
        """
        self.path = Path(path)
        self.config = config or RecorderConfig()
        self.size = size
        self.drop = drop
        self.free = free
        self.pieces = RecordingFiles(self.path, metadata, self.config.piece_bytes)
        self.chunk: int | None = None
        self.unrecorded = 0
        self.sync = DurationHistogram()

    def start(self, context: Context) -> None:
        """Begin the first file.

        Raises:
            RecordingError: it cannot be written, is there already, or the disk is full.
        """
        self.context = context
        self.pieces.check()
        if self.path.parent.is_dir() and self.disk_full():
            raise RecordingError(f"cannot record to {self.path}: {self.space()}")
        self.pieces.begin(context.info)

    def on_message(self, item: Message) -> None:
        """Write one thing, unless recording has stopped."""
        try:
            if isinstance(item, Scan):
                self.end_chunk(item.stamp)
            self.write(item)
        except OSError as error:
            if error.errno not in FULL:
                raise
            self.pieces.break_off()
            self.unrecorded += isinstance(item, Scan)
            self.stopped("its disk is full; free some space")

    def write(self, item: Message) -> None:
        """Hand one thing to the writer."""
        writer = self.pieces.writer
        if writer is None:
            self.unrecorded += isinstance(item, Scan)
        elif isinstance(item, Scan):
            writer.write(item)
        elif isinstance(item, Detection):
            writer.detection(item.record())
        elif isinstance(item, Event):
            writer.event(item.record())

    def end_chunk(self, stamp: int) -> None:
        """Make sure of what is written, where a scan at that time begins a chunk."""
        if self.chunk is None:
            self.chunk = stamp
        passed = (stamp - self.chunk) / NS_PER_S
        if self.pieces.writer is None or passed < self.config.chunk_seconds:
            return
        self.chunk = stamp
        began = perf_counter()
        self.pieces.writer.sync()
        self.sync.add(perf_counter() - began)
        if self.disk_full():
            self.pieces.finish()
            self.stopped(self.space())
        elif self.pieces.large:
            self.pieces.finish()
            self.begin_piece()

    def begin_piece(self) -> None:
        """Open the next file; a full disk is told as such."""
        try:
            self.pieces.begin(self.context.info)
        except RecordingError as error:
            if isinstance(error.__cause__, OSError):
                raise error.__cause__ from None
            raise

    def disk_full(self) -> bool:
        """Whether less is free than should be."""
        return self.free(self.path.parent) < self.config.least_free

    def space(self) -> str:
        """How full the disk is, and what to do."""
        free, least = self.free(self.path.parent), self.config.least_free
        return (
            f"its disk has {free / 1e6:.0f} MB left; allowed are {least / 1e6:.0f} MB "
            "or more; free some space"
        )

    def stopped(self, why: str) -> None:
        """Say that recording has stopped."""
        text = f"recording {self.path} has stopped, all else goes on: {why}"
        logger.warning("%s", text)
        self.context.publish(Event(self.context.clock.now(), "unrecorded", text))

    def close(self) -> None:
        """Finish the file."""
        try:
            self.pieces.finish()
        finally:
            self.pieces.break_off()
