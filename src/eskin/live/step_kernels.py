"""The compiled step of one touch at one reading: from its taxels to probabilities."""

import math
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.arrays import GraphMemory, Ground, Instant, Loads
from eskin.graph.builder_kernels import build_graph
from eskin.live.encoder import EncoderMemory
from eskin.live.feature_kernels import FeatureWeights, featurise
from eskin.live.graph import Graph
from eskin.live.head import HeadWeights
from eskin.live.head_kernels import classify
from eskin.live.held import Held
from eskin.live.kernels import compiled


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


@compiled
@no_type_check
def step(
    parts_held: Held,
    window_held: Held,
    taxels: Int[np.ndarray, "active"],
    earlier: Int[np.ndarray, "earlier"],
    history: Float[np.ndarray, "column"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    instant: Instant,
    before: int,
    now: int,
    out: Float[np.ndarray, "2 class"],
) -> None:
    """Write logits and probabilities of one sequence at a reading that is taken in.

    Args:
        parts_held: `StepParts`, with room for the touch's graph.
        window_held: `HeadMemory` of the sequence.
        taxels: its active taxels now.
        earlier: those it had one reading ago.
        history: what it has been so far.
        T_world_link: of every link of the robot.
        instant: of the reading.
        before: number of the slot of the reading before; long ago for the first.
        now: number of its own slot, the same or later.
        out: where they go.
    """
    parts = parts_held.parts
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
    classify(parts.features, before, now, parts.heads, window_held.parts, out[0])
    calibrate(out[0], parts.temperature, out[1])


@compiled
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
