"""Which true touch a sequence of readings is of, where the truth is known."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.recording import Recording

NEAR = 0.1
"""Farthest that a contact may be from the centre of the true touch it is of [m]."""


class Fit(NamedTuple):
    """What a sequence truly is."""

    touch: int
    """Number of the touch in its file."""
    gesture: str
    """What was done."""
    kind: str
    """Variant of the gesture."""


@dataclass(frozen=True, eq=False)
class TrueTouches:
    """Every true touch of a recording at every reading at which it presses."""

    stamps: Int[np.ndarray, "truth"]
    """Ascending [ns since the epoch]."""
    touch: Int[np.ndarray, "truth"]
    """Number of the touch in its file."""
    p_world: Float[np.ndarray, "truth 3"]
    """Centre of its force [m]."""
    names: dict[int, Fit]
    """What each touch is, by its number."""

    def fit(
        self,
        stamps: Int[np.ndarray, "row"],
        centres: Float[np.ndarray, "row 3"],
        forces: Float[np.ndarray, "row"],
    ) -> Fit | None:
        """The true touch that most of the force of a sequence lies near.

        Args:
            stamps: of the sequence's readings [ns since the epoch].
            centres: of its contacts [m]; NaN without contact.
            forces: of these contacts [N].
        """
        votes: dict[int, float] = {}
        lows = np.searchsorted(self.stamps, stamps, side="left").tolist()
        highs = np.searchsorted(self.stamps, stamps, side="right").tolist()
        for row, (low, high) in enumerate(zip(lows, highs, strict=True)):
            if low == high or forces[row] <= 0:
                continue
            gaps = np.linalg.norm(self.p_world[low:high] - centres[row], axis=1)
            nearest = int(gaps.argmin())
            if gaps[nearest] <= NEAR:
                number = int(self.touch[low + nearest])
                votes[number] = votes.get(number, 0.0) + float(forces[row])
        return self.names[max(votes, key=lambda n: (votes[n], -n))] if votes else None


def true_touches(recording: Recording) -> TrueTouches | None:
    """The truth of a recording; None where it is not known."""
    if not recording.metadata.simulated:
        return None
    records = sorted(recording.truths(), key=lambda truth: (truth.stamp, truth.touch))
    return TrueTouches(
        stamps=np.array([truth.stamp for truth in records], dtype=np.int64),
        touch=np.array([truth.touch for truth in records], dtype=np.int64),
        p_world=np.array([t.p_world for t in records], dtype=np.float64).reshape(-1, 3),
        names={t.touch: Fit(t.touch, t.gesture, t.kind) for t in records},
    )
