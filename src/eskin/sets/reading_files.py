"""This module reads files with one row a reading, npz or Parquet, in chunks of rows.

A column holds one number or text a reading, or an array of a fixed size. The first are
read whole, the others in chunks, so that a file may be larger than the memory.
"""

import math
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any, final

import numpy as np

from eskin.errors import ImportSourceError
from eskin.files import open_file
from eskin.registry import find_package
from eskin.sets.conversion import NPZ_SUFFIX
from eskin.sets.shearsense import ARCHIVE_ERRORS

MAX_FILE_BYTES = 1 << 38
"""Largest size of a file [bytes]."""
MAX_COLUMN_BYTES = 256 << 20
"""Largest size of a column with one value a reading, unpacked [bytes]."""
MAX_GROUP_BYTES = 1 << 30
"""Largest size of a row group of Parquet, which is held whole, as doubles [bytes]."""
NUMBERS = "biuf"
"""Kinds of numbers, as numpy names them."""

Widths = Mapping[str, Sequence[int]]
"""Numbers a reading that are allowed for each column of arrays."""


class ReadingFile(ABC):
    """A reading file holds columns with one row a reading.

    Attributes:
        path: path of the file, for messages.
        names: names of its columns.
    """

    path: Path
    names: tuple[str, ...]

    @abstractmethod
    def count_rows(self, name: str) -> int:
        """Return the number of rows of a column."""

    @abstractmethod
    def read_column(self, name: str) -> np.ndarray:
        """Return a column of numbers, times or texts whole.

        Raises:
            ImportSourceError: it cannot be read, or is too large.
        """

    @abstractmethod
    def iterate(self, widths: Widths, rows: int) -> Iterator[dict[str, np.ndarray]]:
        """Yield columns of arrays in chunks, each with an array `(row, number)`.

        Args:
            widths: numbers a reading that are allowed for each column that is read.
            rows: largest number of rows of a chunk.

        Raises:
            ImportSourceError: a column cannot be read, or has other numbers a reading.
        """

    def check_width(self, name: str, width: int, widths: Widths) -> None:
        """Raise unless a column has a number of numbers a reading that is allowed."""
        if width not in widths[name]:
            allowed = " or ".join(f"{number:,}" for number in widths[name])
            raise ImportSourceError(
                f"{self.path}: '{name}' has {width:,} numbers a reading; allowed are "
                f"{allowed}; give the skin and the robot that were recorded, in the "
                "order of their taxels and joints"
            )

    def check_kind(self, name: str, dtype: np.dtype) -> None:
        """Raise unless a column of arrays holds numbers."""
        if dtype.kind not in NUMBERS:
            raise ImportSourceError(
                f"{self.path}: '{name}' is of type {dtype}; allowed are numbers"
            )


