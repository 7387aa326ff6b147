"""This module encodes and decodes ROS 2 messages as CDR, by their definitions.

Little-endian plain CDR (OMG DDSI-RTPS 10) has four bytes of encapsulation, then fields
aligned to their own size, counted from the end of the encapsulation. An empty sequence
consists of its count only.

The values of a message are given in the order of its fields: numbers, texts, times and
durations as stamps [ns], messages as tuples of their fields. A sequence of numbers is
an array, one of messages whose fields are numbers of one type an array with a row each.
"""

import re
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Shaped

from eskin.errors import RecordingError
from eskin.units import NS_PER_S

ENCAPSULATION = b"\x00\x01\x00\x00"
LATEST_STAMP = 2**31 * NS_PER_S
MAX_STRING = 1000
"""Longest string that is read [bytes]."""
MAX_STRINGS = 1000
"""Largest number of strings in a sequence, such as names of joints."""
RULE = re.compile(r"^=+\nMSG: (\S+)\n", re.MULTILINE)
FIELD = re.compile(r"^(\S+?)(\[\])? (\w+)$")
STAMPS = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
NUMBERS = {
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
    "bool": "?",
    "byte": "B",
}
"""Codes of the types of numbers, of `struct` and numpy."""
STAMP = struct.Struct("<iI")
COUNT = struct.Struct("<I")

Pack = Callable[[bytearray, Any], None]
Unpack = Callable[[bytes, int], tuple[Any, int]]


class Codec(NamedTuple):
    """A codec encodes and decodes the values of one type."""

    pack: Pack
    """Function that appends a value to a message."""
    unpack: Unpack
    """Function of a message and an offset that returns the value there, and its end."""


@dataclass(frozen=True)
class MessageField:
    """A field of a message has a name and a type, and may be a sequence of it."""

    name: str
    type_name: str
    """Basic type such as `float64`, or full name such as `std_msgs/msg/Header`."""
    is_sequence: bool
    """Whether it holds any number of values."""

    @property
    def is_nested(self) -> bool:
        """Return whether its type is a message."""
        return self.type_name != "string" and self.type_name not in NUMBERS


Types = dict[str, tuple[MessageField, ...]]
"""Fields of types, by full name."""


@dataclass(frozen=True)
class Topic:
    """A topic has a name, a type of message and its definition."""

    name: str
    """Name of the topic."""
    type_name: str
    """ROS 2 type of its messages."""
    definition: str
    """Definition of that type, and of all types that it refers to."""

    @cached_property
    def types(self) -> Types:
        """Fields of the topic's type, which comes first, and of all types in it."""
        own, *others = RULE.split(self.definition)
        names = [self.type_name, *map(expand_name, others[::2])]
        return dict(zip(names, map(parse_fields, [own, *others[1::2]]), strict=True))

    @cached_property
    def codec(self) -> Codec:
        """Codec of the topic's type."""
        return build_codec(self.type_name, self.types)

    def pack(self, *values: object) -> bytes:
        """Encode a message.

        Raises:
            RecordingError: a stamp cannot be written.
        """
        buffer = bytearray(ENCAPSULATION)
        self.codec.pack(buffer, values)
        return bytes(buffer)

    def unpack(self, data: bytes) -> tuple[Any, ...]:
        """Decode a message; its arrays are read-only views of it.

        Raises:
            RecordingError: it has another encapsulation, or too long texts.
            struct.error: it is cut short.
            ValueError: it is cut short, or a text is no UTF-8.
        """
        if data[:2] != ENCAPSULATION[:2]:
            raise RecordingError(
                f"message has encapsulation {data[:2].hex()}; allowed is 0001, "
                "little-endian plain CDR; record it with the ros2 profile"
            )
        return self.codec.unpack(data, len(ENCAPSULATION))[0]


def define_topic(name: str, kind: str, own: str, *others: tuple[str, str]) -> Topic:
    """Define a topic; its definition and those of `others` are joined as by rosbag2."""
    rule = "=" * 80
    parts = [own.strip()]
    parts += [f"{rule}\nMSG: {name}\n{text.strip()}" for name, text in others]
    return Topic(name, kind, "\n".join(parts) + "\n")


def expand_name(name: str) -> str:
    """Return `package/msg/Type` for the `package/Type` of a definition."""
    return "/msg/".join(name.split("/"))


def parse_fields(text: str) -> tuple[MessageField, ...]:
    """Return the fields of one definition, without its comments."""
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    found = []
    for line in lines:
        match = FIELD.match(line)
        assert match is not None, line
        kind, sequence, name = match.groups()
        found.append(MessageField(name, expand_name(kind), bool(sequence)))
    return tuple(found)


def build_codec(name: str, types: Types) -> Codec:
    """Build the codec of a type, which is basic or among the types that are given."""
    if name == "string":
        return Codec(pack_string, unpack_string)
    if name in STAMPS:
        return Codec(pack_stamp, unpack_stamp)
    if name in NUMBERS:
        layout = struct.Struct("<" + NUMBERS[name])
        return Codec(partial(pack_number, layout), partial(unpack_number, layout))
    codecs = [
        build_sequence_codec(field.type_name, types)
        if field.is_sequence
        else build_codec(field.type_name, types)
        for field in types[name]
    ]
    return Codec(partial(pack_fields, codecs), partial(unpack_fields, codecs))


