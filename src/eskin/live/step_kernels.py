"""The compiled step of one reading: from the taxels of touches to probabilities."""

import math
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.arrays import GraphMemory, Ground, Instant, Loads
from eskin.graph.builder_kernels import build_graph, take_in
from eskin.live.encoder import EncoderMemory
from eskin.live.feature_kernels import FeatureWeights, featurise
from eskin.live.graph import Graph
from eskin.live.head import HeadMemory, HeadWeights
from eskin.live.head_kernels import classify
from eskin.live.kernels import compiled_network
from eskin.live.pool import FREE, LONG_AGO
from eskin.structref_kernels import Packed


class StepParts(NamedTuple):
    """What every touch's step needs, whichever touch it is."""

    ground: Ground
    """The skin."""
    loads: Loads
    """What has been felt on it."""
    graph: GraphMemory
    """Where graphs are built."""
    shear: bool
    """Whether the network takes shear."""
    weights: FeatureWeights
    """Of the network, up to features."""
    encoder: EncoderMemory
    """With room for every graph that `graph` has room for."""
    features: np.ndarray
    """(channel) where they go."""
    heads: HeadWeights
    """Of the network, from there on."""
    temperature: float
    """That logits are divided by."""


@compiled_network
@no_type_check
def step(
    packed_parts: Packed,
    packed_pool: Packed,
    packed_shares: Packed,
    pressure: Float[np.ndarray, "taxel"],
    shear: Float[np.ndarray, "taxel_or_none 2"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    instant: Instant,
    slot: int,
    out: Float[np.ndarray, "share 2 class"],
) -> None:
    """Take in a reading, and write logits and probabilities of each sequence.

    Args:
        packed_parts: `StepParts`, with room for every graph.
        packed_pool: `Pool`, with a row for every sequence.
        packed_shares: `Shares` of the reading.
        pressure: of every taxel [kPa].
        shear: of every taxel [kPa]; empty where it is not measured.
        T_world_link: of every link of the robot.
        instant: of the reading.
        slot: number of its slot, the same as that of the reading before or later.
        out: where they go.
    """
    shares, pool = packed_shares.parts, packed_pool.parts
    keys, now, before = shares.keys, shares.now, shares.before
    take_in(shares.active, pressure, shear, instant, packed_parts.parts.loads)
    free_others(keys, pool.keys)
    for n in range(len(keys)):
        row = row_of(keys[n], pool.keys, pool.slots)
        step_one(
            packed_parts,
            shares.active[now[n, 0] : now[n, 1]],
            shares.earlier[before[n, 0] : before[n, 1]],
            shares.histories[n],
            T_world_link,
            instant,
            pool.slots[row],
            slot,
            window_of(row, pool.memory),
            out[n],
        )
        pool.slots[row] = slot


@compiled_network
@no_type_check
def step_one(
    packed_parts: Packed,
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    history: Float[np.ndarray, "column"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    instant: Instant,
    before: int,
    slot: int,
    window: HeadMemory,
    out: Float[np.ndarray, "2 class"],
) -> None:
    """Write logits and probabilities of one sequence.

    Args:
        packed_parts: `StepParts`, with room for the graph.
        taxels: its active taxels now.
        earlier: those it had one reading ago.
        history: what it has been so far.
        T_world_link: of every link of the robot.
        instant: of the reading.
        before: number of the slot of the reading before; long ago for the first.
        slot: number of its own slot, the same or later.
        window: of the sequence.
        out: where they go.
    """
    parts = packed_parts.parts
    memory = parts.graph
    nodes = build_graph(
        taxels,
        earlier,
        history,
        T_world_link,
        instant,
        parts.ground,
        parts.loads,
        memory,
    )
    graph = Graph(
        nodes,
        np.float64(np.float32(instant.seconds)),
        memory.pressure,
        memory.before,
        memory.age,
        memory.areas,
        memory.positions,
        memory.normals,
        memory.shear,
        memory.shear_before,
        memory.neighbours,
        memory.history,
    )
    featurise(graph, parts.shear, parts.weights, parts.encoder, parts.features)
    classify(parts.features, before, slot, parts.heads, window, out[0])
    calibrate(out[0], parts.temperature, out[1])


@compiled_network
@no_type_check
def free_others(keys: Int[np.ndarray, "share"], rows: Int[np.ndarray, "row"]) -> None:
    """Free the rows of sequences that have no share: they have ended."""
    for row in range(len(rows)):
        ended = True
        for key in keys:
            ended = ended and rows[row] != key
        if ended:
            rows[row] = FREE


@compiled_network
@no_type_check
def row_of(
    key: int, rows: Int[np.ndarray, "row"], slots: Int[np.ndarray, "row"]
) -> int:
    """The row of a sequence; a new one gets a free row and starts afresh."""
    free = FREE
    for row in range(len(rows)):
        if rows[row] == key:
            return row
        if rows[row] == FREE and free == FREE:
            free = row
    rows[free], slots[free] = key, LONG_AGO
    return free


@compiled_network
@no_type_check
def window_of(row: int, memory: HeadMemory) -> HeadMemory:
    """The memory of one row of a pool."""
    return HeadMemory(
        memory.newest[row],
        memory.fine_seen[row],
        memory.fine[row],
        memory.short_seen[row],
        memory.short[row],
        memory.long_seen[row],
        memory.long[row],
        memory.places[row],
        memory.statistics[row],
    )


@compiled_network
@no_type_check
def calibrate(
    logits: Float[np.ndarray, "class"],
    temperature: float,
    out: Float[np.ndarray, "class"],
) -> None:
    """Write probabilities that mean what they say.

    Args:
        logits: as they come from the heads.
        temperature: that they are divided by.
        out: where the probabilities go.
    """
    most, total = max(logits), 0.0
    for k in range(len(logits)):
        total += math.exp((logits[k] - most) / temperature)
    for k in range(len(logits)):
        out[k] = math.exp((logits[k] - most) / temperature) / total
