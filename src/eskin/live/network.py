"""The network of `eskin.nn`, compiled: the part of a reading, then of a window."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.live.encoder import encoder_memory, encoder_weights
from eskin.live.feature_kernels import FeatureWeights, featurise
from eskin.live.graph import Graph
from eskin.live.head import head_weights
from eskin.live.window import Window
from eskin.model import Model
from eskin.model.file import checked_weights

NODES, NEIGHBOURS = 256, 16
"""What there is memory for at first."""


@final
class Network:
    """What `eskin.nn.RecogniserNetwork` computes, without torch.

    It comes in two halves: `features` once a reading, then a `Window` of each sequence.
    Its memory serves one thread at a time; the interpreter is free while it works.
    """

    def __init__(self, model: Model) -> None:
        """Take a model's weights.

        Raises:
            ModelError: naming the first parameter that does not fit the model's card.
        """
        weights, config = checked_weights(model), model.card.network
        self.shear = model.card.kind == "shear"
        self.slots, self.width = config.slots, config.width
        self.weights = FeatureWeights(
            weights["summary_mean"],
            weights["summary_scale"],
            encoder_weights(weights, config.layers),
        )
        self.heads = head_weights(weights)
        self.memory = encoder_memory(NODES, NEIGHBOURS, self.width)
        self.channels = len(self.weights.summary_mean) + 2 * self.width
        self.out = np.empty(self.channels, np.float32)

    def features(self, graph: Graph) -> Float[np.ndarray, "channel"]:
        """Standardised summary and embedding of a graph.

        They stand in the network's own memory until the next graph.
        """
        self.make_room(graph.nodes, graph.neighbours.shape[1])
        featurise(graph, self.shear, self.weights, self.memory, self.out)
        return self.out

    def make_room(self, nodes: int, neighbours: int) -> None:
        """Take memory for twice as large a graph if this one does not fit."""
        memory = self.memory
        fits = nodes <= len(memory.nodes) and neighbours <= len(memory.hidden)
        if not fits or nodes * neighbours > len(memory.sources):
            self.memory = encoder_memory(2 * nodes, neighbours, self.width)

    def window(self) -> Window:
        """An empty window for one sequence."""
        return Window(self.heads, self.slots)
