"""This module augments training windows: forces of other people, other sensors."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.live import HISTORY, GraphBatch, check_limits

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
    """These settings limit how far a training window differs from the recorded one."""

    gain: float = 0.4
    """Standard deviation of the logarithm of a person's force."""
    taxel_gain: float = 0.15
    """Standard deviation of the logarithm of each taxel's own gain."""
    dead: float = 0.1
    """Largest share of taxels that read zero in a window."""
    offset: float = 2.0
    """Largest pressure subtracted from every taxel [kPa]."""
    shear_gain: float = 0.3
    """Standard deviation of the logarithm of shear relative to pressure."""
    noise: float = 0.0
    """Standard deviation of noise on each taxel's readings, as a share of its
    pressure."""
    patch: float = 0.0
    """Share of windows in which one of several touched patches reads zero."""
    lost: float = 0.0
    """Largest share of the readings of a window that are lost."""
    halved: float = 0.0
    """Share of windows that keep only every other reading: half the rate."""
    stretch: float = 0.0
    """Standard deviation of the logarithm of a person's duration of a gesture."""
    crop: float = 0.7
    """Share of windows that hold nothing from before their gesture."""

    def __post_init__(self) -> None:
        """Reject settings outside their limits."""
        check_limits(self, LIMITS)


NO_AUGMENTATION = AugmentConfig(
    gain=0.0, taxel_gain=0.0, dead=0.0, offset=0.0, shear_gain=0.0
)
"""Settings that leave windows as they were recorded."""


def augment(
    graphs: GraphBatch,
    window: Int[np.ndarray, "graph"],
    rng: np.random.Generator,
    config: AugmentConfig,
    patch_index: Int[np.ndarray, "taxel"] | None = None,
) -> GraphBatch:
    """Augment pressure and shear: each window is of another person on another skin.

    Args:
        graphs: graphs of the windows.
        window: number of the window of each graph.
        rng: source of the random draws.
        config: limits of the changes.
        patch_index: patch of each taxel; None if no patch may read zero.
    """
    windows = int(window.max(initial=-1)) + 1
    node_window = window[graphs.graph_index]
    person = np.exp(config.gain * rng.standard_normal(windows))
    taxel_gains = draw_taxel_gains(graphs, windows, rng, config)
    if patch_index is not None and config.patch > 0:
        silence_patches(taxel_gains, graphs, node_window, patch_index, config, rng)
    gain = person[node_window] * taxel_gains[node_window, graphs.taxels]
    gain = gain.astype(np.float32)
    offset = (config.offset * rng.random(windows))[node_window].astype(np.float32)
    shear_gain = np.exp(config.shear_gain * rng.standard_normal(windows))[node_window]
    shear_factor = (gain * shear_gain)[:, None].astype(np.float32)
    now = before = gain
    if config.noise > 0:
        now, before = (
            gain
            * (1 + config.noise * rng.standard_normal(len(gain))).astype(np.float32)
            for _ in range(2)
        )
    history = graphs.history.copy()
    history[:, FORCE_COLUMNS] *= person[window, None].astype(np.float32)
    return graphs._replace(
        history=history,
        pressure=np.maximum(graphs.pressure * now - offset, 0.0),
        before=np.maximum(graphs.before * before - offset, 0.0),
        shear=graphs.shear * shear_factor,
        shear_before=graphs.shear_before * shear_factor,
    )


def draw_taxel_gains(
    graphs: GraphBatch, windows: int, rng: np.random.Generator, config: AugmentConfig
) -> Float[np.ndarray, "window taxel"]:
    """Draw the gain of each taxel in each window; zero for dead ones."""
    taxels = int(graphs.taxels.max(initial=-1)) + 1
    gains = np.exp(config.taxel_gain * rng.standard_normal((windows, taxels)))
    share = config.dead * rng.random((windows, 1))
    return gains * (rng.random((windows, taxels)) >= share)


def silence_patches(
    gains: Float[np.ndarray, "window taxel"],
    graphs: GraphBatch,
    node_window: Int[np.ndarray, "node"],
    patch_index: Int[np.ndarray, "every"],
    config: AugmentConfig,
    rng: np.random.Generator,
) -> None:
    """Set the gains of one patch to zero, in some windows that touch several."""
    pressed = graphs.pressure > 0
    for window in np.flatnonzero(rng.random(len(gains)) < config.patch):
        here = graphs.taxels[pressed & (node_window == window)]
        patches = np.unique(patch_index[here])
        if len(patches) > 1:
            gains[window, patch_index[: gains.shape[1]] == rng.choice(patches)] = 0.0
