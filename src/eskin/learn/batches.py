"""Batches of training windows: the summary of every reading, the graphs of some."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from eskin.learn.augment import UNCHANGED, AugmentConfig, augment
from eskin.learn.dataset import Dataset
from eskin.learn.sampler import Sampler
from eskin.learn.windows import cut, lose, stretch, thin, to_input, to_places
from eskin.nn import NetworkInput, Places, summary


@dataclass(frozen=True)
class Batch:
    """Training windows: the summary of every reading, the graphs of some."""

    summary: Float[Tensor, "reading feature"]
    """Of every reading."""
    places: Places
    """Where those readings stand."""
    some: NetworkInput
    """Of the first windows, the readings whose graphs are encoded."""
    labels: Int[Tensor, "window"]
    """Class of each window."""


@dataclass(frozen=True, eq=False)
class BatchMaker:
    """Draws windows of a data set and makes each another person on another skin."""

    dataset: Dataset
    """Where to draw from."""
    sampler: Sampler
    """Draws the windows."""
    config: AugmentConfig
    """How far they vary."""
    slots: int
    """Length of a window on the head's clock."""
    shear: bool
    """Whether the network takes shear."""

    @cached_property
    def patch_index(self) -> Int[np.ndarray, "taxel"] | None:
        """The patch of each taxel, where all recordings are of one skin."""
        patches = [r.skin.patch_index for r in self.dataset.recordings]
        same = all(np.array_equal(each, patches[0]) for each in patches)
        return patches[0] if patches and same else None

    def make(
        self, count: int, encoded: int, readings: int, rng: np.random.Generator
    ) -> Batch:
        """A batch of augmented windows.

        Args:
            count: windows.
            encoded: of these, windows whose graphs are encoded.
            readings: of each of those, readings that are.
            rng: draws everything.
        """
        config, (ends, firsts, labels) = self.config, self.sampler.draw(count, rng)
        windows = cut(self.dataset, ends, firsts, self.slots)
        if config.lost > 0 or config.halved > 0:
            windows = windows.at(lose(windows, config.lost, config.halved, rng))
        graphs = self.dataset.graphs.select(windows.rows)
        if config.stretch > 0:
            windows, graphs = stretch(windows, graphs, config.stretch, self.slots, rng)
        if config != UNCHANGED:
            graphs = augment(graphs, windows.window, rng, config, self.patch_index)
        places = replace(windows, rows=np.arange(len(windows.rows)))
        some = thin(places.first(encoded), readings, rng)
        return Batch(
            summary=torch.as_tensor(summary(graphs, self.shear)),
            places=to_places(windows),
            some=to_input(graphs.select(some.rows), some, self.shear),
            labels=torch.tensor(labels),
        )
