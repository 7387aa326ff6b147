"""True events and detections on a table, by seconds and metres along it."""

import numpy as np

from eskin.learn.events import ScoredStream, TrueEvent
from eskin.live import Detection
from eskin.recording import (
    Metadata,
    RecordingWriter,
    TruthRecord,
    read_recording,
    write_all,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
VOCABULARY = ("none", "poke", "stroke", "grab")


def stamp(seconds) -> int:
    return START + round(seconds * SECOND)


def make_event(onset, end, gesture="poke", x=0.0, to=None, kind="") -> TrueEvent:
    """Return a touch that moves from one place to another, sampled at 50 Hz."""
    times = np.arange(onset, end + 0.01, 0.02)
    path = np.zeros((len(times), 3))
    path[:, 0] = np.linspace(x, x if to is None else to, len(times))
    stamps = np.array([stamp(t) for t in times])
    return TrueEvent(stamp(onset), stamp(end), gesture, kind, stamps, path)


def make_detection(
    at, gesture="poke", x=0.0, onset=None, end=None, confidence=0.9
) -> Detection:
    """Return a detection made at a time, of a touch that began a moment before."""
    return Detection(
        stamp=stamp(at),
        touch=1,
        gesture=gesture,
        confidence=confidence,
        onset=stamp(at - 0.2 if onset is None else onset),
        end=stamp(at if end is None else end),
        link="table",
        patch="grid",
        p_world=np.array([x, 0.0, 0.0]),
        n_world=np.array([0.0, 0.0, 1.0]),
        direction_world=np.zeros(3),
        peak_force=1.0,
    )


def make_stream(events, detections, seconds=3600.0, subject="ann") -> ScoredStream:
    return ScoredStream(tuple(events), list(detections), seconds, subject)


def detect_each(events, gestures=None) -> list[Detection]:
    """Return a detection at the end of each event, of its gesture or another one."""
    return [
        make_detection(
            (event.end - START) / SECOND + 0.1,
            event.gesture if gestures is None else gestures[index],
            event.path[-1, 0],
            (event.onset - START) / SECOND,
            (event.end - START) / SECOND,
        )
        for index, event in enumerate(events)
    ]


def make_truth(seconds, touch, gesture="poke", p_world=(0.0, 0.0, 0.0), kind="tip"):
    """Return the record of a true touch at a time."""
    place = tuple(map(float, p_world))
    return TruthRecord(stamp(seconds), touch, gesture, kind, "table", 1.0, 1e-4, place)


def record_events(path, truths=(), labels=(), simulated=True):
    """Write a recording of two scans with true touches and labels; read it."""
    skin = build_grid_skin(2, 2)
    metadata = Metadata("scene", notes={"simulated": "true"} if simulated else {})
    calibration = Calibration.uniform(skin.count, 4095, 100.0)
    counts = np.zeros(skin.count, np.int32)
    received = np.ones(skin.count, bool)
    with RecordingWriter(path, "table", skin, calibration, metadata) as writer:
        scans = [
            Scan(stamp, counts, received, np.zeros(0))
            for stamp in (START, START + 60 * SECOND)
        ]
        write_all(writer, scans, labels)
        for truth in truths:
            writer.write_truth(truth)
    return read_recording(path)
