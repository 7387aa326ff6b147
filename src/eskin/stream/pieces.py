"""A recording in one file, or in several of bounded size."""

from contextlib import suppress
from dataclasses import replace
from glob import escape
from pathlib import Path
from typing import final

from eskin.drivers import SourceInfo
from eskin.errors import RecordingError
from eskin.recording import Metadata, RecordingWriter


@final
class Pieces:
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
