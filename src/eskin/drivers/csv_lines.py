"""This module finds the lines of a matrix in bytes, and the numbers in its lines.

How lines are read is said by options in the address of their port.
"""

import json
import re
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, Literal, final, get_args

import numpy as np

from eskin.drivers.csv_problems import LineError, LineProblem, OptionChange
from eskin.drivers.packet import Framing
from eskin.errors import DeviceError
from eskin.files import parse_number

# Names and units of the time.
UNITS = {"ns": 1e-3, "us": 1.0, "ms": 1e3, "s": 1e6}
"""Units of time [us]."""
TIME_NAMES = ("t", "ts", "time", "timestamp", "millis", "micros")
"""Names of the time in a JSON object, in small letters."""
TIME_PART = re.compile(r"time|stamp|(?:^|_)t?(?:ns|us|ms|s)$")
"""Part of another name that is one of a time."""

# Limits of a line, and of the names in a message.
MAX_LINE_BYTES = 1 << 16
"""Longest line."""
MAX_NAMES = 4
"""Largest number of names in a message."""
MAX_NAME = 24
"""Largest number of characters of each of them."""

# Parts of a line.
END = re.compile(rb"\r\n|\n\r|\n|\r")
COLOURS = re.compile(rb"\x1b\[[\d;]*[A-Za-z]")
"""Codes by which a terminal changes colours or the place of what follows."""
BRACKETS = b"[](){}"
ANY_NUMBER = re.compile(rb"\d|\b[nN][aA][nN]\b|^[,;\t ]+$")
"""Part of a line with numbers, of which all may be missing."""
NUMBERS = re.compile(rb"[-+.\deEnNaA,; \t]*")
HEXADECIMAL = re.compile(rb"[\da-fA-FxX,; \t]*")
AROUND = re.compile(rb" *([,;\t]) *")
SEPARATOR = re.compile(rb"[,;\t]| +")

# Options of an address.
OPTION = re.compile(r"(.*),([a-z]+)=([^,]*)", re.DOTALL)
TimeForm = Literal["", "ns", "us", "ms", "s", "ignore", "none"]
LastForm = Literal["", "ignore"]
DecimalForm = Literal["", "comma", "point"]
BaseForm = Literal["", "10", "16"]
CHOICES: dict[str, tuple[str, ...]] = {
    "time": get_args(TimeForm)[1:],
    "last": get_args(LastForm)[1:],
    "decimal": get_args(DecimalForm)[1:],
    "base": get_args(BaseForm)[1:],
}
"""Options with the words that each may have."""
QUANTITIES = ("scale", "offset", "missing")
"""Options that are numbers."""
ALLOWED_OPTIONS = (
    "time=ns, us, ms, s, ignore or none, last=ignore, decimal=comma or point, base=10 "
    "or 16, label=TEXT, and scale, offset and missing=NUMBER"
)


