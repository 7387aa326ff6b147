"""One serial port, through unplugging and plugging back."""

import errno
import os
import termios
from typing import final

import serial

from eskin.drivers.framing import Deframer
from eskin.errors import DeviceError

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
