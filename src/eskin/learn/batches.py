"""This module draws training windows and makes augmented batches of them."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from eskin.errors import RecordingError
from eskin.learn.augment import NO_AUGMENTATION, AugmentConfig, augment
from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Segment
from eskin.learn.nn import NetworkInput, SlotIndex
from eskin.learn.windows import (
    build_network_input,
    build_slot_index,
    cut_windows,
    drop_readings,
    stretch_time,
    subsample_readings,
)
from eskin.live import SLOT_NS, compute_summary

WHOLE_SHARE = 0.5
"""Share of windows that hold all of their gesture, or as much as fits."""

EARLIEST_NS = 100_000_000
"""Time from the onset to the earliest end of a window [ns]."""
OTHERS = ""
"""Name of all data sets without a share of their own."""
NO_SHARES: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Sampler:
    """A sampler draws windows: a class, one of its segments, the end of the window.

    Classes are equally frequent, and so are the segments of a class, but for data sets
    with a share of their own. Half of the windows hold as much of their gesture as
    fits; the others end at any time from 0.1 s after its onset, as they do live.
    """

    dataset: Dataset
    """Data set to draw from."""
    classes: dict[int, dict[str, list[Segment]]]
    """Segments of each class by data set; by `OTHERS` for those without a share."""
    shares: Mapping[str, float]
    """Share of the windows of a class that are of a data set."""
    slots: int
    """Length of a window on the clock of the temporal head."""
    crop: float
    """Share of windows that hold nothing from before their gesture."""

    def draw(
        self, count: int, rng: np.random.Generator
    ) -> tuple[Int[np.ndarray, "window"], Int[np.ndarray, "window"], list[int]]:
        """Return the last and first rows of windows, and their classes."""
        labels = rng.choice(list(self.classes), count).tolist()
        segments = [self.draw_segment(label, rng) for label in labels]
        after = np.where(
            rng.random(count) < WHOLE_SHARE, self.slots * SLOT_NS, EARLIEST_NS
        )
        pairs = zip(segments, after.tolist(), strict=True)
        ends = np.array([self.draw_end(segment, ns, rng) for segment, ns in pairs])
        firsts = np.array([segment.first for segment in segments])
        cropped = rng.random(count) < self.crop
        return ends, np.where(cropped, firsts, self.dataset.starts[ends]), labels

    def draw_segment(self, label: int, rng: np.random.Generator) -> Segment:
        """Draw one segment of a class."""
        datasets = self.classes[label]
        name, *others = datasets
        if others:
            left = 1.0 - sum(self.shares.get(each, 0.0) for each in datasets)
            shares = np.array([self.shares.get(each, left) for each in datasets])
            name = str(rng.choice(list(datasets), p=shares / shares.sum()))
        segments = datasets[name]
        return segments[rng.integers(len(segments))]

    def draw_end(self, segment: Segment, after: int, rng: np.random.Generator) -> int:
        """Draw a row from `after` [ns] into a segment on, or its last row."""
        stamps = self.dataset.stamps[segment.first : segment.end]
        low = np.searchsorted(stamps, stamps[0] + after)
        return segment.first + int(rng.integers(min(low, len(stamps) - 1), len(stamps)))


def build_sampler(
    dataset: Dataset,
    vocabulary: tuple[str, ...],
    recordings: Collection[int],
    slots: int,
    crop: float,
    shares: Mapping[str, float] = NO_SHARES,
) -> Sampler:
    """Return a `Sampler` of some recordings and of the gestures of a vocabulary.

    Args:
        dataset: data set to draw from.
        vocabulary: classes.
        recordings: indices of the recordings to draw from.
        slots: length of a window.
        crop: share of windows that hold nothing from before their gesture.
        shares: share of the windows of a class for each data set that is to have one,
            by the name in the metadata of its recordings.
    """
    classes: dict[int, dict[str, list[Segment]]] = {}
    for segment in dataset.segments:
        if segment.recording in recordings and segment.gesture in vocabulary:
            label = vocabulary.index(segment.gesture)
            name = dataset.recordings[segment.recording].metadata.dataset
            key = name if name in shares else OTHERS
            classes.setdefault(label, {}).setdefault(key, []).append(segment)
    return Sampler(dataset, classes, shares, slots, crop)


def check_classes(sampler: Sampler, vocabulary: tuple[str, ...]) -> None:
    """Raise a `RecordingError` if a sampler has fewer than two classes."""
    if len(sampler.classes) < 2:
        found = ", ".join(vocabulary[label] for label in sampler.classes)
        raise RecordingError(
            f"training recordings hold only {found or 'no gestures'}; at least two "
            "classes are needed; give more recordings or other --classes"
        )


@dataclass(frozen=True)
class Batch:
    """A batch holds the summaries of all readings and the graphs of some."""

    summary: Float[Tensor, "reading feature"]
    """Summary of each reading."""
    slot_index: SlotIndex
    """Window and slot of each of these readings."""
    encoded: NetworkInput
    """Graphs of some readings of the first windows, with their windows and slots."""
    labels: Int[Tensor, "window"]
    """Class of each window."""


@dataclass(frozen=True, eq=False)
class BatchBuilder:
    """A batch builder draws windows of a data set and augments them."""

    dataset: Dataset
    """Data set to draw from."""
    sampler: Sampler
    """Sampler that draws the windows."""
    config: AugmentConfig
    """Limits of the augmentation."""
    slots: int
    """Length of a window on the clock of the temporal head."""
    shear: bool
    """Whether the network uses shear."""

    @cached_property
    def patch_index(self) -> Int[np.ndarray, "taxel"] | None:
        """Return the patch of each taxel; None if recordings are of different skins."""
        patches = [r.skin.patch_index for r in self.dataset.recordings]
        same = all(np.array_equal(each, patches[0]) for each in patches)
        return patches[0] if patches and same else None

    def build(
        self, count: int, encoded: int, readings: int, rng: np.random.Generator
    ) -> Batch:
        """Return a batch of augmented windows.

        Args:
            count: number of windows.
            encoded: number of these whose graphs are encoded.
            readings: number of readings encoded in each of those.
            rng: source of the random draws.
        """
        config, (ends, firsts, labels) = self.config, self.sampler.draw(count, rng)
        windows = cut_windows(self.dataset, ends, firsts, self.slots)
        if config.lost > 0 or config.halved > 0:
            kept = drop_readings(windows, config.lost, config.halved, rng)
            windows = windows.select(kept)
        graphs = self.dataset.graphs.select(windows.rows)
        if config.stretch > 0:
            windows, graphs = stretch_time(
                windows, graphs, config.stretch, self.slots, rng
            )
        if config != NO_AUGMENTATION:
            graphs = augment(graphs, windows.window, rng, config, self.patch_index)
        numbered = replace(windows, rows=np.arange(len(windows.rows)))
        part = subsample_readings(numbered.first(encoded), readings, rng)
        return Batch(
            summary=torch.as_tensor(compute_summary(graphs, self.shear)),
            slot_index=build_slot_index(windows),
            encoded=build_network_input(graphs.select(part.rows), part, self.shear),
            labels=torch.tensor(labels),
        )
