"""Packets on a serial line: COBS (Cheshire and Baker 1999), then one zero byte.

A zero stands nowhere but between frames, so a receiver that starts anywhere, or hears
garbage, is in step again at the next zero.
"""

from typing import final

from cobs import cobs

from eskin.drivers.packet import MAX_PACKET_BYTES

END = b"\0"
RUN = 254
"""Bytes that COBS adds one byte for, where none of them is zero."""
MAX_FRAME_BYTES = MAX_PACKET_BYTES + -(-MAX_PACKET_BYTES // RUN)
"""Bytes of the longest frame, without its zero."""


def encode_frame(packet: bytes) -> bytes:
    """The packet as it goes on the line, with the zero that ends it."""
    return cobs.encode(packet) + END


@final
class Deframer:
    """Finds the packets in what a line gives, however it is cut into chunks.

    Garbage costs at most the frame that it touches. No more is held than one frame.

    Attributes:
        bytes: pushed so far.
        frames: whole ones found so far.
        broken: frames that were not COBS, or too long. Nothing between two zeros is no
            frame.
    """

    def __init__(self) -> None:
        """Start between two frames."""
        self.bytes = 0
        self.frames = 0
        self.broken = 0
        self.open = bytearray()
        self.skipping = False

    def push(self, chunk: bytes) -> list[bytes]:
        """Packets that end in this chunk; their CRC is not yet checked."""
        self.bytes += len(chunk)
        *ends, start = chunk.split(END)
        packets = []
        for part in ends:
            self.hold(part)
            if self.open:
                packets += self.packet()
            self.skipping = False
        self.hold(start)
        return packets

    def hold(self, part: bytes) -> None:
        """Add bytes to the open frame, or throw it away where it gets too long."""
        if self.skipping or not part:
            return
        if len(self.open) + len(part) > MAX_FRAME_BYTES:
            self.broken += 1
            self.skipping = True
            self.open.clear()
        else:
            self.open += part

    def packet(self) -> list[bytes]:
        """The packet of the open frame, which is closed; none where it is broken."""
        try:
            packet = cobs.decode(self.open)
        except cobs.DecodeError:
            self.broken += 1
            return []
        finally:
            self.open.clear()
        self.frames += 1
        return [packet]
