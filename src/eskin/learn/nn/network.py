"""This module defines the whole network: encoder, summary, temporal heads.

A head computes logits from embeddings of two seconds.
"""

from copy import deepcopy

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import conv1d, silu

from eskin.learn.nn.batch import (
    GraphTensors,
    NetworkInput,
    SlotIndex,
)
from eskin.learn.nn.encoder import Encoder
from eskin.live import (
    LONG_STRIDE,
    LONG_TAPS,
    MAX_DEVIATIONS,
    PRESSURE_SUMMARY,
    SHEAR_SUMMARY,
    SHORT_STRIDE,
    SHORT_TAPS,
    NetworkConfig,
)

Sequence = Float[Tensor, "window channel slot"]
Mask = Float[Tensor, "window 1 slot"]
Shorter = tuple[Float[Tensor, "window channel step"], Float[Tensor, "window 1 step"]]


class PartialConvolution(nn.Module):
    """A partial convolution filters in time over the slots that hold a reading.

    Sums over the present slots are scaled up as if all were present (Liu et al. 2018,
    eq. 1), so readings may come at any rate.
    """

    def __init__(self, channels: int, kernel: int, stride: int) -> None:
        """Create a layer with `kernel` taps and a stride of `stride` slots."""
        super().__init__()
        self.conv = nn.Conv1d(channels, channels, kernel, stride=stride, bias=False)
        self.bias = nn.Parameter(torch.zeros(channels))
        self.ones = nn.Buffer(torch.ones(1, 1, kernel), persistent=False)

    def forward(self, x: Sequence, present: Mask) -> Shorter:
        """Return the filtered sequence, and a mask of the outputs that cover a reading.

        The last output ends with the last slot; surplus slots are cut at the start.
        """
        kernel = self.conv.kernel_size[0]
        stride = self.conv.stride[0]
        skipped = (x.shape[2] - kernel) % stride
        x = x[:, :, skipped:]
        present = present[:, :, skipped:]
        count = conv1d(present, self.ones.to(x.dtype), stride=stride)
        scaled = self.conv(x * present) * (kernel / count.clamp(min=1.0))
        mask = (count > 0).to(x.dtype)
        return silu(scaled + self.bias[:, None]) * mask, mask


class TemporalHead(nn.Module):
    """A head computes logits from statistics of embeddings over time.

    The statistics are mean, spread, maximum and integral over the window, of the
    embeddings (20 ms) and of the output of each of two partial convolutions (0.18 s and
    0.5 s); one linear layer follows.

    Another one, `close`, may answer for touches that have closed.
    """

    def __init__(
        self, inputs: int, channels: int, classes: int, dropout: float
    ) -> None:
        """Create a head for embeddings of `inputs` channels."""
        super().__init__()
        self.project = nn.Linear(inputs, channels)
        self.short = PartialConvolution(channels, SHORT_TAPS, SHORT_STRIDE)
        self.long = PartialConvolution(channels, LONG_TAPS, LONG_STRIDE)
        self.dropout = nn.Dropout(dropout)
        self.classify = nn.Linear(12 * channels, classes)
        self.close: nn.Linear | None = None

    def forward(
        self,
        e: Float[Tensor, "window slot input"],
        present: Float[Tensor, "window slot"],
    ) -> Float[Tensor, "window class"]:
        """Return the logits of windows; `present` is 1 where a slot holds a reading."""
        return self.classify(self.dropout(self.summarise(e, present)))

    def select_layer(self, closing: bool) -> nn.Linear:
        """Return the last layer for windows that end with their touches, or anywhere.

        Without a closing layer it is the open one for all.
        """
        return self.close if closing and self.close is not None else self.classify

    def summarise(
        self,
        e: Float[Tensor, "window slot input"],
        present: Float[Tensor, "window slot"],
    ) -> Float[Tensor, "window statistic"]:
        """Return the statistics of windows, which the last layer takes."""
        mask = present[:, None]
        fine = silu(self.project(e)).transpose(1, 2) * mask
        short, short_mask = self.short(fine, mask)
        long, long_mask = self.long(short, short_mask)
        # Share of the window since its first reading.
        begun = (present.cumsum(dim=1) > 0).to(present.dtype)
        share = begun.mean(dim=1, keepdim=True)
        scales = (fine, mask), (short, short_mask), (long, long_mask)
        statistics = [compute_statistics(x, seen, share) for x, seen in scales]
        return torch.cat(statistics, dim=1)


