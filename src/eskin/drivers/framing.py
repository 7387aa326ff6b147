"""This module encodes packets as frames on a serial line, and decodes them.

A frame is a packet in COBS (Cheshire and Baker 1999), then one zero byte. A zero occurs
only between frames, so a receiver that starts anywhere, or receives garbage, is
synchronised again at the next zero.
"""

from abc import ABC, abstractmethod
from typing import final

from cobs import cobs

from eskin.drivers.packet import MAX_PACKET_BYTES

END = b"\0"
COBS_BLOCK = 254
"""Number of nonzero bytes for which COBS adds one byte."""
MAX_FRAME_BYTES = MAX_PACKET_BYTES + -(-MAX_PACKET_BYTES // COBS_BLOCK)
"""Size of the longest frame, without its zero."""


def encode_frame(packet: bytes) -> bytes:
    """Return a packet as a frame, with the zero that ends it."""
    return cobs.encode(packet) + END


class Framing(ABC):
    """Finds what is sent as a whole in the bytes of a line.

    Attributes:
        bytes: number of bytes pushed so far.
        frames: number of valid frames so far.
        broken: number of frames that were not valid, or too long.
    """

    def __init__(self) -> None:
        """Start with an empty frame."""
        self.bytes = self.frames = self.broken = 0
        self.reset()

    @abstractmethod
    def reset(self) -> None:
        """Discard the open frame; the counters go on."""

    @abstractmethod
    def push(self, chunk: bytes) -> list[bytes]:
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

    def push(self, chunk: bytes) -> list[bytes]:
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
        if self.skipping or not part:
            return
        if len(self.open) + len(part) > MAX_FRAME_BYTES:
            self.broken += 1
            self.skipping = True
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
        return [packet]
