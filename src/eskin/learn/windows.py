"""Windows: the two seconds that end at a reading."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Int

from eskin.graph import GraphBatch
from eskin.learn.dataset import Dataset
from eskin.model import SLOT_NS
from eskin.nn import NetworkInput, network_input


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


def to_input(
    graphs: GraphBatch,
    windows: Windows,
    shear: bool,
    dtype: torch.dtype = torch.float32,
) -> NetworkInput:
    """The network's input for windows whose rows' graphs are given in their order."""
    return network_input(
        graphs, windows.window, windows.slot, windows.count, shear, dtype
    )