def compute_statistics(
    x: Sequence, mask: Mask, share: Float[Tensor, "window 1"]
) -> Float[Tensor, "window feature"]:
    """Return mean, standard deviation, maximum and integral over the present slots.

    All are zero without any. The integral, the mean times the share of the window since
    its first reading, measures how long something lasted, at any rate of readings.
    """
    count = mask.sum(dim=2).clamp(min=1.0)
    mean = x.sum(dim=2) / count
    variance = ((x - mean[:, :, None]) ** 2 * mask).sum(dim=2) / count
    largest = torch.where(mask > 0, x, -torch.inf).amax(dim=2)
    largest = torch.where(torch.isfinite(largest), largest, 0.0)
    spread = torch.sqrt(variance + 1e-4)
    return torch.cat([mean, spread, largest, mean * share], dim=1)


def scatter_to_slots(
    e: Float[Tensor, "reading channel"], slot_index: SlotIndex, slots: int
) -> tuple[Float[Tensor, "window slot channel"], Float[Tensor, "window slot"]]:
    """Scatter readings to time slots; several in one slot give their maximum.

    Jiang et al. 2025 (section IV-C3) have a buffer of the last 100 graphs instead.

    Returns:
        Features by time slot, and a mask that is 1 for slots with a reading.
    """
    total = slot_index.windows * slots
    place = slot_index.window * slots + slot_index.slot
    empty = torch.full((total, e.shape[1]), -torch.inf, dtype=e.dtype)
    filled = empty.scatter_reduce(0, place[:, None].expand_as(e), e, "amax")
    present = torch.zeros(total, dtype=e.dtype).index_fill(0, place, 1.0)
    filled = torch.where(present[:, None] > 0, filled, 0.0)
    shape = slot_index.windows, slots
    return filled.view(*shape, -1), present.view(shape)


class RecogniserNetwork(nn.Module):
    """A network averages the logits of branches of a touch, each with its own head.

    The *summary* branch takes only the summary. The *graph* branch takes the summary
    and the learned embedding of the contact graph; a network of width 0 does not have
    it.

    Jiang et al. 2025 (Fig. 7b) have one graph of the whole skin and no summary.
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
        """Set mean and scale of the summary from the training readings."""
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
        branches = zip(self.heads, self.split_inputs(e), strict=False)
        return torch.stack([head(x, present) for head, x in branches])

    def summarise(
        self, e: Float[Tensor, "reading feature"], slot_index: SlotIndex
    ) -> Float[Tensor, "window statistic"]:
        """Return the statistics of windows that the heads classify, side by side."""
        slots, present = scatter_to_slots(e, slot_index, self.config.slots)
        branches = zip(self.heads, self.split_inputs(slots), strict=False)
        return torch.cat([head.summarise(x, present) for head, x in branches], dim=1)

    def classify_statistics(
        self, statistics: Float[Tensor, "window statistic"], closing: bool = False
    ) -> Float[Tensor, "window class"]:
        """Return the logits of windows from their statistics.

        Args:
            statistics: statistics that `summarise` returns.
            closing: whether the windows end with their touches, so that the closing
                layer answers, where there is one.
        """
        parts = statistics.chunk(len(self.heads), dim=1)
        branches = zip(self.heads, parts, strict=True)
        logits = [head.select_layer(closing)(part) for head, part in branches]
        return torch.stack(logits).mean(dim=0)

    def split_inputs(
        self, e: Float[Tensor, "window slot feature"]
    ) -> tuple[Float[Tensor, "window slot summary"], Float[Tensor, "window slot all"]]:
        """Return the inputs of the heads of the summary and of the graphs."""
        return e[:, :, : len(self.summary_mean)], e

    @property
    def has_closing_layer(self) -> bool:
        """Whether the heads have closing layers."""
        return self.summary_head.close is not None

    def add_closing_layer(self) -> list[nn.Linear]:
        """Give the heads a closing layer that equals the open one; return its parts."""
        layers = [deepcopy(head.classify) for head in self.heads]
        for head, layer in zip(self.heads, layers, strict=True):
            head.close = layer
        return layers

    def remove_closing_layer(self) -> None:
        """Let the open layer answer for touches that have closed."""
        for head in self.heads:
            head.close = None

    @property
    def heads(self) -> list[TemporalHead]:
        """Heads of the branches: summary, then graph."""
        return [self.summary_head, *([self.graph_head] if self.config.width else [])]

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
