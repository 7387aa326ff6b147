"""Other people and other sensors, made of the ones recorded."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from eskin.graph import GraphBatch
from eskin.graph.batch import HISTORY
from eskin.model import check_limits

LIMITS = {
    "gain": (0.0, np.inf),
    "taxel_gain": (0.0, np.inf),
    "dead": (0.0, 1.0),
    "offset": (0.0, np.inf),
    "shear_gain": (0.0, np.inf),
    "noise": (0.0, np.inf),
    "patch": (0.0, 1.0),
    "lost": (0.0, 1.0),
    "halved": (0.0, 1.0),
    "stretch": (0.0, 1.0),
    "crop": (0.0, 1.0),
}
"""Smallest and largest values of the settings."""

FORCE_COLUMNS = [HISTORY.index(name) for name in ("impulse", "peak force")]


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

    noise: float = 0.0
    """Noise of each taxel at each reading, as a share of its pressure."""

    patch: float = 0.0
    """Share of windows in which one of several touched patches is silent."""

    lost: float = 0.0
    """Largest share of readings of a window that never came."""

    halved: float = 0.0
    """Share of windows of which every other reading never came: half the rate."""

    stretch: float = 0.0
    """Spread of the logarithm of how long a person takes."""

    crop: float = 0.7
    """Share of windows that see nothing from before their gesture."""

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_limits(self, LIMITS)


NO_AUGMENTATION = AugmentConfig(
    gain=0.0, taxel_gain=0.0, dead=0.0, offset=0.0, shear_gain=0.0
)
"""As recorded."""


def augment(
    graphs: GraphBatch,
    window: Int[np.ndarray, "graph"],
    rng: np.random.Generator,
    config: AugmentConfig,
    patch_index: Int[np.ndarray, "taxel"] | None = None,
) -> GraphBatch:
    """Change pressure and shear; each window is another person on another skin.

    Args:
        graphs: the windows' graphs.
        window: the window of each graph.
        rng: draws everything.
        config: how far to go.
        patch_index: the patch of each taxel, where a patch may be silent.
    """
    windows = int(window.max(initial=-1)) + 1
    node_window = window[graphs.graph_index]
    person = np.exp(config.gain * rng.standard_normal(windows))
    gain = person[node_window]
    own = draw_taxel_gains(graphs, node_window, windows, rng, config)
    if patch_index is not None and config.patch > 0:
        silence_patches(
            own, graphs, node_window, patch_index, rng.random(windows), config, rng
        )
    gain = (gain * own[node_window, graphs.taxels]).astype(np.float32)
    offset = (config.offset * rng.random(windows))[node_window].astype(np.float32)
    shear_gain = np.exp(config.shear_gain * rng.standard_normal(windows))[node_window]
    turn = (gain * shear_gain)[:, None].astype(np.float32)
    now, before = (
        gain
        if config.noise == 0
        else gain * draw_noise_factors(len(gain), config.noise, rng)
        for _ in range(2)
    )
    history = graphs.history.copy()
    history[:, FORCE_COLUMNS] *= person[window, None].astype(np.float32)
    return replace(
        graphs,
        history=history,
        pressure=pressed(graphs.pressure * now - offset),
        before=pressed(graphs.before * before - offset),
        shear=graphs.shear * turn,
        shear_before=graphs.shear_before * turn,
    )


def draw_taxel_gains(
    graphs: GraphBatch,
    node_window: Int[np.ndarray, "node"],
    windows: int,
    rng: np.random.Generator,
    config: AugmentConfig,
) -> Float[np.ndarray, "window taxel"]:
    """What each taxel of each window multiplies its pressure by; dead ones by zero."""
    taxels = int(graphs.taxels.max(initial=-1)) + 1
    own = np.exp(config.taxel_gain * rng.standard_normal((windows, taxels)))
    share = config.dead * rng.random((windows, 1))
    return own * (rng.random((windows, taxels)) >= share)


def silence_patches(
    own: Float[np.ndarray, "window taxel"],
    graphs: GraphBatch,
    node_window: Int[np.ndarray, "node"],
    patch_index: Int[np.ndarray, "every"],
    draws: Float[np.ndarray, "window"],
    config: AugmentConfig,
    rng: np.random.Generator,
) -> None:
    """Make one patch of some windows silent, of those that touch several."""
    felt = graphs.pressure > 0
    for window in np.flatnonzero(draws < config.patch):
        here = graphs.taxels[felt & (node_window == window)]
        patches = np.unique(patch_index[here])
        if len(patches) > 1:
            own[window, patch_index[: own.shape[1]] == rng.choice(patches)] = 0.0


def draw_noise_factors(
    count: int, spread: float, rng: np.random.Generator
) -> Float[np.ndarray, "node"]:
    """Factors about one."""
    return (1 + spread * rng.standard_normal(count)).astype(np.float32)


def pressed(pressure: Float[np.ndarray, "node"]) -> Float[np.ndarray, "node"]:
    """Nothing pulls."""
    return np.maximum(pressure, 0.0)
