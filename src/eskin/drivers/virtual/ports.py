"""This module defines the ports that virtual patches are plugged into."""

import os
import select
import socket
import time
import tty
from abc import abstractmethod
from pathlib import Path
from typing import final

from eskin.closing import Closing
from eskin.errors import DeviceError


class Port(Closing):
    """Takes what patches say to whoever listens.

    Attributes:
        framed: whether packets need framing on it, as on a serial line.
        unheard: packets that nobody was there for, or had no room for.
        bytes: how many were sent.
    """

    framed: bool

    def __init__(self) -> None:
        """Start counting."""
        self.unheard = 0
        self.bytes = 0

    @property
    @abstractmethod
    def uri(self) -> str:
        """What a listener opens it by."""

    @abstractmethod
    def send(self, chunks: list[bytes]) -> None:
        """Send packets, framed where the port wants that; each whole or not at all."""

    @abstractmethod
    def flush(self) -> None:
        """Wait until what was sent has been taken, if somebody takes it."""

    @abstractmethod
    def unplug(self) -> None:
        """Vanish, as the port of a module without power does."""

    @abstractmethod
    def plug(self) -> None:
        """Be there again."""


PATIENCE = 1.0
"""How long a listener may leave the line full before packets are lost [s]."""
PAUSE = 0.005
"""Between two looks at whether all has been read [s]."""


@final
class PtyPort(Port):
    """A real serial port to whoever opens its path, in raw mode."""

    framed = True

    def __init__(self, link: Path | None = None, patience: float = PATIENCE) -> None:
        """Open a pseudo-terminal.

        Args:
            link: a stable name for it, as a symbolic link that goes when it is closed.
            patience: how long a listener may leave the line full before packets are
                lost [s].

        Raises:
            DeviceError: something else has that name, or there is no terminal left.
        """
        super().__init__()
        self.link = link
        self.patience = patience
        self.master: int | None = None
        if link is not None and link.exists():
            raise DeviceError(
                f"cannot link a port to {link}: it is there already; give a name that "
                "is free, or remove it"
            )
        self.plug()

    @property
    def uri(self) -> str:
        """`serial:` and its path."""
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
            self.relink()
        except OSError as error:
            self.close()
            raise DeviceError(
                f"cannot open a pseudo-terminal ({error}); give a link in a folder "
                "that can be written to, or close other terminals"
            ) from error
        self.room = select.poll()
        self.room.register(self.master, select.POLLOUT)
        self.rest = b""

    def relink(self) -> None:
        """Let the name stand for the terminal that there is now."""
        if self.link is not None:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(self.path)

    def unplug(self) -> None:
        """Close the terminal: whoever reads it is told that the device has gone."""
        if self.master is not None:
            os.close(self.master)
            self.master = None
            if self.link is not None:
                self.link.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the terminal and remove its name."""
        self.unplug()

    def send(self, chunks: list[bytes]) -> None:
        """Write packets as fast as they are read; without a listener they are lost."""
        if not self.is_heard():
            self.rest = b""
            self.unheard += len(chunks)
            return
        data = memoryview(self.rest + b"".join(chunks))
        done = self.write(data)
        self.bytes += done
        whole = len(self.rest)
        self.rest = bytes(data[done:whole])
        for chunk in chunks:
            # What has begun must be finished, or the next packet is broken as well.
            if whole < done < whole + len(chunk):
                self.rest = chunk[done - whole :]
            elif done <= whole:
                self.unheard += 1
            whole += len(chunk)

    def flush(self) -> None:
        """Wait until all is read, or nobody reads: closing throws the rest away."""
        until = time.monotonic() + self.patience
        while self.is_heard() and self.is_unread() and time.monotonic() < until:
            time.sleep(PAUSE)

    def is_unread(self) -> bool:
        """Whether the listener has yet to read something."""
        slave = os.open(self.path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            # Other than FIONREAD, a poll also sees what is still on its way.
            return bool(select.select([slave], [], [], 0)[0])
        finally:
            os.close(slave)

    def write(self, data: memoryview) -> int:
        """Write as much as is taken in time; return how much [byte]."""
        done = 0
        while done < len(data) and self.master is not None:
            try:
                done += os.write(self.master, data[done:])
            except BlockingIOError:
                if not self.room.poll(self.patience * 1000) or not self.is_heard():
                    break
            except OSError:
                break
        return done

    def is_heard(self) -> bool:
        """Whether anybody has opened it."""
        if self.master is None:
            return False
        return not any(state & select.POLLHUP for _, state in self.room.poll(0))


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
