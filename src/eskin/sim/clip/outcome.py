"""What comes of a plan: what the sensor counted, and what was really done."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.recording import TruthRecord


@dataclass(frozen=True, eq=False)
class TrueSeries:
    """One touch as it really was, at every reading of its clip.

    Values are zero, and the centroid without meaning, while there is no contact.
    """

    number: int
    """Which touch of the clip; 0 is the one that the clip is made for."""
    gesture: str
    """Of the vocabulary, `none`, or the name of an unknown gesture."""
    kind: str
    """Variant, such as `two_tips` or `bump`."""
    subject: str
    """Who did it; empty where it was nobody."""
    link: str
    """Link that bears most of it."""
    force: Float[np.ndarray, "reading"]
    """Total force on the skin [N]."""
    area: Float[np.ndarray, "reading"]
    """Contact area [m2]."""
    centroid: Float[np.ndarray, "reading 3"]
    """Centre of the force in the world [m]."""
    onset: float
    """First contact since the start of the clip; negative where it was before [s]."""
    end: float
    """Last contact since the start of the clip; may be after its end [s]."""

    def record(self, number: int, reading: int, stamp: int) -> TruthRecord:
        """What is recorded of it at one reading.

        Args:
            number: which touch of the recording or stream it is.
            reading: of the clip.
            stamp: of that reading [ns since the epoch].
        """
        x, y, z = self.centroid[reading].tolist()
        return TruthRecord(
            stamp,
            number,
            self.gesture,
            self.kind,
            self.link,
            float(self.force[reading]),
            float(self.area[reading]),
            (x, y, z),
        )


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip or stream that was made."""

    counts: Int[np.ndarray, "reading taxel"]
    """What the converter counted (int32), one row every reading of the sensor."""
    received: Bool[np.ndarray, "reading taxel"]
    """False where no fresh data came."""
    q: Float[np.ndarray, "reading joint"]
    """Joint positions [rad]."""
    truths: tuple[TrueSeries, ...]
    """What was really done, by number; empty where nothing touched."""
    pose_group: int
    """Group of the pose at its start."""
    drawn: dict[str, float | str]
    """Every parameter that was drawn for it, by name."""
