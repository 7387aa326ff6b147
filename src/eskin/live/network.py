"""The network of `eskin.nn`, in numpy: the part of a reading, then of a window."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.graph import GraphBatch, pressure_summary, shear_summary
from eskin.live.encoder import Encoder
from eskin.live.head import TemporalHead
from eskin.live.layers import under
from eskin.model import Model
from eskin.model.weights import checked_weights

FARTHEST = 4.0  # standard deviations that a summary feature may be off


@final
class Network:
    """What `eskin.nn.RecogniserNetwork` computes, without torch.

    It comes in two halves: `features` once a reading, `logits` once a window.
    """

    def __init__(self, model: Model) -> None:
        """Take a model's weights.

        Raises:
            ModelError: naming the first parameter that does not fit the model's card.
        """
        weights, card = checked_weights(model), model.card
        self.shear = card.kind == "shear"
        self.summary_mean = weights["summary_mean"]
        self.summary_scale = weights["summary_scale"]
        self.encoder = Encoder(
            under(weights, "encoder"), card.network.layers, self.shear
        )
        self.summary_head = TemporalHead(under(weights, "summary_head"))
        self.graph_head = TemporalHead(under(weights, "graph_head"))
        self.channels = len(self.summary_mean) + 2 * card.network.width

    def features(self, batch: GraphBatch) -> Float[np.ndarray, "graph channel"]:
        """Standardised summary and embedding of every graph."""
        centred = (self.summary(batch) - self.summary_mean) * self.summary_scale
        summary = np.clip(centred, -FARTHEST, FARTHEST)
        return np.concatenate([summary, self.encoder(batch)], axis=1)

    def summary(self, batch: GraphBatch) -> Float[np.ndarray, "graph feature"]:
        """Pressure and, where the network takes it, shear summary of each graph."""
        if not self.shear:
            return pressure_summary(batch)
        return np.concatenate([pressure_summary(batch), shear_summary(batch)], axis=1)

    def logits(
        self,
        e: Float[np.ndarray, "slot channel"],
        present: Float[np.ndarray, "slot"],
    ) -> Float[np.ndarray, "class"]:
        """Logits of a window of features; `present` is 1 where a slot holds any."""
        summary = np.ascontiguousarray(e[:, : len(self.summary_mean)])
        views = self.summary_head(summary, present), self.graph_head(e, present)
        return 0.5 * (views[0] + views[1])
