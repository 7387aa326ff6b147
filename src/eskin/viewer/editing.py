"""This module edits labels of a recording and matches them with detections."""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float16, Int

from eskin.errors import RecordingError
from eskin.recording import (
    NONE,
    DetectionRecord,
    Label,
    Recording,
    check_no_overlap,
    read_recording,
    rewrite_recording,
    select_labels,
    sort_labels,
)
from eskin.touch import Calibrator
from eskin.units import NS_PER_S


@final
class LabelEditor:
    """Edits the labels of a recording; nothing is written before `save`.

    The editor begins with the true labels, or with the best others available. Saved
    labels are marked as true, because a person has checked them; labels of other
    sources stay unchanged.

    Attributes:
        recording: recording to label.
        labels: current labels, by start.
        changed: whether there are unsaved changes.
    """

    def __init__(self, recording: Recording) -> None:
        """Start with the labels in the file."""
        self.recording = recording
        self.labels = select_labels(recording.labels)
        self.changed = False

    def stamp(self, seconds: float) -> int:
        """Return a time since the first reading [s] as a stamp [ns since the epoch]."""
        return self.recording.start + round(seconds * NS_PER_S)

    def seconds(self, stamp: int) -> float:
        """Return a stamp [ns since the epoch] as a time since the first reading [s]."""
        return (stamp - self.recording.start) / NS_PER_S

    def add(self, gesture: str, start: float, end: float) -> Label:
        """Add a label.

        Args:
            gesture: name of the gesture.
            start: start since the first reading [s].
            end: first instant after the gesture, since the first reading [s].

        Raises:
            RecordingError: the label ends before it starts, or overlaps another.
        """
        label = Label(self.stamp(start), self.stamp(end), gesture)
        self.replace_all((*self.labels, label))
        return label

    def change(self, old: Label, gesture: str, start: float, end: float) -> Label:
        """Change a label.

        Args:
            old: label to change, one of `labels`.
            gesture: new name of the gesture.
            start: new start since the first reading [s].
            end: first instant after the gesture, since the first reading [s].

        Raises:
            RecordingError: the label would end before it starts, or overlap another.
        """
        label = Label(self.stamp(start), self.stamp(end), gesture)
        self.replace_all((*(other for other in self.labels if other != old), label))
        return label

    def remove(self, label: Label) -> None:
        """Remove a label."""
        self.replace_all(tuple(other for other in self.labels if other != label))

    def replace_all(self, labels: tuple[Label, ...]) -> None:
        """Replace all labels, unless some of the new ones overlap."""
        found = sort_labels(replace(label, source="true") for label in labels)
        check_no_overlap(found)
        self.labels, self.changed = found, True

    def save(self) -> Path:
        """Write the recording with these labels and return the path of the original.

        The first version stays beside it as `NAME.original.mcap`. The new file
        replaces the recording once it is complete.

        Raises:
            RecordingError: the recording is truncated, so a copy would lose data.
        """
        path = self.recording.path
        kept = path.with_name(f"{path.stem}.original{path.suffix}")
        others = [label for label in self.recording.labels if label.source != "true"]
        if not self.recording.truncated and not kept.exists():
            link_or_copy(path, kept)
        mine = (replace(label, source="true") for label in self.labels)
        rewrite_recording(self.recording, labels=sort_labels([*others, *mine]))
        self.recording = read_recording(path)
        self.changed = False
        return kept


def link_or_copy(path: Path, kept: Path) -> None:
    """Keep a file under a second name, by a hard link or a copy."""
    try:
        os.link(path, kept)
    except OSError:
        shutil.copy2(path, kept)


MAX_DETECTION_DELAY = 1_000_000_000
"""Longest time between the end of a touch and its detection [ns]."""


@dataclass(frozen=True)
class Pair:
    """Pairs a label with its detection; one of them may be missing."""

    label: Label | None
    """Label; None for a detection without a touch."""
    detection: DetectionRecord | None
    """Detection; None for a touch without a detection."""

    @property
    def is_right(self) -> bool:
        """Whether the detection has the gesture of the label."""
        if self.label is None or self.detection is None:
            return False
        return self.label.gesture == self.detection.gesture


