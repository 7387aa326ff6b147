"""Compiled kernels that compute probabilities from the taxels of touches."""

# pyright: reportAttributeAccessIssue=false
# Parts of packed tuples are known to numba only.

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import Packed, compiled_fastmath
from eskin.live.encoder_kernels import (
    EncoderWeights,
    EncoderWorkspace,
    encode,
)
from eskin.live.graph import GraphBatch
from eskin.live.graph_kernels import (
    GraphWorkspace,
    KernelStep,
    SkinGeometry,
    TaxelHistory,
    build_graph,
    update_taxel_history,
)
from eskin.live.head_kernels import HeadState, HeadWeights, classify
from eskin.live.model_config import MAX_DEVIATIONS, SLOT_NS
from eskin.live.summary_kernels import summarise

CLIP = np.float32(MAX_DEVIATIONS)

FREE_ROW = -1
"""Key of a row that no sequence uses."""

NO_SLOT = -(2**62)
"""Slot of the reading before the first, older than any in a window."""


Keys = Int[np.ndarray, "sequence"]
Channels = Float[np.ndarray, "channel"]


class NetworkParts(NamedTuple):
    """These parts of a network compute the features and the logits of one graph."""

    shear: bool  # whether the network uses shear
    summary_mean: Float[np.ndarray, "feature"]  # over the training readings
    summary_scale: Float[np.ndarray, "feature"]  # inverse of the standard deviation
    encoder: EncoderWeights
    heads: HeadWeights
    temperature: float  # divisor of the logits
    workspace: EncoderWorkspace
    features: Channels  # memory for the features of a graph


class SequencePool(NamedTuple):
    """A pool holds the states of all sequences of a stream, one row for each."""

    keys: Int[np.ndarray, "row"]  # key of the sequence that uses the row, or `FREE_ROW`
    slots: Int[np.ndarray, "row"]  # slot of its latest reading
    state: HeadState  # arrays with a further first axis, the row


class StepParts(NamedTuple):
    """These parts of a step are the same for all touches."""

    geometry: SkinGeometry
    history: TaxelHistory
    workspace: GraphWorkspace
    network: NetworkParts  # with room for every graph that `workspace` holds


@compiled_fastmath
def step(
    packed_parts: Packed,
    packed_pool: Packed,
    packed_nodes: Packed,
    reading: KernelStep,
    out: Float[np.ndarray, "sequence 2 class"],
) -> None:
    """Store the loads of a reading, and write logits and probabilities.

    The packed tuples are `StepParts` with room for every graph, a `SequencePool` with a
    row for every sequence, and the `TouchNodeArrays` of the reading.
    """
    parts, pool, nodes = packed_parts.parts, packed_pool.parts, packed_nodes.parts
    slot = reading.stamp // SLOT_NS
    update_taxel_history(nodes.active, reading, parts.history)
    free_ended_rows(nodes.keys, pool.keys)
    for n in range(len(nodes.keys)):
        now, before = nodes.active_spans[n], nodes.earlier_spans[n]
        build_graph(
            nodes.active[now[0] : now[1]],
            nodes.earlier[before[0] : before[1]],
            nodes.histories[n],
            reading,
            parts.geometry,
            parts.history,
            parts.workspace,
        )
        network, features = parts.network, parts.network.features
        compute_features(parts.workspace.graph, network)
        row = find_row(nodes.keys[n], pool.keys, pool.slots)
        state, logits = select_row(row, pool.state), out[n, 0]
        classify(features, pool.slots[row], slot, network.heads, state, logits)
        pool.slots[row] = slot
        write_probabilities(logits, network.temperature, out[n, 1])


@compiled_fastmath
def compute_features(graph: GraphBatch, network: NetworkParts) -> None:
    """Write the standardised summary and the embedding of a batch of one graph.

    Without room for an embedding none is computed.
    """
    mean, scale, out = network.summary_mean, network.summary_scale, network.features
    summarise(graph, 0, network.shear, out)
    for k in range(len(mean)):
        centred = (out[k] - mean[k]) * scale[k]
        out[k] = min(max(centred, -CLIP), CLIP)
    if len(out) > len(mean):
        embedding, workspace = out[len(mean) :], network.workspace
        encode(graph, network.shear, network.encoder, workspace, embedding)


@compiled_fastmath
def free_ended_rows(keys: Keys, rows: Keys) -> None:
    """Free the rows of ended sequences, those that are not among the keys."""
    for row in range(len(rows)):
        ended = True
        for key in keys:
            ended = ended and rows[row] != key
        if ended:
            rows[row] = FREE_ROW


@compiled_fastmath
def find_row(key: int, rows: Keys, slots: Int[np.ndarray, "row"]) -> int:
    """Return the row of a sequence; a new sequence gets a free row."""
    free = FREE_ROW
    for row in range(len(rows)):
        if rows[row] == key:
            return row
        if rows[row] == FREE_ROW and free == FREE_ROW:
            free = row
    rows[free], slots[free] = key, NO_SLOT
    return free


@compiled_fastmath
def select_row(row: int, state: HeadState) -> HeadState:
    """Return the state in one row of a pool."""
    return HeadState(
        state.newest[row],
        state.seen[row],
        state.values[row],
        state.indices[row],
        state.statistics[row],
    )


@compiled_fastmath
def write_probabilities(logits: Channels, temperature: float, out: Channels) -> None:
    """Write the softmax of logits divided by a temperature."""
    highest, total = max(logits), 0.0
    for k in range(len(logits)):
        total += math.exp((logits[k] - highest) / temperature)
    for k in range(len(logits)):
        out[k] = math.exp((logits[k] - highest) / temperature) / total
