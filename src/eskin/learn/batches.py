"""This module draws training windows, augments them, and makes batches of them.

A window is the two seconds before a reading. Augmented, it is of another person, whose
force and speed differ, on another skin.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from eskin.errors import RecordingError
from eskin.learn.config import NO_AUGMENTATION, AugmentConfig
from eskin.learn.dataset import Dataset
from eskin.learn.ground_truth import Segment
from eskin.learn.nn import NetworkInput, SlotIndex, build_graph_tensors
from eskin.live import HISTORY, SLOT_NS, GraphBatch, compute_summary
from eskin.live.graph_builder import MAX_STEP

TIME_COLUMNS = [HISTORY.index(name) for name in ("age", "pause", "impulse")]
"""Columns of a history that are proportional to the duration of a touch."""


@dataclass(frozen=True)
class Windows:
    """Windows hold the rows of a batch of windows, laid end to end."""

    rows: Int[np.ndarray, "reading"]
    """Rows of the data set, oldest first in each window."""
    window: Int[np.ndarray, "reading"]
    """Number of the window of each row."""
    slot: Int[np.ndarray, "reading"]
    """Slot of each row in its window; the last row has the last slot."""
    count: int
    """Number of windows."""

    def select(self, kept: Int[np.ndarray, "some"]) -> "Windows":
        """Return the windows with only some of their rows, given in ascending order."""
        return Windows(self.rows[kept], self.window[kept], self.slot[kept], self.count)

    def first(self, count: int) -> "Windows":
        """Return the first `count` windows, or all where there are fewer."""
        kept = np.flatnonzero(self.window < count)
        return replace(self.select(kept), count=min(count, self.count))


def cut_windows(
    dataset: Dataset,
    ends: Int[np.ndarray, "window"],
    firsts: Int[np.ndarray, "window"],
    slots: int,
) -> Windows:
    """Return the windows that end with the rows `ends`.

    Args:
        dataset: data set to cut from.
        ends: last row of each window.
        firsts: earliest row that each window may hold, of the same sequence.
        slots: length of a window on the clock of the temporal head.
    """
    now = dataset.stamps[ends] // SLOT_NS
    oldest = (now - slots + 1) * SLOT_NS
    first_rows = (
        first + np.searchsorted(dataset.stamps[first : end + 1], stamp)
        for first, end, stamp in zip(firsts, ends, oldest, strict=True)
    )
    lows = np.fromiter(first_rows, np.int64, len(ends))
    lengths = ends + 1 - lows
    window = np.repeat(np.arange(len(ends)), lengths)
    starts = np.cumsum(lengths) - lengths
    rows = np.arange(lengths.sum()) - starts[window] + lows[window]
    slot = dataset.stamps[rows] // SLOT_NS - now[window] + slots - 1
    return Windows(rows, window, slot, len(ends))


def stretch_time(
    windows: Windows,
    graphs: GraphBatch,
    spread: float,
    slots: int,
    rng: np.random.Generator,
) -> tuple[Windows, GraphBatch]:
    """Stretch or compress each window in time, as by a slower or faster person.

    Rows that fall out of a window are left out.

    Args:
        windows: windows to change.
        graphs: graphs of their rows.
        spread: standard deviation of the logarithm of the factor on time.
        slots: length of a window on the clock of the temporal head.
        rng: source of the random draws.
    """
    factor = np.exp(spread * rng.standard_normal(windows.count))[windows.window]
    ago = (slots - 1 - windows.slot) * factor
    kept = np.flatnonzero(ago <= slots - 1)
    factor = factor.astype(np.float32)
    history = graphs.history.copy()
    history[:, TIME_COLUMNS] *= factor[:, None]
    stretched = graphs._replace(
        history=history,
        seconds=graphs.seconds * factor,
        age=graphs.age * factor[graphs.graph_index],
    )
    slot = slots - 1 - np.rint(ago[kept]).astype(np.int64)
    return replace(windows.select(kept), slot=slot), stretched.select(kept)


def drop_readings(
    windows: Windows, share: float, halved: float, rng: np.random.Generator
) -> Int[np.ndarray, "reading"]:
    """Return the indices of the rows left when readings are lost.

    The last reading of a window is never lost.

    Args:
        windows: windows whose readings are lost.
        share: largest share of a window's readings that are lost at random.
        halved: share of windows that keep only every other reading.
        rng: source of the random draws.
    """
    loss = share * rng.random(windows.count)
    is_halved = rng.random(windows.count) < halved
    last = np.append(windows.window[1:] != windows.window[:-1], True)
    ends = np.flatnonzero(last)
    rows = np.arange(len(last))
    rows_to_end = ends[np.searchsorted(ends, rows)] - rows
    kept = rng.random(len(last)) >= loss[windows.window]
    kept &= ~(is_halved[windows.window] & (rows_to_end % 2 == 1))
    return np.flatnonzero(kept | last)


def measure_since_kept(
    windows: Windows, graphs: GraphBatch, stamps: Int[np.ndarray, "row"]
) -> GraphBatch:
    """Return the graphs that a device gives which never measured the lost readings.

    The reading before one becomes the latest that is left in the window: how long ago
    it is, and its loads. Loads of taxels that are no nodes any more are left out.

    Args:
        windows: windows from which readings were dropped.
        graphs: graphs of their rows.
        stamps: stamp of every row of the data set [ns since the epoch].
    """
    rows = windows.rows
    window = windows.window
    changed = (window[1:] == window[:-1]) & (rows[1:] > rows[:-1] + 1)
    changed = np.append(False, changed)  # the first has none before it
    if not changed.any():
        return graphs
    elapsed = np.diff(stamps[rows], prepend=0)[changed] * 1e-9
    seconds = graphs.seconds.copy()
    seconds[changed] = np.minimum(elapsed, MAX_STEP)
    # Taxels are in ascending order in each graph, and so are these keys.
    key = graphs.graph_index * (graphs.taxels.max(initial=0) + 1) + graphs.taxels
    nodes = np.flatnonzero(changed[graphs.graph_index])
    wanted = key[nodes] - graphs.taxels.max(initial=0) - 1
    place = np.searchsorted(key, wanted)
    found = key[place] == wanted
    before = graphs.before.copy()
    shear_before = graphs.shear_before.copy()
    before[nodes] = graphs.pressure[place] * found
    shear_before[nodes] = graphs.shear[place] * found[:, None]
    return graphs._replace(seconds=seconds, before=before, shear_before=shear_before)


def subsample_readings(
    windows: Windows, limit: int, rng: np.random.Generator
) -> Windows:
    """Return windows of at most `limit` readings each, drawn at random."""
    order = np.lexsort((rng.random(len(windows.rows)), windows.window))
    starts = np.searchsorted(windows.window, np.arange(windows.count))
    kept = np.sort(order[np.arange(len(order)) - starts[windows.window] < limit])
    return windows.select(kept)


def build_network_input(
    graphs: GraphBatch,
    windows: Windows,
    shear: bool,
    dtype: torch.dtype = torch.float32,
) -> NetworkInput:
    """Return the network's input for windows and the graphs of their rows."""
    return NetworkInput(
        build_graph_tensors(graphs, shear, dtype), build_slot_index(windows)
    )


