"""From the graphs of each reading to the logits of each sequence."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.graph import GraphBatch
from eskin.live.graph import graph_of
from eskin.live.network import Network
from eskin.live.window import Window
from eskin.model import Model

Logits = dict[int, Float[np.ndarray, "class"]]


@final
class LogitStream:
    """The network on a stream: each graph is encoded once and remembered for 2 s.

    Attributes:
        network: the network.
        logits: of each sequence at the latest reading, by its key.
    """

    def __init__(self, model: Model) -> None:
        """Start before the first reading.

        Raises:
            ModelError: the weights do not fit the model's card.
        """
        self.network = Network(model)
        self.windows: dict[int, Window] = {}
        self.logits: Logits = {}

    def push(self, graphs: dict[int, GraphBatch], stamp: int) -> Logits:
        """Logits of every sequence that has a graph at this reading.

        A sequence without one has ended.

        Args:
            graphs: one graph a sequence.
            stamp: of the reading, later than the one before [ns since the epoch].
        """
        self.windows = {
            key: self.windows.get(key) or self.network.window() for key in graphs
        }
        self.logits = {
            key: window.push(stamp, self.network.features(graph_of(graphs[key])))
            for key, window in self.windows.items()
        }
        return self.logits
