"""This module labels recordings automatically and scores the labels that it finds.

The method comes from Jiang et al. 2025 (section IV-D, Fig. 10): "Within these ranges,
we applied a threshold-based automatic data labeling method, incorporating a minimum
window size to mitigate noise and prevent issues such as the separation of double-tap
gestures".
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import RecordingError
from eskin.recording.label_check import check_labels
from eskin.recording.reader import Recording
from eskin.recording.records import NONE, Label, build_rough_ranges, sort_labels
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, Reading, TouchPipeline
from eskin.units import NS_PER_S

HISTOGRAM_BINS = 128
MIN_IOU = 0.5
"""Intersection over union from which a found label counts as a true one."""


@dataclass(frozen=True)
class AutoLabelConfig:
    """Parameters that decide which readings are touched."""

    threshold: float | None = None
    """Peak pressure from which the skin counts as touched [kPa]; None finds the value
    that separates touched from untouched best in each recording (Otsu 1979)."""
    min_threshold: float = 1.0
    """Lower limit of a threshold that is found [kPa]; below it there is only noise."""
    min_window: float = 0.5
    """Longest gap inside a touch [s]. The default is the pause after which eskin closes
    a touch, so both pats of a double-pat are one touch."""
    min_touch: float = 0.05
    """Shortest touch [s]; anything shorter is noise. A tap takes about as long."""


def label_automatically(
    stamps: Int[np.ndarray, "reading"],
    peaks: Float[np.ndarray, "reading"],
    ranges: Iterable[Label],
    config: AutoLabelConfig | None = None,
) -> tuple[Label, ...]:
    """Build labels of source `auto`, each with the gesture of the range it lies in.

    Fig. 10 of Jiang et al. 2025 shows such labels.

    Args:
        stamps: stamps of the readings, increasing [ns since the epoch].
        peaks: largest pressure of each reading [kPa].
        ranges: rough ranges of the gestures.
        config: parameters that decide what is a touch.
    """
    config = config or AutoLabelConfig()
    ranges = sort_labels(ranges)
    if len(stamps) < 2 or not ranges:
        return ()
    ends = np.append(stamps[1:], stamps[-1] + np.median(np.diff(stamps)).astype(int))
    insides = [find_slice(stamps, marked) for marked in ranges]
    threshold = config.threshold
    if threshold is None:
        among = peaks[find_inside(stamps, ranges)]
        threshold = max(config.min_threshold, compute_otsu_threshold(among))
    found: list[Label] = []
    for marked, inside in zip(ranges, insides, strict=True):
        spans = find_touched_spans(stamps, ends, peaks >= threshold, inside)
        for start, end in merge_spans(spans, config):
            found.append(Label(start, end, marked.gesture, "auto"))
    return tuple(found)


def find_slice(stamps: Int[np.ndarray, "reading"], marked: Label) -> slice:
    """Return which readings lie in a label, given that stamps increase."""
    first, end = np.searchsorted(stamps, (marked.start, marked.end))
    return slice(int(first), int(end))


def find_inside(
    stamps: Int[np.ndarray, "reading"], labels: Iterable[Label]
) -> Bool[np.ndarray, "reading"]:
    """Return for each reading whether it lies in any label, as stamps increase."""
    inside = np.zeros(len(stamps), dtype=np.bool_)
    for label in labels:
        inside[find_slice(stamps, label)] = True
    return inside


def find_touched_spans(
    stamps: Int[np.ndarray, "reading"],
    ends: Int[np.ndarray, "reading"],
    touched: Bool[np.ndarray, "reading"],
    inside: slice,
) -> list[tuple[int, int]]:
    """Return start and end [ns] of every run of touched readings in a slice."""
    edges = np.diff(np.pad(touched[inside], 1).astype(np.int8))
    firsts = np.flatnonzero(edges == 1)
    lasts = np.flatnonzero(edges == -1) - 1
    begun = stamps[inside][firsts]
    ended = ends[inside][lasts]
    return list(zip(begun.tolist(), ended.tolist(), strict=True))


def merge_spans(
    spans: Sequence[tuple[int, int]], config: AutoLabelConfig
) -> list[tuple[int, int]]:
    """Close short gaps between spans, then drop short spans."""
    merged: list[tuple[int, int]] = []
    for start, end in spans:
        if merged and start - merged[-1][1] < config.min_window * NS_PER_S:
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((start, end))
    shortest = config.min_touch * NS_PER_S
    return [(start, end) for start, end in merged if end - start >= shortest]


def compute_otsu_threshold(peaks: Float[np.ndarray, "instant"]) -> float:
    """Return the pressure [kPa] that separates the peaks into two groups.

    It maximises the variance between the groups (Otsu 1979) of the logarithm, since the
    pressures of touches differ by factors.
    """
    logs = np.log1p(np.maximum(peaks, 0.0))
    if not len(logs) or logs.max() == logs.min():
        return 0.0
    counts, edges = np.histogram(logs, HISTOGRAM_BINS)
    centres = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts)[:-1].astype(np.float64)
    above = counts.sum() - below
    sums = np.cumsum(counts * centres)
    with np.errstate(invalid="ignore", divide="ignore"):
        gap = sums[:-1] / below - (sums[-1] - sums[:-1]) / above
        between = np.nan_to_num(below * above * gap**2)
    best = np.flatnonzero(between >= between.max() * (1 - 1e-12))
    return float(np.expm1(edges[1 + best].mean()))


@dataclass
class LabelAgreement:
    """Scores found labels against true ones, summed over recordings."""

    confusion: Int[np.ndarray, "2 2"] = field(
        default_factory=lambda: np.zeros((2, 2), np.int64)
    )
    """Numbers of readings: row 1 is touched in truth, column 1 in the labels found."""
    ious: list[float] = field(default_factory=list)
    """Intersection over union of every true event and the one matched to it."""
    onset_errors: list[float] = field(default_factory=list)
    """Onset found minus true onset of every matched event [s]."""
    found_events: int = 0
    """Number of events found."""

    @property
    def instants(self) -> int:
        """Number of readings scored."""
        return int(self.confusion.sum())

    def add_recording(
        self,
        truth: Sequence[Label],
        found: Sequence[Label],
        stamps: Int[np.ndarray, "reading"],
    ) -> None:
        """Add one recording."""
        touched = find_touched(truth, stamps), find_touched(found, stamps)
        np.add.at(self.confusion, tuple(side.astype(np.int64) for side in touched), 1)
        events = [label for label in truth if label.gesture != NONE]
        matches = match_labels(events, found)
        for event, best in zip(events, matches, strict=True):
            self.ious.append(0.0 if best is None else compute_iou(event, best))
            if best is not None:
                self.onset_errors.append((best.start - event.start) / NS_PER_S)
        self.found_events += len(found)

    def summary(self) -> dict[str, float | int | None]:
        """Return the scores by name; None where there is nothing to score.

        Readings are scored as touched or not, since the gesture comes from the range.
        """
        (rest, extra), (missed, hit) = self.confusion.tolist()
        recall = divide_or_none(hit, hit + missed)
        rest_recall = divide_or_none(rest, rest + extra)
        same = sum(value >= MIN_IOU for value in self.ious)
        return {
            "instants": self.instants,
            "accuracy": divide_or_none(hit + rest, self.instants),
            "balanced_accuracy": mean_or_none([recall, rest_recall]),
            "touched_recall": recall,
            "untouched_recall": rest_recall,
            "events": len(self.ious),
            "events_found": self.found_events,
            "event_iou": mean_or_none(self.ious),
            "event_recall": divide_or_none(same, len(self.ious)),
            "event_precision": divide_or_none(same, self.found_events),
            "onset_error_s": median_or_none(np.abs(self.onset_errors).tolist()),
            "onset_bias_s": median_or_none(self.onset_errors),
        }


def find_touched(
    labels: Sequence[Label], stamps: Int[np.ndarray, "reading"]
) -> Bool[np.ndarray, "reading"]:
    """Return for each stamp whether any gesture is made."""
    return find_inside(stamps, (x for x in labels if x.gesture != NONE))


def match_labels(truth: Sequence[Label], found: Sequence[Label]) -> list[Label | None]:
    """Match each true label to at most one label found, best overlap first."""
    pairs = [
        (compute_iou(event, other), i, j)
        for i, event in enumerate(truth)
        for j, other in enumerate(found)
        if event.gesture == other.gesture and compute_iou(event, other) > 0
    ]
    matches: list[Label | None] = [None] * len(truth)
    taken: set[int] = set()
    for _, i, j in sorted(pairs, key=lambda pair: (-pair[0], pair[1:])):
        if matches[i] is None and j not in taken:
            matches[i] = found[j]
            taken.add(j)
    return matches


def compute_iou(one: Label, other: Label) -> float:
    """Return the intersection over union of two labels in time."""
    shared = min(one.end, other.end) - max(one.start, other.start)
    if shared <= 0:
        return 0.0
    return shared / (max(one.end, other.end) - min(one.start, other.start))


def divide_or_none(part: int, whole: int) -> float | None:
    """Return a ratio; None if the whole is 0."""
    return part / whole if whole else None


def mean_or_none(values: Sequence[float | None]) -> float | None:
    """Return the mean of the known values; None without any."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def median_or_none(values: Sequence[float]) -> float | None:
    """Return the median; None without values."""
    return float(np.median(values)) if len(values) else None


