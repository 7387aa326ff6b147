"""Windows: the two seconds that end at a reading."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Int

from eskin.graph import GraphBatch
from eskin.learn.dataset import Dataset
from eskin.model import SLOT_NS
from eskin.nn import NetworkInput, Places, graph_tensors


@dataclass(frozen=True)
class Windows:
    """The rows of a batch of windows, laid end to end."""

    rows: Int[np.ndarray, "reading"]
    """Rows of the data set, oldest first in each window."""

    window: Int[np.ndarray, "reading"]
    """The window of each."""

    slot: Int[np.ndarray, "reading"]
    """Its place on the head's clock; the window's last reading has the last slot."""

    count: int
    """Number of windows."""

    def first(self, count: int) -> "Windows":
        """The first `count` of the windows, or all where there are fewer."""
        kept = self.window < count
        return Windows(
            self.rows[kept],
            self.window[kept],
            self.slot[kept],
            min(count, self.count),
        )


def cut(
    dataset: Dataset,
    ends: Int[np.ndarray, "window"],
    firsts: Int[np.ndarray, "window"],
    slots: int,
) -> Windows:
    """Cut the windows that end with the rows `ends`.

    Args:
        dataset: where to cut.
        ends: last row of each window.
        firsts: row before which each window sees nothing; never of another sequence.
        slots: length of the window on the head's clock.
    """
    now = dataset.stamps[ends] // SLOT_NS
    oldest = (now - slots + 1) * SLOT_NS
    lows = np.array(
        [
            low + np.searchsorted(dataset.stamps[low : end + 1], stamp)
            for low, end, stamp in zip(firsts, ends, oldest, strict=True)
        ],
        dtype=np.int64,
    )
    lengths = ends + 1 - lows
    window = np.repeat(np.arange(len(ends)), lengths)
    starts = np.cumsum(lengths) - lengths
    rows = np.arange(lengths.sum()) - starts[window] + lows[window]
    slot = dataset.stamps[rows] // SLOT_NS - now[window] + slots - 1
    return Windows(rows, window, slot, len(ends))


def thin(windows: Windows, most: int, rng: np.random.Generator) -> Windows:
    """Windows of at most `most` readings, those left out drawn at random."""
    order = np.lexsort((rng.random(len(windows.rows)), windows.window))
    starts = np.searchsorted(windows.window, np.arange(windows.count))
    kept = np.sort(order[np.arange(len(order)) - starts[windows.window] < most])
    return Windows(
        windows.rows[kept], windows.window[kept], windows.slot[kept], windows.count
    )


def to_input(
    graphs: GraphBatch,
    windows: Windows,
    shear: bool,
    dtype: torch.dtype = torch.float32,
) -> NetworkInput:
    """The network's input for windows whose rows' graphs are given in their order."""
    return NetworkInput(graph_tensors(graphs, shear, dtype), to_places(windows))


def to_places(windows: Windows) -> Places:
    """Where the windows' readings stand, for the network."""
    return Places(
        torch.as_tensor(windows.window), torch.as_tensor(windows.slot), windows.count
    )
