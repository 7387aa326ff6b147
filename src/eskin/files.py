"""This module writes files atomically: readers see the whole file or none."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_path(path: Path, durable: bool = False) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` at the end of the block.

    The temporary file lies in the same folder and keeps the suffix, by which some
    libraries choose a format. If the block raises, it is deleted and `path` stays as it
    was. Missing folders are created.

    Args:
        path: the file to write.
        durable: whether to wait until the data have reached the disk.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield part
        if durable:
            with part.open("rb") as file:
                os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
