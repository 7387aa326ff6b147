"""The folder of a set while it is made: whole files, and the index of just those."""

import os
from collections.abc import Sequence
from pathlib import Path

from eskin.files import atomic_path
from eskin.sim.files.index import INDEX_NAME, ClipRow, to_text
from eskin.sim.files.sitting import Sitting


class Archive:
    """Grows file by file in the order of the set; what is there is always whole."""

    def __init__(self, folder: Path, sittings: Sequence[Sitting]) -> None:
        """Look at what an earlier generation left, without changing it."""
        self.folder = folder
        self.sittings = tuple(sittings)
        self.index = folder / INDEX_NAME

    def resume(self) -> int:
        """Remove what is not whole; return how many files are.

        Files count as far as each is there and has a line of the index for every clip,
        in the order in which they were made.
        """
        kept = done = 0
        for sitting in self.sittings:
            size = self.size_of(sitting, kept)
            if size is None:
                break
            kept, done = kept + size, done + 1
        if self.index.exists():
            os.truncate(self.index, kept)
        else:
            with atomic_path(self.index, durable=True) as part:
                part.touch()
        for sitting in self.sittings[done:]:
            path = self.folder / sitting.file
            path.unlink(missing_ok=True)
            path.with_name(path.name + ".part").unlink(missing_ok=True)
        return done

    def size_of(self, sitting: Sitting, start: int) -> int | None:
        """Bytes of the lines of a file from `start` of the index on; None if cut."""
        if not (self.index.exists() and (self.folder / sitting.file).exists()):
            return None
        begin = f'{{"file": "{sitting.file}", "number": '.encode()
        size = 0
        with self.index.open("rb") as file:
            file.seek(start)
            for number in range(sitting.clips):
                line = file.readline()
                if not (
                    line.startswith(begin + b"%d," % number) and line[-1:] == b"\n"
                ):
                    return None
                size += len(line)
        return size

    def add(self, rows: Sequence[ClipRow]) -> None:
        """Append the clips of the next file, which is there already."""
        with self.index.open("a", encoding="utf-8") as file:
            file.write(to_text(rows))
            file.flush()
            os.fsync(file.fileno())
