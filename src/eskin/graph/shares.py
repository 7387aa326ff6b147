"""What the graph of each sequence is made of at one reading."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.batch import HISTORY
from eskin.structref_kernels import Packed, pack


class Share(NamedTuple):
    """What the graph of one sequence is made of at one reading."""

    taxels: Int[np.ndarray, "active"]
    """Its active taxels now."""

    earlier: Int[np.ndarray, "earlier"]
    """Those it had one reading ago."""

    history: Float[np.ndarray, "column"]
    """What it has been so far; see `eskin.graph.batch.HISTORY`."""


class Shares(NamedTuple):
    """The same of every sequence, as arrays; a span is the first and the end."""

    keys: np.ndarray
    """(share) which sequence it is of."""
    active: np.ndarray
    """(load) taxels: the spans of `now`."""
    earlier: np.ndarray
    """(load) taxels: the spans of `before`."""
    now: np.ndarray
    """(share, 2) span of the taxels that are active now."""
    before: np.ndarray
    """(share, 2) span of those that were a reading ago."""
    histories: np.ndarray
    """(share, column)"""


class HeldShares(NamedTuple):
    """The shares of one reading: what everybody asks for, and a handle on the rest."""

    keys: list[int]
    """Which sequences there are."""
    most: int
    """Taxels of one of them at most, now and a reading ago together."""
    packed: Packed
    """`Shares`."""


def held_shares(shares: Mapping[int, Share]) -> HeldShares:
    """Shares by the keys of their sequences, as compiled code reads them."""
    every, keys = list(shares.values()), list(shares)
    active, now = in_a_row([share.taxels for share in every])
    earlier, before = in_a_row([share.earlier for share in every])
    histories = np.empty((len(every), len(HISTORY)))
    for n, share in enumerate(every):
        histories[n] = share.history
    numbers = np.array(keys, np.int64)
    packed = pack(Shares(numbers, active, earlier, now, before, histories))
    sizes = [len(share.taxels) + len(share.earlier) for share in every]
    return HeldShares(keys, max(sizes, default=0), packed)


def in_a_row(
    parts: list[np.ndarray],
) -> tuple[Int[np.ndarray, "load"], Int[np.ndarray, "share 2"]]:
    """All parts one after another, and the span of each."""
    ends = np.cumsum([0, *map(len, parts)])
    nobody = np.empty(0, np.int64)
    return np.concatenate([nobody, *parts]), np.stack([ends[:-1], ends[1:]], axis=1)