def to_texts(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    """Return the values of a column of a file as texts; what is missing is empty.

    Raises:
        ImportSourceError: they are bytes of another encoding than UTF-8.
    """
    if values.dtype.kind == "O":
        return np.array(["" if value is None else str(value) for value in values])
    if values.dtype.kind != "S":
        return values.astype(np.str_)
    try:
        return np.char.decode(values, "utf-8")
    except UnicodeError as error:
        raise ImportSourceError(
            f"{path}: '{name}' holds bytes that are no UTF-8 ({error}); allowed are "
            "texts; save them as texts, not as bytes"
        ) from None


@contextmanager
def explain_errors(path: Path) -> Iterator[None]:
    """Turn errors of a file's format into one that names the file."""
    try:
        yield
    except ImportSourceError:
        raise
    except ARCHIVE_ERRORS as error:
        reason = " ".join(str(error).split())
        raise ImportSourceError(
            f"{path}: not a whole file of readings ({reason:.200}); copy it again"
        ) from error


@contextmanager
def open_readings(path: Path) -> Iterator[ReadingFile]:
    """Open an npz archive or a Parquet file.

    Raises:
        ImportSourceError: it cannot be read.
        ExtraError: it is Parquet, and pyarrow is not installed.
    """
    with ExitStack() as stack:
        with explain_errors(path):
            file = stack.enter_context(open_file(path, MAX_FILE_BYTES))
            if path.suffix == NPZ_SUFFIX:
                archive = stack.enter_context(zipfile.ZipFile(file))
                opened: ReadingFile = NpzReadings(path, archive)
            else:
                opened = ParquetReadings(path, file)
        yield opened


@final
class NpzReadings(ReadingFile):
    """An npz archive, whose arrays are decompressed as they are read."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        """Read the names and the sizes of its arrays."""
        self.path = path
        self.archive = archive
        self.names = tuple(
            name.removesuffix(".npy")
            for name in archive.namelist()
            if name.endswith(".npy")
        )

    def count_rows(self, name: str) -> int:
        """Return the number of rows of an array."""
        with explain_errors(self.path), self.archive.open(f"{name}.npy") as file:
            shape, _ = self.read_head(name, file)
        return shape[0] if shape else 0

    def read_column(self, name: str) -> np.ndarray:
        """Return a column of numbers, times or texts whole."""
        with explain_errors(self.path), self.archive.open(f"{name}.npy") as file:
            shape, dtype = self.read_head(name, file)
            size = math.prod(shape) * dtype.itemsize
            if size > MAX_COLUMN_BYTES or len(shape) > 1:
                raise ImportSourceError(
                    f"{self.path}: '{name}' has shape {shape} and {size:,} bytes; "
                    f"allowed is one value a reading, of {MAX_COLUMN_BYTES:,} bytes "
                    "in all"
                )
            return np.frombuffer(file.read(size), dtype).reshape(shape)

    def iterate(self, widths: Widths, rows: int) -> Iterator[dict[str, np.ndarray]]:
        """Yield columns of arrays in chunks."""
        with explain_errors(self.path), ExitStack() as stack:
            files: dict[str, IO[bytes]] = {}
            sizes: dict[str, int] = {}
            types: dict[str, np.dtype] = {}
            counts: dict[str, int] = {}
            for name in widths:
                file = stack.enter_context(self.archive.open(f"{name}.npy"))
                shape, dtype = self.read_head(name, file)
                self.check_kind(name, dtype)
                self.check_width(name, math.prod(shape[1:]), widths)
                files[name] = file
                sizes[name] = math.prod(shape[1:])
                types[name] = dtype
                counts[name] = shape[0] if shape else 0
            self.check_counts(counts)
            for start in range(0, max(counts.values()), rows):
                chunk = {}
                for name, file in files.items():
                    number = min(rows, counts[name] - start)
                    data = file.read(number * sizes[name] * types[name].itemsize)
                    values = np.frombuffer(data, types[name])
                    chunk[name] = values.reshape(number, sizes[name])
                yield chunk

    def read_head(self, name: str, file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype]:
        """Read the shape and the type of an array, up to its data."""
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            head = np.lib.format.read_array_header_1_0(file)
        else:
            head = np.lib.format.read_array_header_2_0(file)
        shape, is_fortran, dtype = head
        if dtype.hasobject or (is_fortran and len(shape) > 1):
            raise ImportSourceError(
                f"{self.path}: '{name}' is an array of "
                f"{'objects' if dtype.hasobject else 'columns in turn'}; allowed are "
                "numbers or texts row by row; save np.ascontiguousarray of it"
            )
        return shape, dtype

    def check_counts(self, counts: Mapping[str, int]) -> None:
        """Raise unless all arrays have as many rows."""
        if len(set(counts.values())) > 1:
            told = ", ".join(f"'{name}' {count:,}" for name, count in counts.items())
            raise ImportSourceError(
                f"{self.path}: readings are {told}; allowed is one number of readings"
            )


@final
class ParquetReadings(ReadingFile):
    """A Parquet file, whose row groups are read one at a time."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        """Read its schema."""
        parquet = find_package("pyarrow.parquet", "pyarrow", "parquet", str(path))
        self.compute: Any = find_package(
            "pyarrow.compute", "pyarrow", "parquet", str(path)
        )
        self.path = path
        self.table: Any = parquet.ParquetFile(file, buffer_size=1 << 20)
        self.names = tuple(self.table.schema_arrow.names)

    def count_rows(self, name: str) -> int:
        """Return the number of rows, which all columns have."""
        return self.table.metadata.num_rows

    def read_column(self, name: str) -> np.ndarray:
        """Return a column of numbers, times or texts whole."""
        parts = []
        size = 0
        with explain_errors(self.path):
            for batch in self.table.iter_batches(columns=[name], use_threads=False):
                column = batch.column(0)
                size += column.nbytes
                if size > MAX_COLUMN_BYTES or self.is_list(column):
                    raise ImportSourceError(
                        f"{self.path}: '{name}' is of type {column.type}, of {size:,} "
                        "bytes or more; allowed is one value a reading, of "
                        f"{MAX_COLUMN_BYTES:,} bytes in all"
                    )
                parts.append(column.to_numpy(zero_copy_only=False))
        return np.concatenate(parts) if parts else np.empty(0)

    def iterate(self, widths: Widths, rows: int) -> Iterator[dict[str, np.ndarray]]:
        """Yield columns of arrays in chunks."""
        with explain_errors(self.path):
            # Read together, all row groups would be held until the end.
            self.check_groups(sum(map(max, widths.values())))
            for group in range(self.table.num_row_groups):
                batches = self.table.iter_batches(
                    rows, [group], columns=list(widths), use_threads=False
                )
                for batch in batches:
                    yield {
                        name: self.flatten(name, batch.column(name), widths)
                        for name in widths
                    }

    def check_groups(self, numbers: int) -> None:
        """Raise if a row group of a number of numbers a reading would take too much."""
        groups = range(self.table.num_row_groups)
        rows = [self.table.metadata.row_group(group).num_rows for group in groups]
        size = 8 * numbers * max(rows, default=0)
        if size > MAX_GROUP_BYTES:
            raise ImportSourceError(
                f"{self.path}: a row group has {max(rows):,} readings, of up to "
                f"{size:,} bytes in memory; allowed are {MAX_GROUP_BYTES:,}; write it "
                "with a row_group_size of 1000"
            )

    def flatten(self, name: str, column: Any, widths: Widths) -> np.ndarray:  # noqa: ANN401
        """Return the numbers of a column of lists, or of lists of lists."""
        count = len(column)
        width = 1
        while self.is_list(column):
            lengths = np.unique(self.compute.list_value_length(column).to_numpy(False))
            if len(lengths) != 1 or column.null_count:
                raise ImportSourceError(
                    f"{self.path}: '{name}' has lists of {len(lengths)} lengths; "
                    "allowed is one length, and no list missing; leave the other "
                    "readings out"
                )
            width *= int(lengths[0])
            column = column.flatten()
        self.check_width(name, width, widths)
        values = column.to_numpy(zero_copy_only=False)
        self.check_kind(name, values.dtype)
        return values.reshape(count, width)

    def is_list(self, column: Any) -> bool:  # noqa: ANN401
        """Return whether the values of a column are lists."""
        return hasattr(column.type, "value_field")
