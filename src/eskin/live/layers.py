"""The layers that the network is made of, in numpy and float32."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Weights = Mapping[str, np.ndarray]
"""Parameters by name, as in the state of the torch module of the same shape."""

EPSILON = 1e-5


def under(weights: Weights, name: str) -> Weights:
    """The weights of one part of a module, by their names in it."""
    start = name + "."
    return {
        key.removeprefix(start): weight
        for key, weight in weights.items()
        if key.startswith(start)
    }


@dataclass(frozen=True, eq=False)
class Linear:
    """A layer x W^T + b."""

    weight: Float[np.ndarray, "output input"]
    """W"""

    bias: Float[np.ndarray, "output"] | None
    """b; None for a layer without one."""

    @classmethod
    def of(cls, weights: Weights, name: str) -> "Linear":
        """The layer of that name."""
        return cls(weights[f"{name}.weight"], weights.get(f"{name}.bias"))

    def __call__(
        self, x: Float[np.ndarray, "*batch input"]
    ) -> Float[np.ndarray, "*batch output"]:
        """Apply it to the last axis."""
        flat = x.reshape(-1, x.shape[-1]) @ self.weight.T
        if self.bias is not None:
            flat += self.bias
        return flat.reshape(*x.shape[:-1], len(self.weight))


@dataclass(frozen=True, eq=False)
class LayerNorm:
    """Zero mean and unit variance over the channels of each row, then scale, shift."""

    weight: Float[np.ndarray, "channel"]
    """Scale."""

    bias: Float[np.ndarray, "channel"]
    """Shift."""

    @classmethod
    def of(cls, weights: Weights, name: str) -> "LayerNorm":
        """The layer of that name."""
        return cls(weights[f"{name}.weight"], weights[f"{name}.bias"])

    def __call__(
        self, x: Float[np.ndarray, "row channel"]
    ) -> Float[np.ndarray, "row channel"]:
        """Apply it to every row."""
        centred = x - x.mean(axis=1, keepdims=True)
        variance = (centred * centred).mean(axis=1, keepdims=True)
        return centred / np.sqrt(variance + EPSILON) * self.weight + self.bias


def silu(x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
    """The product of x and its sigmoid, written so that it never overflows."""
    half = 0.5 * x
    return half * np.tanh(half) + half
