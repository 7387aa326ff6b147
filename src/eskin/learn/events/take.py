"""One stream to score: what was done, and what was said."""

from collections.abc import Sequence
from dataclasses import dataclass

from eskin.learn.events.true_events import TrueEvent
from eskin.live import UNKNOWN, Detection
from eskin.recording import NONE

NO_GESTURE = (NONE, UNKNOWN)
"""What a detection may say that is no gesture."""


@dataclass(frozen=True, eq=False)
class Take:
    """What was done to a skin in one go, and what was said of it."""

    events: Sequence[TrueEvent]
    """What was done."""

    detections: Sequence[Detection]
    """What was said."""

    seconds: float
    """How long it took [s]."""

    subject: str
    """Who did it."""
