"""A serial port that is not there: one end of a pseudo-terminal."""

import os
import select
import time
import tty
from pathlib import Path
from typing import final

from eskin.drivers.virtual.port import Port
from eskin.errors import DeviceError

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
