"""This module edits labels of a recording and matches them with detections."""

import os
import shutil
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float16, Int

from eskin.errors import RecordingError
from eskin.labelling.autolabel import compute_readings
from eskin.recording import (
    NONE,
    DetectionRecord,
    Label,
    Recording,
    check_labels,
    check_new_name,
    read_recording,
    rewrite_recording,
    select_labels,
    sort_labels,
)
from eskin.recording.records import describe_label
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig
from eskin.units import NS_PER_S


@final
class LabelEditor:
    """Edits the labels of a recording; nothing is written before `save`.

    The editor begins with the true labels, or with the best others available. Saved
    labels are marked as true, because a person has checked them; labels of other
    sources stay unchanged.

    Attributes:
        recording: recording to label.
        vocabulary: names of gestures beside the names in its labels.
        labels: current labels, by start.
        changed: whether there are unsaved changes.
    """

    def __init__(self, recording: Recording, vocabulary: Sequence[str] = ()) -> None:
        """Start with the labels in the file.

        Args:
            recording: recording to label.
            vocabulary: names of gestures beside the names in its labels.
        """
        self.recording = recording
        self.vocabulary = tuple(vocabulary)
        self.labels = select_labels(recording.labels)
        self.changed = False
        self.previous: list[tuple[Label, ...]] = []

    def stamp(self, seconds: float) -> int:
        """Return a time since the first reading [s] as a stamp [ns since the epoch]."""
        return self.recording.start + round(seconds * NS_PER_S)

    def seconds(self, stamp: int) -> float:
        """Return a stamp [ns since the epoch] as a time since the first reading [s]."""
        return (stamp - self.recording.start) / NS_PER_S

    def span(self, label: Label) -> tuple[float, float]:
        """Return start and end of a label since the first reading [s]."""
        return self.seconds(label.start), self.seconds(label.end)

    def set_range(self, gesture: str, start: float, end: float) -> Label:
        """Give a range a gesture: change the label that it overlaps, or add one.

        Args:
            gesture: name of the gesture.
            start: start since the first reading [s].
            end: first instant after the gesture, since the first reading [s].

        Raises:
            RecordingError: the range ends before it starts, or overlaps two labels, or
                no gesture may have this name, or another label or the vocabulary
                spells it otherwise.
        """
        label = Label(self.stamp(start), self.stamp(end), gesture)
        replaced = self.find_overlapping(start, end)
        if len(replaced) > 1:
            first, second = replaced[:2]
            raise RecordingError(
                f"a label from {start:.2f} to {end:.2f} s overlaps "
                f"{describe_label(first, self.recording.start)} and "
                f"{describe_label(second, self.recording.start)}; allowed is one "
                "label, which it changes"
            )
        kept = [other for other in self.labels if other not in replaced]
        check_new_name(gesture, [*(other.gesture for other in kept), *self.vocabulary])
        self.replace_all((*kept, label))
        return label

    def find_overlapping(self, start: float, end: float) -> list[Label]:
        """Return the labels that overlap a range [s since the first reading]."""
        first, last = self.stamp(start), self.stamp(end)
        if last <= first:
            return []
        return [x for x in self.labels if x.start < last and first < x.end]

    def undo(self) -> bool:
        """Take back the last change, and return whether there was one."""
        if not self.previous:
            return False
        self.labels = self.previous.pop()
        self.changed = True
        return True

    def remove(self, *labels: Label) -> None:
        """Remove labels, as one change."""
        self.replace_all(tuple(other for other in self.labels if other not in labels))

    def replace_all(self, labels: tuple[Label, ...]) -> None:
        """Replace all labels."""
        self.previous.append(self.labels)
        self.labels = sort_labels(replace(label, source="true") for label in labels)
        self.changed = True

    def save(self) -> Path:
        """Write the recording with these labels and return the path of the original.

        The first version stays beside it as `NAME.original.mcap`. The new file
        replaces the recording once it is complete.

        Raises:
            RecordingError: the recording is truncated, so a copy would lose data, or
                the labels cannot be right.
        """
        path = self.recording.path
        own = replace(self.recording.label_set, labels=self.labels)
        check_labels([own], written=True)
        kept = path.with_name(f"{path.stem}.original{path.suffix}")
        others = [label for label in self.recording.labels if label.source != "true"]
        if not self.recording.truncated:
            try:
                os.link(path, kept)
            except FileExistsError:
                pass
            except OSError:
                shutil.copy2(path, kept)
        mine = (replace(label, source="true") for label in self.labels)
        rewrite_recording(self.recording, labels=sort_labels([*others, *mine]))
        self.recording = read_recording(path)
        self.changed = False
        return kept


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
    def time(self) -> int:
        """Start of the label, or onset of the detection [ns since the epoch]."""
        if self.label is not None:
            return self.label.start
        return 0 if self.detection is None else self.detection.onset

    @property
    def is_right(self) -> bool:
        """Return whether the detection has the gesture of the label."""
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
    found = sorted(
        (one for one in detections if one.gesture != NONE), key=lambda one: one.stamp
    )
    # Places in `found`, of all gestures and of each. Labels are visited by their start,
    # so that a detection before one of them is before the others too.
    left: dict[str | None, deque[int]] = {None: deque(range(len(found)))}
    for place, one in enumerate(found):
        left.setdefault(one.gesture, deque()).append(place)
    taken: set[int] = set()

    def take(label: Label, gesture: str | None) -> DetectionRecord | None:
        places = left.get(gesture, deque())
        while places and (places[0] in taken or found[places[0]].stamp < label.start):
            places.popleft()
        if not places or found[places[0]].stamp >= label.end + MAX_DETECTION_DELAY:
            return None
        taken.add(places[0])
        return found[places[0]]

    pairs = [
        Pair(label, take(label, label.gesture) or take(label, None))
        for label in sorted(labels)
        if label.gesture != NONE
    ]
    pairs += [Pair(None, one) for n, one in enumerate(found) if n not in taken]
    return tuple(sorted(pairs, key=lambda pair: pair.time))