def build_slot_index(windows: Windows) -> SlotIndex:
    """Return the windows and slots of the rows, for the network."""
    return SlotIndex(
        torch.as_tensor(windows.window), torch.as_tensor(windows.slot), windows.count
    )


FORCE_COLUMNS = [HISTORY.index(name) for name in ("impulse", "peak force")]


def augment(
    graphs: GraphBatch,
    window: Int[np.ndarray, "graph"],
    rng: np.random.Generator,
    config: AugmentConfig,
    patch_index: Int[np.ndarray, "taxel"] | None = None,
) -> GraphBatch:
    """Augment pressure and shear: each window is of another person on another skin.

    Args:
        graphs: graphs of the windows.
        window: number of the window of each graph.
        rng: source of the random draws.
        config: limits of the changes.
        patch_index: patch of each taxel; None if no patch may read zero.
    """
    windows = int(window.max(initial=-1)) + 1
    node_window = window[graphs.graph_index]
    person = np.exp(config.gain * rng.standard_normal(windows))
    taxel_gains = draw_taxel_gains(graphs, windows, rng, config)
    if patch_index is not None and config.patch > 0:
        silence_patches(taxel_gains, graphs, node_window, patch_index, config, rng)
    gain = person[node_window] * taxel_gains[node_window, graphs.taxels]
    gain = gain.astype(np.float32)
    offset = (config.offset * rng.random(windows))[node_window].astype(np.float32)
    shear_gain = np.exp(config.shear_gain * rng.standard_normal(windows))[node_window]
    shear_factor = (gain * shear_gain)[:, None].astype(np.float32)
    now = before = gain
    if config.noise > 0:
        now, before = (
            gain
            * (1 + config.noise * rng.standard_normal(len(gain))).astype(np.float32)
            for _ in range(2)
        )
    history = graphs.history.copy()
    history[:, FORCE_COLUMNS] *= person[window, None].astype(np.float32)
    return graphs._replace(
        history=history,
        pressure=np.maximum(graphs.pressure * now - offset, 0.0),
        before=np.maximum(graphs.before * before - offset, 0.0),
        shear=graphs.shear * shear_factor,
        shear_before=graphs.shear_before * shear_factor,
    )


