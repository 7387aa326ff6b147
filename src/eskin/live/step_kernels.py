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
from eskin.live.head_kernels import HeadWeights, classify
from eskin.live.model_config import MAX_DEVIATIONS, SLOT_NS
from eskin.live.summary_kernels import summarise

CLIP = np.float32(MAX_DEVIATIONS)

Taxels = Int[np.ndarray, "taxel"]
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


class StepParts(NamedTuple):
    """These parts of a step are the same for all touches."""

    geometry: SkinGeometry
    history: TaxelHistory
    workspace: GraphWorkspace
    network: NetworkParts  # with room for every graph that `workspace` holds


@compiled_fastmath
def step(
    packed_parts: Packed,
    packed_state: Packed,
    active: Taxels,
    taxels: Taxels,
    earlier: Taxels,
    touch_history: Float[np.ndarray, "column"],
    reading: KernelStep,
    out: Float[np.ndarray, "2 layer class"],
) -> None:
    """Write logits and probabilities of a sequence at the next reading, by last layer.

    The packed tuples are `StepParts` with room for its graph, and the `HeadState` of
    the sequence. `active` are the active taxels of all sequences, `taxels` those of
    this one, `earlier` those that it had in its last graph; `touch_history` has
    the columns `eskin.live.HISTORY`.
    """
    parts = packed_parts.fields
    state = packed_state.fields
    network = parts.network
    features = parts.network.features
    update_taxel_history(active, reading, parts.history)
    build_graph(
        taxels,
        earlier,
        touch_history,
        reading,
        parts.geometry,
        parts.history,
        parts.workspace,
    )
    compute_features(parts.workspace.graph, network)
    logits = out[0].reshape(out[0].size)
    classify(features, reading.stamp // SLOT_NS, network.heads, state, logits)
    for layer in range(out.shape[1]):
        write_probabilities(out[0, layer], network.temperature, out[1, layer])


@compiled_fastmath
def compute_features(graph: GraphBatch, network: NetworkParts) -> None:
    """Write the standardised summary and the embedding of a batch of one graph.

    Without room for an embedding none is computed.
    """
    mean = network.summary_mean
    scale = network.summary_scale
    out = network.features
    summarise(graph, 0, network.shear, out)
    for k in range(len(mean)):
        centred = (out[k] - mean[k]) * scale[k]
        out[k] = min(max(centred, -CLIP), CLIP)
    if len(out) > len(mean):
        embedding = out[len(mean) :]
        workspace = network.workspace
        encode(graph, network.shear, network.encoder, workspace, embedding)


@compiled_fastmath
def write_probabilities(logits: Channels, temperature: float, out: Channels) -> None:
    """Write the softmax of logits divided by a temperature."""
    highest = max(logits)
    total = 0.0
    for k in range(len(logits)):
        total += math.exp((logits[k] - highest) / temperature)
    for k in range(len(logits)):
        out[k] = math.exp((logits[k] - highest) / temperature) / total
