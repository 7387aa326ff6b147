"""Virtual patches on a real transport and a clock that only goes on when it is read."""

import threading
import time
from collections.abc import Iterator
from typing import final

from eskin.drivers import Event, ManualClock, ReceivedPacket, Transport
from eskin.drivers.virtual import VirtualSkin
from eskin.touch import Scan

PATIENCE = 0.1
"""How long what was sent may be on its way through the kernel [s]."""
PAUSE = 0.001
"""Between two readings once there is nothing more to send [s]."""


@final
class Cable(Transport):
    """Lets a device make its next scan whenever its listener waits for so long.

    What is sent goes through the kernel and is read back before time goes on, so that
    hours take minutes and every run is the same.

    Attributes:
        over: set when all scans were sent.
        sent: how many were.
    """

    def __init__(
        self,
        inner: Transport,
        device: VirtualSkin,
        scans: Iterator[Scan],
        clock: ManualClock,
    ) -> None:
        """Connect them.

        Args:
            inner: that hears the ports of the device.
            device: that sends.
            scans: what it feels.
            clock: of both.
        """
        self.inner = inner
        self.device = device
        self.scans = scans
        self.clock = clock
        self.start = clock.now()
        self.over = threading.Event()
        self.sent = 0
        self.gone = 0

    def read(self, timeout: float) -> list[ReceivedPacket]:
        """What arrives until so much time has passed; no longer than to a next scan."""
        now = self.clock.now()
        wait = max(0.0, (self.start + self.device.elapsed - now) / 1e9)
        scan = None
        if wait <= timeout and not self.over.is_set():
            scan = next(self.scans, None)
        self.clock.sleep(min(wait, timeout) if scan is not None else timeout)
        if scan is not None:
            self.device.send(scan)
            self.sent += 1
        elif wait <= timeout:
            self.over.set()
            time.sleep(PAUSE)
        return self.take()

    def take(self) -> list[ReceivedPacket]:
        """All that was sent, as far as it arrives."""
        deliveries = self.inner.read(0.0)
        while (left := self.on_the_way()) > 0:
            more = self.inner.read(PATIENCE)
            deliveries += more
            if not more and self.on_the_way() == left:
                self.gone += left
        return deliveries

    def on_the_way(self) -> int:
        """Bytes that were sent and neither read nor given up."""
        sent = sum(port.bytes for port in self.device.ports)
        return sent - self.inner.counters()["bytes"] - self.gone

    def take_events(self, now: int) -> list[Event]:
        """Of the real transport."""
        return self.inner.take_events(now)

    def counters(self) -> dict[str, int]:
        """Of the real transport."""
        return self.inner.counters()

    def close(self) -> None:
        """Close both ends."""
        self.inner.close()
        self.device.close()
