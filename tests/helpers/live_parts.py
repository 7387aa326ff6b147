"""Run the parts of the compiled network's step one by one, for tests and timing."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.live import SLOT_NS, GraphBatch, Network
from eskin.live.head_kernels import HeadWeights, classify
from eskin.live.network import create_head_state
from eskin.live.step_kernels import compute_features as compiled_features


def compute_features(
    network: Network, graph: GraphBatch
) -> Float[np.ndarray, "channel"]:
    """Return the standardised summary and the embedding of a batch of one graph.

    They are overwritten with those of the next graph.
    """
    graph = graph.for_kernels()
    parts = network.reserve(int(graph.offsets[1]), graph.neighbours.shape[1])
    compiled_features(graph, parts)
    return parts.features


@final
class SequenceWindow:
    """Holds the window of one sequence, whose logits each reading updates.

    Readings that share a slot give their maximum; slots without a reading hold none.
    The logits are those that the heads give for the whole window.
    """

    def __init__(self, weights: HeadWeights, slots: int) -> None:
        """Start with an empty window."""
        self.weights = weights
        self.state = create_head_state(weights, slots)

    def push(
        self, stamp: int, features: Float[np.ndarray, "channel"]
    ) -> Float[np.ndarray, "class"]:
        """Return the logits of the window that ends with a reading.

        Args:
            stamp: stamp of the reading, later than the previous [ns since the epoch].
            features: features of the reading.
        """
        logits = np.empty_like(self.weights.classify_bias)
        classify(features, stamp // SLOT_NS, self.weights, self.state, logits)
        return logits