MAX_LOADED_BYTES = 256 << 20
"""Largest size of the readings that are held in memory [bytes]."""


@dataclass(frozen=True, eq=False)
class LoadedRecording:
    """Holds the readings of a recording, or one of each group where there are many."""

    seconds: Float[np.ndarray, "reading"]
    """Time of each reading, or of the first of its group, since the first [s]."""
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
    group: int = 1
    """Number of readings of which the one of greatest peak is held."""

    def at(self, seconds: float) -> int:
        """Return the index of the latest reading at a time [s], at least the first."""
        return max(int(np.searchsorted(self.seconds, seconds, "right")) - 1, 0)


def load_replayed(
    recording: Recording,
    mounted: MountedSkin | None = None,
    config: PipelineConfig | None = None,
) -> LoadedRecording:
    """Compute the readings of a recording as a recogniser sees them.

    Where they take more than `MAX_LOADED_BYTES`, the one of greatest peak of each group
    of them is kept.

    Args:
        recording: recording to show.
        mounted: its skin on its robot; None for the robot of the recording.
        config: configuration of the pipeline, as of a model; None for the default.

    Raises:
        RecordingError: the recording holds no scans.
    """
    if not recording.count:
        raise RecordingError(f"{recording.path} holds no scans; allowed is one or more")
    areas = 1e3 * recording.skin.areas
    taxels = recording.skin.count
    joints = len(recording.joint_names)
    group = count_group(recording.count, taxels, joints)
    size = -(-recording.count // group)
    seconds = np.empty(size)
    q = np.empty((size, joints))
    pressure = np.zeros((size, taxels), np.float16)
    valid = np.zeros((size, taxels), np.bool_)
    force = np.zeros(size)
    peak = np.full(size, -1.0)
    rows = 0
    for number, reading in enumerate(compute_readings(recording, mounted, config)):
        row = number // group
        rows = number // group + 1
        pressures = np.where(reading.valid, np.maximum(reading.pressure, 0.0), 0.0)
        if number % group == 0:
            seconds[row] = (reading.stamp - recording.start) / NS_PER_S
        highest = pressures.max()
        if highest > peak[row]:
            pressure[row] = pressures
            valid[row] = reading.valid
            q[row] = reading.q
            force[row] = pressures @ areas
            peak[row] = highest
    columns = (seconds, pressure, valid, q, force, peak)
    return LoadedRecording(*(column[:rows] for column in columns), group=group)


def count_group(readings: int, taxels: int, joints: int) -> int:
    """Return the number of readings of which one is held, so that all fit in memory."""
    size = np.dtype(np.float64).itemsize
    row = taxels * (np.dtype(np.float16).itemsize + 1) + size * (joints + 3)
    return max(1, -(-readings * row // MAX_LOADED_BYTES))


def compute_envelope(
    values: Float[np.ndarray, "reading"], bins: int
) -> Float[np.ndarray, "bin"]:
    """Return the greatest value of each of `bins` equal parts, or all if fewer."""
    bins = min(bins, len(values))
    edges: Int[np.ndarray, bin] = np.linspace(0, len(values), bins, endpoint=False)
    return np.maximum.reduceat(values, edges.astype(np.int64))
