"""The compiled temporal heads: what a new reading changes, and nothing else."""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float

from eskin.live.head import STATISTICS, HeadMemory, HeadWeights
from eskin.live.kernels import add_product, compiled, dot, silu
from eskin.model.weights import LONG, SHORT

SHORT_STRIDE, LONG_STRIDE = 4, 2
"""Slots between outputs of the short convolution, and of those between the long's."""

LONG_APART = SHORT_STRIDE * LONG_STRIDE
ZERO = np.float32(0.0)


@compiled
@no_type_check
def classify(
    features: Float[np.ndarray, "input"],
    before: int,
    now: int,
    weights: HeadWeights,
    memory: HeadMemory,
    logits: Float[np.ndarray, "class"],
) -> None:
    """Take in the features of a reading, and write the logits of the window ending now.

    Args:
        features: of the reading.
        before: number of the slot of the reading before; long ago for the first.
        now: number of its own slot, the same or later.
        weights: of both heads.
        memory: of the sequence.
        logits: where they go.
    """
    slots = len(memory.fine_seen)
    if now - before >= slots:
        memory.fine_seen[:] = False
        memory.short_seen[:] = False
        memory.long_seen[:] = False
    else:
        for slot in range(before + 1, now):
            memory.fine_seen[slot % slots] = False
            convolve(slot, weights, memory)
    if now == before:
        for c in range(len(features)):
            memory.newest[c] = max(memory.newest[c], features[c])
    else:
        memory.newest[:] = features
    memory.fine_seen[now % slots] = True
    fine = memory.fine[now % slots]
    fine[:] = ZERO
    add_product(memory.newest, weights.project_weight, fine)
    activate_scaled(fine, np.float32(1.0), weights.project_bias)
    convolve(now, weights, memory)
    gather(now, memory)
    found = memory.statistics.reshape(memory.statistics.size)
    for k in range(len(logits)):
        logits[k] = weights.classify_bias[k] + dot(found, weights.classify_weight[k])


@compiled
@no_type_check
def convolve(slot: int, weights: HeadWeights, memory: HeadMemory) -> None:
    """Compute what ends with a slot, all of its taps being known."""
    filter_taps(
        slot,
        SHORT,
        1,
        memory.fine_seen,
        memory.fine,
        weights.short_weight,
        weights.short_bias,
        memory.short_seen,
        memory.short,
    )
    filter_taps(
        slot,
        LONG,
        SHORT_STRIDE,
        memory.short_seen,
        memory.short,
        weights.long_weight,
        weights.long_bias,
        memory.long_seen,
        memory.long,
    )


@compiled
@no_type_check
def filter_taps(
    slot: int,
    kernel: int,
    apart: int,
    seen: Bool[np.ndarray, "slot"],
    x: Float[np.ndarray, "slot track"],
    weight: Float[np.ndarray, "view tap_and_channel channel"],
    bias: Float[np.ndarray, "track"],
    out_seen: Bool[np.ndarray, "slot"],
    out: Float[np.ndarray, "slot track"],
) -> None:
    """A partial convolution's output at one slot, its last tap; see `eskin.nn`.

    Args:
        slot: number of the slot.
        kernel: number of taps.
        apart: slots between taps.
        seen: which slots of `x` hold anything.
        x: what is looked at.
        weight: the filters.
        bias: added to what they give.
        out_seen: where it is noted whether any tap held anything.
        out: where the output goes.
    """
    slots, here = len(seen), slot % len(seen)
    views, channels = weight.shape[0], weight.shape[2]
    count = 0
    for k in range(kernel):
        count += seen[(slot - (kernel - 1 - k) * apart) % slots]
    out_seen[here] = count > 0
    if count == 0:
        return
    for view in range(views):
        y = out[here, view * channels : (view + 1) * channels]
        y[:] = ZERO
        for k in range(kernel):
            place = (slot - (kernel - 1 - k) * apart) % slots
            if seen[place]:
                add_product(
                    x[place, view * channels : (view + 1) * channels],
                    weight[view, k * channels : (k + 1) * channels],
                    y,
                )
    activate_scaled(out[here], np.float32(kernel / count), bias)


@compiled
@no_type_check
def activate_scaled(
    x: Float[np.ndarray, "track"], scale: float, bias: Float[np.ndarray, "track"]
) -> None:
    """Replace x by silu(scale x + bias)."""
    for c in range(len(x)):
        x[c] = silu(x[c] * scale + bias[c])


@compiled
@no_type_check
def gather(now: int, memory: HeadMemory) -> None:
    """Write the statistics of the window that ends now, at all three scales."""
    slots, statistics = len(memory.fine_seen), memory.statistics
    shorts = (slots - SHORT) // SHORT_STRIDE + 1
    longs = (shorts - LONG) // LONG_STRIDE + 1
    share = np.float32(covered(now, memory.fine_seen) / slots)
    fine, short, long = (
        statistics[:STATISTICS],
        statistics[STATISTICS : 2 * STATISTICS],
        statistics[2 * STATISTICS :],
    )
    measure(now, 1, slots, memory.fine_seen, memory.fine, share, fine)
    measure(now, SHORT_STRIDE, shorts, memory.short_seen, memory.short, share, short)
    measure(now, LONG_APART, longs, memory.long_seen, memory.long, share, long)


@compiled
@no_type_check
def covered(now: int, seen: Bool[np.ndarray, "slot"]) -> int:
    """Slots of the window since its first reading."""
    slots = len(seen)
    for age in range(slots - 1, 0, -1):
        if seen[(now - age) % slots]:
            return age + 1
    return 1


@compiled
@no_type_check
def measure(
    now: int,
    apart: int,
    outputs: int,
    seen: Bool[np.ndarray, "slot"],
    x: Float[np.ndarray, "slot track"],
    share: float,
    out: Float[np.ndarray, "4 track"],
) -> None:
    """Mean, spread, maximum and integral over the outputs that saw a reading.

    Args:
        now: number of the newest slot, where the last output stands.
        apart: slots between outputs.
        outputs: how many of them the window has.
        seen: which of them saw a reading.
        x: the outputs.
        share: of the window since its first reading.
        out: where the statistics go.
    """
    slots, count = len(seen), 0
    mean, spread, largest, integral = out[0], out[1], out[2], out[3]
    for k in range(outputs):
        place = (now - k * apart) % slots
        if not seen[place]:
            continue
        if count == 0:
            mean[:] = x[place]
            largest[:] = x[place]
        else:
            add_and_compare(x[place], mean, largest)
        count += 1
    part = np.float32(1.0 / count)  # the newest has always seen a reading
    for c in range(len(mean)):
        mean[c] *= part
        integral[c] = mean[c] * share
        spread[c] = ZERO
    for k in range(outputs):
        place = (now - k * apart) % slots
        if seen[place]:
            add_square(x[place], mean, spread)
    for c in range(len(mean)):
        spread[c] = np.sqrt(spread[c] * part + np.float32(1e-4))


@compiled
@no_type_check
def add_and_compare(
    x: Float[np.ndarray, "track"],
    total: Float[np.ndarray, "track"],
    largest: Float[np.ndarray, "track"],
) -> None:
    """Add `x` to the total, and keep the larger."""
    for c in range(len(x)):
        total[c] += x[c]
        largest[c] = max(largest[c], x[c])


@compiled
@no_type_check
def add_square(
    x: Float[np.ndarray, "track"],
    mean: Float[np.ndarray, "track"],
    total: Float[np.ndarray, "track"],
) -> None:
    """Add the squared distance from the mean."""
    for c in range(len(x)):
        total[c] += (x[c] - mean[c]) ** 2
