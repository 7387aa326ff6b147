"""This module draws training windows and makes augmented batches of them."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from eskin.errors import RecordingError
from eskin.learn.augment import NO_AUGMENTATION, AugmentConfig, augment
from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Segment
from eskin.learn.windows import (
    build_network_input,
    build_places,
    cut_windows,
    drop_readings,
    stretch_time,
    subsample_readings,
)
from eskin.model import SLOT_NS
from eskin.nn import NetworkInput, Places, summary

WHOLE = 0.5
"""Share of windows that see all of their gesture, or as much as fits."""

EARLIEST_NS = 100_000_000
"""Time after the onset from which a gesture is asked for [ns]."""


@dataclass(frozen=True)
class Sampler:
    """Draws windows so that every gesture, then every segment, counts the same.

    Half of the windows see as much of their gesture as a window can hold, the others
    end anywhere from 0.1 s after its onset, as they do live.
    """

    dataset: Dataset
    classes: dict[int, list[Segment]]
    """The segments of each class."""
    slots: int
    crop: float

    def draw(
        self, count: int, rng: np.random.Generator
    ) -> tuple[Int[np.ndarray, "window"], Int[np.ndarray, "window"], list[int]]:
        """Last and first rows of windows, and their classes."""
        labels = rng.choice(list(self.classes), count).tolist()
        segments = [self.pick(label, rng) for label in labels]
        after = np.where(rng.random(count) < WHOLE, self.slots * SLOT_NS, EARLIEST_NS)
        pairs = zip(segments, after.tolist(), strict=True)
        ends = np.array([self.end(segment, ns, rng) for segment, ns in pairs])
        firsts = np.array([segment.first for segment in segments])
        cropped = rng.random(count) < self.crop
        return ends, np.where(cropped, firsts, self.dataset.starts[ends]), labels

    def pick(self, label: int, rng: np.random.Generator) -> Segment:
        """One segment of a class."""
        segments = self.classes[label]
        return segments[rng.integers(len(segments))]

    def end(self, segment: Segment, after: int, rng: np.random.Generator) -> int:
        """A row of a segment later than `after` [ns], or its last one."""
        stamps = self.dataset.stamps[segment.first : segment.end]
        low = np.searchsorted(stamps, stamps[0] + after)
        return segment.first + int(rng.integers(min(low, len(stamps) - 1), len(stamps)))


def build_sampler(
    dataset: Dataset,
    vocabulary: tuple[str, ...],
    recordings: Collection[int],
    slots: int,
    crop: float,
) -> Sampler:
    """A sampler over some of the recordings.

    Args:
        dataset: where to draw from.
        vocabulary: the gestures to draw; others are passed over.
        recordings: indices of those to draw from.
        slots: length of a window on the head's clock.
        crop: share of windows that see nothing from before their gesture.
    """
    classes: dict[int, list[Segment]] = {}
    for segment in dataset.segments:
        if segment.recording in recordings and segment.gesture in vocabulary:
            label = vocabulary.index(segment.gesture)
            classes.setdefault(label, []).append(segment)
    return Sampler(dataset, classes, slots, crop)


def check_classes(sampler: Sampler, vocabulary: tuple[str, ...]) -> None:
    """Refuse to train where there is nothing to tell apart.

    Raises:
        RecordingError: if the sampler has fewer than two classes.
    """
    if len(sampler.classes) < 2:
        found = ", ".join(vocabulary[label] for label in sampler.classes)
        raise RecordingError(
            f"training recordings hold only {found or 'no gestures'}; at least two "
            "classes are needed; give more recordings or other --classes"
        )


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
class BatchBuilder:
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
        windows = cut_windows(self.dataset, ends, firsts, self.slots)
        if config.lost > 0 or config.halved > 0:
            windows = windows.at(
                drop_readings(windows, config.lost, config.halved, rng)
            )
        graphs = self.dataset.graphs.select(windows.rows)
        if config.stretch > 0:
            windows, graphs = stretch_time(
                windows, graphs, config.stretch, self.slots, rng
            )
        if config != NO_AUGMENTATION:
            graphs = augment(graphs, windows.window, rng, config, self.patch_index)
        places = replace(windows, rows=np.arange(len(windows.rows)))
        some = subsample_readings(places.first(encoded), readings, rng)
        return Batch(
            summary=torch.as_tensor(summary(graphs, self.shear)),
            places=build_places(windows),
            some=build_network_input(graphs.select(some.rows), some, self.shear),
            labels=torch.tensor(labels),
        )
