"""This module defines what guides of a person have in common who presses a skin."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

from eskin.skin import MountedSkin, Skin
from eskin.touch import PressDetector, Scan, TouchState

Press = TypeVar("Press")


@dataclass(frozen=True)
class GuideEvent:
    """An event is what a scan has led to."""

    kind: Literal["touched", "rested", "pressed", "refused"]
    """`touched`: rest begins again, since the skin is touched; `rested`: rest is
    measured; `pressed`: a press was measured; `refused`: one was not."""
    text: str = ""
    """Reason for which rest begins again, or a press is refused."""
    taxel: int | None = None
    """Taxel of greatest pressure of a press."""


class PressGuide(ABC, Generic[Press]):
    """A guide measures rest, then asks for presses until it has enough.

    It is pushed scan by scan, from a device or a recording, and knows neither terminal
    nor page.

    Attributes:
        mounted: the skin on its robot.
        phase: what is measured now.
        presses: presses so far.
        rest_seconds: time without touch that is asked for first [s].
        detector: detector of the presses.
        state: contacts and pressures at the latest scan; None before the first.
    """

    mounted: MountedSkin
    phase: Literal["rest", "press", "done"]
    presses: list[Press]
    rest_seconds: float
    detector: PressDetector
    state: TouchState | None

    @property
    def skin(self) -> Skin:
        """The skin that is pressed."""
        return self.mounted.skin

    @property
    def is_pressed(self) -> bool:
        """Whether a press goes on."""
        return self.detector.since is not None

    @abstractmethod
    def push(self, scan: Scan) -> GuideEvent | None:
        """Process the next scan, and return what it has led to."""

    @property
    @abstractmethod
    def progress(self) -> float:
        """Share of the time at rest, or of the presses asked for, that is done."""

    @abstractmethod
    def skip(self) -> None:
        """Leave out what is asked for, and ignore a press that goes on."""

    @abstractmethod
    def withdraw(self) -> None:
        """Forget the last press and ask for it again; ignore one that goes on."""
