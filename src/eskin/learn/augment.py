"""Other people and other sensors, made of the ones recorded."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from eskin.graph import GraphBatch
from eskin.model import check_limits

LIMITS = {
    "gain": (0.0, np.inf),
    "taxel_gain": (0.0, np.inf),
    "dead": (0.0, 1.0),
    "offset": (0.0, np.inf),
    "shear_gain": (0.0, np.inf),
    "crop": (0.0, 1.0),
}
"""Smallest and largest values of the settings."""


@dataclass(frozen=True)
class AugmentConfig:
    """How far a training window may be from the recorded one."""

    gain: float = 0.4
    """Spread of the logarithm of the force a person uses."""

    taxel_gain: float = 0.15
    """Spread of the logarithm of each taxel's own gain."""

    dead: float = 0.1
    """Largest share of taxels that are silent in a window."""

    offset: float = 2.0
    """Largest pressure taken off every taxel [kPa]."""

    shear_gain: float = 0.3
    """Spread of the logarithm of shear against pressure."""

    crop: float = 0.7
    """Share of windows that see nothing from before their gesture."""

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_limits(self, LIMITS)


def augment(
    graphs: GraphBatch,
    window: Int[np.ndarray, "graph"],
    rng: np.random.Generator,
    config: AugmentConfig,
) -> GraphBatch:
    """Change pressure and shear; each window is another person on another skin.

    Args:
        graphs: the windows' graphs.
        window: the window of each graph.
        rng: draws everything.
        config: how far to go.
    """
    windows = int(window.max(initial=-1)) + 1
    node_window = window[graphs.graph_index]
    taxels = int(graphs.taxels.max(initial=-1)) + 1
    gain = np.exp(config.gain * rng.standard_normal(windows))[node_window]
    own = np.exp(config.taxel_gain * rng.standard_normal((windows, taxels)))
    share = config.dead * rng.random((windows, 1))
    own *= rng.random((windows, taxels)) >= share
    gain = (gain * own[node_window, graphs.taxels]).astype(np.float32)
    offset = (config.offset * rng.random(windows))[node_window].astype(np.float32)
    shear_gain = np.exp(config.shear_gain * rng.standard_normal(windows))[node_window]
    turn = (gain * shear_gain)[:, None].astype(np.float32)
    return replace(
        graphs,
        pressure=pressed(graphs.pressure * gain - offset),
        before=pressed(graphs.before * gain - offset),
        shear=graphs.shear * turn,
        shear_before=graphs.shear_before * turn,
    )


def pressed(pressure: Float[np.ndarray, "node"]) -> Float[np.ndarray, "node"]:
    """Nothing pulls."""
    return np.maximum(pressure, 0.0)
