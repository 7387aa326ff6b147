"""A recording of presses on a small skin, with labels and detections."""

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


def stamp(seconds):
    return START + round(seconds * SECOND)


def said(gesture, onset, at):
    """A detection of a gesture that began at a time and was said at another [s]."""
    zero = (0.0, 0.0, 0.0)
    return DetectionRecord(
        stamp=stamp(at),
        gesture=gesture,
        confidence=0.9,
        onset=stamp(onset),
        end=stamp(at),
        link="table",
        patch="grid",
        p_world=zero,
        n_world=zero,
        direction_world=zero,
        peak_force=5.0,
    )


def write_recording(path, presses, detections=(), labels=None, seconds=6.0):
    """Presses are (gesture, start, end) [s]; each loads ten taxels by 20 kPa."""
    skin = build_grid_skin(6, 8)
    calibration = Calibration(np.full(skin.count, 0.1), 4000)
    scans = []
    for index in range(round(seconds * RATE)):
        now = index / RATE
        counts = np.full(skin.count, 100, np.int32)
        if any(start <= now < end for _, start, end in presses):
            counts[:10] = 300
        every = np.ones(skin.count, bool)
        scans.append(Scan(stamp(now), counts, every, np.zeros(0)))
    if labels is None:
        labels = [Label(stamp(a), stamp(b), name) for name, a, b in presses]
    writer = RecordingWriter(
        path, "table", skin, calibration, Metadata("set", "P1", "one"), ()
    )
    with writer:
        write_all(writer, scans, labels, detections)
    return path
