"""This module reads packets from serial ports, through unplugging and plugging back."""

import errno
import os
import select
import termios
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import final

import serial
from serial.tools import list_ports

from eskin.drivers.clock import Clock
from eskin.drivers.events import Event, EventLog
from eskin.drivers.packet import END, Deframer, Framing, encode_frame
from eskin.drivers.source import ReceivedPacket, Transport
from eskin.errors import DeviceError
from eskin.units import NS_PER_S

MAX_READ_BYTES = 1 << 16
"""Largest read of one port."""
FULL_CHUNK = 4095
"""Size of what Linux returns of a serial line when there is more to read [bytes]."""
RETRY_INTERVAL = 250_000_000
"""Time between two attempts to open a port that is gone [ns]."""


@final
class SerialPort:
    """Reads one serial port without waiting, and reopens it when it comes back.

    Attributes:
        path: path of its device file.
        line: the open device file; None while the port is gone.
        deframer: finds packets in its bytes and counts them.
    """

    def __init__(self, path: str, baud: int, deframer: Framing | None = None) -> None:
        """Open the port.

        Args:
            path: path of its device file.
            baud: baud rate [bit/s].
            deframer: what finds packets in its bytes; frames of COBS unless given.

        Raises:
            DeviceError: it is missing, busy or not readable.
        """
        self.path = path
        self.baud = baud
        self.line: serial.Serial | None = None
        self.deframer = deframer or Deframer()
        self.tried = 0
        try:
            self.open()
        except OSError as error:
            raise build_open_error(path, error) from error

    def open(self) -> None:
        """Open the device file; pyserial empties its buffer."""
        try:
            self.line = serial.Serial(self.path, self.baud, timeout=0, exclusive=True)
        except (termios.error, ValueError) as error:
            # pyserial: unplugged while it was opened, or an unsupported baud rate.
            raise OSError(str(error)) from error
        self.deframer.reset()

    def retry(self, now: int) -> bool:
        """Reopen the port if it is gone, not too often; return whether it is back."""
        if self.line is not None or now - self.tried < RETRY_INTERVAL:
            return False
        self.tried = now
        try:
            self.open()
        except OSError:
            self.close()
            return False
        return True

    def read(self) -> list[bytes] | None:
        """Return the packets that have arrived; None where the port is gone."""
        if self.line is None:
            return []
        try:
            chunk = read_available(self.line.fileno())
        except OSError:
            self.close()
            return None
        return self.deframer.push_chunk(chunk)

    def send(self, packet: bytes) -> None:
        """Write a packet without waiting; what does not fit is lost.

        The zero before it ends a frame of which only a part was written.
        """
        if self.line is not None:
            with suppress(OSError):
                os.write(self.line.fileno(), END + encode_frame(packet))

    def close(self) -> None:
        """Close the device file."""
        line = self.line
        self.line = None
        if line is not None:
            line.close()


def read_available(file: int) -> bytes:
    """Return all that can be read without waiting, up to 64 kB.

    pyserial would make five system calls instead of one.

    Raises:
        OSError: the device is gone.
    """
    chunks = []
    size = 0
    while size < MAX_READ_BYTES:
        try:
            chunk = os.read(file, MAX_READ_BYTES - size)
        except BlockingIOError:
            break
        if not chunk and not chunks:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        chunks.append(chunk)
        size += len(chunk)
        if len(chunk) < FULL_CHUNK:
            break
    return b"".join(chunks)


def build_open_error(path: str, error: OSError) -> DeviceError:
    """Build the error of a port that cannot be opened, with the remedy."""
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
    """A serial port of this computer, as it is listed."""

    path: str
    """Path of the device file."""
    description: str
    """Description that the device gives of itself."""
    usable: bool
    """Whether this user may read and write it."""


def list_serial_ports() -> list[SerialPortInfo]:
    """List the ports with hardware behind them, sorted by path."""
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
    """Reads serial ports in one thread; a port that vanishes is reopened later.

    Attributes:
        ports: serial ports by their paths.
    """

    def __init__(
        self, clock: Clock, paths: Sequence[str], baud: int = 1_000_000
    ) -> None:
        """Open ports.

        Args:
            clock: clock that stamps arrivals.
            paths: paths of their device files.
            baud: baud rate [bit/s]; has no effect on a pure USB port.

        Raises:
            DeviceError: one of them cannot be opened, or is given twice.
        """
        if not paths or len(set(paths)) != len(paths):
            raise DeviceError(
                f"serial ports are {', '.join(paths) or 'none'}; allowed is at least "
                "one, and each once"
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
        """Return what has arrived at all ports, at most 64 kB of each."""
        if self.closed:
            return []
        now = self.clock.now()
        for path, port in self.ports.items():
            if port.retry(now):
                self.log.log_event(now, "returned", f"port {path} is back")
        open_ports = [port for port in self.ports.values() if port.line is not None]
        if len(open_ports) < len(self.ports):
            timeout = min(timeout, RETRY_INTERVAL / NS_PER_S)
        packets = []
        for port in self.wait_readable(open_ports, max(0.0, timeout)):
            was_text = port.deframer.is_text
            found = port.read()
            arrived = self.clock.now()
            if port.deframer.is_text and not was_text:
                text = (
                    f"port {port.path} sends lines of text, and no packets; "
                    f"csv:{port.path} reads lines of numbers"
                )
                self.log.log_event(arrived, "damaged", text)
            if found is None:
                text = f"port {port.path} is gone; plug it in again"
                self.log.log_event(arrived, "silent", text)
            for packet in found or ():
                packets.append(ReceivedPacket(port.path, arrived, packet))
        return packets

    def send(self, port: str, packet: bytes) -> None:
        """Write a request to the port of a path."""
        self.ports[port].send(packet)

    def wait_readable(
        self, ports: list[SerialPort], timeout: float
    ) -> list[SerialPort]:
        """Wait for ports that can be read and return them."""
        if not ports:
            self.clock.sleep(timeout)
            return []
        files = {port.line.fileno(): port for port in ports if port.line}
        return [files[file] for file in select.select(list(files), [], [], timeout)[0]]

    def take_events(self, now: int) -> list[Event]:
        """Return events of ports that vanished and came back."""
        return self.log.take()

    def counters(self) -> dict[str, int]:
        """Return bytes, valid frames and broken frames of all ports."""
        deframers = [port.deframer for port in self.ports.values()]
        return {
            "bytes": sum(deframer.bytes for deframer in deframers),
            "frames": sum(deframer.frames for deframer in deframers),
            "broken": sum(deframer.broken for deframer in deframers),
        }

    def close(self) -> None:
        """Close all ports for good."""
        self.closed = True
        for port in self.ports.values():
            port.close()
