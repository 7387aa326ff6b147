"""From the last two seconds of embeddings to logits."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import conv1d, silu

Sequence = Float[Tensor, "window channel slot"]
Mask = Float[Tensor, "window 1 slot"]
Shorter = tuple[Float[Tensor, "window channel step"], Float[Tensor, "window 1 step"]]


class PartialConvolution(nn.Module):
    """A convolution in time over the slots that hold a reading.

    Sums over the present slots are scaled up as if all were present (Liu et al. 2018,
    eq. 1), so readings may come at any rate.
    """

    def __init__(self, channels: int, kernel: int, stride: int) -> None:
        """Make a layer that looks at `kernel` slots, `stride` apart."""
        super().__init__()
        self.conv = nn.Conv1d(channels, channels, kernel, stride=stride, bias=False)
        self.bias = nn.Parameter(torch.zeros(channels))
        self.ones = nn.Buffer(torch.ones(1, 1, kernel), persistent=False)

    def forward(self, x: Sequence, present: Mask) -> Shorter:
        """Filter; the mask returned tells which outputs saw any reading.

        The last output ends with the last slot: what is cut off is the oldest.
        """
        kernel, stride = self.conv.kernel_size[0], self.conv.stride[0]
        skipped = (x.shape[2] - kernel) % stride
        x, present = x[:, :, skipped:], present[:, :, skipped:]
        seen = conv1d(present, self.ones.to(x.dtype), stride=stride)
        scaled = self.conv(x * present) * (kernel / seen.clamp(min=1.0))
        mask = (seen > 0).to(x.dtype)
        return silu(scaled + self.bias[:, None]) * mask, mask


class TemporalHead(nn.Module):
    """Partial convolutions at two time scales, statistics over time, one linear layer.

    Mean, spread, maximum and integral over the window are taken of the embeddings
    (20 ms) and of each convolution's output (0.18 s and 0.5 s).
    """

    def __init__(
        self, inputs: int, channels: int, classes: int, dropout: float
    ) -> None:
        """Make a head for embeddings of `inputs` channels."""
        super().__init__()
        self.project = nn.Linear(inputs, channels)
        self.short = PartialConvolution(channels, kernel=9, stride=4)
        self.long = PartialConvolution(channels, kernel=5, stride=2)
        self.dropout = nn.Dropout(dropout)
        self.classify = nn.Linear(12 * channels, classes)

    def forward(
        self,
        e: Float[Tensor, "window slot input"],
        present: Float[Tensor, "window slot"],
    ) -> Float[Tensor, "window class"]:
        """Logits of each window; `present` is 1 where a slot holds a reading."""
        mask = present[:, None]
        fine = silu(self.project(e)).transpose(1, 2) * mask
        short, short_mask = self.short(fine, mask)
        long, long_mask = self.long(short, short_mask)
        share = covered(present)
        features = torch.cat(
            [
                statistics(fine, mask, share),
                statistics(short, short_mask, share),
                statistics(long, long_mask, share),
            ],
            dim=1,
        )
        return self.classify(self.dropout(features))


def covered(present: Float[Tensor, "window slot"]) -> Float[Tensor, "window 1"]:
    """Share of the window since its first reading: how long there was a touch."""
    since = present.cummax(dim=1).values
    return since.mean(dim=1, keepdim=True)


def statistics(
    x: Sequence, mask: Mask, share: Float[Tensor, "window 1"]
) -> Float[Tensor, "window feature"]:
    """Mean, standard deviation and maximum over the present slots, zero without any.

    The mean times the share of the window covered is the integral, which tells how
    long something lasted, at any rate of readings.
    """
    count = mask.sum(dim=2).clamp(min=1.0)
    mean = x.sum(dim=2) / count
    variance = ((x - mean[:, :, None]) ** 2 * mask).sum(dim=2) / count
    largest = torch.where(mask > 0, x, -torch.inf).amax(dim=2)
    largest = torch.where(torch.isfinite(largest), largest, 0.0)
    spread = torch.sqrt(variance + 1e-4)
    return torch.cat([mean, spread, largest, mean * share], dim=1)


def into_slots(
    e: Float[Tensor, "reading channel"],
    window: Int[Tensor, "reading"],
    slot: Int[Tensor, "reading"],
    windows: int,
    slots: int,
) -> tuple[Float[Tensor, "window slot channel"], Float[Tensor, "window slot"]]:
    """Lay readings on the head's clock; several in one slot give their maximum."""
    place = window * slots + slot
    index = place[:, None].expand_as(e)
    empty = torch.full((windows * slots, e.shape[1]), -torch.inf, dtype=e.dtype)
    filled = empty.scatter_reduce(0, index, e, "amax")
    present = torch.zeros(windows * slots, dtype=e.dtype)
    present = present.index_fill(0, place, 1.0)
    filled = torch.where(present[:, None] > 0, filled, 0.0)
    return filled.view(windows, slots, -1), present.view(windows, slots)