def build_sequence_codec(name: str, types: Types) -> Codec:
    """Build the codec of a sequence of a type."""
    codes = {NUMBERS.get(name)}
    if name in types and name not in STAMPS:
        codes = {NUMBERS.get(field.type_name) for field in types[name]}
    codec = build_codec(name, types)
    code = codes.pop()
    pack = partial(pack_all, codec.pack)
    unpack = partial(unpack_all, codec.unpack)
    if code is not None and not codes:
        pack = partial(pack_rows, np.dtype("<" + code))
    if name in NUMBERS:
        unpack = partial(unpack_numbers, np.dtype("<" + NUMBERS[name]))
    return Codec(pack, unpack)


def pack_fields(
    codecs: Sequence[Codec], buffer: bytearray, values: Iterable[object]
) -> None:
    """Append the fields of a message."""
    for codec, value in zip(codecs, values, strict=True):
        codec.pack(buffer, value)


def unpack_fields(
    codecs: Sequence[Codec], data: bytes, offset: int
) -> tuple[tuple[Any, ...], int]:
    """Return the fields of a message, and their end."""
    values = []
    for codec in codecs:
        value, offset = codec.unpack(data, offset)
        values.append(value)
    return tuple(values), offset


def pack_aligned(buffer: bytearray, data: bytes, size: int) -> None:
    """Append bytes that are aligned to a size."""
    buffer += bytes((len(ENCAPSULATION) - len(buffer)) % size) + data


def align(offset: int, size: int) -> int:
    """Return the first multiple of a size from an offset in a message on."""
    return offset + (len(ENCAPSULATION) - offset) % size


def pack_number(
    layout: struct.Struct, buffer: bytearray, value: float | int | np.number
) -> None:
    """Append a number."""
    pack_aligned(buffer, layout.pack(value), layout.size)


def unpack_number(layout: struct.Struct, data: bytes, offset: int) -> tuple[Any, int]:
    """Return a number, and its end."""
    start = align(offset, layout.size)
    return layout.unpack_from(data, start)[0], start + layout.size


def pack_stamp(buffer: bytearray, stamp: int) -> None:
    """Append a time or a duration [ns]."""
    check_stamps(stamp, stamp)
    pack_aligned(buffer, STAMP.pack(*divmod(stamp, NS_PER_S)), COUNT.size)


def check_stamps(first: int, last: int) -> None:
    """Raise a RecordingError unless stamps from the first to the last are allowed."""
    if not (0 <= first and last < LATEST_STAMP):
        shown = f"stamp {first}" if first == last else f"stamps from {first} to {last}"
        raise RecordingError(
            f"{shown} ns cannot be written; allowed are 0 to 2^31 s since the epoch; "
            "give stamps in nanoseconds of Unix time"
        )


def unpack_stamp(data: bytes, offset: int) -> tuple[int, int]:
    """Return a time or a duration [ns], and its end."""
    start = align(offset, COUNT.size)
    seconds, nanoseconds = STAMP.unpack_from(data, start)
    return seconds * NS_PER_S + nanoseconds, start + STAMP.size


def pack_string(buffer: bytearray, text: str) -> None:
    """Append a string: count with its closing zero, UTF-8 bytes, zero."""
    data = text.encode()
    pack_aligned(buffer, COUNT.pack(len(data) + 1) + data + b"\x00", COUNT.size)


def unpack_string(data: bytes, offset: int) -> tuple[str, int]:
    """Return a string, and its end."""
    length, start = unpack_number(COUNT, data, offset)
    if length > MAX_STRING:
        raise RecordingError(
            f"a string has {length:,} bytes; allowed are {MAX_STRING:,}"
        )
    end = start + length
    if len(data) < end:
        raise struct.error("string is cut short")
    return data[start:end].rstrip(b"\x00").decode(), end


def pack_all(pack: Pack, buffer: bytearray, values: Sequence[object]) -> None:
    """Append a sequence of texts or messages."""
    pack_number(COUNT, buffer, len(values))
    for value in values:
        pack(buffer, value)


def unpack_all(unpack: Unpack, data: bytes, offset: int) -> tuple[tuple[Any, ...], int]:
    """Return a sequence of texts or messages, and its end."""
    count, offset = unpack_number(COUNT, data, offset)
    if count > MAX_STRINGS:
        raise RecordingError(
            f"a sequence has {count:,} strings; allowed are {MAX_STRINGS:,}"
        )
    values = []
    for _ in range(count):
        value, offset = unpack(data, offset)
        values.append(value)
    return tuple(values), offset


def pack_rows(
    kind: np.dtype, buffer: bytearray, values: Shaped[np.ndarray, "item *field"]
) -> None:
    """Append a sequence of numbers, or of messages of numbers."""
    pack_number(COUNT, buffer, len(values))
    if len(values):
        pack_aligned(buffer, values.astype(kind).tobytes(), kind.itemsize)


def unpack_numbers(
    kind: np.dtype, data: bytes, offset: int
) -> tuple[Shaped[np.ndarray, "item"], int]:
    """Return a sequence of numbers, and its end."""
    count, offset = unpack_number(COUNT, data, offset)
    if not count:
        return np.empty(0, kind), offset
    start = align(offset, kind.itemsize)
    # A byte of a bool may hold any number, which numpy takes as it is.
    read = np.dtype(np.uint8) if kind.char == "?" else kind
    values = np.frombuffer(data, read, count, start)
    return values != 0 if kind.char == "?" else values, start + values.nbytes