def draw_taxel_gains(
    graphs: GraphBatch, windows: int, rng: np.random.Generator, config: AugmentConfig
) -> Float[np.ndarray, "window taxel"]:
    """Draw the gain of each taxel in each window; zero for dead ones."""
    taxels = int(graphs.taxels.max(initial=-1)) + 1
    gains = np.exp(config.taxel_gain * rng.standard_normal((windows, taxels)))
    share = config.dead * rng.random((windows, 1))
    return gains * (rng.random((windows, taxels)) >= share)


def silence_patches(
    gains: Float[np.ndarray, "window taxel"],
    graphs: GraphBatch,
    node_window: Int[np.ndarray, "node"],
    patch_index: Int[np.ndarray, "every"],
    config: AugmentConfig,
    rng: np.random.Generator,
) -> None:
    """Set the gains of one patch to zero, in some windows that touch several."""
    pressed = graphs.pressure > 0
    for window in np.flatnonzero(rng.random(len(gains)) < config.patch):
        here = graphs.taxels[pressed & (node_window == window)]
        patches = np.unique(patch_index[here])
        if len(patches) > 1:
            gains[window, patch_index[: gains.shape[1]] == rng.choice(patches)] = 0.0


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
            name = str(rng.choice(list(datasets), p=self.find_shares(label)))
        segments = datasets[name]
        return segments[rng.integers(len(segments))]

    def find_shares(self, label: int) -> Float[np.ndarray, "dataset"]:
        """Return the shares of the data sets in the windows of a class."""
        datasets = self.classes[label]
        if len(datasets) == 1:
            return np.ones(1)
        left = 1.0 - sum(self.shares.get(each, 0.0) for each in datasets)
        shares = np.array([self.shares.get(each, left) for each in datasets])
        return shares / shares.sum()

    def list_segments(
        self,
    ) -> tuple[list[Segment], Int[np.ndarray, "segment"], Float[np.ndarray, "segment"]]:
        """Return all segments, their classes, and how often each is drawn."""
        segments: list[Segment] = []
        labels: list[int] = []
        weights: list[float] = []
        for label, datasets in self.classes.items():
            shares = self.find_shares(label).tolist()
            for share, some in zip(shares, datasets.values(), strict=True):
                segments += some
                labels += [label] * len(some)
                weights += [share / len(some) / len(self.classes)] * len(some)
        return segments, np.array(labels), np.array(weights)

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
        config = self.config
        (ends, firsts, labels) = self.sampler.draw(count, rng)
        windows = cut_windows(self.dataset, ends, firsts, self.slots)
        if config.lost > 0 or config.halved > 0:
            kept = drop_readings(windows, config.lost, config.halved, rng)
            windows = windows.select(kept)
        graphs = self.dataset.graphs.select(windows.rows)
        graphs = measure_since_kept(windows, graphs, self.dataset.stamps)
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
