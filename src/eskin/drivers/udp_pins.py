"""Which network address each patch is believed to be at."""

from typing import final

from eskin.drivers.packet import HEADER, HELLO, decode
from eskin.errors import PacketError

RELEASE = 2_000_000_000
"""After how long unheard a patch may be at another network address [ns]."""


@final
class Pins:
    """Pins each patch address to the network address of its first valid hello.

    UDP says nothing about who sends; so nobody else is heard for a patch while the
    first goes on.
    """

    def __init__(self) -> None:
        """Start without any."""
        self.peers: dict[int, tuple[str, int]] = {}

    def admit(self, packet: bytes, peer: str, now: int) -> bool:
        """Whether a datagram comes from where its patch is, or may be that.

        Args:
            packet: its bytes.
            peer: network address that it came from.
            now: the time [ns].
        """
        if len(packet) < HEADER.size:
            return True
        _, kind, address, _, _ = HEADER.unpack_from(packet)
        pinned, heard = self.peers.get(address, ("", 0))
        if pinned == peer:
            self.peers[address] = (peer, now)
            return True
        if pinned and now - heard < RELEASE:
            return False
        if kind == HELLO and is_packet(packet):
            self.peers[address] = (peer, now)
        return True


def is_packet(data: bytes) -> bool:
    """Whether bytes are a packet of a known version."""
    try:
        decode(data)
    except PacketError:
        return False
    return True
