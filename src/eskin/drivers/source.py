"""This module defines the abstract source of scans, and the transport of packets."""

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from eskin.drivers.clock import Clock
from eskin.drivers.events import Event
from eskin.errors import DeviceError
from eskin.progress import Closing
from eskin.skin import MountedSkin, Skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

BYTE_WAIT = 0.05
"""Longest wait before it is checked whether a device has sent a byte [s]."""

MIN_ARM_RATE = 20.0
"""Scan rate below which a skin commands no arm [1/s]."""


@dataclass(frozen=True)
class SourceInfo:
    """Describes a source before its first scan."""

    uri: str
    """URI that the source was opened with."""
    mounted: MountedSkin
    """Skin whose taxels are scanned, on its robot, whose joints `Scan.q` has."""
    calibration: Calibration
    """Calibration of that skin."""
    rate: float
    """Nominal scan rate [1/s]."""
    is_rate_assumed: bool = False
    """Whether nothing has told the rate, neither the device nor the user."""

    @property
    def skin(self) -> Skin:
        """Return the skin whose taxels are scanned."""
        return self.mounted.skin

    @property
    def robot_name(self) -> str:
        """Return the name of the robot that wears the skin."""
        return self.mounted.robot.name

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the joint names in the order of `Scan.q`."""
        return self.mounted.robot.joint_names

    def describe_rate(self) -> str:
        """Describe a rate that is assumed or too low for an arm, with remedies.

        It is empty for another rate.
        """
        if self.is_rate_assumed:
            return (
                f"no patch has told its rate: {self.rate:.3g} scans a second are "
                "assumed; --rate states another"
            )
        if self.rate >= MIN_ARM_RATE:
            return ""
        return (
            f"{self.rate:.3g} scans a second, below the {MIN_ARM_RATE:g} that an arm "
            "needs: raise the baud rate on both sides (--baud), or send packets "
            "(firmware/eskin_patch.h), which are half as long as lines"
        )


class Source(Closing):
    """Returns scans one after the other, in the order of their stamps.

    Everything it holds is closed at the end of `with`. Only one thread may read it.
    """

    info: SourceInfo
    """Description that is known before the first scan."""
    clock: Clock
    """Clock that stamps the scans."""

    @abstractmethod
    def read(self, timeout: float | None = None) -> Scan | None:
        """Return the next scan; None where none came in time or the source has ended.

        Args:
            timeout: longest wait [s]; None waits for a scan or the end.

        Raises:
            DeviceError: the transport is lost and will not come back.
        """

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Return whether no scan will come any more."""

    @abstractmethod
    def take_events(self) -> list[Event]:
        """Return the events since the last call."""

    def take_last_events(self) -> list[Event]:
        """Return the events since the last call, and of what was only counted yet."""
        return self.take_events()

    @abstractmethod
    def counters(self) -> dict[str, int]:
        """Return counters: `readings` returned, and more by the kind of source."""

    def __iter__(self) -> Iterator[Scan]:
        """Iterate over scans until there are no more."""
        while not self.ended:
            scan = self.read()
            if scan is not None:
                yield scan


def await_first_byte(
    uri: str,
    clock: Clock,
    patience: float,
    count: Callable[[], int],
    receive: Callable[[float], object],
) -> None:
    """Receive from a device until it has sent a byte.

    Args:
        uri: URI that the device was opened with.
        clock: clock by which is waited.
        patience: longest wait [s]; 0 waits for none.
        count: function that returns how many bytes have come so far.
        receive: function that receives from the device, for at most a time [s].

    Raises:
        DeviceError: no byte came in time.
    """
    end = clock.now() + round(patience * NS_PER_S)
    while patience and not count():
        if (now := clock.now()) >= end:
            raise DeviceError(
                f"{uri} sent no byte within {patience:g} s; allowed is a device that "
                "sends; switch it on, and check its cable, address and port"
            )
        receive(min(BYTE_WAIT, (end - now) / NS_PER_S))


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
