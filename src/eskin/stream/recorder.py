"""The recorder: a listener that writes a recording."""

import errno
import logging
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import final

from eskin.drivers import Event
from eskin.errors import RecordingError
from eskin.live import Detection
from eskin.recording import Metadata
from eskin.stream.durations import Durations
from eskin.stream.inbox import Drop
from eskin.stream.listener import Context, Listener
from eskin.stream.moment import Heard
from eskin.stream.pieces import Pieces
from eskin.touch import Scan
from eskin.units import NS_PER_S

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
    hears = (Scan, Detection, Event)

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
        self.pieces = Pieces(self.path, metadata, self.config.piece_bytes)
        self.chunk: int | None = None
        self.unrecorded = 0
        self.sync = Durations()

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

    def hear(self, item: Heard) -> None:
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

    def write(self, item: Heard) -> None:
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
        self.context.tell(Event(self.context.clock.now(), "unrecorded", text))

    def close(self) -> None:
        """Finish the file."""
        try:
            self.pieces.finish()
        finally:
            self.pieces.break_off()
