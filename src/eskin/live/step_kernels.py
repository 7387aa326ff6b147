"""Compiled kernels that compute probabilities from the taxels of touches."""

# pyright: reportAttributeAccessIssue=false
# Parts of packed tuples are known to numba only.

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import Packed, compiled_fastmath
from eskin.live.encoder_kernels import EncoderWeights, EncoderWorkspace, encode
from eskin.live.graph import GraphBatch
from eskin.live.graph_kernels import (
    GraphWorkspace,
    SkinGeometry,
    TaxelHistory,
    TimeStep,
    build_graph,
    update_taxel_history,
)
from eskin.live.head_kernels import HeadState, HeadWeights, classify
from eskin.live.model_config import MAX_DEVIATIONS
from eskin.live.summary_kernels import summarise

CLIP = np.float32(MAX_DEVIATIONS)

FREE_ROW = -1
"""Key of a row that no sequence uses."""

NO_SLOT = -(2**62)
"""Slot of the reading before the first, older than any in a window."""


class FeatureWeights(NamedTuple):
    """These weights determine the features of a graph."""

    summary_mean: Float[np.ndarray, "feature"]  # over the training readings
    summary_scale: Float[np.ndarray, "feature"]  # inverse of the standard deviation
    encoder: EncoderWeights


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
    shear: bool  # whether the network uses shear
    weights: FeatureWeights
    encoder: EncoderWorkspace  # with room for every graph that `workspace` holds
    features: Float[np.ndarray, "channel"]  # memory for the features of a graph
    heads: HeadWeights
    temperature: float  # divisor of the logits


@compiled_fastmath
def step(
    packed_parts: Packed,
    packed_pool: Packed,
    packed_nodes: Packed,
    pressure: Float[np.ndarray, "taxel"],
    shear: Float[np.ndarray, "taxel_or_none 2"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    time_step: TimeStep,
    slot: int,
    out: Float[np.ndarray, "sequence 2 class"],
) -> None:
    """Store the loads of a reading, and write the logits of each sequence.

    Args:
        packed_parts: packed `StepParts`, with room for every graph.
        packed_pool: packed `SequencePool`, with a row for every sequence.
        packed_nodes: packed `TouchNodeArrays` of the reading.
        pressure: pressure of every taxel [kPa].
        shear: shear of every taxel [kPa]; empty if it is not measured.
        T_world_link: pose of every link of the robot.
        time_step: number and time of the reading.
        slot: slot of the reading, that of the previous reading or later.
        out: output, logits and probabilities.
    """
    nodes, pool = packed_nodes.parts, packed_pool.parts
    keys, now, before = nodes.keys, nodes.active_spans, nodes.earlier_spans
    update_taxel_history(
        nodes.active, pressure, shear, time_step, packed_parts.parts.history
    )
    free_ended_rows(keys, pool.keys)
    for n in range(len(keys)):
        row = find_row(keys[n], pool.keys, pool.slots)
        step_sequence(
            packed_parts,
            nodes.active[now[n, 0] : now[n, 1]],
            nodes.earlier[before[n, 0] : before[n, 1]],
            nodes.histories[n],
            T_world_link,
            time_step,
            pool.slots[row],
            slot,
            select_row(row, pool.state),
            out[n],
        )
        pool.slots[row] = slot


@compiled_fastmath
def step_sequence(
    packed_parts: Packed,
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    history: Float[np.ndarray, "column"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    time_step: TimeStep,
    before: int,
    slot: int,
    state: HeadState,
    out: Float[np.ndarray, "2 class"],
) -> None:
    """Write logits and probabilities of one sequence.

    Arguments are those of `build_graph` and `classify`: `before` is the slot of the
    sequence's previous reading.
    """
    parts = packed_parts.parts
    build_graph(
        taxels,
        earlier,
        history,
        T_world_link,
        time_step,
        parts.geometry,
        parts.history,
        parts.workspace,
    )
    compute_features(
        parts.workspace.graph, parts.shear, parts.weights, parts.encoder, parts.features
    )
    classify(parts.features, before, slot, parts.heads, state, out[0])
    write_probabilities(out[0], parts.temperature, out[1])


@compiled_fastmath
def compute_features(
    graph: GraphBatch,
    shear: bool,
    weights: FeatureWeights,
    workspace: EncoderWorkspace,
    out: Float[np.ndarray, "channel"],
) -> None:
    """Write the standardised summary and the embedding of a batch of one graph.

    Without room for an embedding none is computed.
    """
    mean, scale = weights.summary_mean, weights.summary_scale
    summarise(graph, 0, shear, out)
    for k in range(len(mean)):
        centred = (out[k] - mean[k]) * scale[k]
        out[k] = min(max(centred, -CLIP), CLIP)
    if len(out) > len(mean):
        encode(graph, shear, weights.encoder, workspace, out[len(mean) :])


@compiled_fastmath
def free_ended_rows(
    keys: Int[np.ndarray, "sequence"], rows: Int[np.ndarray, "row"]
) -> None:
    """Free the rows of ended sequences, those that are not among the keys."""
    for row in range(len(rows)):
        ended = True
        for key in keys:
            ended = ended and rows[row] != key
        if ended:
            rows[row] = FREE_ROW


@compiled_fastmath
def find_row(
    key: int, rows: Int[np.ndarray, "row"], slots: Int[np.ndarray, "row"]
) -> int:
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
        state.fine_seen[row],
        state.fine[row],
        state.short_seen[row],
        state.short[row],
        state.long_seen[row],
        state.long[row],
        state.indices[row],
        state.statistics[row],
    )


@compiled_fastmath
def write_probabilities(
    logits: Float[np.ndarray, "class"],
    temperature: float,
    out: Float[np.ndarray, "class"],
) -> None:
    """Write the softmax of logits divided by a temperature."""
    highest, total = max(logits), 0.0
    for k in range(len(logits)):
        total += math.exp((logits[k] - highest) / temperature)
    for k in range(len(logits)):
        out[k] = math.exp((logits[k] - highest) / temperature) / total