@dataclass(frozen=True)
class AutoLabelResult:
    """The labels found in one recording, with their stamps and rough ranges."""

    stamps: Int[np.ndarray, "reading"]
    """Stamps of the readings [ns since the epoch]."""
    ranges: tuple[Label, ...]
    """Rough ranges of the gestures."""
    found: tuple[Label, ...]
    """Labels of source `auto`."""


def label_recording(
    recording: Recording,
    ranges: Sequence[Label] | None = None,
    config: AutoLabelConfig | None = None,
    place: Path | None = None,
) -> AutoLabelResult:
    """Label a recording automatically; nothing is written.

    Args:
        recording: recording to label.
        ranges: rough ranges of the gestures; None takes the recording's own labels of
            source `range`, or else its true labels, widened and joined.
        config: parameters that decide what is a touch.
        place: file of the ranges, which messages name; None for the recording.

    Raises:
        RecordingError: there are neither ranges nor true gestures, or ranges or true
            labels that cannot be right.
    """
    if ranges is None:
        ranges = sort_labels(recording.labels, "range")
        ranges = ranges or build_rough_ranges(recording.labels)
    if not ranges:
        raise RecordingError(
            f"{recording.path} holds neither ranges nor true gestures; "
            "say where the gestures are with --ranges FILE"
        )
    own = recording.label_set
    kept = replace(own, labels=sort_labels(own.labels, "true"))
    marked = replace(own, labels=tuple(ranges), path=place or own.path)
    check_labels([kept], written=True)
    check_labels([marked], written=True)
    stamps, peaks = compute_peak_pressures(recording)
    found = label_automatically(stamps, peaks, ranges, config)
    check_labels([replace(own, labels=found)], written=True)
    return AutoLabelResult(stamps, tuple(ranges), found)


def compute_readings(
    recording: Recording,
    mounted: MountedSkin | None = None,
    config: PipelineConfig | None = None,
) -> Iterator[Reading]:
    """Compute the reading of every scan as a recogniser sees it, one after the other.

    Args:
        recording: recording that is read.
        mounted: its skin on its robot; None mounts it on the robot of the recording.
        config: configuration of the pipeline, as of a model; None for the default.

    Raises:
        RobotError: the recording does not hold its robot.
    """
    mounted = mounted or MountedSkin(recording.skin, recording.load_robot())
    pipeline = TouchPipeline(mounted, recording.calibration, config)
    for scan in recording.scans():
        yield pipeline.push_scan(scan).reading


def compute_peak_pressures(
    recording: Recording,
) -> tuple[Int[np.ndarray, "reading"], Float[np.ndarray, "reading"]]:
    """Return stamps [ns] and largest valid pressure [kPa] of all readings."""
    pairs = [
        (reading.stamp, reading.pressure.max(initial=0.0, where=reading.valid))
        for reading in compute_readings(recording)
    ]
    stamps, peaks = zip(*pairs, strict=True) if pairs else ((), ())
    return np.array(stamps, dtype=np.int64), np.array(peaks, dtype=np.float64)
