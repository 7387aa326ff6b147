"""This module defines the ports that virtual patches are plugged into."""

import os
import select
import socket
import time
import tty
from abc import abstractmethod
from pathlib import Path
from typing import final

from eskin.drivers.packet import Deframer
from eskin.errors import DeviceError
from eskin.progress import Closing

MAX_RECEIVED_BYTES = 4096
"""Largest number of bytes that are received at once."""
MAX_DATAGRAMS = 64
"""Largest number of datagrams that are received at once."""
FLUSH_INTERVAL = 0.005
"""Time between two checks whether all has been read [s]."""


class VirtualPort(Closing):
    """Carries packets of virtual patches to a receiver.

    Attributes:
        framed: whether packets need framing on it, as on a serial line.
        undelivered: number of packets without a receiver, or without room.
        bytes: number of bytes sent.
    """

    framed: bool

    def __init__(self) -> None:
        """Start the counters at zero."""
        self.undelivered = 0
        self.bytes = 0

    @property
    @abstractmethod
    def uri(self) -> str:
        """Return the URI by which a receiver opens it."""

    @abstractmethod
    def send(self, chunks: list[bytes]) -> None:
        """Send packets, framed if `framed`; each is sent as a whole or not at all."""

    @abstractmethod
    def receive(self) -> list[bytes]:
        """Return the packets that the receiver has sent, without waiting."""

    @abstractmethod
    def flush(self) -> None:
        """Wait until the receiver, if there is one, has read everything."""

    @abstractmethod
    def unplug(self) -> None:
        """Disappear, like the port of a module without power."""

    @abstractmethod
    def plug(self) -> None:
        """Appear again."""


@final
class PtyPort(VirtualPort):
    """Provides one end of a pseudo-terminal, whose path opens like a serial port."""

    framed = True

    def __init__(self, link: Path | None = None, timeout: float = 1.0) -> None:
        """Open a pseudo-terminal.

        Args:
            link: stable name, as a symbolic link that is removed when it is closed.
            timeout: time for which the line may stay full before packets are lost [s].

        Raises:
            DeviceError: the name is taken, or there is no terminal left.
        """
        super().__init__()
        self.link = link
        self.timeout = timeout
        self.master: int | None = None
        if link is not None and link.exists():
            raise DeviceError(
                f"cannot link a port to {link}: it is there already; give a name that "
                "is free, or remove it"
            )
        self.plug()

    @property
    def uri(self) -> str:
        """Return the URI `serial:PATH`."""
        return f"serial:{self.link or self.path}"

    def plug(self) -> None:
        """Open a new terminal, under the same name where it has one."""
        if self.master is not None:
            return
        try:
            self.master, slave = os.openpty()
            self.path = os.ttyname(slave)
            tty.setraw(slave)
            os.close(slave)
            os.set_blocking(self.master, False)
            if self.link is not None:
                self.link.unlink(missing_ok=True)
                self.link.symlink_to(self.path)
        except OSError as error:
            self.close()
            raise DeviceError(
                f"cannot open a pseudo-terminal ({error}); give a link in a folder "
                "that can be written to, or close other terminals"
            ) from error
        self.deframer = Deframer()
        self.writable = select.poll()
        self.writable.register(self.master, select.POLLOUT)
        self.unsent = b""

    def unplug(self) -> None:
        """Close the terminal; its reader gets an error, as from a lost device."""
        if self.master is not None:
            os.close(self.master)
            self.master = None
            if self.link is not None:
                self.link.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the terminal and remove its name."""
        self.unplug()

    def send(self, chunks: list[bytes]) -> None:
        """Write packets as fast as they are read; without a receiver they are lost."""
        if not self.has_receiver():
            self.unsent = b""
            self.undelivered += len(chunks)
            return
        data = memoryview(self.unsent + b"".join(chunks))
        done = self.write(data)
        self.bytes += done
        whole = len(self.unsent)
        self.unsent = bytes(data[done:whole])
        for chunk in chunks:
            # A packet that is sent in part must be completed, or the next breaks too.
            if whole < done < whole + len(chunk):
                self.unsent = chunk[done - whole :]
            elif done <= whole:
                self.undelivered += 1
            whole += len(chunk)

    def flush(self) -> None:
        """Wait until all is read or the receiver is gone; closing discards the rest."""
        until = time.monotonic() + self.timeout
        while self.has_receiver() and self.has_unread() and time.monotonic() < until:
            time.sleep(FLUSH_INTERVAL)

    def receive(self) -> list[bytes]:
        """Return the packets that the receiver has written."""
        if self.master is None:
            return []
        try:
            return self.deframer.push_chunk(os.read(self.master, MAX_RECEIVED_BYTES))
        except OSError:
            return []

    def has_unread(self) -> bool:
        """Return whether the receiver has not yet read everything."""
        slave = os.open(self.path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            # Unlike FIONREAD, select also reports bytes that are still on their way.
            return bool(select.select([slave], [], [], 0)[0])
        finally:
            os.close(slave)

    def write(self, data: memoryview) -> int:
        """Write as much as is read in time; return the number of bytes written."""
        done = 0
        while done < len(data) and self.master is not None:
            try:
                done += os.write(self.master, data[done:])
            except BlockingIOError:
                ready = self.writable.poll(self.timeout * 1000)
                if not ready or not self.has_receiver():
                    break
            except OSError:
                break
        return done

    def has_receiver(self) -> bool:
        """Return whether a receiver has opened it."""
        if self.master is None:
            return False
        return not any(state & select.POLLHUP for _, state in self.writable.poll(0))


@final
class UdpPort(VirtualPort):
    """Sends every packet as one datagram to one address."""

    framed = False

    def __init__(self, host: str, port: int) -> None:
        """Open a socket to a port of a host, given by name or IP address.

        Raises:
            DeviceError: the host is unknown or cannot be reached.
        """
        super().__init__()
        self.host = host
        self.port = port
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
            family, kind, protocol, _, address = found[0]
            self.socket = socket.socket(family, kind, protocol)
        except (OSError, OverflowError) as error:
            raise DeviceError(
                f"cannot send to {host}:{port} ({error}); allowed are a computer that "
                "is known and a port from 1 to 65535"
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
        """Return the URI `udp://HOST:PORT` of the receiver."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"udp://{host}:{self.port}"

    def send(self, chunks: list[bytes]) -> None:
        """Send datagrams; those without a receiver are lost."""
        for chunk in chunks:
            try:
                if self.is_plugged:
                    self.bytes += self.socket.send(chunk)
                else:
                    self.undelivered += 1
            except OSError:
                self.undelivered += 1

    def receive(self) -> list[bytes]:
        """Return the datagrams of the receiver; others do not reach the socket."""
        packets = []
        while len(packets) < MAX_DATAGRAMS:
            try:
                packet = self.socket.recv(MAX_RECEIVED_BYTES, socket.MSG_DONTWAIT)
            except OSError:
                break
            packets += [packet] if self.is_plugged else []
        return packets

    def flush(self) -> None:
        """Return at once: datagrams are not buffered."""

    def unplug(self) -> None:
        """Stop sending."""
        self.is_plugged = False

    def plug(self) -> None:
        """Send again, from the same address."""
        self.is_plugged = True

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()
