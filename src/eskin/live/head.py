"""The temporal heads' weights as their kernels take them, and one sequence's memory."""

from typing import NamedTuple

import numpy as np

from eskin.live.encoder import Weights, transposed

VIEWS = ("summary", "graph")
"""The two heads, side by side in every array: one sees the summary alone, the other
the embedding beside it."""

SCALES = 3
"""Of time: a slot, and the spans of the two convolutions."""

STATISTICS = 4
"""Of each channel at each scale: mean, spread, maximum, integral."""


class HeadWeights(NamedTuple):
    """Parameters of both heads; a *track* is a channel of one of them.

    Whatever a head does not see has zeros for weights.
    """

    project_weight: np.ndarray
    """(input, track)"""
    project_bias: np.ndarray
    """(track)"""
    short_weight: np.ndarray
    """(view, tap and channel, channel)"""
    short_bias: np.ndarray
    """(track)"""
    long_weight: np.ndarray
    """(view, tap and channel, channel)"""
    long_bias: np.ndarray
    """(track)"""
    classify_weight: np.ndarray
    """(class, statistic of each scale and track), halved: the views are averaged."""
    classify_bias: np.ndarray
    """(class)"""


class HeadMemory(NamedTuple):
    """What is remembered of one sequence; slot number n stands at n modulo the slots.

    An output of a convolution stands where its last tap is, whether or not the window
    that ends now looks at it: each is computed once and used every fourth slot, or
    every eighth.
    """

    newest: np.ndarray
    """(input) features of the newest slot."""
    fine_seen: np.ndarray
    """(slot) whether it holds a reading."""
    fine: np.ndarray
    """(slot, track) its projection."""
    short_seen: np.ndarray
    """(slot) whether the short convolution that ends there saw a reading."""
    short: np.ndarray
    """(slot, track) what it gives."""
    long_seen: np.ndarray
    """(slot) whether the long convolution that ends there saw a reading."""
    long: np.ndarray
    """(slot, track) what it gives."""
    places: np.ndarray
    """(slot) where the outputs stand that the statistics are of."""
    statistics: np.ndarray
    """(statistic of each scale, track)"""


def head_weights(weights: Weights) -> HeadWeights:
    """The parameters whose names begin with `summary_head.` and `graph_head.`."""

    def both(name: str) -> list[np.ndarray]:
        return [weights[f"{view}_head.{name}"] for view in VIEWS]

    inputs = both("project.weight")[-1].shape[1]
    project = [
        np.pad(weight, [(0, 0), (0, inputs - weight.shape[1])])
        for weight in both("project.weight")
    ]
    tracks = len(project) * len(project[0])
    classify = [
        weight.reshape(len(weight), -1, tracks // 2)
        for weight in both("classify.weight")
    ]
    classify_weight = np.concatenate(classify, axis=2) / np.float32(2.0)
    return HeadWeights(
        project_weight=transposed(np.concatenate(project)),
        project_bias=np.concatenate(both("project.bias")),
        short_weight=filters(both("short.conv.weight")),
        short_bias=np.concatenate(both("short.bias")),
        long_weight=filters(both("long.conv.weight")),
        long_bias=np.concatenate(both("long.bias")),
        classify_weight=classify_weight.reshape(len(classify_weight), -1),
        classify_bias=np.add(*both("classify.bias")) / np.float32(2.0),
    )


def head_memory(weights: HeadWeights, slots: int, *pool: int) -> HeadMemory:
    """Memory for a sequence of which nothing has come yet, or for a pool of them."""
    inputs, tracks = weights.project_weight.shape

    def ring() -> np.ndarray:
        return np.zeros((*pool, slots, tracks), np.float32)

    def seen() -> np.ndarray:
        return np.zeros((*pool, slots), np.bool_)

    return HeadMemory(
        newest=np.zeros((*pool, inputs), np.float32),
        fine_seen=seen(),
        fine=ring(),
        short_seen=seen(),
        short=ring(),
        long_seen=seen(),
        long=ring(),
        places=np.zeros((*pool, slots), np.int64),
        statistics=np.zeros((*pool, SCALES * STATISTICS, tracks), np.float32),
    )


def filters(weights: list[np.ndarray]) -> np.ndarray:
    """Filters of torch as (view, tap and input, output)."""
    turned = [weight.transpose(2, 1, 0) for weight in weights]
    return np.stack([weight.reshape(-1, weight.shape[2]) for weight in turned])
