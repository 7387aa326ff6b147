"""This module defines the abstract transport, which brings packets to the host."""

from abc import abstractmethod
from typing import NamedTuple

from eskin.drivers.events import Event
from eskin.progress import Closing


class ReceivedPacket(NamedTuple):
    """Bytes that were received as one packet and are not yet decoded."""

    port: str
    """Port or network address that the bytes came from."""
    arrived: int
    """Time at which they were read [ns since the epoch]."""
    packet: bytes
    """Header to CRC, not yet checked."""


class Transport(Closing):
    """Carries packets of patches over some kind of line; one thread uses it."""

    @abstractmethod
    def read(self, timeout: float) -> list[ReceivedPacket]:
        """Return what has arrived, in bounded time and memory.

        Args:
            timeout: longest wait for the first packet [s].

        Raises:
            DeviceError: the transport is lost and will not come back.
        """

    @abstractmethod
    def send(self, port: str, packet: bytes) -> None:
        """Send a request to a port or address that packets came from, or lose it.

        It does not wait, and raises nothing: a patch that gets no request goes on.
        """

    @abstractmethod
    def take_events(self, now: int) -> list[Event]:
        """Return the events of ports since the last call, up to a time [ns]."""

    @abstractmethod
    def counters(self) -> dict[str, int]:
        """Return the counters of this kind of transport."""
