"""This module receives packets over UDP, one packet a datagram."""

import ipaddress
import select
import socket
from typing import final

from eskin.drivers.clock import Clock
from eskin.drivers.events import Event, EventLog
from eskin.drivers.packet import HEADER, HELLO, MAX_PACKET_BYTES, decode_packet
from eskin.drivers.transport import ReceivedPacket, Transport
from eskin.errors import DeviceError, PacketError

PEER_TIMEOUT = 2_000_000_000
"""After how long unheard a patch may be at another network address [ns]."""


@final
class PeerAddressFilter:
    """PeerAddressFilter each patch address to the network address of its first valid hello.

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
        if pinned and now - heard < PEER_TIMEOUT:
            return False
        if kind == HELLO and is_packet(packet):
            self.peers[address] = (peer, now)
        return True


def is_packet(data: bytes) -> bool:
    """Whether bytes are a packet of a known version."""
    try:
        decode_packet(data)
    except PacketError:
        return False
    return True


BUFFER = 8 << 20
"""What the system is asked to keep while nobody reads [bytes]; it may give less."""
MOST_DATAGRAMS = 2048
"""Of one read."""
MOST_PEERS = 4096
"""Names of network addresses that are kept ready."""


@final
class UdpTransport(Transport):
    """Hears patches on one UDP port, of this computer only unless told otherwise.

    Attributes:
        port: that it is bound to.
    """

    def __init__(
        self,
        clock: Clock,
        host: str = "127.0.0.1",
        port: int = 0,
        allow_remote: bool = False,
    ) -> None:
        """Bind a port.

        Args:
            clock: that stamps arrivals.
            host: IP address of this computer to listen on.
            port: number; any free one where 0.
            allow_remote: whether others than this computer may be heard.

        Raises:
            DeviceError: the address is not loopback, is none of this computer, or the
                port is taken.
        """
        check_udp_host(host, allow_remote)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            self.socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self.socket.close()
            raise DeviceError(
                f"cannot listen on UDP {host} port {port} ({error}); allowed is a free "
                "port of an address of this computer; choose another"
            ) from error
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]
        self.clock = clock
        self.log = EventLog()
        self.pins = PeerAddressFilter()
        self.names: dict[tuple[str, int], str] = {}
        self.datagrams = self.bytes = self.refused = 0
        self.closed = False

    def read(self, timeout: float) -> list[ReceivedPacket]:
        """All datagrams that have come, up to 2,048."""
        deliveries = []
        if self.closed:
            return deliveries
        select.select([self.socket], [], [], max(0.0, timeout))
        for _ in range(MOST_DATAGRAMS):
            try:
                packet, address = self.socket.recvfrom(MAX_PACKET_BYTES + 1)
            except BlockingIOError:
                break
            arrived = self.clock.now()
            self.datagrams += 1
            self.bytes += len(packet)
            peer = self.name(address)
            if self.pins.admit(packet, peer, arrived):
                deliveries.append(ReceivedPacket(peer, arrived, packet))
            else:
                self.refused += 1
                self.log.count(
                    "conflict",
                    "packets were refused that came from another network address than "
                    "their patch's first hello; stop that sender, or wait until the "
                    "first is silent",
                )
        return deliveries

    def name(self, address: tuple[str, int]) -> str:
        """A network address as people read it."""
        key = address[:2]
        name = self.names.get(key)
        if name is None:
            if len(self.names) >= MOST_PEERS:
                self.names.clear()
            name = self.names[key] = f"udp://{key[0]}:{key[1]}"
        return name

    def take_events(self, now: int) -> list[Event]:
        """That others were refused."""
        self.log.poll(now)
        return self.log.take()

    def counters(self) -> dict[str, int]:
        """Datagrams, their bytes, and those refused for where they came from."""
        return {
            "datagrams": self.datagrams,
            "bytes": self.bytes,
            "refused": self.refused,
        }

    def close(self) -> None:
        """Free the port."""
        self.closed = True
        self.socket.close()


def check_udp_host(host: str, allow_remote: bool) -> None:
    """Refuse what is no IP address, or not loopback unless allowed."""
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError as error:
        raise DeviceError(
            f"UDP host is '{host}'; allowed is an IP address of this computer; use "
            "127.0.0.1"
        ) from error
    if not loopback and not allow_remote:
        raise DeviceError(
            f"UDP host is {host}, which others can send to, and UDP does not tell who "
            "sends; allowed is loopback, 127.0.0.1; allow remote senders if the "
            "network is trusted"
        )
