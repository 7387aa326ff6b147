"""This module receives packets over UDP, one packet a datagram."""

import ipaddress
import select
import socket
from contextlib import suppress
from typing import final

from eskin.drivers.clock import Clock
from eskin.drivers.events import Event, EventLog
from eskin.drivers.module_registry import NETWORK_PORT
from eskin.drivers.packet import HEADER, HELLO, MAX_PACKET_BYTES, decode_packet
from eskin.drivers.source import ReceivedPacket, Transport
from eskin.errors import DeviceError, PacketError
from eskin.units import NS_PER_S

PEER_TIMEOUT = 2 * NS_PER_S
"""Silence after which a patch may move to another network address [ns]."""
RECEIVE_BUFFER = 8 << 20
"""Requested size of the receive buffer [bytes]; the system may give less."""
MAX_DATAGRAMS = 2048
"""Largest number of datagrams of one read."""
MAX_PEERS = 4096
"""Largest number of cached names of network addresses."""


@final
class PeerAddressFilter:
    """Binds each patch address to the network address of its first valid hello.

    UDP does not authenticate senders, so no other sender is accepted for a patch while
    the first one continues.
    """

    def __init__(self) -> None:
        """Start without addresses."""
        self.peers: dict[int, tuple[str, int]] = {}

    def admit(self, packet: bytes, peer: str, now: int) -> bool:
        """Return whether a datagram of a network address is accepted at a time [ns]."""
        if len(packet) < HEADER.size:
            return True
        _, kind, address, _, _ = HEADER.unpack_from(packet)
        bound, last_seen = self.peers.get(address, ("", 0))
        if bound == peer:
            self.peers[address] = (peer, now)
            return True
        if bound and now - last_seen < PEER_TIMEOUT:
            return False
        if kind == HELLO:
            with suppress(PacketError):
                decode_packet(packet)
                self.peers[address] = (peer, now)
        return True


@final
class UdpTransport(Transport):
    """Receives packets on one UDP port, by default only from this computer."""

    def __init__(
        self,
        clock: Clock,
        host: str = "127.0.0.1",
        port: int = 0,
        allow_remote: bool = False,
        authenticated: bool = False,
    ) -> None:
        """Bind a port.

        Args:
            clock: clock that stamps arrivals.
            host: IP address of this computer to listen on.
            port: port number; 0 takes any free one.
            allow_remote: whether packets of other computers are accepted.
            authenticated: whether packets are accepted from any address, since a key
                tells who sends them.

        Raises:
            DeviceError: the port cannot be bound, or the address is not loopback.
        """
        self.socket = bind_udp(
            host, port, allow_remote or authenticated, RECEIVE_BUFFER
        )
        self.socket.setblocking(False)
        self.port: int = self.socket.getsockname()[1]
        self.clock = clock
        self.log = EventLog()
        self.peer_filter = None if authenticated else PeerAddressFilter()
        self.names: dict[tuple[str, int], str] = {}
        self.datagrams = self.bytes = self.refused = 0
        self.closed = False

    def read(self, timeout: float) -> list[ReceivedPacket]:
        """Return all datagrams that have arrived, up to 2,048."""
        packets = []
        if self.closed:
            return packets
        select.select([self.socket], [], [], max(0.0, timeout))
        for _ in range(MAX_DATAGRAMS):
            try:
                packet, address = self.socket.recvfrom(MAX_PACKET_BYTES + 1)
            except BlockingIOError:
                break
            arrived = self.clock.now()
            self.datagrams += 1
            self.bytes += len(packet)
            peer = self.peer_name(address)
            allowed = self.peer_filter
            if allowed is None or allowed.admit(packet, peer, arrived):
                packets.append(ReceivedPacket(peer, arrived, packet))
            else:
                self.refused += 1
                self.log.count(
                    "conflict",
                    "packet",
                    "came from another network address than the patch's first hello "
                    "and did not count; stop that sender, or wait until the first is "
                    "silent",
                )
        return packets

    def send(self, port: str, packet: bytes) -> None:
        """Send a request to a network address, `udp://HOST:PORT`."""
        host, _, number = port.removeprefix(NETWORK_PORT).rpartition(":")
        with suppress(OSError):
            self.socket.sendto(packet, (host, int(number)))

    def peer_name(self, address: tuple[str, int]) -> str:
        """Return a network address as messages name it."""
        key = address[:2]
        name = self.names.get(key)
        if name is None:
            if len(self.names) >= MAX_PEERS:
                self.names.clear()
            name = self.names[key] = f"{NETWORK_PORT}{key[0]}:{key[1]}"
        return name

    def take_events(self, now: int) -> list[Event]:
        """Return events of refused packets."""
        self.log.flush_counts(now)
        return self.log.take()

    def counters(self) -> dict[str, int]:
        """Return datagrams, their bytes, and datagrams refused for their sender."""
        counts = {"datagrams": self.datagrams, "bytes": self.bytes}
        return {**counts, "refused": self.refused}

    def close(self) -> None:
        """Close the socket."""
        self.closed = True
        self.socket.close()


def bind_udp(
    host: str, port: int, allow_remote: bool, buffer: int | None = None
) -> socket.socket:
    """Bind a UDP port.

    Args:
        host: IP address of this computer.
        port: port number; 0 takes any free one.
        allow_remote: whether the address may be one that others can send to.
        buffer: size of the receive buffer that is asked for [bytes].

    Raises:
        DeviceError: the port cannot be bound, or the address is not allowed.
    """
    check_udp_host(host, allow_remote)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_DGRAM)
    try:
        if buffer is not None:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        bound.bind((host, port))
    except (OSError, OverflowError) as error:
        bound.close()
        raise DeviceError(
            f"cannot listen on UDP {host} port {port} ({error}); allowed is a free "
            "port of an address of this computer"
        ) from error
    return bound


def check_udp_host(host: str, allow_remote: bool) -> None:
    """Refuse a host that is no IP address, or not loopback unless allowed."""
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError as error:
        raise DeviceError(
            f"UDP host is '{host}'; allowed is an IP address of this computer; use "
            "127.0.0.1"
        ) from error
    if not loopback and not allow_remote:
        raise DeviceError(
            f"UDP host is {host}, which others can send to, and UDP does not "
            "authenticate senders; allowed is loopback, 127.0.0.1; use a key, or allow "
            "remote senders if the network is trusted"
        )
