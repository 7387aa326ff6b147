"""This module encodes CDR, the byte layout of ROS 2 messages (OMG DDSI-RTPS 10).

Little-endian plain CDR has four bytes of encapsulation, then fields aligned to their
own size, counted from the end of the encapsulation. An empty sequence consists of its
count only.
"""

import struct

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


class CdrPacker:
    """Encodes a message field by field, in the order of its definition."""

    def __init__(self) -> None:
        """Start an empty message."""
        self.buffer = bytearray(ENCAPSULATION)

    def bytes(self) -> bytes:
        """Return the message so far."""
        return bytes(self.buffer)

    def align(self, size: int) -> None:
        """Pad to a multiple of `size` bytes."""
        self.buffer += bytes(-(len(self.buffer) - len(ENCAPSULATION)) % size)

    def unsigned(self, value: int) -> None:
        """Append a uint32."""
        self.align(4)
        self.buffer += struct.pack("<I", value)

    def signed(self, value: int) -> None:
        """Append an int32."""
        self.align(4)
        self.buffer += struct.pack("<i", value)

    def byte(self, value: int) -> None:
        """Append a byte, a uint8 or a bool."""
        self.buffer.append(value)

    def number(self, value: float, code: str = "d") -> None:
        """Append a float64 (`d`) or float32 (`f`)."""
        self.align(struct.calcsize(code))
        self.buffer += struct.pack("<" + code, value)

    def numbers(self, values: Shaped[np.ndarray, "*item"]) -> None:
        """Append fields of the array's type, such as those of a point."""
        self.align(values.itemsize)
        self.buffer += values.astype(values.dtype.newbyteorder("<")).tobytes()

    def stamp(self, stamp: int) -> None:
        """Append a `builtin_interfaces/Time` from a stamp [ns since the epoch]."""
        if not 0 <= stamp < LATEST_STAMP:
            raise RecordingError(
                f"stamp {stamp} ns cannot be written; allowed are 0 to 2^31 s "
                "since the epoch; give stamps in nanoseconds of Unix time"
            )
        self.align(4)
        self.buffer += struct.pack("<iI", *divmod(stamp, NS_PER_S))

    def header(self, stamp: int, frame_id: str) -> None:
        """Append a `std_msgs/Header` with a stamp [ns since the epoch]."""
        self.stamp(stamp)
        self.string(frame_id)

    def string(self, text: str) -> None:
        """Append a string: count with its closing zero, UTF-8 bytes, zero."""
        data = text.encode()
        self.unsigned(len(data) + 1)
        self.buffer += data + b"\x00"

    def strings(self, texts: tuple[str, ...]) -> None:
        """Append a sequence of strings."""
        self.unsigned(len(texts))
        for text in texts:
            self.string(text)

    def sequence(self, values: Shaped[np.ndarray, "item *field"]) -> None:
        """Append a sequence of the array's rows, which are numbers or fields."""
        self.unsigned(len(values))
        if len(values):
            self.numbers(values)


class CdrUnpacker:
    """Decodes a message field by field, in the order of its definition."""

    def __init__(self, data: bytes) -> None:
        """Start at the first field; raise unless it is little-endian plain CDR."""
        if data[:2] != ENCAPSULATION[:2]:
            raise RecordingError(
                f"message has encapsulation {data[:2].hex()}; allowed is 0001, "
                "little-endian plain CDR; record it with the ros2 profile"
            )
        self.data = data
        self.offset = len(ENCAPSULATION)

    def take(self, code: str, size: int) -> tuple:
        """Take the fields of a struct code, aligned to `size` bytes."""
        self.align(size)
        values = struct.unpack_from("<" + code, self.data, self.offset)
        self.offset += struct.calcsize("<" + code)
        return values

    def align(self, size: int) -> None:
        """Skip to a multiple of `size` bytes."""
        self.offset += -(self.offset - len(ENCAPSULATION)) % size

    def unsigned(self) -> int:
        """Take a uint32."""
        return self.take("I", 4)[0]

    def signed(self) -> int:
        """Take an int32."""
        return self.take("i", 4)[0]

    def number(self, code: str = "d") -> float:
        """Take a float64 (`d`) or float32 (`f`)."""
        return self.take(code, struct.calcsize(code))[0]

    def stamp(self) -> int:
        """Take a `builtin_interfaces/Time` as a stamp [ns since the epoch]."""
        seconds, nanoseconds = self.take("iI", 4)
        return seconds * NS_PER_S + nanoseconds

    def header(self) -> int:
        """Take a `std_msgs/Header`; return its stamp [ns since the epoch]."""
        stamp = self.stamp()
        self.string()
        return stamp

    def string(self) -> str:
        """Take a string."""
        length = self.unsigned()
        if length > MAX_STRING:
            raise RecordingError(
                f"a string has {length:,} bytes; allowed are {MAX_STRING:,}"
            )
        data = self.data[self.offset : self.offset + length]
        if len(data) < length:
            raise struct.error("string is cut short")
        self.offset += length
        return data.rstrip(b"\x00").decode()

    def strings(self) -> tuple[str, ...]:
        """Take a sequence of strings."""
        count = self.unsigned()
        if count > MAX_STRINGS:
            raise RecordingError(
                f"a sequence has {count:,} strings; allowed are {MAX_STRINGS:,}"
            )
        return tuple(self.string() for _ in range(count))

    def sequence(self, dtype: str) -> Shaped[np.ndarray, "item"]:
        """Take a sequence of numbers; the array is a read-only view of the message."""
        length = self.unsigned()
        kind = np.dtype(dtype)
        if not length:
            return np.empty(0, kind)
        self.align(kind.itemsize)
        values = np.frombuffer(self.data, kind, length, self.offset)
        self.offset += length * kind.itemsize
        return values
