"""Compiled kernels that update the temporal heads by what a new reading changes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled_fastmath
from eskin.live.encoder_kernels import silu
from eskin.live.model_config import LONG_STRIDE, LONG_TAPS, SHORT_STRIDE, SHORT_TAPS

NO_SLOT = -(2**62)
"""Slot of the reading before the first, older than any in a window."""

SCALES = 3
"""Number of time scales: a slot, and the spans of the two convolutions."""

STATISTICS = 4
"""Statistics of each channel at each scale: mean, spread, maximum, integral."""

SPACINGS = (1, SHORT_STRIDE, SHORT_STRIDE * LONG_STRIDE)
"""Slots between the values that the statistics of each scale are over."""
ZERO = np.float32(0.0)

Channels = Float[np.ndarray, "channel"]
Filters = Float[np.ndarray, "branch tap*width width"]
Values = Float[np.ndarray, "slot channel"]
Seen = Bool[np.ndarray, "slot"]
Indices = Int[np.ndarray, "output"]


class HeadWeights(NamedTuple):
    """Parameters of all heads, whose channels lie side by side, a branch's together.

    Inputs that a head does not take have zeros for weights. The classes of the closing
    layer, in a network that has one, follow those of the open layer.
    """

    project_weight: Float[np.ndarray, "input channel"]
    project_bias: Channels
    short_weight: Filters
    short_bias: Channels
    long_weight: Filters
    long_bias: Channels
    classify_weight: Float[np.ndarray, "layer*class scale*statistic*channel"]  # mean's
    classify_bias: Float[np.ndarray, "layer*class"]


class HeadState(NamedTuple):
    """A state holds the ring buffers of one sequence; slot n is at n modulo the slots.

    There are three time scales: the projected features of a slot, the output of the
    short convolution, and that of the long one. An output is stored at the slot of its
    last tap, whether or not the window that ends now uses it: it is computed once, and
    used every fourth or eighth slot.
    """

    slot: Int[np.ndarray, "1"]  # the newest, `NO_SLOT` before the first reading
    newest: Float[np.ndarray, "input"]  # features of the newest slot
    seen: Bool[np.ndarray, "scale slot"]  # whether a value covers a reading
    values: Float[np.ndarray, "scale slot channel"]
    indices: Int[np.ndarray, "slot"]  # indices of the values that statistics are over
    statistics: Float[np.ndarray, "scale*statistic channel"]  # of the window


@compiled_fastmath
def add_vecmat(
    x: Channels, weight: Float[np.ndarray, "input output"], out: Channels
) -> None:
    """Add x @ weight to `out`, four inputs at a time."""
    inputs, outputs = weight.shape
    fours = inputs - inputs % 4
    for c in range(0, fours, 4):
        x0 = x[c]
        x1 = x[c + 1]
        x2 = x[c + 2]
        x3 = x[c + 3]
        w0 = weight[c]
        w1 = weight[c + 1]
        w2 = weight[c + 2]
        w3 = weight[c + 3]
        for o in range(outputs):
            out[o] += x0 * w0[o] + x1 * w1[o] + x2 * w2[o] + x3 * w3[o]
    for c in range(fours, inputs):
        for o in range(outputs):
            out[o] += x[c] * weight[c, o]


@compiled_fastmath
def dot(x: Channels, weight: Channels) -> np.float32:
    """Return the sum of products, for short vectors faster than BLAS."""
    total = np.float32(0.0)
    for c in range(len(x)):
        total += x[c] * weight[c]
    return total


@compiled_fastmath
def classify(
    features: Channels,
    now: int,
    weights: HeadWeights,
    state: HeadState,
    logits: Float[np.ndarray, "layer*class"],
) -> None:
    """Update the state with a reading, and write the logits of the window ending now.

    `now` is the slot of the reading: that of the previous one, or later.
    """
    seen = state.seen
    slots = state.seen.shape[1]
    before = state.slot[0]
    state.slot[0] = now
    if now - before >= slots:
        for index in range(slots):
            for scale in range(SCALES):
                seen[scale, index] = False
    else:
        for slot in range(before + 1, now):
            seen[0, slot % slots] = False
            convolve(slot, weights, state)
    if now == before:
        for c in range(len(features)):
            state.newest[c] = max(state.newest[c], features[c])
    else:
        for c in range(len(features)):
            state.newest[c] = features[c]
    seen[0, now % slots] = True
    fine = state.values[0, now % slots]
    for c in range(len(fine)):
        fine[c] = ZERO
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
    convolve_scale(
        slot, 0, SHORT_TAPS, 1, weights.short_weight, weights.short_bias, state
    )
    convolve_scale(
        slot, 1, LONG_TAPS, SHORT_STRIDE, weights.long_weight, weights.long_bias, state
    )


@compiled_fastmath
def convolve_scale(
    slot: int,
    scale: int,
    taps: int,
    spacing: int,
    weight: Filters,
    bias: Channels,
    state: HeadState,
) -> None:
    """Compute a partial convolution of a scale whose last tap is a slot.

    Its output belongs to the next scale; `spacing` is the number of slots between taps.
    """
    seen = state.seen[scale]
    x = state.values[scale]
    out = state.values[scale + 1]
    slots = len(seen)
    here = slot % len(seen)
    branches = weight.shape[0]
    width = weight.shape[2]
    count = 0
    for k in range(taps):
        count += seen[(slot - (taps - 1 - k) * spacing) % slots]
    state.seen[scale + 1, here] = count > 0
    if count == 0:
        return
    for branch in range(branches):
        first, last = branch * width, (branch + 1) * width
        y = out[here, first:last]
        for c in range(width):
            y[c] = ZERO
        for k in range(taps):
            index = (slot - (taps - 1 - k) * spacing) % slots
            if seen[index]:
                kernel = weight[branch, k * width : (k + 1) * width]
                add_vecmat(x[index, first:last], kernel, y)
    activate_scaled(out[here], np.float32(taps / count), bias)


@compiled_fastmath
def activate_scaled(x: Channels, scale: float, bias: Channels) -> None:
    """Replace x by silu(scale x + bias)."""
    for c in range(len(x)):
        x[c] = silu(x[c] * scale + bias[c])


@compiled_fastmath
def update_statistics(now: int, state: HeadState) -> None:
    """Update the statistics of the window that ends now, at all three scales."""
    slots = state.seen.shape[1]
    indices = state.indices
    shorts = (slots - SHORT_TAPS) // SHORT_STRIDE + 1
    outputs = (slots, shorts, (shorts - LONG_TAPS) // LONG_STRIDE + 1)
    share = np.float32(count_covered(now, state.seen[0]) / slots)
    for scale in range(SCALES):
        seen = state.seen[scale]
        spacing = SPACINGS[scale]
        count = find_outputs(now, spacing, outputs[scale], seen, indices)
        first = scale * STATISTICS
        out = state.statistics[first : first + STATISTICS]
        compute_statistics(state.values[scale], indices[:count], share, out)


@compiled_fastmath
def count_covered(now: int, seen: Seen) -> int:
    """Return the number of slots of the window since its first reading."""
    slots = len(seen)
    for age in range(slots - 1, 0, -1):
        if seen[(now - age) % slots]:
            return age + 1
    return 1


@compiled_fastmath
def find_outputs(
    now: int, spacing: int, outputs: int, seen: Seen, indices: Indices
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
    x: Values, indices: Indices, share: float, out: Float[np.ndarray, "4 channel"]
) -> None:
    """Compute mean, spread, maximum and integral over some outputs, in one pass.

    Sums are of differences from the first output, which keeps them small. `share` is
    that of the window since its first reading.
    """
    count = len(indices)
    first = x[indices[0]]
    mean = out[0]
    spread = out[1]
    largest = out[2]
    integral = out[3]
    for c in range(len(first)):
        mean[c] = ZERO
        spread[c] = ZERO
        largest[c] = first[c]
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
    x: Channels, first: Channels, total: Channels, squares: Channels, largest: Channels
) -> None:
    """Add the difference of `x` from the first, and its square; update the maximum."""
    for c in range(len(x)):
        away = x[c] - first[c]
        total[c] += away
        squares[c] += away * away
        largest[c] = max(largest[c], x[c])


@compiled_fastmath
def accumulate_four(
    x: Values,
    four: Indices,
    first: Channels,
    total: Channels,
    squares: Channels,
    largest: Channels,
) -> None:
    """Accumulate four outputs at once, with a quarter of the writes."""
    x0 = x[four[0]]
    x1 = x[four[1]]
    x2 = x[four[2]]
    x3 = x[four[3]]
    for c in range(len(first)):
        f = first[c]
        a0 = x0[c] - f
        a1 = x1[c] - f
        a2 = x2[c] - f
        a3 = x3[c] - f
        total[c] += (a0 + a1) + (a2 + a3)
        squares[c] += (a0 * a0 + a1 * a1) + (a2 * a2 + a3 * a3)
        highest = max(max(x0[c], x1[c]), max(x2[c], x3[c]))
        largest[c] = max(largest[c], highest)
