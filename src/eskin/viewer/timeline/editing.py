"""Labels of a recording as a person sets and mends them."""

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import final

from eskin.recording import (
    Label,
    Recording,
    check_no_overlap,
    read_recording,
    rewrite_recording,
    select_labels,
    sort_labels,
)
from eskin.units import NS_PER_S


@final
class Editing:
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
        """Take a label away."""
        self.put(tuple(other for other in self.labels if other != label))

    def put(self, labels: tuple[Label, ...]) -> None:
        """Take these labels in place of all, if none overlap."""
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
