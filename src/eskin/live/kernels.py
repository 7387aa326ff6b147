"""Compiled kernels that do float32 arithmetic: activation, product, normalisation."""

import numpy as np
from jaxtyping import Float

from eskin.compiled import compiled, compiled_fastmath

BLOCK = 256
"""Rows multiplied at once: few enough that they and their products fit in the cache and
that BLAS uses one thread, which is faster."""

EPSILON = np.float32(1e-5)
"""Added to the variance in a normalisation, as in torch."""

# exp2 by a polynomial on [-0.5, 0.5], to a relative error of 2e-7.
LOG2_E = np.float32(1.4426950408889634)
MAX_EXPONENT = np.float32(80.0)  # where exp is still a float32 on both sides
ONE = np.float32(1.0)
E0 = np.float32(1.000000075)
E1 = np.float32(0.693147188)
E2 = np.float32(0.2402210749)
E3 = np.float32(0.05550357114)
E4 = np.float32(0.009676031918)
E5 = np.float32(0.001339086336)
# Adding this to a small number rounds it to a whole one, in the lowest bits.
ROUNDER = np.float32(1.5 * 2**23)
EXPONENT_SHIFT = np.int32(23)


@compiled(fastmath={"contract", "nsz"})
def exp_negative(x: float) -> np.float32:
    """Return exp(-x) without a library call, so that loops over it are vectorised.

    Its sums must not be reordered: it rounds by adding and subtracting `ROUNDER`.
    """
    z = min(max(x, -MAX_EXPONENT), MAX_EXPONENT)
    shifted = np.float32(ROUNDER - z * LOG2_E)
    f = (ROUNDER - shifted) - z * LOG2_E
    power = np.float32(((((E5 * f + E4) * f + E3) * f + E2) * f + E1) * f + E0)
    exponent = np.int32(shifted.view(np.int32) << EXPONENT_SHIFT)
    return np.int32(power.view(np.int32) + exponent).view(np.float32)


@compiled_fastmath(inline="always")
def sigmoid(x: float) -> float:
    """Return 1 / (1 + exp(-x))."""
    return ONE / (ONE + exp_negative(x))


@compiled_fastmath(inline="always")
def silu(x: float) -> float:
    """Return the product of x and its sigmoid."""
    return x / (ONE + exp_negative(x))


@compiled_fastmath
def matmul(
    x: Float[np.ndarray, "row input"],
    weight: Float[np.ndarray, "input output"],
    out: Float[np.ndarray, "row output"],
) -> None:
    """Write x @ weight to `out`."""
    for first in range(0, len(x), BLOCK):
        last = min(first + BLOCK, len(x))
        np.dot(x[first:last], weight, out[first:last])


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
def add_bias(
    x: Float[np.ndarray, "row channel"], bias: Float[np.ndarray, "channel"]
) -> None:
    """Add the same bias to every row."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            x[i, c] += bias[c]


@compiled_fastmath
def add(
    x: Float[np.ndarray, "row channel"], out: Float[np.ndarray, "row channel"]
) -> None:
    """Add `x` to `out`."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            out[i, c] += x[i, c]


@compiled_fastmath
def activate(
    x: Float[np.ndarray, "row channel"], bias: Float[np.ndarray, "channel"]
) -> None:
    """Replace each row by silu(row + bias)."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            x[i, c] = silu(x[i, c] + bias[c])


@compiled_fastmath
def layer_norm(
    x: Float[np.ndarray, "row channel"],
    scale: Float[np.ndarray, "channel"],
    shift: Float[np.ndarray, "channel"],
    out: Float[np.ndarray, "row channel"],
) -> None:
    """Normalise each row to zero mean and unit variance, then scale and shift it."""
    rows, channels = x.shape
    for i in range(rows):
        mean = np.float32(0.0)
        for c in range(channels):
            mean += x[i, c]
        mean /= np.float32(channels)
        variance = np.float32(0.0)
        for c in range(channels):
            variance += (x[i, c] - mean) ** 2
        inverse = ONE / np.sqrt(variance / np.float32(channels) + EPSILON)
        for c in range(channels):
            out[i, c] = (x[i, c] - mean) * inverse * scale[c] + shift[c]
