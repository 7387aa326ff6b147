"""Device protocol, version 1: what a patch says, as bytes.

Little-endian. Every packet is a header, what its kind holds, and a CRC-32 of all bytes
before it; `docs/protocol.md` has the tables.
"""

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt16

from eskin.errors import PacketError

VERSION = 1
HELLO, DATA, STATUS = 1, 2, 3
MOST_BYTES = 1400
"""Of one packet: with UDP and IP before it, it still fits every Ethernet frame."""

HEADER = struct.Struct("<BBHHI")
HELLO_BODY = struct.Struct("<HHHHQB")
DATA_BODY = struct.Struct("<HH")
STATUS_BODY = struct.Struct("<IIh")
CRC = struct.Struct("<I")
RESIDUE = 0x2144DF1C
"""CRC-32 of any bytes with their own CRC-32 behind them."""
LEAST_BYTES = HEADER.size + CRC.size
MOST_TEXT = 255
MOST_COUNTS = (MOST_BYTES - HEADER.size - DATA_BODY.size - CRC.size) // 2
COUNT = np.dtype("<u2")


@dataclass(frozen=True)
class Hello:
    """A patch introduces itself: at power-up and once a second."""

    address: int
    """Of the patch on its bus, 0 to 65535."""
    scan: int
    """Number of its latest scan, modulo 65536."""
    device_time: int
    """Its own clock [us], modulo 2**32."""
    rows: int
    """Rows of its electrode grid."""
    columns: int
    """Columns of its electrode grid."""
    taxels: int
    """How many cells of the grid hold a taxel."""
    rate: int
    """Scans a second that it means to make; 0 where it does not say."""
    serial_number: int
    """Tells this module from every other, 64 bits."""
    firmware: str
    """Name and version of its program, at most 255 bytes of UTF-8."""


@dataclass(frozen=True, eq=False)
class Data:
    """Counts of some taxels of one scan."""

    address: int
    """Of the patch on its bus, 0 to 65535."""
    scan: int
    """Number of the scan, modulo 65536; its packets share it."""
    device_time: int
    """When the scan began by the patch's own clock [us], modulo 2**32."""
    first: int
    """Place of the first count among the taxels of the patch."""
    counts: UInt16[np.ndarray, "count"]
    """What the converter counted, in the order of the patch's taxels; read-only where
    the packet was decoded."""


@dataclass(frozen=True)
class Status:
    """How a patch fares: once a second, or when something is wrong."""

    address: int
    """Of the patch on its bus, 0 to 65535."""
    scan: int
    """Number of its latest scan, modulo 65536."""
    device_time: int
    """Its own clock [us], modulo 2**32."""
    skipped: int
    """Scans that it had no time to make or send since power-up."""
    errors: int
    """What went wrong in its electronics since power-up."""
    temperature: int
    """Of the module [0.01 degrees Celsius]; -32768 where it is not measured."""


Packet = Hello | Data | Status


def encode(packet: Packet) -> bytes:
    """A packet as bytes.

    Raises:
        PacketError: a number does not fit its field (`content`), or there are too many
            counts (`length`).
    """
    kind = {Hello: HELLO, Data: DATA, Status: STATUS}[type(packet)]
    try:
        body = encode_body(packet)
        header = HEADER.pack(
            VERSION, kind, packet.address, packet.scan, packet.device_time
        )
    except struct.error as error:
        shown = " ".join(repr(packet).split())
        raise PacketError(
            f"a number of {shown:.200} does not fit its field ({error}); allowed are "
            "the ranges of protocol version 1; wrap what counts upwards",
            "content",
        ) from error
    return header + body + CRC.pack(zlib.crc32(body, zlib.crc32(header)))


def encode_body(packet: Packet) -> bytes:
    """What stands between header and CRC."""
    if isinstance(packet, Hello):
        text = firmware_bytes(packet.firmware)
        fixed = HELLO_BODY.pack(
            packet.rows,
            packet.columns,
            packet.taxels,
            packet.rate,
            packet.serial_number,
            len(text),
        )
        return fixed + text
    if isinstance(packet, Data):
        counts = count_bytes(packet.counts)
        return DATA_BODY.pack(packet.first, len(packet.counts)) + counts
    return STATUS_BODY.pack(packet.skipped, packet.errors, packet.temperature)


