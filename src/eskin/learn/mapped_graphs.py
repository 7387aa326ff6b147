"""This module lays contact graphs end to end on disk, for sets larger than memory."""

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import numpy as np

from eskin.live import NODE_FIELDS, GraphBatch

FIELDS = (*NODE_FIELDS, "seconds", "history")
"""Fields that are laid end to end as they are."""


def map_graphs(batches: Iterable[GraphBatch], folder: Path) -> GraphBatch:
    """Lay batches end to end in files, and return them memory-mapped, read-only.

    The files have no names, so the system deletes them with the last reference or
    process. Only one batch is in memory at a time. What is zero in all batches, as
    shear is where no skin measures it, takes no space.

    Args:
        batches: batches of one data set, whose arrays have equal types and widths.
        folder: folder on whose disk there is space.

    Raises:
        ValueError: if there is no batch.
        OSError: if the disk is full.
    """
    sizes: list[np.ndarray] = []
    with ExitStack() as files:
        fields = {name: MappedField(folder, files) for name in FIELDS}
        for batch in batches:
            for name, field in fields.items():
                field.append(getattr(batch, name))
            sizes.append(batch.sizes)
        if not sizes:
            raise ValueError("no graphs to join; give at least one batch")
        arrays = {name: field.map() for name, field in fields.items()}
    offsets = np.concatenate([[0], np.cumsum(np.concatenate(sizes))]).astype(np.int64)
    return GraphBatch(**arrays, offsets=offsets)


class MappedField:
    """A mapped field collects the rows of an array in a file."""

    def __init__(self, folder: Path, files: ExitStack) -> None:
        """Create a field without rows, whose file is closed with `files`."""
        self.folder, self.files = folder, files
        self.file: IO[bytes] | None = None
        self.count = 0
        self.like = np.zeros(0, np.float32)

    def append(self, rows: np.ndarray) -> None:
        """Append rows; those before the first that is not zero are not written."""
        self.like = rows[:0].copy()
        if self.file is None and rows.any():
            self.file = self.files.enter_context(TemporaryFile(dir=self.folder))
            self.file.truncate(self.count * self.row_bytes)
            self.file.seek(0, 2)
        if self.file is not None:
            self.file.write(np.ascontiguousarray(rows).data)
        self.count += len(rows)

    @property
    def row_bytes(self) -> int:
        """Size of a row."""
        return self.like.dtype.itemsize * int(np.prod(self.like.shape[1:]))

    def map(self) -> np.ndarray:
        """Return all rows, memory-mapped."""
        shape = self.count, *self.like.shape[1:]
        if self.file is None:
            return np.broadcast_to(self.like.dtype.type(0), shape)
        self.file.flush()
        mapped = np.memmap(self.file, self.like.dtype, "r", shape=shape)
        return mapped.view(np.ndarray)
