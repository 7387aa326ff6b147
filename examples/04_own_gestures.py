"""Teach gestures of your own, from a few repetitions of each.

    python examples/04_own_gestures.py

A finger knocks on a panel or circles on it, a palm rests there, five times each. The
weights that come with eskin learn the two gestures and that the palm is none, then
recognise nine touches that they have not seen. With hardware, `eskin record` asks a
person for the gestures and writes such a recording.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

import eskin
from eskin.learn.config import TrainConfig
from eskin.recording import Label, Metadata, write_all
from eskin.skin import build_grid_skin

RATE = 50  # scans a second [Hz]
PERIOD = 20_000_000  # from one scan to the next [ns]
SKIN = build_grid_skin(12, 16, calibrated=True)
CALIBRATION = eskin.Calibration.uniform(SKIN.count, 4095, 100.0)


@dataclass(frozen=True)
class Example:
    """Teach gestures of your own."""

    train: TrainConfig = TrainConfig(epochs=3, encoded=8, readings=12, validation=0.0)
    """Encodes few graphs, which is quick."""


def press(name: str, part: float) -> np.ndarray:
    """Return the counts that a gesture adds; `part` of its second has passed."""
    turn = 2 * np.pi * part
    x, y = 0.02 * np.array([np.cos(turn), np.sin(turn)]) * (name == "circle")
    width = 0.03 if name == "none" else 0.01
    lifted = name == "knock" and part % 0.3 > 0.12
    distance = np.linalg.norm(SKIN.positions - (x, y, 0.0), axis=1)
    return 1500 * (not lifted) * np.exp(-((distance / width) ** 2))


def perform(names: list[str], seed: int) -> tuple[list[eskin.Scan], list[Label]]:
    """Return the scans of gestures, one in 3 s after 2 s of rest, and their labels."""
    rng = np.random.default_rng(seed)
    received = np.ones(SKIN.count, bool)
    scans = []
    labels = []
    for number, name in enumerate(names):
        strength = rng.normal(1.0, 0.15)
        begin = (3 * number + 2) * RATE
        labels.append(Label(begin * PERIOD, (begin + RATE) * PERIOD, name))
        for index in range(3 * number * RATE, begin + RATE):
            counts = rng.normal(200, 1.5, SKIN.count)
            if index >= begin:
                counts += strength * press(name, (index - begin) / RATE)
            scans.append(
                eskin.Scan(index * PERIOD, np.int32(counts), received, np.zeros(0))
            )
    return scans, labels


def main(example: Example) -> None:
    """Record, train, recognise."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mine.mcap"
        with eskin.RecordingWriter(
            path, "table", SKIN, CALIBRATION, Metadata("mine", "me")
        ) as writer:
            write_all(writer, *perform(["knock", "circle", "none"] * 5, seed=0))
        model = eskin.train(path, "ur5", config=example.train)

    skin = eskin.MountedSkin(SKIN, eskin.load_robot("table"))
    recognizer = eskin.Recognizer(model, skin, CALIBRATION)
    scans, labels = perform(["circle", "none", "knock"] * 3, seed=1)
    found = [detection for scan in scans for detection in recognizer.push(scan)]
    print("made:      ", *(label.gesture for label in labels))
    print("recognised:", *(d.gesture for d in found + recognizer.finish()))


if __name__ == "__main__":
    main(tyro.cli(Example))
