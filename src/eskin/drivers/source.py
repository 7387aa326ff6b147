"""This module defines the abstract source of scans and of joint positions."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.closing import Closing
from eskin.drivers.clock import Clock
from eskin.drivers.events import Event
from eskin.skin import Skin
from eskin.touch import Calibration, Scan


class JointSource(ABC):
    """Tells the joint positions of a robot at a time."""

    @abstractmethod
    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Joint positions [rad] at a time [ns since the epoch]; the last known."""


@final
class FixedJoints(JointSource):
    """A robot that does not move."""

    def __init__(self, q: Float[np.ndarray, "joint"]) -> None:
        """Stay at `q` [rad]."""
        self.q = np.array(q, np.float64)

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """The same at all times."""
        return self.q


@dataclass(frozen=True)
class SourceInfo:
    """What is known of a source before its first scan."""

    uri: str
    """How it was opened."""
    robot_name: str
    """Preset or URDF that the skin is on."""
    joint_names: tuple[str, ...]
    """In the order of `Scan.q`."""
    skin: Skin
    """Whose taxels the scans count."""
    calibration: Calibration
    """Of that skin."""
    rate: float
    """Scans a second that it means to give [1/s]."""


class Source(Closing):
    """Gives scans one after the other, in the order of their stamps.

    Everything it holds is closed at the end of `with`. One thread reads it.

    Attributes:
        info: what is known before the first scan.
        clock: that its scans are stamped by.
    """

    info: SourceInfo
    clock: Clock

    @abstractmethod
    def read(self, timeout: float | None = None) -> Scan | None:
        """The next scan; None where none came in time, or there are no more.

        Args:
            timeout: how long to wait [s]; None waits until there is one or the end.

        Raises:
            DeviceError: the transport is lost and will not come back.
        """

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether no scan will come any more."""

    @abstractmethod
    def take_events(self) -> list[Event]:
        """What has happened since it was last asked."""

    @abstractmethod
    def counters(self) -> dict[str, int]:
        """What it has counted so far: `readings` given, and more by its kind."""

    def __iter__(self) -> Iterator[Scan]:
        """Scans until there are no more."""
        while not self.ended:
            scan = self.read()
            if scan is not None:
                yield scan
