"""Make a recording and a model file in the formats that eskin writes today.

    python tests/data/make_formats.py FOLDER

The files in tests/data/formats were made by it once and stay as they are: a test reads
them, so that files of before still open. A later format gets files of its own.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from eskin.learn.checkpoint import to_model
from eskin.learn.nn import RecogniserNetwork
from eskin.live import (
    DecisionConfig,
    GraphConfig,
    ModelCard,
    NetworkConfig,
    save_model,
)
from eskin.recording import (
    DetectionRecord,
    EventRecord,
    Label,
    Metadata,
    RecordingWriter,
    TruthRecord,
    write_all,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def write_recording(path: Path) -> None:
    """Write three scans of a skin of 2 x 3 taxels and one of everything else."""
    skin = build_grid_skin(2, 3, 0.01, kind="shear", calibrated=True, name="tiny")
    calibration = Calibration(np.linspace(0.1, 0.15, 6), 4095, 0.5, 128)
    metadata = Metadata("set", "ann", "morning", "five", {"simulated": "true"})
    numbers = np.arange(6, dtype=np.int32)
    stamps = [START + n * SECOND // 50 for n in range(3)]
    scans = [
        Scan(
            stamp,
            counts=100 * n + numbers,
            received=numbers != n,
            q=np.array([0.5, -0.25 * n]),
            shear=np.stack([128 + numbers, 128 - n - numbers], axis=1),
        )
        for n, stamp in enumerate(stamps)
    ]
    detection = DetectionRecord(
        stamp=stamps[2],
        gesture="poke",
        confidence=0.875,
        onset=stamps[0],
        end=stamps[1],
        link="table",
        patch="grid",
        p_world=(0.25, 0.5, 0.75),
        n_world=(0.0, 0.0, 1.0),
        direction_world=(0.0, 1.0, 0.0),
        peak_force=2.5,
    )
    place = (0.25, -0.5, 0.0)
    truths = [
        TruthRecord(stamp, 7, "poke", "tip", "table", 1.5 + n, 2e-4, place)
        for n, stamp in enumerate(stamps)
    ]
    labels = [
        Label(stamps[0], stamps[2], "poke"),
        Label(stamps[0], stamps[2], "stroke", "auto"),
    ]
    event = EventRecord(stamps[1], "lost", "patch grid is lost", "grid", row=1)
    with RecordingWriter(
        path, "table", skin, calibration, metadata, ("a", "b")
    ) as writer:
        write_all(writer, scans, labels, [detection], truths, [event])


def write_model(path: Path) -> None:
    """Write a network of the smallest size, whose weights count from -3/8 to 3/8."""
    config = NetworkConfig(width=4, layers=1, channels=4, dropout=0.125, slots=100)
    card = ModelCard(
        vocabulary=("none", "poke", "stroke"),
        network=config,
        graph=GraphConfig(fixed=6, live=2, live_reach=0.03125),
        decision=DecisionConfig(0.75, {"poke": 0.5}, least=0.25),
        temperature=1.5,
        training={"seed": "3"},
        data_digest="ab12",
        metrics={"accuracy": 0.5, "worst": float("nan")},
    )
    model = to_model(RecogniserNetwork(config, 3, shear=False), card)
    values = np.arange(-3, 4, dtype=np.float32) / 8
    weights = {name: np.resize(values, w.shape) for name, w in model.weights.items()}
    save_model(path, replace(model, weights=weights))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    write_recording(folder / "recording_1.mcap")
    write_model(folder / "model_1.safetensors")
