"""Recordings of presses on a small skin, with labels and detections."""

import numpy as np

from eskin.recording import (
    DetectionRecord,
    Label,
    Metadata,
    RecordingWriter,
    write_all,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
RATE = 50
SKIN = build_grid_skin(6, 8)
COUNTS_PER_KPA = 10


def to_stamp(seconds):
    return START + round(seconds * SECOND)


def make_label(gesture, start, end, source="true"):
    return Label(to_stamp(start), to_stamp(end), gesture, source)


def make_detection(gesture, onset, stamp):
    """Return a detection of a gesture by its onset and its time [s]."""
    zero = (0.0, 0.0, 0.0)
    return DetectionRecord(
        stamp=to_stamp(stamp),
        gesture=gesture,
        confidence=0.9,
        onset=to_stamp(onset),
        end=to_stamp(stamp),
        link="table",
        patch="grid",
        p_world=zero,
        n_world=zero,
        direction_world=zero,
        peak_force=5.0,
    )


def write_recording(path, labels, detections=(), seconds=6.0):
    """Write a recording in which ten taxels are loaded by 20 kPa during each label."""
    received = np.ones(SKIN.count, bool)
    scans = []
    for stamp in (to_stamp(index / RATE) for index in range(round(seconds * RATE))):
        counts = np.full(SKIN.count, 100, np.int32)
        if any(label.start <= stamp < label.end for label in labels):
            counts[:10] += 20 * COUNTS_PER_KPA
        scans.append(Scan(stamp, counts, received, np.zeros(0)))
    calibration = Calibration(np.full(SKIN.count, 1 / COUNTS_PER_KPA), 4000)
    metadata = Metadata("set", "P1", "one")
    with RecordingWriter(path, "table", SKIN, calibration, metadata, ()) as writer:
        write_all(writer, scans, labels, detections)
    return path