def match_detections(
    labels: Sequence[Label], detections: Sequence[DetectionRecord]
) -> tuple[Pair, ...]:
    """Pair labels with detections one to one, by time.

    A detection belongs to a label if its stamp lies between the label's start and one
    second after its end; one of the same gesture is preferred. `none` is ignored on
    both sides.

    Args:
        labels: labels of the recording.
        detections: detections in the recording.
    """
    left = [found for found in detections if found.gesture != NONE]
    pairs = []
    for label in sorted(labels):
        if label.gesture == NONE:
            continue
        candidates = [
            x for x in left if label.start <= x.stamp < label.end + MAX_DETECTION_DELAY
        ]
        best = min(
            candidates,
            key=lambda x: (x.gesture != label.gesture, x.stamp),
            default=None,
        )
        if best is not None:
            left.remove(best)
        pairs.append(Pair(label, best))
    pairs += [Pair(None, found) for found in left]
    return tuple(sorted(pairs, key=find_time))


def find_time(pair: Pair) -> int:
    """Return the time of a pair [ns since the epoch]."""
    if pair.label is not None:
        return pair.label.start
    return 0 if pair.detection is None else pair.detection.onset


@dataclass(frozen=True, eq=False)
class LoadedRecording:
    """Holds every reading of a recording."""

    seconds: Float[np.ndarray, "reading"]
    """Time of each reading since the first [s]."""
    pressure: Float16[np.ndarray, "reading taxel"]
    """Pressure of each taxel [kPa]; zero where it is not valid."""
    valid: Bool[np.ndarray, "reading taxel"]
    """Validity of each taxel."""
    q: Float[np.ndarray, "reading joint"]
    """Joint positions [rad]."""
    force: Float[np.ndarray, "reading"]
    """Force on the whole skin [N]."""
    peak: Float[np.ndarray, "reading"]
    """Greatest pressure [kPa]."""

    def at(self, seconds: float) -> int:
        """Return the index of the latest reading at a time [s], at least the first."""
        return max(int(np.searchsorted(self.seconds, seconds, "right")) - 1, 0)


def load_replayed(recording: Recording) -> LoadedRecording:
    """Read and calibrate every scan of a recording.

    Raises:
        RecordingError: the recording holds no scans.
    """
    if not recording.count:
        raise RecordingError(
            f"{recording.path} holds no scans; allowed is one or more; give another"
        )
    calibrator = Calibrator(recording.skin, recording.calibration)
    areas = 1e3 * recording.skin.areas
    taxels, joints = recording.skin.count, len(recording.joint_names)
    seconds, q = np.empty(recording.count), np.empty((recording.count, joints))
    pressure = np.zeros((recording.count, taxels), np.float16)
    valid = np.zeros((recording.count, taxels), np.bool_)
    force, peak = np.zeros(recording.count), np.zeros(recording.count)
    count = 0
    for count, scan in enumerate(recording.scans(), 1):
        reading = calibrator.push(scan)
        row = count - 1
        pressures = np.where(reading.valid, np.maximum(reading.pressure, 0.0), 0.0)
        seconds[row] = (reading.stamp - recording.start) / NS_PER_S
        pressure[row], valid[row], q[row] = pressures, reading.valid, reading.q
        force[row], peak[row] = pressures @ areas, pressures.max()
    columns = (seconds, pressure, valid, q, force, peak)
    return LoadedRecording(*(column[:count] for column in columns))


def compute_envelope(
    values: Float[np.ndarray, "reading"], bins: int
) -> Float[np.ndarray, "bin"]:
    """Return the greatest value of each of `bins` equal parts, or all if fewer."""
    bins = min(bins, len(values))
    edges: Int[np.ndarray, bin] = np.linspace(0, len(values), bins, endpoint=False)
    return np.maximum.reduceat(values, edges.astype(np.int64))