@final
@dataclass(frozen=True)
class LineForm:
    """A line form says how the lines of a port are read."""

    path: str
    """Path of the port's device file."""
    time: TimeForm = ""
    """Unit of the time that a line begins with; `ignore` leaves the first number out,
    `none` says that there is no time. Empty: a time follows an @ and is in us."""
    last: LastForm = ""
    """`ignore` leaves the last number of a line out."""
    decimal: DecimalForm = ""
    """Mark before the decimals of a number: `comma` or `point`."""
    base: BaseForm = ""
    """Base of the numbers: 10 or 16."""
    label: str = ""
    """What a line begins with, where * stands for any text; others are left out."""
    scale: float | None = None
    """Counts of a number 1; None for 1, where numbers are no fractions."""
    offset: float | None = None
    """Count of a number 0; None for 0."""
    missing: float | None = None
    """Number of a cell that is missing; None where none stands for it."""

    @classmethod
    def parse(cls, text: str) -> "LineForm":
        """Parse a path and options that follow it, each as `,name=value`.

        Raises:
            DeviceError: there is no such option, or it has no such value.
        """
        options: dict[str, str] = {}
        while (match := OPTION.fullmatch(text)) is not None:
            text, name, value = match.groups()
            options[name] = value
        known = {*CHOICES, *QUANTITIES, "label"}
        if not (
            options.keys() <= known
            and all(options.get(name, one[0]) in one for name, one in CHOICES.items())
            and all(is_number(options.get(name, "1")) for name in QUANTITIES)
        ):
            given = ",".join(f"{name}={value}" for name, value in options.items())
            raise DeviceError(
                f"options of csv:{text} are {given}; allowed are {ALLOWED_OPTIONS}"
            )
        return cls(text).change(options)

    def change(self, options: dict[str, str]) -> "LineForm":
        """Return the form with other options, as they are written in an address."""
        values: dict[str, Any] = {
            name: parse_number(word) if name in QUANTITIES else word
            for name, word in options.items()
        }
        return replace(self, **values)

    def format(self) -> str:
        """Return the address of the port with its options, as a shell takes it."""
        options = asdict(self)
        path = options.pop("path")
        words = [
            f"{name}={str(value).removesuffix('.0') if name in QUANTITIES else value}"
            for name, value in options.items()
            if value not in ("", None)
        ]
        return shlex.quote(",".join([f"csv:{path}", *words]))

    @cached_property
    def label_parts(self) -> list[bytes]:
        """Parts of the label between which there is any text."""
        return self.label.encode().split(b"*")

    def find_label_end(self, body: bytes) -> int | None:
        """Return the size of the label of a line; None where it is not there."""
        end = 0
        for number, part in enumerate(self.label_parts):
            start = body.find(part, end)
            if start < 0 or (number == 0 and start > 0):
                return None
            end = start + len(part)
        return end

    def split(self, body: bytes) -> list[bytes]:
        """Return the words of a line that are numbers; empty where one is missing.

        Raises:
            LineError: something in it is no number, or commas may be decimal.
        """
        numbers = HEXADECIMAL if self.base == "16" else NUMBERS
        if numbers.fullmatch(body) is None:
            if find_hexadecimal(body):
                raise LineError(LineProblem.LETTERS.reason(), HEXADECIMAL_CHANGES)
            raise LineError(LineProblem.NOT_NUMBERS.reason())
        body = AROUND.sub(rb"\1", body.strip())
        if self.decimal == "comma":
            body = body.replace(b",", b".")
        elif not self.decimal and b"," in body and any(c in body for c in b"; \t"):
            others = SEPARATOR.sub(b" ", body.replace(b",", b".")).split()
            raise LineError(
                LineProblem.COMMAS.reason(count=len(others)),
                [
                    OptionChange({"decimal": "comma"}, "if commas are decimal"),
                    OptionChange({"decimal": "point"}, "if commas separate"),
                ],
            )
        return SEPARATOR.split(body) if body else []

    def convert(self, words: Sequence[bytes]) -> list[float]:
        """Return the numbers of words; those that are missing are not a number.

        Raises:
            LineError: a word is no number.
        """
        try:
            if self.base == "16":
                return [float(int(word, 16)) if word else np.nan for word in words]
            return [float(word) if word else np.nan for word in words]
        except (ValueError, OverflowError):
            raise LineError(LineProblem.NOT_NUMBERS.reason()) from None


HEXADECIMAL_CHANGES = (OptionChange({"base": "16"}, "if they are hexadecimal"),)


def find_hexadecimal(body: bytes) -> list[bytes]:
    """Return the words of a line of hexadecimal numbers; empty where it is none.

    Two of them have letters at least: in one, a letter may be damage.
    """
    words = body.replace(b",", b" ").replace(b";", b" ").split()
    lettered = sum(not word.isdigit() for word in words)
    is_hexadecimal = HEXADECIMAL.fullmatch(body) is not None and lettered > 1
    return words if is_hexadecimal else []


def is_number(text: str) -> bool:
    """Return whether a text is a finite number."""
    try:
        parse_number(text)
    except ValueError:
        return False
    return True


def clean_line(line: bytes) -> bytes:
    """Return a line without blanks around it, byte order mark and colours."""
    return COLOURS.sub(b"", line).strip(b"\xef\xbb\xbf \t")


