"""This module cuts windows, the two seconds before a reading, and augments them."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Int

from eskin.learn.dataset import Dataset
from eskin.learn.nn import (
    NetworkInput,
    SlotIndex,
    build_graph_tensors,
)
from eskin.live import HISTORY, SLOT_NS, GraphBatch

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
    ends, rows = np.flatnonzero(last), np.arange(len(last))
    rows_to_end = ends[np.searchsorted(ends, rows)] - rows
    kept = rng.random(len(last)) >= loss[windows.window]
    kept &= ~(is_halved[windows.window] & (rows_to_end % 2 == 1))
    return np.flatnonzero(kept | last)


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
