"""This module defines the whole network: encoder, summary, temporal heads."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from eskin.learn.nn.batch import (
    GraphTensors,
    NetworkInput,
    SlotIndex,
)
from eskin.learn.nn.encoder import Encoder
from eskin.learn.nn.head import TemporalHead, scatter_to_slots
from eskin.live import MAX_DEVIATIONS, PRESSURE_SUMMARY, SHEAR_SUMMARY, NetworkConfig


class RecogniserNetwork(nn.Module):
    """A network averages the logits of branches of a touch, each with its own head.

    The *summary* branch takes only the summary. The *graph* branch takes the summary
    and the learned embedding of the contact graph; a network of width 0 does not have
    it.
    """

    def __init__(self, config: NetworkConfig, classes: int, shear: bool) -> None:
        """Create a network for `classes` classes, with or without shear."""
        super().__init__()
        self.config = config
        self.classes = classes
        self.shear = shear
        features = len(PRESSURE_SUMMARY) + (len(SHEAR_SUMMARY) if shear else 0)
        self.summary_mean = nn.Buffer(torch.zeros(features))
        self.summary_scale = nn.Buffer(torch.ones(features))
        if config.width:
            self.encoder = Encoder(config)
        self.summary_head = TemporalHead(
            features, config.channels, classes, config.dropout
        )
        if config.width:
            size = features + self.encoder.size
            self.graph_head = TemporalHead(
                size, config.channels, classes, config.dropout
            )

    def fit_summary(self, summary: Float[Tensor, "reading feature"]) -> None:
        """Set mean and scale of the summary from those of the training readings."""
        self.summary_mean.copy_(summary.mean(dim=0))
        self.summary_scale.copy_(1.0 / (summary.std(dim=0) + 1e-2))

    def forward(self, batch: NetworkInput) -> Float[Tensor, "window class"]:
        """Return the logits of each window."""
        return self.branches(batch).mean(dim=0)

    def branches(self, batch: NetworkInput) -> Float[Tensor, "branch window class"]:
        """Return the logits of each branch of each window: summary, then graph."""
        return self.classify(self.embed(batch.graphs), batch.slot_index)

    def embed(self, graphs: GraphTensors) -> Float[Tensor, "reading feature"]:
        """Return the standardised summary, and the embedding, of each reading."""
        summary = self.standardise(graphs.summary)
        if not self.config.width:
            return summary
        return torch.cat([summary, self.encoder(graphs)], dim=1)

    def classify(
        self, e: Float[Tensor, "reading feature"], slot_index: SlotIndex
    ) -> Float[Tensor, "branch window class"]:
        """Return the logits of each branch and window from its readings' features."""
        return self.classify_slots(*scatter_to_slots(e, slot_index, self.config.slots))

    def classify_slots(
        self,
        e: Float[Tensor, "window slot feature"],
        present: Float[Tensor, "window slot"],
    ) -> Float[Tensor, "branch window class"]:
        """Return the logits of each branch and window from its slots' features."""
        summary = e[:, :, : len(self.summary_mean)]
        branches = [self.summary_head(summary, present)]
        if self.config.width:
            branches.append(self.graph_head(e, present))
        return torch.stack(branches)

    def standardise(
        self, summary: Float[Tensor, "reading summary"]
    ) -> Float[Tensor, "reading summary"]:
        """Return the summary with mean 0 and scale 1 over training, clipped."""
        centred = (summary - self.summary_mean) * self.summary_scale
        return centred.clamp(-MAX_DEVIATIONS, MAX_DEVIATIONS)

    def summary_branch(
        self, summary: Float[Tensor, "reading summary"], slot_index: SlotIndex
    ) -> Float[Tensor, "window class"]:
        """Return the logits from the standardised summary alone."""
        slots = scatter_to_slots(summary, slot_index, self.config.slots)
        return self.summary_head(*slots)

    def graph_branch(
        self, e: Float[Tensor, "reading feature"], slot_index: SlotIndex
    ) -> Float[Tensor, "window class"]:
        """Return the logits from summary and embedding."""
        return self.graph_head(*scatter_to_slots(e, slot_index, self.config.slots))
