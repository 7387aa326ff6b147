"""This module labels recordings automatically and scores the labels that it finds.

The method is that of the paper: "Within these ranges, we applied a threshold-based
automatic data labeling method, incorporating a minimum window size to mitigate noise and
prevent issues such as the separation of double-tap gestures" (Data Collection).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import RecordingError
from eskin.recording.labels import NONE, Label, build_rough_ranges, sort_labels
from eskin.recording.reader import Recording
from eskin.touch.calibration import Calibrator
from eskin.units import NS_PER_S

BINS = 128


@dataclass(frozen=True)
class AutoLabelConfig:
    """What counts as a touch."""

    threshold: float | None = None
    """Largest pressure from which on the skin is touched [kPa]; None finds the value
    that parts touched from untouched best in each recording (Otsu 1979)."""

    min_threshold: float = 1.0
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
        threshold = max(config.min_threshold, best_threshold(among))
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


SAME = 0.5


@dataclass
class LabelAgreement:
    """Adds up over recordings; `summary` gives the figures."""

    hits: int = 0
    """Instants touched in both."""
    misses: int = 0
    """Instants touched in truth only."""
    extras: int = 0
    """Instants touched in what was found only."""
    rests: int = 0
    """Instants touched in neither."""
    overlaps: list[float] = field(default_factory=list)
    """Intersection over union of every true event and the one matched to it."""
    onset_errors: list[float] = field(default_factory=list)
    """Onset found minus true onset of every matched event [s]."""
    found_events: int = 0
    """Number of events found."""

    @property
    def instants(self) -> int:
        """Number of instants judged."""
        return self.hits + self.misses + self.extras + self.rests

    def add(
        self,
        truth: Sequence[Label],
        found: Sequence[Label],
        stamps: Int[np.ndarray, "reading"],
    ) -> None:
        """Add one recording."""
        is_true, is_found = touched(truth, stamps), touched(found, stamps)
        self.hits += int((is_true & is_found).sum())
        self.misses += int((is_true & ~is_found).sum())
        self.extras += int((~is_true & is_found).sum())
        self.rests += int((~is_true & ~is_found).sum())
        events = [label for label in truth if label.gesture != NONE]
        matches = match(events, found)
        for event, best in zip(events, matches, strict=True):
            self.overlaps.append(0.0 if best is None else overlap(event, best))
            if best is not None:
                self.onset_errors.append((best.start - event.start) / NS_PER_S)
        self.found_events += len(found)

    def summary(self) -> dict[str, float | int | None]:
        """Figures by name; None where there is nothing to judge.

        Instants are judged as touched or not, since the gesture comes from the range.
        """
        recall = ratio(self.hits, self.hits + self.misses)
        rest_recall = ratio(self.rests, self.rests + self.extras)
        same = sum(value >= SAME for value in self.overlaps)
        return {
            "instants": self.instants,
            "accuracy": ratio(self.hits + self.rests, self.instants),
            "balanced_accuracy": mean([recall, rest_recall]),
            "touched_recall": recall,
            "untouched_recall": rest_recall,
            "events": len(self.overlaps),
            "events_found": self.found_events,
            "event_iou": mean(self.overlaps),
            "event_recall": ratio(same, len(self.overlaps)),
            "event_precision": ratio(same, self.found_events),
            "onset_error_s": median(np.abs(self.onset_errors).tolist()),
            "onset_bias_s": median(self.onset_errors),
        }


def touched(
    labels: Sequence[Label], stamps: Int[np.ndarray, "reading"]
) -> Bool[np.ndarray, "reading"]:
    """Whether any gesture is made at each stamp."""
    inside = np.zeros(len(stamps), dtype=np.bool_)
    for label in labels:
        if label.gesture != NONE:
            inside |= (stamps >= label.start) & (stamps < label.end)
    return inside


def match(truth: Sequence[Label], found: Sequence[Label]) -> list[Label | None]:
    """For each true label the one found that is its, one to one, best overlap first."""
    pairs = [
        (overlap(event, other), i, j)
        for i, event in enumerate(truth)
        for j, other in enumerate(found)
        if event.gesture == other.gesture and overlap(event, other) > 0
    ]
    matches: list[Label | None] = [None] * len(truth)
    taken: set[int] = set()
    for _, i, j in sorted(pairs, key=lambda pair: (-pair[0], pair[1:])):
        if matches[i] is None and j not in taken:
            matches[i] = found[j]
            taken.add(j)
    return matches


def overlap(one: Label, other: Label) -> float:
    """Intersection over union in time."""
    shared = min(one.end, other.end) - max(one.start, other.start)
    if shared <= 0:
        return 0.0
    return shared / (max(one.end, other.end) - min(one.start, other.start))


def ratio(part: int, whole: int) -> float | None:
    """A share, None of nothing."""
    return part / whole if whole else None


def mean(values: Sequence[float | None]) -> float | None:
    """The mean of those that are known."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def median(values: Sequence[float]) -> float | None:
    """The median, None of nothing."""
    return float(np.median(values)) if len(values) else None


@dataclass(frozen=True)
class AutoLabelResult:
    """What automatic labelling says of one recording."""

    stamps: Int[np.ndarray, "reading"]
    """Of the readings [ns since the epoch]."""
    peaks: Float[np.ndarray, "reading"]
    """Largest pressure of each reading [kPa]."""
    ranges: tuple[Label, ...]
    """Where a gesture was roughly made."""
    found: tuple[Label, ...]
    """Labels of source `auto`."""


def label_recording(
    recording: Recording,
    ranges: Sequence[Label] | None = None,
    config: AutoLabelConfig | None = None,
) -> AutoLabelResult:
    """Label a recording automatically; nothing is written.

    Args:
        recording: what to label.
        ranges: where gestures were roughly made; None takes the recording's own labels
            of source `range`, or else its true labels, widened and joined.
        config: what counts as a touch.

    Raises:
        RecordingError: when nothing says where and what.
    """
    if ranges is None:
        ranges = sort_labels(recording.labels, "range")
        ranges = ranges or build_rough_ranges(recording.labels)
    if not ranges:
        raise RecordingError(
            f"{recording.path} holds neither ranges nor true gestures; "
            "say where the gestures are with --ranges FILE"
        )
    stamps, peaks = peak_pressures(recording)
    found = label_automatically(stamps, peaks, ranges, config)
    return AutoLabelResult(stamps, peaks, tuple(ranges), found)


def peak_pressures(
    recording: Recording,
) -> tuple[Int[np.ndarray, "reading"], Float[np.ndarray, "reading"]]:
    """Stamps [ns] and largest valid pressure [kPa] of all readings, calibrated."""
    calibrator = Calibrator(recording.skin, recording.calibration)
    stamps: list[int] = []
    peaks: list[float] = []
    for scan in recording.scans():
        reading = calibrator.push(scan)
        stamps.append(reading.stamp)
        peaks.append(float(reading.pressure.max(initial=0.0, where=reading.valid)))
    return np.array(stamps, dtype=np.int64), np.array(peaks, dtype=np.float64)
