"""What is counted of events."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from jaxtyping import Float

from eskin.learn.metrics import draw_clusters


@dataclass(frozen=True)
class Tally:
    """Events that were to be recognised, and what was said of them."""

    matched: int = 0
    """Events with a detection of the same gesture."""

    missed: int = 0
    """Events without."""

    false: int = 0
    """Detections of a gesture without such an event."""

    @property
    def precision(self) -> float:
        """Share of detections that match; NaN where there is none."""
        return share(self.matched, self.matched + self.false)

    @property
    def recall(self) -> float:
        """Share of events that match; NaN where there is none."""
        return share(self.matched, self.matched + self.missed)

    @property
    def f1(self) -> float:
        """Harmonic mean of both; NaN where there is neither event nor detection."""
        return share(2 * self.matched, 2 * self.matched + self.missed + self.false)

    def __add__(self, other: "Tally") -> "Tally":
        """Both together."""
        return Tally(
            self.matched + other.matched,
            self.missed + other.missed,
            self.false + other.false,
        )


@dataclass(frozen=True)
class LeftAlone:
    """Events that are no gesture of the vocabulary, of which none should be said."""

    count: int = 0
    """How many there were."""

    mistaken: int = 0
    """How many of them were said to be a gesture."""

    @property
    def share(self) -> float:
        """Share that was mistaken; NaN where there was none."""
        return share(self.mistaken, self.count)

    def __add__(self, other: "LeftAlone") -> "LeftAlone":
        """Both together."""
        return LeftAlone(self.count + other.count, self.mistaken + other.mistaken)


@dataclass(frozen=True, eq=False)
class Delays:
    """When matched detections were said."""

    after_end: Float[np.ndarray, "match"]
    """Since the true last contact; negative where said before it [s]."""

    after_onset: Float[np.ndarray, "match"]
    """Since the true first contact [s]."""

    def latency(self, percent: int) -> float:
        """A percentile of the time since the last contact [s]; NaN without matches."""
        return percentile(self.after_end, percent)

    def from_onset(self, percent: int) -> float:
        """A percentile of the time since the first contact [s]; NaN without matches."""
        return percentile(self.after_onset, percent)


def share(part: int, whole: int) -> float:
    """Part of a whole; NaN where there is nothing."""
    return part / whole if whole else float("nan")


def percentile(values: Float[np.ndarray, "value"], percent: int) -> float:
    """A percentile; NaN without values."""
    return float(np.percentile(values, percent)) if len(values) else float("nan")


def f1_interval(parts: Sequence[Tally], seed: int = 0) -> tuple[float, float]:
    """95 % bootstrap interval of F1, parts such as people drawn anew.

    NaN where there are no events, or only one part, which tells nothing of others.

    Args:
        parts: that do not depend on each other.
        seed: decides the draws.
    """
    counts = np.array([astuple(part) for part in parts], dtype=np.float64)
    if len(parts) < 2 or not counts.sum():
        return float("nan"), float("nan")
    matched, missed, false = draw_clusters(counts, seed).T
    whole = 2 * matched + missed + false
    f1 = 2 * matched[whole > 0] / whole[whole > 0]
    low, high = np.percentile(f1, [2.5, 97.5])
    return float(low), float(high)
