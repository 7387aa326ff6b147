"""The whole recogniser network: encoder, summary, temporal heads."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from eskin.graph import PRESSURE_SUMMARY, SHEAR_SUMMARY
from eskin.model import NetworkConfig
from eskin.nn.batch import GraphTensors, NetworkInput, Places
from eskin.nn.encoder import Encoder
from eskin.nn.head import TemporalHead, into_slots

FARTHEST = 4.0  # standard deviations that a summary feature may be off


class RecogniserNetwork(nn.Module):
    """Two views of a touch, each with its own temporal head, whose logits are averaged.

    The *graph* view sees the learned embedding of the contact graph beside the summary;
    the *summary* view sees only the summary, and holds its own where examples are few.
    """

    def __init__(self, config: NetworkConfig, classes: int, shear: bool) -> None:
        """Make a network for `classes` classes, with or without shear."""
        super().__init__()
        self.config = config
        self.shear = shear
        features = len(PRESSURE_SUMMARY) + (len(SHEAR_SUMMARY) if shear else 0)
        self.encoder = Encoder(config)
        self.summary_mean = nn.Buffer(torch.zeros(features))
        self.summary_scale = nn.Buffer(torch.ones(features))
        shape = (config.channels, classes, config.dropout)
        self.summary_head = TemporalHead(features, *shape)
        self.graph_head = TemporalHead(features + self.encoder.size, *shape)

    def standardise_by(self, summary: Float[Tensor, "reading feature"]) -> None:
        """Take mean and spread of the summary from the training readings."""
        self.summary_mean.copy_(summary.mean(dim=0))
        self.summary_scale.copy_(1.0 / (summary.std(dim=0) + 1e-2))

    def forward(self, batch: NetworkInput) -> Float[Tensor, "window class"]:
        """Logits of each window."""
        return self.views(batch).mean(dim=0)

    def views(self, batch: NetworkInput) -> Float[Tensor, "view window class"]:
        """Logits of each view of each window: summary, then graph."""
        return self.classify(self.embed(batch.graphs), batch.places)

    def embed(self, graphs: GraphTensors) -> Float[Tensor, "reading feature"]:
        """Standardised summary and embedding of each reading, each on its own."""
        summary = self.standardised(graphs.summary)
        return torch.cat([summary, self.encoder(graphs)], dim=1)

    def classify(
        self, e: Float[Tensor, "reading feature"], places: Places
    ) -> Float[Tensor, "view window class"]:
        """Logits of each view of each window from its readings' features."""
        summary = e[:, : len(self.summary_mean)]
        return torch.stack(
            [self.summary_view(summary, places), self.graph_view(e, places)]
        )

    def standardised(
        self, summary: Float[Tensor, "reading summary"]
    ) -> Float[Tensor, "reading summary"]:
        """The summary with mean 0 and spread 1 over training, outliers clipped."""
        centred = (summary - self.summary_mean) * self.summary_scale
        return centred.clamp(-FARTHEST, FARTHEST)

    def summary_view(
        self, summary: Float[Tensor, "reading summary"], places: Places
    ) -> Float[Tensor, "window class"]:
        """Logits from the standardised summary alone."""
        return self.summary_head(*self.lay(summary, places))

    def graph_view(
        self, e: Float[Tensor, "reading feature"], places: Places
    ) -> Float[Tensor, "window class"]:
        """Logits from summary and embedding."""
        return self.graph_head(*self.lay(e, places))

    def lay(
        self, e: Float[Tensor, "reading channel"], places: Places
    ) -> tuple[Float[Tensor, "window slot channel"], Float[Tensor, "window slot"]]:
        """Features on the head's clock, and where there are any."""
        return into_slots(
            e, places.window, places.slot, places.windows, self.config.slots
        )
