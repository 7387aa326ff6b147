"""This module encodes and decodes the packets of device protocol version 1.

All numbers are little-endian. Every packet is a header, the body of its kind, and a
CRC-32 of all bytes before it; `docs/protocol.md` has the tables.
"""

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt16

from eskin.errors import PacketError

VERSION = 1
HELLO, DATA, STATUS = 1, 2, 3
MAX_PACKET_BYTES = 1400
"""Largest packet: with UDP and IP headers it still fits every Ethernet frame."""

HEADER = struct.Struct("<BBHHI")
HELLO_BODY = struct.Struct("<HHHHQB")
DATA_BODY = struct.Struct("<HH")
STATUS_BODY = struct.Struct("<IIh")
CRC = struct.Struct("<I")
CRC_RESIDUE = 0x2144DF1C
"""CRC-32 of any bytes that are followed by their own CRC-32."""
MIN_PACKET_BYTES = HEADER.size + CRC.size
MAX_FIRMWARE_BYTES = 255
MAX_COUNTS = (MAX_PACKET_BYTES - HEADER.size - DATA_BODY.size - CRC.size) // 2
COUNT_TYPE = np.dtype("<u2")
MAX_COUNT = 2**16 - 1
"""Largest count that a packet can hold."""
MAX_ADDRESS = 2**16 - 1
SCAN_NUMBER_SPAN = 1 << 16
"""Number of scan numbers before they wrap."""
DEVICE_TIME_SPAN = 1 << 32
"""Period after which device time wraps [us]."""


@dataclass(frozen=True)
class Hello:
    """A packet that describes a patch, sent at power-up and once a second."""

    address: int
    """Address of the patch on its bus, 0 to 65535."""
    scan: int
    """Number of the latest scan, modulo 65536."""
    device_time: int
    """Time of the patch's own clock [us], modulo 2**32."""
    rows: int
    """Rows of the electrode grid."""
    columns: int
    """Columns of the electrode grid."""
    taxels: int
    """Number of grid cells that hold a taxel."""
    rate: int
    """Nominal scan rate [1/s]; 0 where it is not specified."""
    serial_number: int
    """Unique number of the module, 64 bits."""
    firmware: str
    """Name and version of the firmware, at most 255 bytes of UTF-8."""


@dataclass(frozen=True, eq=False)
class Data:
    """A packet that holds counts of some taxels of one scan."""

    address: int
    """Address of the patch on its bus, 0 to 65535."""
    scan: int
    """Number of the scan, modulo 65536; all packets of a scan share it."""
    device_time: int
    """Start of the scan by the patch's own clock [us], modulo 2**32."""
    first: int
    """Index of the first count among the taxels of the patch."""
    counts: UInt16[np.ndarray, "count"]
    """Counts of the converter in the order of the patch's taxels; read-only where the
    packet was decoded."""


@dataclass(frozen=True)
class Status:
    """A packet that reports the health of a patch, once a second or on an error."""

    address: int
    """Address of the patch on its bus, 0 to 65535."""
    scan: int
    """Number of the latest scan, modulo 65536."""
    device_time: int
    """Time of the patch's own clock [us], modulo 2**32."""
    skipped: int
    """Scans that the patch had no time to make or send since power-up."""
    errors: int
    """Errors of the electronics since power-up."""
    temperature: int
    """Temperature of the module [0.01 degrees Celsius]; -32768 if not measured."""


Packet = Hello | Data | Status


