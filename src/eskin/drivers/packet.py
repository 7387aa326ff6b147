"""This module encodes and decodes packets and frames of the device protocol.

All numbers are little-endian. Every packet is a header, the body of its kind, and a
CRC-32 of all bytes before it. A packet of version 2 may have a seal before its CRC,
which `sessions` checks; `docs/protocol.md` has the tables.

On a serial line a packet is sent as a frame: the packet in COBS (Cheshire and Baker
1999), then one zero byte. A zero occurs only between frames, so a receiver that starts
anywhere, or receives garbage, is synchronised again at the next zero.
"""

import struct
import zlib
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from cobs import cobs
from jaxtyping import UInt16

from eskin.errors import PacketError

# Versions, and kinds of packets.
VERSION_1 = 1
VERSION_2 = 2
HELLO = 1
DATA = 2
STATUS = 3
REQUEST = 4
ECHO = 5
KINDS = {
    VERSION_1: (HELLO, DATA, STATUS),
    VERSION_2: (HELLO, DATA, STATUS, REQUEST, ECHO),
}
"""Kinds of packets of each version."""
SEALED = 0x80
"""Bit of the kind of a packet of version 2 that has a seal."""

# Layouts of the header, of the body of each kind, and of what ends a packet.
HEADER = struct.Struct("<BBHHI")
HELLO_BODY = struct.Struct("<HHHHQB")
DATA_BODY = struct.Struct("<HH")
STATUS_BODY = struct.Struct("<IIh")
REQUEST_BODY = struct.Struct("<I16s")
ECHO_BODY = struct.Struct("<I16sI")
SEAL = struct.Struct("<Q16s")
"""Session and counter in one number, and the tag."""
CRC = struct.Struct("<I")
CRC_RESIDUE = 0x2144DF1C
"""CRC-32 of any bytes that are followed by their own CRC-32."""
COUNT_TYPE = np.dtype("<u2")

# Sizes, and limits of what is in a packet.
MAX_PACKET_BYTES = 1400
"""Largest packet: with UDP and IP headers it still fits every Ethernet frame."""
MIN_PACKET_BYTES = HEADER.size + CRC.size
MAX_FIRMWARE_BYTES = 255
MAX_COUNTS = (MAX_PACKET_BYTES - HEADER.size - DATA_BODY.size - CRC.size) // 2
MAX_SEALED_COUNTS = MAX_COUNTS - SEAL.size // 2
"""Largest number of counts of a packet with a seal."""
CHALLENGE_BYTES = 16
"""Size of the challenge in a request."""
MAX_COUNT = 2**16 - 1
"""Largest count that a packet can hold."""
MAX_ADDRESS = 2**16 - 1

# Numbers that wrap.
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


@dataclass(frozen=True)
class Request:
    """A packet of version 2 that the host sends to a patch, which answers it."""

    address: int
    """Address of the patch on its bus, 0 to 65535."""
    number: int
    """Number of the request in its session; 0 opens the session."""
    challenge: bytes
    """Challenge of the session, 16 random bytes."""


@dataclass(frozen=True)
class Echo:
    """A packet of version 2 by which a patch answers a request."""

    address: int
    """Address of the patch on its bus, 0 to 65535."""
    scan: int
    """Number of the latest scan, modulo 65536."""
    device_time: int
    """Time of the patch's own clock when the request arrived [us], modulo 2**32."""
    number: int
    """Number of that request."""
    challenge: bytes
    """Challenge of that request: only who received it can know it."""
    held: int
    """Time from its arrival until the echo was sent, by the patch's own clock [us]."""


Packet = Hello | Data | Status | Request | Echo
KIND_OF: dict[type[Packet], int] = {
    Hello: HELLO,
    Data: DATA,
    Status: STATUS,
    Request: REQUEST,
    Echo: ECHO,
}
"""Kind of each class of packets, as its number in the header."""


def read_kind(packet: bytes) -> int:
    """Return the kind of a packet that `encode_packet` made, with or without seal."""
    return packet[1] & ~SEALED


