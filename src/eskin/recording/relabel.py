"""Labelling recordings on disk: find labels, then write them next to those known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import RecordingError
from eskin.recording.autolabel import AutoLabelConfig, label_automatically
from eskin.recording.detection import DetectionRecord
from eskin.recording.labels import Label, sort_labels
from eskin.recording.ranges import rough_ranges
from eskin.recording.reader import Recording
from eskin.recording.writer import RecordingWriter, write_all
from eskin.touch.calibration import Calibrator


@dataclass(frozen=True)
class Labelling:
    """What automatic labelling says of one recording."""

    stamps: Int[np.ndarray, "reading"]
    """Of the readings [ns since the epoch]."""
    peaks: Float[np.ndarray, "reading"]
    """Largest pressure of each reading [kPa]."""
    ranges: tuple[Label, ...]
    """Where a gesture was roughly made."""
    found: tuple[Label, ...]
    """Labels of source `auto`."""


def find_labels(
    recording: Recording,
    ranges: Sequence[Label] | None = None,
    config: AutoLabelConfig | None = None,
) -> Labelling:
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
        ranges = ranges or rough_ranges(recording.labels)
    if not ranges:
        raise RecordingError(
            f"{recording.path} holds neither ranges nor true gestures; "
            "say where the gestures are with --ranges FILE"
        )
    stamps, peaks = peak_pressures(recording)
    found = label_automatically(stamps, peaks, ranges, config)
    return Labelling(stamps, peaks, tuple(ranges), found)


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


def rewrite(
    recording: Recording,
    path: Path | str | None = None,
    labels: Iterable[Label] | None = None,
    detections: Iterable[DetectionRecord] | None = None,
) -> None:
    """Write a copy of a recording with other labels or detections, whole or not at all.

    Args:
        recording: what to copy.
        path: of the copy; None replaces the recording once its copy is whole.
        labels: all labels of the copy; None keeps the recording's.
        detections: all detections of the copy; None keeps the recording's.

    Raises:
        RecordingError: when a recording that is cut short would be replaced.
    """
    target = recording.path if path is None else Path(path)
    check_target(recording, target)
    writer = RecordingWriter(
        target,
        recording.robot_name,
        recording.skin,
        recording.calibration,
        recording.metadata,
        recording.joint_names,
    )
    try:
        with writer:
            write_all(
                writer,
                recording.scans(),
                recording.labels if labels is None else labels,
                recording.detections if detections is None else detections,
                recording.truths(),
                recording.events,
            )
    except BaseException:
        writer.part.unlink(missing_ok=True)
        raise


def check_target(recording: Recording, target: Path) -> None:
    """Refuse to replace a recording by less than there was of it.

    Raises:
        RecordingError: when it is cut short and would be replaced.
    """
    if recording.truncated and target.resolve() == recording.path.resolve():
        raise RecordingError(
            f"{recording.path} is cut short and would be replaced by what is left; "
            "write the copy elsewhere"
        )
