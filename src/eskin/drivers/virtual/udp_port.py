"""A network socket that virtual patches send from."""

import socket
from typing import final

from eskin.drivers.virtual.port import Port
from eskin.errors import DeviceError


@final
class UdpPort(Port):
    """Sends every packet as one datagram to one address."""

    framed = False

    def __init__(self, host: str, port: int) -> None:
        """Open a socket of its own.

        Args:
            host: name or number of the listening computer.
            port: that it listens on.

        Raises:
            DeviceError: there is no such computer, or no way to it.
        """
        super().__init__()
        self.host, self.port = host, port
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
            family, kind, protocol, _, address = found[0]
            self.socket = socket.socket(family, kind, protocol)
        except (OSError, OverflowError) as error:
            raise DeviceError(
                f"cannot send to {host}:{port} ({error}); allowed are a computer that "
                "is known and a port from 1 to 65535; check both"
            ) from error
        try:
            self.socket.connect(address)
        except OSError as error:
            self.socket.close()
            raise DeviceError(
                f"cannot send to {host}:{port} ({error}); check the network"
            ) from error
        self.is_plugged = True

    @property
    def uri(self) -> str:
        """`udp://` and where it sends to."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"udp://{host}:{self.port}"

    def send(self, chunks: list[bytes]) -> None:
        """Send datagrams; those that nobody listens for are lost."""
        for chunk in chunks:
            try:
                if self.is_plugged:
                    self.bytes += self.socket.send(chunk)
                else:
                    self.unheard += 1
            except OSError:
                self.unheard += 1

    def flush(self) -> None:
        """Nothing to wait for: a datagram that was sent is away."""

    def unplug(self) -> None:
        """Send nothing any more."""
        self.is_plugged = False

    def plug(self) -> None:
        """Send again, from the same address."""
        self.is_plugged = True

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()