def encode_packet(packet: Packet, version: int = VERSION_1) -> bytes:
    """Return a packet as bytes, without a seal.

    Raises:
        PacketError: a number does not fit its field, the version has no such packet
            (`content`), or there are too many counts (`length`).
    """
    kind = KIND_OF[type(packet)]
    if kind not in KINDS.get(version, ()):
        raise PacketError(
            f"packet is {type(packet).__name__} of version {version}; allowed are "
            "hello, data and status of version 1, and all kinds of version 2",
            "content",
        )
    is_request = isinstance(packet, Request)
    times = (0, 0) if is_request else (packet.scan, packet.device_time)
    try:
        body = encode_body(packet)
        header = HEADER.pack(version, kind, packet.address, *times)
    except struct.error as error:
        shown = " ".join(repr(packet).split())
        raise PacketError(
            f"a number of {shown:.200} does not fit its field ({error}); allowed are "
            f"the ranges of protocol version {version}; let counters wrap",
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
    if isinstance(packet, Request):
        return REQUEST_BODY.pack(packet.number, encode_challenge(packet.challenge))
    if isinstance(packet, Echo):
        challenge = encode_challenge(packet.challenge)
        return ECHO_BODY.pack(packet.number, challenge, packet.held)
    return STATUS_BODY.pack(packet.skipped, packet.errors, packet.temperature)


def encode_challenge(challenge: bytes) -> bytes:
    """Return a challenge; another length is refused, since it would be padded."""
    if len(challenge) != CHALLENGE_BYTES:
        raise PacketError(
            f"challenge has {len(challenge)} bytes; allowed are {CHALLENGE_BYTES}",
            "content",
        )
    return challenge


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
            f"{MAX_FIRMWARE_BYTES}",
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
    kinds = KINDS.get(version)
    if kinds is None:
        raise PacketError(
            f"packet has protocol version {version}; allowed are {VERSION_1} and "
            f"{VERSION_2}; use a newer eskin, or older firmware",
            "version",
        )
    end = len(data) - CRC.size
    if version == VERSION_2 and kind & SEALED:
        kind = kind ^ SEALED
        end = end - SEAL.size
    if kind not in kinds:
        raise PacketError(
            f"packet of version {version} is of kind {kind}; allowed are "
            f"{', '.join(map(str, kinds))}; skip it",
            "kind",
        )
    return decode_body(kind, (address, scan, device_time), data[: max(end, 0)])


def decode_body(kind: int, common: tuple[int, int, int], data: bytes) -> Packet:
    """Return the packet of a kind, whose header was read, without seal and CRC."""
    if kind == DATA:
        return decode_data(common, data)
    if kind == HELLO:
        return decode_hello(common, data)
    if kind == STATUS:
        check_body_size("status", data, STATUS_BODY.size)
        return Status(*common, *STATUS_BODY.unpack_from(data, HEADER.size))
    if kind == ECHO:
        check_body_size("echo", data, ECHO_BODY.size)
        return Echo(*common, *ECHO_BODY.unpack_from(data, HEADER.size))
    check_body_size("request", data, REQUEST_BODY.size)
    address, *times = common
    if any(times):
        raise PacketError(
            f"request has scan number and device time {times}; allowed is 0 for both",
            "content",
        )
    return Request(address, *REQUEST_BODY.unpack_from(data, HEADER.size))


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
        firmware = data[HEADER.size + HELLO_BODY.size :].decode()
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
    got = len(data) - HEADER.size
    if got < size or (got > size and not at_least):
        allowed = f"at least {size}" if at_least else f"{size}"
        raise PacketError(
            f"body of a {kind} packet has {got} bytes; allowed are {allowed}; correct "
            "the device's firmware",
            "content",
        )


END = b"\0"
COBS_BLOCK = 254
"""Number of nonzero bytes for which COBS adds one byte."""
MAX_FRAME_BYTES = MAX_PACKET_BYTES + -(-MAX_PACKET_BYTES // COBS_BLOCK)
"""Size of the longest frame, without its zero."""


def encode_frame(packet: bytes) -> bytes:
    """Return a packet as a frame, with the zero that ends it."""
    return cobs.encode(packet) + END


class Framing(ABC):
    """Finds whole frames in the bytes of a line.

    Attributes:
        bytes: number of bytes pushed so far.
        frames: number of valid frames so far.
        broken: number of frames that were not valid, or too long.
        is_text: whether bytes that were discarded since the last frame are lines of
            text.
    """

    is_text = False

    def __init__(self) -> None:
        """Start with an empty frame."""
        self.bytes = self.frames = self.broken = 0
        self.reset()

    @abstractmethod
    def reset(self) -> None:
        """Discard the open frame; the counters go on."""

    @abstractmethod
    def push_chunk(self, chunk: bytes) -> list[bytes]:
        """Return what ends in this chunk, without framing."""


@final
class Deframer(Framing):
    """Finds the packets in the bytes of a line, however they are cut into chunks.

    Garbage destroys at most the frame that it touches. At most one frame is buffered.
    Empty frames do not count as broken.
    """

    def reset(self) -> None:
        """Discard the open frame; the counters go on."""
        self.open = bytearray()
        self.skipping = False
        self.is_text = False

    def push_chunk(self, chunk: bytes) -> list[bytes]:
        """Return the packets that end in this chunk; their CRC is not yet checked."""
        self.bytes += len(chunk)
        *ends, start = chunk.split(END)
        packets = []
        for part in ends:
            self.append(part)
            if self.open:
                packets += self.close_frame()
            self.skipping = False
        self.append(start)
        return packets

    def append(self, part: bytes) -> None:
        """Append bytes to the open frame, or discard it where it gets too long."""
        if self.skipping:
            self.is_text = self.is_text or is_lines_of_text(part)
            return
        if not part:
            return
        if len(self.open) + len(part) > MAX_FRAME_BYTES:
            self.broken += 1
            self.skipping = True
            self.is_text = is_lines_of_text(self.open + part)
            self.open.clear()
        else:
            self.open += part

    def close_frame(self) -> list[bytes]:
        """Close the open frame; return its packet, or nothing where it is broken."""
        try:
            packet = cobs.decode(self.open)
        except cobs.DecodeError:
            self.broken += 1
            return []
        finally:
            self.open.clear()
        self.frames += 1
        self.is_text = False
        return [packet]


def is_lines_of_text(data: bytes | bytearray) -> bool:
    """Return whether bytes are lines that can be read, of ASCII."""
    text = bytes(data).decode("latin-1")
    is_readable = text.isascii() and "".join(text.split()).isprintable()
    return is_readable and "\n" in text
