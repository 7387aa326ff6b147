"""This module holds a recording that a person labels, and compares detections with labels."""

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
    """The labels of a recording, edited; nothing is written before `save`.

    Begins with the true labels, or the best others there are. What is saved is true,
    since a person has seen it; labels of other sources stay as they are.

    Attributes:
        recording: what is labelled.
        labels: as they are now, by start.
        changed: whether there is something to save.
    """

    def __init__(self, recording: Recording) -> None:
        """Begin with the labels in the file."""
        self.recording = recording
        self.labels = select_labels(recording.labels)
        self.changed = False

    def stamp(self, seconds: float) -> int:
        """A time of the recording as a stamp [ns since the epoch]."""
        return self.recording.start + round(seconds * NS_PER_S)

    def seconds(self, stamp: int) -> float:
        """A stamp as a time of the recording [s]."""
        return (stamp - self.recording.start) / NS_PER_S

    def add(self, gesture: str, start: float, end: float) -> Label:
        """Label a time.

        Args:
            gesture: its name.
            start: since the first reading [s].
            end: first instant after it [s].

        Raises:
            RecordingError: it ends before it starts, or another label is there.
        """
        label = Label(self.stamp(start), self.stamp(end), gesture)
        self.put((*self.labels, label))
        return label

    def mend(self, old: Label, gesture: str, start: float, end: float) -> Label:
        """Change a label.

        Args:
            old: one of `labels`.
            gesture: its name from now on.
            start: since the first reading [s].
            end: first instant after it [s].

        Raises:
            RecordingError: it would end before it starts, or another label is there.
        """
        label = Label(self.stamp(start), self.stamp(end), gesture)
        self.put((*(other for other in self.labels if other != old), label))
        return label

    def remove(self, label: Label) -> None:
        """LoadedRecording a label away."""
        self.put(tuple(other for other in self.labels if other != label))

    def put(self, labels: tuple[Label, ...]) -> None:
        """LoadedRecording these labels in place of all, if none overlap."""
        found = sort_labels(replace(label, source="true") for label in labels)
        check_no_overlap(found)
        self.labels, self.changed = found, True

    def save(self) -> Path:
        """Write the recording with these labels; where the one before it is kept.

        The first recording of all is kept beside it as `NAME.original.mcap`. The new
        one takes its place once it is whole.

        Raises:
            RecordingError: it is cut short, so that a copy would be less.
        """
        path = self.recording.path
        kept = path.with_name(f"{path.stem}.original{path.suffix}")
        others = [label for label in self.recording.labels if label.source != "true"]
        if not self.recording.truncated and not kept.exists():
            keep(path, kept)
        mine = (replace(label, source="true") for label in self.labels)
        rewrite_recording(self.recording, labels=sort_labels([*others, *mine]))
        self.recording = read_recording(path)
        self.changed = False
        return kept


def keep(path: Path, kept: Path) -> None:
    """Have a file under a second name, whatever becomes of the first."""
    try:
        os.link(path, kept)
    except OSError:
        shutil.copy2(path, kept)


LATE = 1_000_000_000
"""How long after its end a touch may still be spoken of [ns]."""


@dataclass(frozen=True)
class Pair:
    """A label and what was said of it; one of them may lack the other."""

    label: Label | None
    """What was done; None where something was said of nothing."""

    detection: DetectionRecord | None
    """What was said; None where nothing was."""

    @property
    def is_right(self) -> bool:
        """Whether the gesture that was made was said."""
        if self.label is None or self.detection is None:
            return False
        return self.label.gesture == self.detection.gesture


def compare(
    labels: Sequence[Label], detections: Sequence[DetectionRecord]
) -> tuple[Pair, ...]:
    """Pair labels with detections one to one, by time.

    A detection belongs to a label if it was said between the label's start and one
    second after its end; one of the same gesture is preferred. `none` counts on
    neither side.

    Args:
        labels: what was done.
        detections: what was said.
    """
    left = [found for found in detections if found.gesture != NONE]
    pairs = []
    for label in sorted(labels):
        if label.gesture == NONE:
            continue
        heard = [x for x in left if label.start <= x.stamp < label.end + LATE]
        best = min(
            heard, key=lambda x: (x.gesture != label.gesture, x.stamp), default=None
        )
        if best is not None:
            left.remove(best)
        pairs.append(Pair(label, best))
    pairs += [Pair(None, found) for found in left]
    return tuple(sorted(pairs, key=time_of))


def time_of(pair: Pair) -> int:
    """When it happened [ns since the epoch]."""
    if pair.label is not None:
        return pair.label.start
    return 0 if pair.detection is None else pair.detection.onset


@dataclass(frozen=True, eq=False)
class LoadedRecording:
    """Every reading of a recording."""

    seconds: Float[np.ndarray, "reading"]
    """Since the first reading [s]."""

    pressure: Float16[np.ndarray, "reading taxel"]
    """[kPa]; zero where it is not believed."""

    valid: Bool[np.ndarray, "reading taxel"]
    """Which taxels are believed."""

    q: Float[np.ndarray, "reading joint"]
    """Joint positions [rad]."""

    force: Float[np.ndarray, "reading"]
    """Of the whole skin [N]."""

    peak: Float[np.ndarray, "reading"]
    """Greatest pressure [kPa]."""

    def at(self, seconds: float) -> int:
        """The latest reading at a time [s]; the first where there is none yet."""
        return max(int(np.searchsorted(self.seconds, seconds, "right")) - 1, 0)


def load_replayed(recording: Recording) -> LoadedRecording:
    """Read and calibrate every scan.

    Raises:
        RecordingError: there is none.
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
        believed = np.where(reading.valid, np.maximum(reading.pressure, 0.0), 0.0)
        seconds[row] = (reading.stamp - recording.start) / NS_PER_S
        pressure[row], valid[row], q[row] = believed, reading.valid, reading.q
        force[row], peak[row] = believed @ areas, believed.max()
    rows = slice(count)
    return LoadedRecording(
        seconds[rows], pressure[rows], valid[rows], q[rows], force[rows], peak[rows]
    )


def envelope(
    values: Float[np.ndarray, "reading"], bins: int
) -> Float[np.ndarray, "bin"]:
    """The greatest value of each of equal parts; as many as there are, at most."""
    bins = min(bins, len(values))
    edges: Int[np.ndarray, bin] = np.linspace(0, len(values), bins, endpoint=False)
    return np.maximum.reduceat(values, edges.astype(np.int64))
