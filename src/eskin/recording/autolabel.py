"""The paper's automatic labelling: where the largest pressure passes a threshold.

"Within these ranges, we applied a threshold-based automatic data labeling method,
incorporating a minimum window size to mitigate noise and prevent issues such as the
separation of double-tap gestures" (the paper, Data Collection).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.recording.labels import Label, sort_labels
from eskin.units import NS_PER_S

BINS = 128


@dataclass(frozen=True)
class AutoLabelConfig:
    """What counts as a touch."""

    threshold: float | None = None
    """Largest pressure from which on the skin is touched [kPa]; None finds the value
    that parts touched from untouched best in each recording (Otsu 1979)."""

    least_threshold: float = 1.0
    """No threshold found is below this [kPa]: it would part noise from noise."""

    min_window: float = 0.5
    """Touches closer than this are one [s]. The default is the pause after which a
    touch is over everywhere in eskin, so that both pats of a double-pat are one."""

    min_touch: float = 0.05
    """Anything shorter is noise [s]. A finger needs about this long to tap."""


def label_automatically(
    stamps: Int[np.ndarray, "reading"],
    peaks: Float[np.ndarray, "reading"],
    ranges: Iterable[Label],
    config: AutoLabelConfig | None = None,
) -> tuple[Label, ...]:
    """Labels of source `auto`, each with the gesture of the range it lies in.

    Args:
        stamps: of the readings, increasing [ns since the epoch].
        peaks: largest pressure of each reading [kPa].
        ranges: where roughly something was done, and what.
        config: what counts as a touch.
    """
    config = config or AutoLabelConfig()
    ranges = sort_labels(ranges)
    if len(stamps) < 2 or not ranges:
        return ()
    insides = [(stamps >= r.start) & (stamps < r.end) for r in ranges]
    threshold = config.threshold
    if threshold is None:
        among = peaks[np.any(insides, axis=0)]
        threshold = max(config.least_threshold, best_threshold(among))
    found: list[Label] = []
    for marked, inside in zip(ranges, insides, strict=True):
        spans = touched_spans(stamps, inside & (peaks >= threshold))
        for start, end in windowed(spans, config):
            found.append(Label(start, end, marked.gesture, "auto"))
    return tuple(found)


def touched_spans(
    stamps: Int[np.ndarray, "reading"], touched: Bool[np.ndarray, "reading"]
) -> list[tuple[int, int]]:
    """Start and end [ns] of every run of touched readings."""
    ends = np.append(stamps[1:], stamps[-1] + np.median(np.diff(stamps)).astype(int))
    edges = np.diff(np.concatenate([[False], touched, [False]]).astype(np.int8))
    firsts, lasts = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(int(stamps[i]), int(ends[j])) for i, j in zip(firsts, lasts, strict=True)]


def windowed(
    spans: Sequence[tuple[int, int]], config: AutoLabelConfig
) -> list[tuple[int, int]]:
    """Spans with short gaps closed, then short spans dropped."""
    merged: list[tuple[int, int]] = []
    for start, end in spans:
        if merged and start - merged[-1][1] < config.min_window * NS_PER_S:
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((start, end))
    return [
        (start, end)
        for start, end in merged
        if end - start >= config.min_touch * NS_PER_S
    ]


def best_threshold(peaks: Float[np.ndarray, "instant"]) -> float:
    """Pressure [kPa] that parts the peaks into two groups as unlike as can be.

    Otsu 1979: the variance between the groups is largest. Taken on the logarithm, since
    touches differ by factors, not by amounts.
    """
    logs = np.log1p(np.maximum(peaks, 0.0))
    if not len(logs) or logs.max() == logs.min():
        return 0.0
    counts, edges = np.histogram(logs, BINS)
    centres = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts)[:-1].astype(np.float64)
    above = counts.sum() - below
    sums = np.cumsum(counts * centres)
    with np.errstate(invalid="ignore", divide="ignore"):
        gap = sums[:-1] / below - (sums[-1] - sums[:-1]) / above
        between = np.nan_to_num(below * above * gap**2)
    best = np.flatnonzero(between >= between.max() * (1 - 1e-12))
    return float(np.expm1(edges[1 + best].mean()))