def read_json(body: bytes, unit: str, sizes: Sequence[int]) -> list[float]:
    """Return the numbers of a line that is a JSON object.

    They are those of the one array that has the numbers of a scan, else those of all
    arrays in order, or all of it where it has no array. The time is the number outside
    of them that `find_time` names.

    Args:
        body: the line.
        unit: unit of the time, which comes before the counts; empty for no time.
        sizes: numbers of counts that a scan may have.

    Raises:
        LineError: it is no such object.
    """
    try:
        content = json.loads(body)
        if not isinstance(content, dict):
            raise ValueError
        arrays: list[list[float]] = []
        outside: dict[str, float] = {}
        for name, value in content.items():
            if isinstance(value, list):
                arrays.append(flatten(value))
            elif isinstance(value, int | float) and not isinstance(value, bool):
                outside[name] = float(value)
        fitting = [array for array in arrays if len(array) in sizes]
        counts = sum(arrays, []) if len(fitting) != 1 else fitting[0]
    except (ValueError, RecursionError, OverflowError, TypeError):
        raise LineError(LineProblem.BROKEN_OBJECT.reason()) from None
    if not unit:
        return counts or [*outside.values()]
    time = outside.pop(find_time(outside, unit))
    return [time, *(counts or outside.values())]


def find_time(names: Iterable[str], unit: str) -> str:
    """Return which of the names of numbers names the time.

    It is the first of `TIME_NAMES` or the unit, else the one name with `time` or
    `stamp` in it or a unit at its end, else the only name.

    Args:
        names: the names.
        unit: unit of the time.

    Raises:
        LineError: there is none, or it is not known which.
    """
    names = list(names)
    lower = {name.lower(): name for name in reversed(names)}
    for exact in (*TIME_NAMES, unit):
        if exact in lower:
            return lower[exact]
    alike = [name for name in names if TIME_PART.search(name.lower())]
    found = alike or names
    if len(found) == 1:
        return found[0]
    if not found:
        raise LineError(LineProblem.OBJECT_WITHOUT_TIME.reason(unit=unit))
    listed = ", ".join(ascii(name)[:MAX_NAME] for name in found[:MAX_NAMES])
    raise LineError(LineProblem.OBJECT_WITH_TIMES.reason(unit=unit, names=listed))


def flatten(values: list[Any]) -> list[float]:
    """Return the numbers of nested lists in order; null is not a number.

    Raises:
        TypeError: something is neither a number nor a list.
    """
    numbers: list[float] = []
    for value in values:
        if isinstance(value, list):
            numbers += flatten(value)
        else:
            numbers.append(read_value(value))
    return numbers


def read_value(value: Any) -> float:  # noqa: ANN401
    """Return the number of a value in a JSON list; null is not a number.

    Raises:
        TypeError: it is neither a number nor the text of one.
        ValueError: it is the text of no number.
    """
    if value is None:
        return np.nan
    return parse_number(value) if isinstance(value, str) else float(value)


@final
class LineDeframer(Framing):
    """Finds the lines in the bytes of a port; the first may be cut and is left out.

    Lines end with a line feed, a carriage return, or both in any order.
    """

    def reset(self) -> None:
        """Discard the open line; the rest of it will be left out."""
        self.open = bytearray()
        self.other = b""
        self.skipping = True

    def push_chunk(self, chunk: bytes) -> list[bytes]:
        """Return the lines that end in this chunk, without their ends."""
        self.bytes += len(chunk)
        if chunk and self.other:
            chunk = chunk.removeprefix(self.other)
            self.other = b""
        lines = []
        *ends, start = END.split(chunk)
        for part in ends:
            if not self.skipping:
                lines.append(bytes(self.open + part))
            self.open = bytearray()
            self.skipping = False
        if ends and not start:
            # The other half of the end may be in the next chunk.
            last = END.findall(chunk)[-1]
            self.other = {b"\r": b"\n", b"\n": b"\r"}.get(last, b"")
        if not self.skipping:
            self.open += start
        if len(self.open) > MAX_LINE_BYTES:
            self.broken += 1
            self.reset()
        self.frames += len(lines)
        return lines
