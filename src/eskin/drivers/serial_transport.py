"""This module reads packets from serial ports, through unplugging and plugging back."""

import errno
import os
import select
import termios
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import serial
from serial.tools import list_ports

from eskin.drivers.clock import Clock
from eskin.drivers.events import Event, EventLog
from eskin.drivers.framing import Deframer
from eskin.drivers.transport import ReceivedPacket, Transport
from eskin.errors import DeviceError
from eskin.units import NS_PER_S

MOST_BYTES = 1 << 16
"""Of one read of one port."""
FULL = 4095
"""What Linux gives of a serial line at once when there is more [bytes]."""
RETRY = 250_000_000
"""Between two attempts to open a port that is gone [ns]."""


@final
class SerialPort:
    """Reads one port without waiting, and opens it again when it comes back.

    Attributes:
        path: of its device file.
        deframer: finds packets in its bytes; begins anew with every opening.
        bytes: read so far.
        broken: frames so far that were none.
    """

    def __init__(self, path: str, baud: int) -> None:
        """Open the port.

        Raises:
            DeviceError: it is not there, is used by others, or must not be read.
        """
        self.path = path
        self.baud = baud
        self.line: serial.Serial | None = None
        self.deframer = Deframer()
        self.bytes = self.frames = self.broken = 0
        self.tried = 0
        try:
            self.open()
        except OSError as error:
            raise refusal(path, error) from error

    def open(self) -> None:
        """Open the device file; pyserial throws away what lies in its buffer."""
        try:
            self.line = serial.Serial(self.path, self.baud, timeout=0, exclusive=True)
        except (termios.error, ValueError) as error:
            # pyserial: unplugged while it was opened, or a speed that it cannot have.
            raise OSError(str(error)) from error
        self.deframer = Deframer()

    def retry(self, now: int) -> bool:
        """Open it if it is gone, not too often; whether it has come back."""
        if self.line is not None or now - self.tried < RETRY:
            return False
        self.tried = now
        try:
            self.open()
        except OSError:
            self.close()
            return False
        return True

    def read(self) -> list[bytes] | None:
        """Packets that have come; None where the port is gone."""
        if self.line is None:
            return []
        try:
            chunk = read_all(self.line.fileno())
        except OSError:
            self.close()
            return None
        before = self.deframer.broken
        packets = self.deframer.push(chunk)
        self.bytes += len(chunk)
        self.frames += len(packets)
        self.broken += self.deframer.broken - before
        return packets

    def close(self) -> None:
        """Let the device file go."""
        line, self.line = self.line, None
        if line is not None:
            line.close()


def read_all(file: int) -> bytes:
    """All that there is to read without waiting, up to 64 kB.

    pyserial takes five calls of the system for what is one.

    Raises:
        OSError: the device is gone.
    """
    chunks, size = [], 0
    while size < MOST_BYTES:
        try:
            chunk = os.read(file, MOST_BYTES - size)
        except BlockingIOError:
            break
        if not chunk and not chunks:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        chunks.append(chunk)
        size += len(chunk)
        if len(chunk) < FULL:
            break
    return b"".join(chunks)


def refusal(path: str, error: OSError) -> DeviceError:
    """Why a port cannot be opened, and what to do."""
    code = getattr(error, "errno", None)
    if code == errno.EACCES:
        remedy = "join its group: sudo usermod -aG dialout $USER, then log in again"
    elif code == errno.ENOENT:
        remedy = "plug it in, or look for its name under /dev/serial/by-id"
    else:
        remedy = "stop the program that uses it, or check its name and baud rate"
    return DeviceError(
        f"cannot open serial port {path} ({error}); allowed is a port that is there, "
        f"free and readable; {remedy}"
    )


@dataclass(frozen=True)
class SerialPortInfo:
    """A serial port that could carry patches."""

    path: str
    """Of its device file."""

    description: str
    """What the device says of itself."""

    usable: bool
    """Whether this user may read and write it."""


def list_serial_ports() -> list[SerialPortInfo]:
    """Ports with hardware behind them, by path; built-in ones without are left out."""
    return [
        SerialPortInfo(
            port.device,
            " ".join(word for word in (port.description, port.serial_number) if word),
            os.access(port.device, os.R_OK | os.W_OK),
        )
        for port in sorted(list_ports.comports())
        if port.hwid != "n/a"
    ]


@final
class SerialTransport(Transport):
    """Reads serial ports in one thread; one that vanishes is opened when it is back.

    Attributes:
        ports: by their paths.
    """

    def __init__(
        self, clock: Clock, paths: Sequence[str], baud: int = 1_000_000
    ) -> None:
        """Open ports.

        Args:
            clock: that stamps arrivals.
            paths: of their device files.
            baud: bits a second; without meaning where the port is USB alone.

        Raises:
            DeviceError: one of them cannot be opened, or is there twice.
        """
        if not paths or len(set(paths)) != len(paths):
            raise DeviceError(
                f"serial ports are {', '.join(paths) or 'none'}; allowed is at least "
                "one, and each once; correct them"
            )
        self.clock = clock
        self.log = EventLog()
        self.closed = False
        self.ports: dict[str, SerialPort] = {}
        try:
            for path in paths:
                self.ports[path] = SerialPort(path, baud)
        except DeviceError:
            self.close()
            raise

    def read(self, timeout: float) -> list[ReceivedPacket]:
        """What has come at all ports, at most 64 kB of each."""
        if self.closed:
            return []
        now = self.clock.now()
        for path, port in self.ports.items():
            if port.retry(now):
                self.log.say(now, "returned", f"port {path} is back")
        open_ports = [port for port in self.ports.values() if port.line is not None]
        if len(open_ports) < len(self.ports):
            timeout = min(timeout, RETRY / NS_PER_S)
        deliveries = []
        for port in self.ready(open_ports, max(0.0, timeout)):
            packets = port.read()
            arrived = self.clock.now()
            if packets is None:
                text = f"port {port.path} is gone; plug it in again"
                self.log.say(arrived, "silent", text)
                continue
            deliveries += [
                ReceivedPacket(port.path, arrived, packet) for packet in packets
            ]
        return deliveries

    def ready(self, ports: list[SerialPort], timeout: float) -> list[SerialPort]:
        """Ports with something to read."""
        if not ports:
            self.clock.sleep(timeout)
            return []
        files = {port.line.fileno(): port for port in ports if port.line}
        return [files[file] for file in select.select(list(files), [], [], timeout)[0]]

    def take_events(self, now: int) -> list[Event]:
        """Ports that went and came."""
        return self.log.take()

    def counters(self) -> dict[str, int]:
        """Bytes, frames, and those broken, of all ports."""
        ports = self.ports.values()
        return {
            "bytes": sum(port.bytes for port in ports),
            "frames": sum(port.frames for port in ports),
            "broken": sum(port.broken for port in ports),
        }

    def close(self) -> None:
        """Let all ports go, for good."""
        self.closed = True
        for port in self.ports.values():
            port.close()