def encode_packet(packet: Packet) -> bytes:
    """Return a packet as bytes.

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
            "the ranges of protocol version 1; let counters wrap",
            "content",
        ) from error
    return header + body + CRC.pack(zlib.crc32(body, zlib.crc32(header)))


def encode_body(packet: Packet) -> bytes:
    """Return the bytes between header and CRC."""
    if isinstance(packet, Hello):
        text = encode_firmware(packet.firmware)
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
        counts = encode_counts(packet.counts)
        return DATA_BODY.pack(packet.first, len(packet.counts)) + counts
    return STATUS_BODY.pack(packet.skipped, packet.errors, packet.temperature)


def encode_firmware(firmware: str) -> bytes:
    """Return name and version of the firmware as at most 255 bytes."""
    try:
        text = firmware.encode()
    except UnicodeEncodeError as error:
        raise PacketError(
            f"firmware {firmware!r:.60} is no text ({error.reason}); allowed is what "
            "UTF-8 can encode; leave out surrogates",
            "content",
        ) from error
    if len(text) > MAX_FIRMWARE_BYTES:
        raise PacketError(
            f"firmware {firmware!r:.60} has {len(text)} bytes of UTF-8; allowed are "
            f"{MAX_FIRMWARE_BYTES}; shorten it",
            "content",
        )
    return text


def encode_counts(counts: UInt16[np.ndarray, "count"]) -> bytes:
    """Return counts as bytes; other types are refused, since they would wrap."""
    if counts.dtype.type is not np.uint16 or counts.ndim != 1:
        raise PacketError(
            f"counts are {counts.dtype} of shape {counts.shape}; allowed are uint16 "
            "of one dimension; clip them to 0 to 65535 and convert them",
            "content",
        )
    if len(counts) > MAX_COUNTS:
        raise PacketError(
            f"packet has {len(counts)} counts; allowed are {MAX_COUNTS}; send the "
            "scan in several packets",
            "length",
        )
    return counts.astype(COUNT_TYPE).tobytes()


def decode_packet(data: bytes | bytearray | memoryview) -> Packet:
    """Return the packet that consists of exactly these bytes, which are copied.

    Raises:
        PacketError: they are no packet; `reason` is the first check that failed.
    """
    data = bytes(data)
    if not MIN_PACKET_BYTES <= len(data) <= MAX_PACKET_BYTES:
        raise PacketError(
            f"packet has {len(data)} bytes; allowed are {MIN_PACKET_BYTES} to "
            f"{MAX_PACKET_BYTES}; check the framing",
            "length",
        )
    if zlib.crc32(data) != CRC_RESIDUE:
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
        check_body_size("status", data, STATUS_BODY.size)
        return Status(*common, *STATUS_BODY.unpack_from(data, HEADER.size))
    raise PacketError(
        f"packet is of kind {kind}; allowed are {HELLO} (hello), {DATA} (data) and "
        f"{STATUS} (status); skip it",
        "kind",
    )


def decode_data(common: tuple[int, int, int], data: bytes) -> Data:
    """Return the data packet with that header; its counts are read-only."""
    check_body_size("data", data, DATA_BODY.size, at_least=True)
    first, count = DATA_BODY.unpack_from(data, HEADER.size)
    check_body_size("data", data, DATA_BODY.size + count * COUNT_TYPE.itemsize)
    start = HEADER.size + DATA_BODY.size
    return Data(*common, first, np.frombuffer(data, COUNT_TYPE, count, start))


def decode_hello(common: tuple[int, int, int], data: bytes) -> Hello:
    """Return the hello packet with that header."""
    check_body_size("hello", data, HELLO_BODY.size, at_least=True)
    *numbers, length = HELLO_BODY.unpack_from(data, HEADER.size)
    check_body_size("hello", data, HELLO_BODY.size + length)
    try:
        firmware = data[HEADER.size + HELLO_BODY.size : -CRC.size].decode()
    except UnicodeDecodeError as error:
        raise PacketError(
            f"firmware of a hello is no text ({error}); allowed is UTF-8; correct the "
            "device's firmware",
            "content",
        ) from error
    rows, columns, taxels, rate, serial_number = numbers
    return Hello(*common, rows, columns, taxels, rate, serial_number, firmware)


def check_body_size(kind: str, data: bytes, size: int, at_least: bool = False) -> None:
    """Refuse a packet whose body does not have the size that its fields require."""
    got = len(data) - MIN_PACKET_BYTES
    if got < size or (got > size and not at_least):
        allowed = f"at least {size}" if at_least else f"{size}"
        raise PacketError(
            f"body of a {kind} packet has {got} bytes; allowed are {allowed}; correct "
            "the device's firmware",
            "content",
        )
