"""Touches: all tracks of one gesture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.touch.contacts import Contact


@dataclass(frozen=True, eq=False)
class Touch:
    """All tracks of one gesture, such as both of a double pat."""

    id: int
    """Counts up from 1 in the order of appearance."""

    onset: int
    """Stamp of its first contact [ns since the epoch]."""

    last: int
    """Stamp of its last contact so far [ns since the epoch]."""

    tracks: tuple[int, ...]
    """Ids of its tracks, ascending."""

    impulse: float
    """Its force integrated over time [N s]."""

    peak_force: float
    """Greatest force of all its contacts at one instant [N]."""

    peak: float
    """Greatest pressure on one taxel [kPa]."""

    link: str
    """Link of its first contact."""

    start: Float[np.ndarray, "3"]
    """Centre of its first contact in the frame of `link` [m]."""

    latest: Float[np.ndarray, "3"]
    """Force-weighted centre of its latest contacts in the frame of `link` [m]."""

    contact: Contact
    """The strongest of its latest contacts."""

    closed: bool = False
    """True once it is over: no track will join it any more."""

    merged_into: int | None = None
    """The touch that it turned out to be a part of."""

    @property
    def travel(self) -> Float[np.ndarray, "3"]:
        """From its first to its latest centre in the frame of `link` [m]."""
        return self.latest - self.start


@dataclass(frozen=True)
class TouchConfig:
    """What makes tracks one touch."""

    near: float = 0.08
    """How far a track may begin from where one ended [m], in the frame of its link."""

    pause_seconds: float = 0.5
    """How long after it [s]; so long after its last contact a touch closes."""

    beside: float = 0.1
    """How far contacts at the same time may be apart [m], nearest taxels in space."""
