"""This module finds the lines of a matrix in bytes, and the numbers in its lines.

How lines are read is said by options in the address of their port.
"""

import re
from dataclasses import asdict, dataclass, replace
from typing import final

import numpy as np

from eskin.drivers.packet import Framing
from eskin.errors import DeviceError

MAX_LINE_BYTES = 1 << 16
"""Longest line."""
UNITS = {"ns": 1e-3, "us": 1.0, "ms": 1e3, "s": 1e6}
"""Units of time [us]."""
END = re.compile(rb"\r\n|\n\r|\n|\r")
NUMBERS = re.compile(rb"[-+.\deEnNaA,; \t]*")
LABEL = re.compile(rb"[^,;]*[^-+.\d,; \t]")
AROUND = re.compile(rb" *([,;\t]) *")
SEPARATOR = re.compile(rb"[,;\t]| +")
OPTION = re.compile(r"(.*),([a-z]+)=([^,]*)", re.DOTALL)
ALLOWED_OPTIONS = (
    "time=ns, us, ms, s, ignore or none, decimal=comma or point, label=TEXT, "
    "scale=NUMBER and offset=NUMBER"
)


@final
class LineError(Exception):
    """Says why a line is refused, and what the remedy is; empty where not known."""

    def __init__(self, why: str, remedy: str = "") -> None:
        """Keep both."""
        super().__init__(why)
        self.why, self.remedy = why, remedy


@final
@dataclass(frozen=True)
class LineForm:
    """A line form says how the lines of a port are read."""

    path: str
    """Path of the port's device file."""
    time: str = ""
    """Unit of the time that a line begins with; `ignore` leaves the time out, `none`
    says that there is none. Empty: a time follows an @ and is in us."""
    decimal: str = ""
    """What is before the decimals of a number: `comma` or `point`."""
    label: str = ""
    """What a line begins with; other lines are left out."""
    scale: str = ""
    """Counts of a number 1."""
    offset: str = ""
    """Count of a number 0."""

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
        if not (
            options.keys() <= {"time", "decimal", "label", "scale", "offset"}
            and options.get("time", "us") in (*UNITS, "ignore", "none")
            and options.get("decimal", "comma") in ("comma", "point")
            and all(is_number(options.get(name, "1")) for name in ("scale", "offset"))
        ):
            given = ",".join(f"{name}={value}" for name, value in options.items())
            raise DeviceError(
                f"options of csv:{text} are {given}; allowed are {ALLOWED_OPTIONS}; "
                "correct them"
            )
        return cls(text, **options)

    def format(self, **changes: str) -> str:
        """Return the address of the port with other options."""
        options = asdict(replace(self, **changes))
        path = options.pop("path")
        words = [f"{name}={value}" for name, value in options.items() if value]
        return ",".join([f"csv:{path}", *words])

    def split(self, body: bytes) -> list[float]:
        """Return the numbers of a line; those that are missing are not a number.

        Raises:
            ValueError: something is not a number.
            LineError: commas may be decimal.
        """
        if NUMBERS.fullmatch(body) is None:
            raise ValueError
        body = AROUND.sub(rb"\1", body.strip())
        if self.decimal == "comma":
            body = body.replace(b",", b".")
        elif not self.decimal and b"," in body and any(c in body for c in b"; \t"):
            comma = self.format(decimal="comma")
            raise LineError(
                "commas may separate or be decimal",
                f"give {comma} or {self.format(decimal='point')}",
            )
        words = SEPARATOR.split(body)
        if not words[-1]:
            words.pop()
        return [float(word) if word else np.nan for word in words]

    def find_label(self, line: bytes) -> str:
        """Return the option that reads a line with a label before its numbers."""
        match = LABEL.match(line)
        if (
            match is None
            or NUMBERS.fullmatch(line[match.end() :].removeprefix(b"@")) is None
        ):
            return ""
        label = match.group().decode("ascii", "replace")
        return f"give {self.format(label=label)}" if label.isprintable() else ""


def is_number(text: str) -> bool:
    """Return whether a text is a finite number."""
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


@final
class LineDeframer(Framing):
    """Finds the lines in the bytes of a port; the first may be cut and is left out.

    Lines end with a line feed, a carriage return, or both in any order.
    """

    def reset(self) -> None:
        """Discard the open line; the rest of it will be left out."""
        self.open, self.other = bytearray(), b""
        self.skipping = True

    def push(self, chunk: bytes) -> list[bytes]:
        """Return the lines that end in this chunk, without their ends."""
        self.bytes += len(chunk)
        if chunk and self.other:
            chunk, self.other = chunk.removeprefix(self.other), b""
        lines = []
        *ends, start = END.split(chunk)
        for part in ends:
            if not self.skipping:
                lines.append(bytes(self.open + part))
            self.open, self.skipping = bytearray(), False
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
