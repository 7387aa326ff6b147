"""This module reads files that a user names, and writes files atomically.

A file is read only if it is a regular one of a limited size: opening a FIFO would wait
for a writer, and a device may never end.
"""

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
"""Kinds of files that are refused, beside folders."""


class UnfitFileError(OSError):
    """A file is no regular file, or larger than allowed; `strerror` says which."""


def open_file(path: Path, max_bytes: int) -> BinaryIO:
    """Open a regular file for reading, without waiting for another process.

    Args:
        path: path of the file.
        max_bytes: largest size that is allowed [bytes].

    Raises:
        OSError: it cannot be opened, is no regular file, or is too large; `strerror`
            says why.
    """
    # A device is not even opened: that alone may reset it.
    check_status(os.stat(path), max_bytes)
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
    try:
        # Another file may have taken its place in between.
        check_status(os.fstat(descriptor), max_bytes)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def check_status(status: os.stat_result, max_bytes: int) -> None:
    """Raise unless a status is that of a regular file of at most a size [bytes]."""
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        kind = KINDS.get(stat.S_IFMT(status.st_mode), "no regular file")
        raise UnfitFileError(errno.EINVAL, f"it is {kind}, allowed is a regular file")
    if status.st_size > max_bytes:
        raise UnfitFileError(
            errno.EFBIG,
            f"it has {status.st_size:,} bytes, allowed are {max_bytes:,}",
        )


def read_file(path: Path, max_bytes: int) -> bytes:
    """Read a regular file whole; arguments and errors are those of `open_file`."""
    with open_file(path, max_bytes) as file:
        # Never beyond the size: files of the kernel have none, and may not end.
        return file.read(os.fstat(file.fileno()).st_size)


def read_mask() -> int:
    """Return the rights that new files do not get, as the user has set them."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def atomic_path(path: Path, durable: bool = False) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` at the end of the block.

    The temporary file lies in the same folder and keeps the suffix, by which some
    libraries choose a format. It gets the rights that any new file gets. If the block
    raises, it is deleted and `path` stays as it was. Missing folders are created.

    Args:
        path: the file to write.
        durable: whether to wait until the data have reached the disk.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield part
        part.chmod(0o666 & ~read_mask())
        if durable:
            with part.open("rb") as file:
                os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def write_folder(path: Path, error: type[Exception]) -> Iterator[Path]:
    """Yield a temporary folder that becomes `path` at the end of the block.

    If the block raises, it is deleted. Missing folders above are created.

    Args:
        path: the folder to write, which must not exist.
        error: error to raise where it cannot be written.

    Raises:
        Exception: as given, where the folder exists or cannot be written.
    """
    if path.exists():
        raise error(
            f"cannot write {path}: it is there already; allowed is a new folder; move "
            "it away or give another"
        )
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        part.mkdir(parents=True)
        yield part
        part.rename(path)
    except OSError as reason:
        raise error(
            f"cannot write {path}: {reason.strerror or reason}; give a folder in one "
            "that exists and can be written to"
        ) from reason
    finally:
        shutil.rmtree(part, ignore_errors=True)
