"""The compiled features of one graph: standardised summary, then embedding."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float

from eskin.live.encoder import EncoderMemory, EncoderWeights
from eskin.live.encoder_kernels import encode
from eskin.live.graph import Graph
from eskin.live.kernels import compiled_network
from eskin.live.summary_kernels import summarise

FARTHEST = np.float32(4.0)  # standard deviations that a summary feature may be off


class FeatureWeights(NamedTuple):
    """What is learned of features."""

    summary_mean: np.ndarray
    """(feature) over the training readings."""
    summary_scale: np.ndarray
    """(feature) inverse of their spread."""
    encoder: EncoderWeights
    """Parameters of the encoder."""


@compiled_network
@no_type_check
def featurise(
    graph: Graph,
    shear: bool,
    weights: FeatureWeights,
    memory: EncoderMemory,
    out: Float[np.ndarray, "channel"],
) -> None:
    """Write the features of a graph.

    Args:
        graph: the graph.
        shear: whether the network takes shear; else it is left out.
        weights: of the network.
        memory: with room for the graph.
        out: where the features go.
    """
    mean, scale = weights.summary_mean, weights.summary_scale
    summarise(graph, shear, out)
    for k in range(len(mean)):
        centred = (out[k] - mean[k]) * scale[k]
        out[k] = min(max(centred, -FARTHEST), FARTHEST)
    encode(graph, shear, weights.encoder, memory, out[len(mean) :])
