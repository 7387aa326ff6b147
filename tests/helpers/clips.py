"""Small generated sets of clips, and data sets of rows of known force."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Clip
from eskin.live import HISTORY, GraphBatch
from eskin.sim.dataset import GenerationSettings, generate
from eskin.skin import MountedSkin
from helpers.simulation import StandIn

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


class Placed(StandIn):
    """Presses that truly are where their taxels are."""

    away = 0.0
    """Distance between the true and the labelled position [m]."""

    def __init__(self, skin):
        super().__init__(skin)
        calibrated = replace(self.mounted.skin, calibrated=True)
        self.mounted = MountedSkin(calibrated, self.mounted.robot)

    def make(self, plan):
        clip = super().make(plan)
        place = self.mounted.skin.positions[0] + np.array([0.0, 0.0, self.away])
        truths = tuple(
            replace(truth, centroid=np.tile(place, (len(truth.force), 1)))
            for truth in clip.truths
        )
        return replace(clip, truths=truths)


class Elsewhere(Placed):
    """Presses that the skin measures where nothing touches it."""

    away = 0.5


def generated(folder, generator=Placed, clips=6, chosen="val") -> list[Path]:
    """The recordings of a generated set, of one person."""
    generate(folder, GenerationSettings(chosen, clips=clips, subjects=1), 0, generator)
    return sorted(folder.rglob("*.mcap"))


def clip_at(begin, gesture="poke", seconds=2.0) -> Clip:
    """A clip by seconds since the start."""
    start = START + round(begin * SECOND)
    return Clip(start, start + round(seconds * SECOND), gesture, "")


def loaded(times, sequence, forces, clips=(), recording=None) -> Dataset:
    """A data set whose rows bear so much force [N] on one taxel, 50 ms each."""
    n = len(times)
    real = np.ones(n, np.float32)
    vectors = np.zeros((n, 3), np.float32)
    pressure = 10 * np.asarray(forces, np.float32)
    graphs = GraphBatch(
        taxels=np.zeros(n, np.int64),
        pressure=pressure,
        before=0 * real,
        age=0 * real,
        areas=real,
        positions=vectors,
        normals=np.tile(np.float32([0, 0, 1]), (n, 1)),
        shear=vectors,
        shear_before=vectors,
        neighbours=np.full((n, 2), -1),
        offsets=np.arange(n + 1),
        seconds=np.full(n, 0.05, np.float32),
        history=np.zeros((n, len(HISTORY)), np.float32),
    )
    stamps = START + np.rint(np.asarray(times) * SECOND).astype(np.int64)
    recording = np.zeros(n, np.int64) if recording is None else np.asarray(recording)
    names = ("none",) * n
    sequence = np.asarray(sequence)
    return Dataset((), graphs, stamps, sequence, recording, names, (), (), clips)
