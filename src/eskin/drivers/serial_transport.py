"""Patches heard over serial ports, any number a port."""

import select
from collections.abc import Sequence
from typing import final

from eskin.drivers.clock import Clock
from eskin.drivers.event import Event
from eskin.drivers.event_log import EventLog
from eskin.drivers.serial_port import RETRY, SerialPort
from eskin.drivers.transport import Delivery, Transport
from eskin.errors import DeviceError
from eskin.units import NS_PER_S


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

    def read(self, timeout: float) -> list[Delivery]:
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
            deliveries += [Delivery(port.path, arrived, packet) for packet in packets]
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

    def counted(self) -> dict[str, int]:
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
