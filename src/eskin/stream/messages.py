"""This module defines what a stream publishes to its listeners."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.drivers import Event
from eskin.live import Detection
from eskin.touch import Scan, TouchState


@dataclass(frozen=True, eq=False)
class RecognitionState:
    """One instant of the skin as the recogniser understands it."""

    state: TouchState
    """The calibrated reading with its faults, contacts and touches."""

    probabilities: dict[int, Float[np.ndarray, "class"]]
    """Of the model's vocabulary, calibrated, for each open touch by its id."""

    detections: tuple[Detection, ...]
    """What was said at it; each is also told by itself, before."""


@dataclass(frozen=True)
class Commanded:
    """What was decided about a touch or a fault that concerns the robot's motion."""

    stamp: int
    """When it was decided [ns since the epoch]."""

    action: str
    """What was to be done."""

    touch: int | None
    """Id of the touch that it is about, where it is about one."""

    gesture: str | None
    """Gesture of that touch, where it was recognised."""

    accepted: bool
    """Whether it was done."""

    why: str
    """Why it was, or was not."""


Message = Scan | RecognitionState | Detection | Event | Commanded
"""Scans and moments flow at the rate of the skin; the others are rare."""

RARE = (Detection, Event, Commanded)
"""What a full queue drops last."""
