"""Small recordings of two distinct gestures, and settings to learn fast."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from eskin.learn.config import NO_AUGMENTATION, TrainConfig
from eskin.learn.dataset import Dataset
from eskin.live import HISTORY, NetworkConfig, create_empty_batch
from eskin.recording import Label, Metadata, RecordingWriter, write_all
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
RATE = 20
FIRST = 2.4  # onset of the first touch [s]
LASTS = 1.2  # length of a touch [s]
EVERY = 2.0  # from an onset to the next [s]

NETWORK = NetworkConfig(width=4, layers=1, channels=8, dropout=0.0)
AS_RECORDED = replace(NO_AUGMENTATION, crop=1.0)
TINY = TrainConfig(
    epochs=1, steps=2, batch=8, encoded=8, readings=4, ridge=0.0, network=NETWORK
)
FLAGS = tuple(
    "--train.epochs 1 --train.steps 2 --train.batch 8 --train.encoded 8 "
    "--train.readings 4 --train.ridge 0 --train.network.width 4 "
    "--train.network.layers 1 --train.network.channels 8".split()
)


def onset(index: int) -> float:
    """Return when the gesture of an index begins [s since the first scan]."""
    return FIRST + EVERY * index


def label(begin, end, gesture, source="true") -> Label:
    """Return a label by seconds since the first scan."""
    start, stop = (START + round(s * SECOND) for s in (begin, end))
    return Label(start, stop, gesture, source)


def labels_for(gestures) -> list[Label]:
    return [label(onset(i), onset(i) + LASTS, g) for i, g in enumerate(gestures)]


def pressure(skin, gesture, seconds) -> np.ndarray:
    """Return the pressure [kPa] of a broad steady `hold`, or of small repeated taps."""
    if gesture == "hold":
        centre = (0.0, 0.0)
        radius = 0.03
        kpa = 40.0
    else:
        centre = (0.015, 0.01)
        radius = 0.012
        kpa = 15.0 * (seconds % 0.4 < 0.2)
    distance = np.linalg.norm(skin.positions[:, :2] - np.array(centre), axis=1)
    return kpa * (distance < radius)


def record(
    path,
    gestures=("hold", "tap"),
    *,
    labels=None,
    subject="",
    session="",
    calibrated=False,
    kind="pressure",
    strength=1.0,
    size=(5, 6),
    notes=None,
) -> Path:
    """Write a recording of gestures one after the other."""
    skin = build_grid_skin(*size, calibrated=calibrated, kind=kind)
    rng = np.random.default_rng(0)
    scans = []
    for index in range(round((onset(len(gestures)) + 0.4) * RATE)):
        t = index / RATE
        kpa = np.zeros(skin.count)
        for number, gesture in enumerate(gestures):
            since = t - onset(number)
            if 0 <= since < LASTS:
                kpa = strength * pressure(skin, gesture, since)
        counts = np.rint(10 * kpa + rng.normal(20, 1, skin.count)).astype(np.int32)
        shear = None
        if kind == "shear":
            shear = np.stack([500 + 3 * kpa, 500 - kpa], axis=1).astype(np.int32)
        stamp = START + round(t * SECOND)
        received = np.ones(skin.count, bool)
        scans.append(Scan(stamp, counts, received, np.zeros(0), shear))
    calibration = Calibration(
        np.full(skin.count, 0.1), 4000, shear_gain=0.1, shear_rest=500
    )
    metadata = Metadata("scene", subject, session, notes=notes or {})
    with RecordingWriter(path, "table", skin, calibration, metadata) as writer:
        write_all(writer, scans, labels_for(gestures) if labels is None else labels)
    return path


def record_people(folder, names=("ann", "bob", "cleo"), **options) -> list[Path]:
    """Write one recording of each person, each pressing harder than the last."""
    folder.mkdir(parents=True, exist_ok=True)
    return [
        record(
            folder / f"{name}.mcap",
            subject=name,
            session=f"day-{i}",
            strength=1 + 0.3 * i,
            **options,
        )
        for i, name in enumerate(names)
    ]


def bare(stamps, sequence) -> Dataset:
    """Return a data set of empty graphs at some stamps [ns]."""
    n = len(stamps)
    graphs = create_empty_batch(4)._replace(
        offsets=np.zeros(n + 1, np.int64),
        seconds=np.full(n, 0.05, np.float32),
        history=np.zeros((n, len(HISTORY)), np.float32),
    )
    return Dataset((), graphs, stamps, sequence, sequence, ("none",) * n, ())