def firmware_bytes(firmware: str) -> bytes:
    """Name and version of a program as at most 255 bytes."""
    try:
        text = firmware.encode()
    except UnicodeEncodeError as error:
        raise PacketError(
            f"firmware {firmware!r:.60} is no text ({error.reason}); allowed is what "
            "UTF-8 can write; leave out surrogates",
            "content",
        ) from error
    if len(text) > MOST_TEXT:
        raise PacketError(
            f"firmware {firmware!r:.60} has {len(text)} bytes of UTF-8; allowed are "
            f"{MOST_TEXT}; shorten it",
            "content",
        )
    return text


def count_bytes(counts: UInt16[np.ndarray, "count"]) -> bytes:
    """Counts as they travel; those of another type are refused, never wrapped."""
    if counts.dtype.type is not np.uint16 or counts.ndim != 1:
        raise PacketError(
            f"counts are {counts.dtype} of shape {counts.shape}; allowed are uint16 "
            "of one dimension; clip them to 0 to 65535 and convert them",
            "content",
        )
    if len(counts) > MOST_COUNTS:
        raise PacketError(
            f"packet has {len(counts)} counts; allowed are {MOST_COUNTS}; send the "
            "scan in several packets",
            "length",
        )
    return counts.astype(COUNT).tobytes()


def decode(data: bytes | bytearray | memoryview) -> Packet:
    """The packet that is exactly these bytes; it keeps none of the caller's memory.

    Raises:
        PacketError: they are none; its `reason` is the first check that failed.
    """
    data = bytes(data)
    if not LEAST_BYTES <= len(data) <= MOST_BYTES:
        raise PacketError(
            f"packet has {len(data)} bytes; allowed are {LEAST_BYTES} to {MOST_BYTES}; "
            "check the framing",
            "length",
        )
    if zlib.crc32(data) != RESIDUE:
        raise PacketError(
            "CRC-32 of a packet is wrong; allowed is that of its bytes; check cable "
            "and baud rate",
            "crc",
        )
    version, kind, address, scan, device_time = HEADER.unpack_from(data)
    if version != VERSION:
        raise PacketError(
            f"packet has protocol version {version}; allowed is {VERSION}; use a "
            "newer eskin, or older firmware",
            "version",
        )
    common = address, scan, device_time
    if kind == DATA:
        return decode_data(common, data)
    if kind == HELLO:
        return decode_hello(common, data)
    if kind == STATUS:
        check_size("status", data, STATUS_BODY.size)
        return Status(*common, *STATUS_BODY.unpack_from(data, HEADER.size))
    raise PacketError(
        f"packet is of kind {kind}; allowed are {HELLO} (hello), {DATA} (data) and "
        f"{STATUS} (status); skip it",
        "kind",
    )


def decode_data(common: tuple[int, int, int], data: bytes) -> Data:
    """The data packet with that header; its counts cannot be written to."""
    check_least("data", data, DATA_BODY.size)
    first, count = DATA_BODY.unpack_from(data, HEADER.size)
    check_size("data", data, DATA_BODY.size + count * COUNT.itemsize)
    start = HEADER.size + DATA_BODY.size
    return Data(*common, first, np.frombuffer(data, COUNT, count, start))


def decode_hello(common: tuple[int, int, int], data: bytes) -> Hello:
    """The hello packet with that header."""
    check_least("hello", data, HELLO_BODY.size)
    *numbers, length = HELLO_BODY.unpack_from(data, HEADER.size)
    check_size("hello", data, HELLO_BODY.size + length)
    try:
        firmware = data[HEADER.size + HELLO_BODY.size : -CRC.size].decode()
    except UnicodeDecodeError as error:
        raise PacketError(
            f"firmware of a hello is no text ({error}); allowed is UTF-8; mend the "
            "device's program",
            "content",
        ) from error
    rows, columns, taxels, rate, serial_number = numbers
    return Hello(*common, rows, columns, taxels, rate, serial_number, firmware)


def check_least(kind: str, data: bytes, size: int) -> None:
    """Refuse a packet whose body is shorter than the fixed part of its kind."""
    if len(data) - LEAST_BYTES < size:
        raise wrong_size(kind, data, f"at least {size}")


def check_size(kind: str, data: bytes, size: int) -> None:
    """Refuse a packet whose body is not as long as it says."""
    if len(data) - LEAST_BYTES != size:
        raise wrong_size(kind, data, str(size))


def wrong_size(kind: str, data: bytes, allowed: str) -> PacketError:
    """The error of a packet whose body has another length than it should."""
    return PacketError(
        f"body of a {kind} packet has {len(data) - LEAST_BYTES} bytes; allowed are "
        f"{allowed}; mend the device's program",
        "content",
    )
