"""Compiled kernels that update the temporal heads by what a new reading changes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled_fastmath
from eskin.live.encoder_kernels import silu
from eskin.live.model_config import (
    LONG_STRIDE,
    LONG_TAPS,
    SHORT_STRIDE,
    SHORT_TAPS,
)

SCALES = 3
"""Number of time scales: a slot, and the spans of the two convolutions."""

STATISTICS = 4
"""Statistics of each channel at each scale: mean, spread, maximum, integral."""

LONG_SPACING = SHORT_STRIDE * LONG_STRIDE
ZERO = np.float32(0.0)


class HeadWeights(NamedTuple):
    """Parameters of all heads, whose channels lie side by side, a branch's together.

    Inputs that a head does not take have zeros for weights.
    """

    project_weight: Float[np.ndarray, "input channel"]
    project_bias: Float[np.ndarray, "channel"]
    short_weight: Float[np.ndarray, "branch tap*width width"]
    short_bias: Float[np.ndarray, "channel"]
    long_weight: Float[np.ndarray, "branch tap*width width"]
    long_bias: Float[np.ndarray, "channel"]
    classify_weight: Float[np.ndarray, "class scale*statistic*channel"]  # for the mean
    classify_bias: Float[np.ndarray, "class"]


class HeadState(NamedTuple):
    """A state holds the ring buffers of one sequence; slot n is at n modulo the slots.

    An output of a convolution is stored at the slot of its last tap, whether or not the
    window that ends now uses it: it is computed once, and used every fourth or eighth
    slot. `..._seen` tells whether an output covers a reading.
    """

    newest: Float[np.ndarray, "input"]  # features of the newest slot
    fine_seen: Bool[np.ndarray, "slot"]
    fine: Float[np.ndarray, "slot channel"]  # projection of the features
    short_seen: Bool[np.ndarray, "slot"]
    short: Float[np.ndarray, "slot channel"]  # output of the short convolution
    long_seen: Bool[np.ndarray, "slot"]
    long: Float[np.ndarray, "slot channel"]  # output of the long convolution
    indices: Int[np.ndarray, "slot"]  # indices of the outputs that statistics are over
    statistics: Float[np.ndarray, "scale*statistic channel"]  # of the window


@compiled_fastmath
def add_vecmat(
    x: Float[np.ndarray, "input"],
    weight: Float[np.ndarray, "input output"],
    out: Float[np.ndarray, "output"],
) -> None:
    """Add x @ weight to `out`, four inputs at a time."""
    inputs, outputs = weight.shape
    fours = inputs - inputs % 4
    for c in range(0, fours, 4):
        x0, x1, x2, x3 = x[c], x[c + 1], x[c + 2], x[c + 3]
        w0, w1, w2, w3 = weight[c], weight[c + 1], weight[c + 2], weight[c + 3]
        for o in range(outputs):
            out[o] += x0 * w0[o] + x1 * w1[o] + x2 * w2[o] + x3 * w3[o]
    for c in range(fours, inputs):
        for o in range(outputs):
            out[o] += x[c] * weight[c, o]


@compiled_fastmath
def dot(
    x: Float[np.ndarray, "input"], weight: Float[np.ndarray, "input"]
) -> np.float32:
    """Return the sum of products, for short vectors faster than BLAS."""
    total = np.float32(0.0)
    for c in range(len(x)):
        total += x[c] * weight[c]
    return total


@compiled_fastmath
def classify(
    features: Float[np.ndarray, "input"],
    before: int,
    now: int,
    weights: HeadWeights,
    state: HeadState,
    logits: Float[np.ndarray, "class"],
) -> None:
    """Update the state with a reading, and write the logits of the window ending now.

    Args:
        features: features of the reading.
        before: slot of the previous reading; `NO_SLOT` for the first.
        now: slot of the reading, the same or later.
        weights: weights of all heads.
        state: state of the sequence.
        logits: output, the logits.
    """
    slots = len(state.fine_seen)
    if now - before >= slots:
        state.fine_seen[:] = False
        state.short_seen[:] = False
        state.long_seen[:] = False
    else:
        for slot in range(before + 1, now):
            state.fine_seen[slot % slots] = False
            convolve(slot, weights, state)
    if now == before:
        for c in range(len(features)):
            state.newest[c] = max(state.newest[c], features[c])
    else:
        state.newest[:] = features
    state.fine_seen[now % slots] = True
    fine = state.fine[now % slots]
    fine[:] = ZERO
    add_vecmat(state.newest, weights.project_weight, fine)
    activate_scaled(fine, np.float32(1.0), weights.project_bias)
    convolve(now, weights, state)
    update_statistics(now, state)
    flat = state.statistics.reshape(state.statistics.size)
    for k in range(len(logits)):
        logits[k] = weights.classify_bias[k] + dot(flat, weights.classify_weight[k])


@compiled_fastmath
def convolve(slot: int, weights: HeadWeights, state: HeadState) -> None:
    """Compute the outputs of both convolutions whose last tap is a slot."""
    convolve_taps(
        slot,
        SHORT_TAPS,
        1,
        state.fine_seen,
        state.fine,
        weights.short_weight,
        weights.short_bias,
        state.short_seen,
        state.short,
    )
    convolve_taps(
        slot,
        LONG_TAPS,
        SHORT_STRIDE,
        state.short_seen,
        state.short,
        weights.long_weight,
        weights.long_bias,
        state.long_seen,
        state.long,
    )


@compiled_fastmath
def convolve_taps(
    slot: int,
    kernel: int,
    spacing: int,
    seen: Bool[np.ndarray, "slot"],
    x: Float[np.ndarray, "slot channel"],
    weight: Float[np.ndarray, "branch tap_and_width width"],
    bias: Float[np.ndarray, "channel"],
    out_seen: Bool[np.ndarray, "slot"],
    out: Float[np.ndarray, "slot channel"],
) -> None:
    """Compute the output of a partial convolution whose last tap is a slot.

    Args:
        slot: number of the slot.
        kernel: number of taps.
        spacing: slots between taps.
        seen: which slots of `x` hold a value.
        x: values to convolve.
        weight: the filters.
        bias: bias added to their output.
        out_seen: output, whether any tap holds a value.
        out: output of the convolution.
    """
    slots, here = len(seen), slot % len(seen)
    branches, width = weight.shape[0], weight.shape[2]
    count = 0
    for k in range(kernel):
        count += seen[(slot - (kernel - 1 - k) * spacing) % slots]
    out_seen[here] = count > 0
    if count == 0:
        return
    for branch in range(branches):
        y = out[here, branch * width : (branch + 1) * width]
        y[:] = ZERO
        for k in range(kernel):
            index = (slot - (kernel - 1 - k) * spacing) % slots
            if seen[index]:
                add_vecmat(
                    x[index, branch * width : (branch + 1) * width],
                    weight[branch, k * width : (k + 1) * width],
                    y,
                )
    activate_scaled(out[here], np.float32(kernel / count), bias)


@compiled_fastmath
def activate_scaled(
    x: Float[np.ndarray, "channel"], scale: float, bias: Float[np.ndarray, "channel"]
) -> None:
    """Replace x by silu(scale x + bias)."""
    for c in range(len(x)):
        x[c] = silu(x[c] * scale + bias[c])


@compiled_fastmath
def update_statistics(now: int, state: HeadState) -> None:
    """Update the statistics of the window that ends now, at all three scales."""
    slots, n = len(state.fine_seen), STATISTICS
    out, indices = state.statistics, state.indices
    shorts = (slots - SHORT_TAPS) // SHORT_STRIDE + 1
    longs = (shorts - LONG_TAPS) // LONG_STRIDE + 1
    share = np.float32(count_covered(now, state.fine_seen) / slots)
    count = find_outputs(now, 1, slots, state.fine_seen, indices)
    compute_statistics(state.fine, indices[:count], share, out[:n])
    count = find_outputs(now, SHORT_STRIDE, shorts, state.short_seen, indices)
    compute_statistics(state.short, indices[:count], share, out[n : 2 * n])
    count = find_outputs(now, LONG_SPACING, longs, state.long_seen, indices)
    compute_statistics(state.long, indices[:count], share, out[2 * n :])


@compiled_fastmath
def count_covered(now: int, seen: Bool[np.ndarray, "slot"]) -> int:
    """Return the number of slots of the window since its first reading."""
    slots = len(seen)
    for age in range(slots - 1, 0, -1):
        if seen[(now - age) % slots]:
            return age + 1
    return 1


@compiled_fastmath
def find_outputs(
    now: int,
    spacing: int,
    outputs: int,
    seen: Bool[np.ndarray, "slot"],
    indices: Int[np.ndarray, "slot"],
) -> int:
    """List the outputs that cover a reading, newest first; return their number.

    The newest slot is `now`; it always covers one.
    """
    count = 0
    for k in range(outputs):
        index = (now - k * spacing) % len(seen)
        if seen[index]:
            indices[count] = index
            count += 1
    return count


@compiled_fastmath
def compute_statistics(
    x: Float[np.ndarray, "slot channel"],
    indices: Int[np.ndarray, "output"],
    share: float,
    out: Float[np.ndarray, "4 channel"],
) -> None:
    """Compute mean, spread, maximum and integral over some outputs, in one pass.

    Sums are of differences from the first output, which keeps them small. `share` is
    that of the window since its first reading.
    """
    count, first = len(indices), x[indices[0]]
    mean, spread, largest, integral = out[0], out[1], out[2], out[3]
    mean[:], spread[:], largest[:] = ZERO, ZERO, first
    fours = count - count % 4
    for k in range(0, fours, 4):
        accumulate_four(x, indices[k : k + 4], first, mean, spread, largest)
    for k in range(fours, count):
        accumulate(x[indices[k]], first, mean, spread, largest)
    part = np.float32(1.0 / count)
    for c in range(len(mean)):
        away = mean[c] * part
        mean[c] = first[c] + away
        integral[c] = mean[c] * share
        variance = max(spread[c] * part - away * away, ZERO)
        spread[c] = np.sqrt(variance + np.float32(1e-4))


@compiled_fastmath
def accumulate(
    x: Float[np.ndarray, "channel"],
    first: Float[np.ndarray, "channel"],
    total: Float[np.ndarray, "channel"],
    squares: Float[np.ndarray, "channel"],
    largest: Float[np.ndarray, "channel"],
) -> None:
    """Add the difference of `x` from the first, and its square; update the maximum."""
    for c in range(len(x)):
        away = x[c] - first[c]
        total[c] += away
        squares[c] += away * away
        largest[c] = max(largest[c], x[c])


@compiled_fastmath
def accumulate_four(
    x: Float[np.ndarray, "slot channel"],
    indices: Int[np.ndarray, "4"],
    first: Float[np.ndarray, "channel"],
    total: Float[np.ndarray, "channel"],
    squares: Float[np.ndarray, "channel"],
    largest: Float[np.ndarray, "channel"],
) -> None:
    """Accumulate four outputs at once, with a quarter of the writes."""
    x0, x1, x2, x3 = x[indices[0]], x[indices[1]], x[indices[2]], x[indices[3]]
    for c in range(len(first)):
        f = first[c]
        a0, a1, a2, a3 = x0[c] - f, x1[c] - f, x2[c] - f, x3[c] - f
        total[c] += (a0 + a1) + (a2 + a3)
        squares[c] += (a0 * a0 + a1 * a1) + (a2 * a2 + a3 * a3)
        highest = max(max(x0[c], x1[c]), max(x2[c], x3[c]))
        largest[c] = max(largest[c], highest)
