"""The compiled temporal heads: what a new reading changes, and nothing else."""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.live.head import STATISTICS, HeadMemory, HeadWeights
from eskin.live.kernels import add_product, compiled_network, dot, silu
from eskin.model.file import LONG, SHORT

SHORT_STRIDE, LONG_STRIDE = 4, 2
"""Slots between outputs of the short convolution, and of those between the long's."""

LONG_APART = SHORT_STRIDE * LONG_STRIDE
ZERO = np.float32(0.0)


@compiled_network
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


@compiled_network
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


@compiled_network
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


@compiled_network
@no_type_check
def activate_scaled(
    x: Float[np.ndarray, "track"], scale: float, bias: Float[np.ndarray, "track"]
) -> None:
    """Replace x by silu(scale x + bias)."""
    for c in range(len(x)):
        x[c] = silu(x[c] * scale + bias[c])


@compiled_network
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
    places = memory.places
    count = find_places(now, 1, slots, memory.fine_seen, places)
    measure(memory.fine, places[:count], share, fine)
    count = find_places(now, SHORT_STRIDE, shorts, memory.short_seen, places)
    measure(memory.short, places[:count], share, short)
    count = find_places(now, LONG_APART, longs, memory.long_seen, places)
    measure(memory.long, places[:count], share, long)


@compiled_network
@no_type_check
def covered(now: int, seen: Bool[np.ndarray, "slot"]) -> int:
    """Slots of the window since its first reading."""
    slots = len(seen)
    for age in range(slots - 1, 0, -1):
        if seen[(now - age) % slots]:
            return age + 1
    return 1


@compiled_network
@no_type_check
def find_places(
    now: int,
    apart: int,
    outputs: int,
    seen: Bool[np.ndarray, "slot"],
    places: Int[np.ndarray, "slot"],
) -> int:
    """List where the outputs stand that saw a reading, and return how many did.

    Args:
        now: number of the newest slot, where the last output stands.
        apart: slots between outputs.
        outputs: how many of them the window has.
        seen: which of them saw a reading; the last one always did.
        places: where they are listed, the last one first.
    """
    count = 0
    for k in range(outputs):
        place = (now - k * apart) % len(seen)
        if seen[place]:
            places[count] = place
            count += 1
    return count


@compiled_network
@no_type_check
def measure(
    x: Float[np.ndarray, "slot track"],
    places: Int[np.ndarray, "output"],
    share: float,
    out: Float[np.ndarray, "4 track"],
) -> None:
    """Mean, spread, maximum and integral over some outputs, in one pass.

    Sums are of what is away from the first of them, which keeps them small.

    Args:
        x: the outputs, among others.
        places: where they stand.
        share: of the window since its first reading.
        out: where the statistics go.
    """
    count, first = len(places), x[places[0]]
    mean, spread, largest, integral = out[0], out[1], out[2], out[3]
    mean[:], spread[:], largest[:] = ZERO, ZERO, first
    fours = count - count % 4
    for k in range(0, fours, 4):
        gather_four(x, places[k : k + 4], first, mean, spread, largest)
    for k in range(fours, count):
        gather_one(x[places[k]], first, mean, spread, largest)
    part = np.float32(1.0 / count)
    for c in range(len(mean)):
        away = mean[c] * part
        mean[c] = first[c] + away
        integral[c] = mean[c] * share
        variance = max(spread[c] * part - away * away, ZERO)
        spread[c] = np.sqrt(variance + np.float32(1e-4))


@compiled_network
@no_type_check
def gather_one(
    x: Float[np.ndarray, "track"],
    first: Float[np.ndarray, "track"],
    total: Float[np.ndarray, "track"],
    squares: Float[np.ndarray, "track"],
    largest: Float[np.ndarray, "track"],
) -> None:
    """Add how far `x` is from the first, and its square, and keep the larger."""
    for c in range(len(x)):
        away = x[c] - first[c]
        total[c] += away
        squares[c] += away * away
        largest[c] = max(largest[c], x[c])


@compiled_network
@no_type_check
def gather_four(
    x: Float[np.ndarray, "slot track"],
    places: Int[np.ndarray, "4"],
    first: Float[np.ndarray, "track"],
    total: Float[np.ndarray, "track"],
    squares: Float[np.ndarray, "track"],
    largest: Float[np.ndarray, "track"],
) -> None:
    """The same with four of them at once, for a quarter of the writing."""
    x0, x1, x2, x3 = x[places[0]], x[places[1]], x[places[2]], x[places[3]]
    for c in range(len(first)):
        a0, a1, a2, a3 = (
            x0[c] - first[c],
            x1[c] - first[c],
            x2[c] - first[c],
            x3[c] - first[c],
        )
        total[c] += (a0 + a1) + (a2 + a3)
        squares[c] += (a0 * a0 + a1 * a1) + (a2 * a2 + a3 * a3)
        most = max(max(x0[c], x1[c]), max(x2[c], x3[c]))
        largest[c] = max(largest[c], most)
