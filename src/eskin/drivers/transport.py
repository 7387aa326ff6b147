"""What carries packets to this computer: the abstract transport."""

from abc import abstractmethod
from typing import NamedTuple

from eskin.closing import Closing
from eskin.drivers.events import Event


class ReceivedPacket(NamedTuple):
    """The bytes of one packet, as they came."""

    port: str
    """Port or network address that they came from."""
    arrived: int
    """When they were read [ns since the epoch]."""
    packet: bytes
    """Header to CRC, which nobody has checked yet."""


class Transport(Closing):
    """Hears patches over some kind of line; one thread reads it."""

    @abstractmethod
    def read(self, timeout: float) -> list[ReceivedPacket]:
        """What has come; costs bounded time and memory, however much comes.

        Args:
            timeout: how long to wait for the first of it [s].

        Raises:
            DeviceError: it is lost and will not come back.
        """

    @abstractmethod
    def take_events(self, now: int) -> list[Event]:
        """What has happened to ports since it was last asked, up to a time [ns]."""

    @abstractmethod
    def counters(self) -> dict[str, int]:
        """What it has counted so far, by its kind."""
