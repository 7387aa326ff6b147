"""Fuzz the decoder of packets and frames."""

import json
import random
import struct
import zlib
from pathlib import Path
from typing import final

from eskin.drivers import decode_packet, encode_packet
from eskin.drivers.packet import (
    CRC,
    MAX_FRAME_BYTES,
    SEAL,
    Deframer,
    encode_frame,
    read_kind,
)
from eskin.drivers.sessions import is_sealed
from eskin.errors import PacketError
from lab.fuzz.mutation import mutate
from lab.fuzz.run import Target, check_refusal

DATA = Path(__file__).parents[2] / "tests/data"
VECTORS = (DATA / "protocol_v1.json", DATA / "protocol_v2.json")
PACKET = 0
SEALED = 1
STREAM = 2
"""Modes of an input, by its first byte modulo 3: the rest is a packet; a packet without
its CRC, which is added so that later checks are reached; or data of a serial line."""
REASONS = {"length", "crc", "version", "kind", "content"}


@final
class DecoderTarget(Target):
    """Fuzzes the packet decoder and the deframer."""

    def __init__(self, folder: Path) -> None:
        """Start from the test vectors; the folder is not needed."""
        self.packets = [
            bytes.fromhex(vector["packet"])
            for path in VECTORS
            for vector in json.loads(path.read_text("utf-8"))["vectors"]
        ]

    def make(self, rng: random.Random) -> bytes:
        """Return a mode and its mutated bytes."""
        mode = rng.choice((PACKET, SEALED, SEALED, STREAM))
        packet = rng.choice(self.packets)
        if mode == PACKET:
            content = mutate(packet, rng)
        elif mode == SEALED:
            content = mutate(packet[:-4], rng)
        else:
            few = [rng.choice(self.packets) for _ in range(rng.randint(1, 4))]
            content = mutate(b"".join(map(encode_frame, few)), rng)
        return bytes([mode]) + content

    def feed(self, data: bytes) -> bool:
        """Decode the input; an accepted packet must be encoded to the same bytes."""
        mode = data[0] % 3 if data else PACKET
        content = data[1:]
        if mode == PACKET:
            return accepts(content)
        if mode == SEALED:
            return accepts(content + struct.pack("<I", zlib.crc32(content)))
        return any([accepts(packet) for packet in found(content)])


def accepts(data: bytes) -> bool:
    """Return whether bytes are a packet, which must be encoded to the same bytes."""
    try:
        packet = decode_packet(data)
    except PacketError as error:
        check_refusal(error)
        if error.reason not in REASONS:
            raise AssertionError(f"reason {error.reason!r}") from error
        return False
    if encode_packet(packet, data[0])[:-4] != remove_seal(data)[:-4]:
        raise AssertionError(f"{packet} is encoded to other bytes")
    return True


def remove_seal(data: bytes) -> bytes:
    """Return a packet without its seal, if it has one; the CRC is not corrected."""
    if not is_sealed(data):
        return data
    start = bytes((data[0], read_kind(data))) + data[2 : -SEAL.size - CRC.size]
    return start + data[-CRC.size :]


def found(stream: bytes) -> list[bytes]:
    """Return the packets of a stream, which must not depend on its division."""
    whole = Deframer()
    parts = Deframer()
    packets = whole.push_chunk(stream)
    size = 1 + len(stream) % 97
    pieces = []
    for start in range(0, len(stream), size):
        pieces += parts.push_chunk(stream[start : start + size])
        if len(parts.open) > MAX_FRAME_BYTES:
            raise AssertionError(f"{len(parts.open)} bytes are held")
    counters = [(x.bytes, x.frames, x.broken) for x in (whole, parts)]
    if pieces != packets or counters[0] != counters[1]:
        raise AssertionError(f"pieces of {size} bytes give other packets: {counters}")
    return packets
