"""Connect virtual patches to a real transport, on a clock that reads advance."""

import threading
import time
from collections.abc import Iterator
from typing import final

from eskin.drivers import Event, ManualClock, ReceivedPacket, Transport
from eskin.sim.virtual import VirtualSkin
from eskin.touch import Scan

PATIENCE = 0.1
"""Longest time for data to pass through the kernel [s]."""
PAUSE = 0.001
"""Interval between reads after the last scan [s]."""


@final
class Cable(Transport):
    """Lets a device send its next scan when the reader waits until it is due.

    Sent data passes through the kernel and is read back before time advances, so that
    hours take minutes and every run is the same.

    Attributes:
        over: event that is set when all scans were sent.
        sent: number of scans that were sent.
    """

    def __init__(
        self,
        inner: Transport,
        device: VirtualSkin,
        scans: Iterator[Scan],
        clock: ManualClock,
    ) -> None:
        """Connect a device and a transport.

        Args:
            inner: transport that receives from the ports of the device.
            device: device that sends.
            scans: scans of the device.
            clock: clock of both.
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
        """Return the packets until the timeout or the next scan."""
        now = self.clock.now()
        wait = max(0.0, (self.start + self.device.elapsed - now) / 1e9)
        scan = None
        if wait <= timeout and not self.over.is_set():
            scan = next(self.scans, None)
        self.clock.sleep(min(wait, timeout) if scan is not None else timeout)
        self.device.answer(self.clock.now() - self.start)
        if scan is not None:
            self.device.send(scan)
            self.sent += 1
        elif wait <= timeout:
            self.over.set()
            time.sleep(PAUSE)
        return self.take()

    def take(self) -> list[ReceivedPacket]:
        """Return all packets that were sent and arrive."""
        deliveries = self.inner.read(0.0)
        while (left := self.count_in_transit()) > 0:
            more = self.inner.read(PATIENCE)
            deliveries += more
            if not more and self.count_in_transit() == left:
                self.gone += left
        return deliveries

    def count_in_transit(self) -> int:
        """Return the number of bytes that were sent and neither read nor given up."""
        sent = sum(port.bytes for port in self.device.ports)
        return sent - self.inner.counters()["bytes"] - self.gone

    def send(self, port: str, packet: bytes) -> None:
        """Send a request to the device by the real transport."""
        self.inner.send(port, packet)

    def take_events(self, now: int) -> list[Event]:
        """Return those of the real transport."""
        return self.inner.take_events(now)

    def counters(self) -> dict[str, int]:
        """Return those of the real transport."""
        return self.inner.counters()

    def close(self) -> None:
        """Close both ends."""
        self.inner.close()
        self.device.close()
