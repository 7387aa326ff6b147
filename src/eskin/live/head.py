"""The temporal head of `eskin.nn`, in numpy, for one window."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.live.layers import Linear, Weights, silu, under

Sequence = Float[np.ndarray, "slot channel"]
Mask = Float[np.ndarray, "slot 1"]
Filtered = tuple[Float[np.ndarray, "output channel"], Float[np.ndarray, "output 1"]]


@final
class PartialConvolution:
    """A convolution in time over the slots that hold a reading, as in `eskin.nn`."""

    def __init__(self, weights: Weights, stride: int) -> None:
        """Take the convolution's own weights."""
        filters = weights["conv.weight"]
        self.kernel, self.stride = filters.shape[2], stride
        self.filters = filters.transpose(0, 2, 1).reshape(len(filters), -1)
        self.bias = weights["bias"]

    def __call__(self, x: Sequence, present: Mask) -> Filtered:
        """Filter; the mask returned tells which outputs saw any reading.

        The last output ends with the last slot: what is cut off is the oldest.
        """
        seen = self.gather(present).sum(axis=1, keepdims=True)
        scaled = self.gather(x * present) @ self.filters.T
        scaled *= self.kernel / np.maximum(seen, 1.0)
        mask = (seen > 0).astype(np.float32)
        return silu(scaled + self.bias) * mask, mask

    def gather(
        self, x: Float[np.ndarray, "slot channel"]
    ) -> Float[np.ndarray, "output tap"]:
        """What each output looks at: all channels at its first tap, then the next."""
        skipped = (len(x) - self.kernel) % self.stride
        firsts = np.arange(skipped, len(x) - self.kernel + 1, self.stride)
        parts = x[firsts[:, None] + np.arange(self.kernel)]
        return parts.reshape(len(parts), -1)


@final
class TemporalHead:
    """A window of features to logits, as `eskin.nn.TemporalHead` does it."""

    def __init__(self, weights: Weights) -> None:
        """Take the head's own weights."""
        self.project = Linear.of(weights, "project")
        self.short = PartialConvolution(under(weights, "short"), stride=4)
        self.long = PartialConvolution(under(weights, "long"), stride=2)
        self.classify = Linear.of(weights, "classify")

    def __call__(
        self,
        e: Float[np.ndarray, "slot input"],
        present: Float[np.ndarray, "slot"],
    ) -> Float[np.ndarray, "class"]:
        """Logits of the window; `present` is 1 where a slot holds a reading."""
        mask = present[:, None]
        fine = silu(self.project(e)) * mask
        short, short_mask = self.short(fine, mask)
        long, long_mask = self.long(short, short_mask)
        share = np.maximum.accumulate(present).mean()
        features = np.concatenate(
            [
                statistics(fine, mask, share),
                statistics(short, short_mask, share),
                statistics(long, long_mask, share),
            ]
        )
        return self.classify(features)


def statistics(
    x: Sequence, mask: Mask, share: np.float32
) -> Float[np.ndarray, "feature"]:
    """Mean, spread and maximum over the present slots, zero without any, and integral.

    Args:
        x: what to look at.
        mask: where there is anything.
        share: of the window since its first reading.
    """
    count = np.maximum(mask.sum(), 1.0)
    mean = x.sum(axis=0) / count
    variance = ((x - mean) ** 2 * mask).sum(axis=0) / count
    largest = np.where(mask > 0, x, -np.inf).max(axis=0)
    largest = np.where(np.isfinite(largest), largest, 0.0)
    spread = np.sqrt(variance + 1e-4)
    return np.concatenate([mean, spread, largest, mean * share])
