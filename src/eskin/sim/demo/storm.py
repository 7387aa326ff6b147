"""This module makes the simulated skin of a demonstration fail while it is used."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from eskin.sim.interactive import InteractiveSkin
from eskin.touch import Scan
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class StormConfig:
    """Sets which faults of the skin come beside those of its build."""

    loss: float = 0.0
    """Probability that a scan of a patch is lost, beside the losses of the build."""
    unplug_period: float | None = None
    """Time from one unplugged patch to the next [s]; None unplugs none."""
    unplug_seconds: float = 5.0
    """Time after which an unplugged patch is plugged in again [s]."""
    dead: float = 0.0
    """Share of all taxels that are dead from the start."""


@final
class FaultStorm:
    """Loses scans of patches, unplugs patches and kills taxels of a simulated skin."""

    def __init__(self, skin: InteractiveSkin, config: StormConfig, seed: int) -> None:
        """Kill the taxels that are dead from the start.

        Args:
            skin: the skin that fails.
            config: which faults come.
            seed: seed of what is lost and unplugged.

        Raises:
            ValueError: a share is not between 0 and 1.
        """
        if not 0.0 <= config.loss <= 1.0:
            raise ValueError(
                f"loss is {config.loss}; allowed is 0 to 1, the share of lost scans; "
                "change it"
            )
        self.skin = skin
        self.config = config
        self.rng = np.random.default_rng([seed, 2811])
        self.patches = [patch.id for patch in skin.mounted.skin.patches]
        self.patch_index = skin.mounted.skin.patch_index
        self.unplugged: str | None = None
        self.next_change: int | None = None
        if config.dead:
            skin.kill(config.dead)

    def update(self, stamp: int) -> None:
        """Unplug a patch or plug it in again, where that is due at a time [ns]."""
        period = self.config.unplug_period
        if period is None:
            return
        if self.next_change is None:
            self.next_change = stamp + round(period * NS_PER_S)
        if stamp < self.next_change:
            return
        seconds = self.config.unplug_seconds
        if self.unplugged is None:
            self.unplugged = str(self.rng.choice(self.patches))
            self.skin.unplug(self.unplugged)
        else:
            self.skin.plug(self.unplugged)
            self.unplugged, seconds = None, period - seconds
        self.next_change = stamp + round(seconds * NS_PER_S)

    def corrupt(self, scan: Scan) -> Scan:
        """Return a scan without the patches that are lost."""
        if not self.config.loss:
            return scan
        lost = self.rng.random(len(self.patches)) < self.config.loss
        received = scan.received & ~lost[self.patch_index]
        counts = np.where(received, scan.counts, 0).astype(scan.counts.dtype)
        return replace(scan, counts=counts, received=received)
