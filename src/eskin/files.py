"""This module reads files that a user names, also YAML, and writes files atomically.

A file is read only if it is a regular one of a limited size: opening a FIFO would wait
for a writer, and a device may never end.
"""

import errno
import math
import os
import shutil
import stat
from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, BinaryIO

import yaml
from annotated_types import Interval
from pydantic import Field, ValidationError
from pydantic_core import ErrorDetails

KINDS = {
    stat.S_IFIFO: "a FIFO",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
"""Kinds of files that are refused, beside folders."""
LFS_POINTER = b"version https://git-lfs.github.com/spec/"
"""Beginning of the text that stands for a file of Git LFS until it is fetched."""

ALLOWED = {
    "greater_than_equal": "{ge} or more",
    "greater_than": "more than {gt}",
    "less_than_equal": "{le} or less",
    "less_than": "less than {lt}",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "a text",
    "string_pattern_mismatch": "one line of text without spaces at its ends",
    "string_too_short": "a text of {min_length} characters or more",
    "string_too_long": "a text of {max_length} characters or fewer",
    "literal_error": "{expected}",
    "list_type": "a list",
    "tuple_type": "a list",
    "too_short": "a list of {min_length} entries or more",
    "too_long": "a list of {max_length} entries or fewer",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "dataclass_type": "a mapping",
    "dataclass_exact_type": "a mapping",
    "none_required": "nothing",
    "json_invalid": "JSON ({error})",
    "json_type": "JSON",
}
"""What is allowed for an entry, by the type of error of pydantic."""
UNKNOWN_ENTRY = ("extra_forbidden", "unexpected_keyword_argument")
"""Types of error of pydantic of an entry that is not known."""


class UnfitFileError(OSError):
    """A file is no regular one, too large, or not fetched; `strerror` says which."""


def open_file(path: Path, max_bytes: int) -> BinaryIO:
    """Open a regular file for reading, without waiting for another process.

    Args:
        path: path of the file.
        max_bytes: largest size that is allowed [bytes].

    Raises:
        OSError: it cannot be opened, is no regular file, is too large, or is a pointer
            of Git LFS; `strerror` says why.
    """
    # A device is not even opened: that alone may reset it.
    check_status(os.stat(path), max_bytes)
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
    try:
        # Another file may have taken its place in between.
        check_status(os.fstat(descriptor), max_bytes)
        if os.pread(descriptor, len(LFS_POINTER), 0) == LFS_POINTER:
            raise UnfitFileError(
                errno.EINVAL,
                "it is a pointer of Git LFS, not the file itself; run 'git lfs pull' "
                "in its folder",
            )
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def check_status(status: os.stat_result, max_bytes: int) -> None:
    """Raise unless a status is of a regular file of at most a size [bytes]."""
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
    """Read a regular file whole; arguments and errors are as of `open_file`."""
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


def rename_new(part: Path, path: Path) -> None:
    """Rename a file; raise a FileExistsError where the new name is taken by then."""
    path.touch(exist_ok=False)
    part.replace(path)


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


READINGS = "readings.parquet"
"""Table of the readings in a folder that `eskin export --parquet` writes."""
TOUCHES = "touches.parquet"
"""Table of the touches there."""
TAXELS = "taxels.parquet"
"""Table of the taxels there."""
MAX_SHOWN = 40
"""Number of characters of a value that messages show."""
MAX_DEPTH = 20
"""Largest depth of nested collections in a file."""
YAML_SUFFIXES = (".yaml", ".yml")
"""Ends of the names of YAML files."""
MAX_YAML_BYTES = 1 << 19
"""Largest size of a file [bytes]."""
MAX_VALUES = 16_000
"""Largest number of values in a file; keys and collections count too."""
MAX_SCALAR = 10_000
"""Largest number of characters of a single value."""
NUMBER_TAGS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
MAX_DIGITS = 400
"""Largest number of characters of a number."""
# One line without control characters, and without spaces at its ends.
NAME = r"^[^\s\p{Cc}]([^\p{Cc}\p{Zl}\p{Zp}]*[^\s\p{Cc}])?$"
Name = Annotated[str, Field(pattern=NAME, max_length=200)]

# Numbers of a file that may come from a stranger. Some are sizes of memory, others
# become indices in compiled code, which has no bounds checks. The limits leave room for
# every setting that makes sense.
Share = Annotated[float, Interval(ge=0.0, le=1.0)]
Duration = Annotated[float, Interval(ge=0.001, le=86_400.0)]  # [s] up to a day
Pause = Annotated[float, Interval(ge=0.0, le=60.0)]  # [s]
Pressure = Annotated[float, Interval(ge=0.001, le=10_000.0)]  # [kPa]
Distance = Annotated[float, Interval(ge=0.0, le=1.0)]  # [m]
Factor = Annotated[float, Interval(ge=0.0, le=1000.0)]
NotNegative = Annotated[float, Interval(ge=0.0, le=math.inf)]


def load_plain_yaml(text: str) -> object:
    """Load the data of a YAML text.

    Raises:
        ValueError: The text is not plain YAML. The message is one line that says where
            and why, to follow the name of the file.
    """
    try:
        if len(text) > MAX_YAML_BYTES:
            raise ValueError(
                f"it has {len(text):,} characters, allowed are {MAX_YAML_BYTES:,}"
            )
        return yaml.load(text, PlainLoader)  # noqa: S506  It is a SafeLoader.
    except yaml.YAMLError as error:
        raise ValueError(describe_yaml_error(error)) from None
    except (OverflowError, ValueError) as error:  # An invalid character code.
        raise ValueError(f": not plain YAML: {error}") from None


class PlainLoader(yaml.SafeLoader):
    """Loads plain data: only YAML's own tags are allowed, and no repeated keys.

    Within a second it has loaded a text, or refused it: a few aliases could expand to
    billions of values, and the time to read nested collections grows with the square of
    their depth.
    """

    def __init__(self, text: str) -> None:
        """Start at the beginning of a text."""
        super().__init__(text)
        self.values = self.depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Read a value; raise a YAML error where it is an alias, or one too many."""
        event = self.peek_event()
        self.values = self.values + 1
        self.depth = self.depth + 1
        for is_wrong, problem in (
            (event.anchor is not None, "anchors and aliases are not allowed"),
            (self.values > MAX_VALUES, f"more than {MAX_VALUES:,} values"),
            (
                len(getattr(event, "value", "")) > MAX_SCALAR,
                f"a value has more than {MAX_SCALAR:,} characters",
            ),
            (self.depth > MAX_DEPTH, f"more than {MAX_DEPTH} nested collections"),
        ):
            if is_wrong:
                raise yaml.MarkedYAMLError(
                    problem=problem, problem_mark=event.start_mark
                )
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> object:
        """Construct a value; raise a YAML error where it does not match its tag."""
        try:
            if node.tag in NUMBER_TAGS and len(node.value) > MAX_DIGITS:
                # The time to read digits to the base 60 grows with the square.
                raise ValueError
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
            raise yaml.MarkedYAMLError(
                problem=f"{shorten(node.value)} is no {node.tag.rpartition(':')[2]}",
                problem_mark=node.start_mark,
            ) from None

    def construct_mapping(
        self, node: yaml.MappingNode, deep: bool = False
    ) -> dict[Hashable, object]:
        """Construct a mapping; raise where a key is repeated or not a scalar."""
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(
                    problem="a key is not a word", problem_mark=key.start_mark
                )
            if key.value in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"the key {shorten(key.value)} is repeated",
                    problem_mark=key.start_mark,
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def describe_yaml_error(error: yaml.YAMLError) -> str:
    """Describe where and why a YAML text is invalid, in one line."""
    mark = getattr(error, "problem_mark", None)
    where = f" line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    why = getattr(error, "problem", None) or str(error)
    return f"{where}: not plain YAML: {' '.join(str(why).split())}"


def format_entry_path(steps: Sequence[int | str]) -> str:
    """Return the path of an entry in a file, such as `patches[2].rows`."""
    path = ""
    for step in steps:
        plain = str(step) if str(step).isidentifier() else shorten(step)
        path += f"[{step}]" if isinstance(step, int) else f".{plain}"
    return path.lstrip(".")


def describe_first_error(error: ValidationError) -> str:
    """Describe the first wrong entry of a file as `describe_entry_error` does."""
    return describe_entry_error(error.errors()[0])


def describe_entry_error(detail: ErrorDetails, known: Sequence[str] = ()) -> str:
    """Describe a wrong entry of a file: where it is, what was got, what is allowed.

    Args:
        detail: what pydantic says of the entry.
        known: names of the entries that may stand where an unknown one does; none are
            told where it is empty.
    """
    path = format_entry_path(detail["loc"]) or "the file"
    if detail["type"] == "missing":
        return f"{path} is missing; add it"
    if detail["type"] in UNKNOWN_ENTRY:
        remedy = f", allowed {', '.join(known)}" if known else "; take it out"
        return f"{path} is not known{remedy}"
    got = f"{path}: got {shorten(detail['input'])}"
    if detail["type"] == "value_error":
        return f"{got}; {detail['msg'].removeprefix('Value error, ')}"
    allowed = ALLOWED.get(detail["type"])
    if allowed is None:
        return f"{got}, allowed is {detail['msg'].removeprefix('Input should be ')}"
    return f"{got}, allowed is {allowed.format_map(detail.get('ctx', {}))}"


def parse_number(text: str) -> float:
    """Return the finite number of a text, written with a decimal point.

    Raises:
        ValueError: It is none. Underscores between digits and words such as `nan`,
            which Python reads, are not allowed.
    """
    number = float(text)
    if "_" in text or not text.isascii() or not math.isfinite(number):
        raise ValueError(f"'{text:.40}' is no finite number")
    return number


def shorten(value: object) -> str:
    """Return the representation of a value, cut to a length for messages."""
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else text[:MAX_SHOWN] + "..."
