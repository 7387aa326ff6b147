"""Contacts: connected active taxels at one instant."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class Contact:
    """Connected active taxels at one instant."""

    taxels: Int[np.ndarray, "active"]
    """Its taxels, ordered by patch, row and column."""

    force: float
    """Sum of pressure times area [N]."""

    area: float
    """Sum of the taxels' areas [m2]."""

    peak: float
    """Greatest pressure [kPa]."""

    p_world: Float[np.ndarray, "3"]
    """Centre, weighted by force [m]."""

    n_world: Float[np.ndarray, "3"]
    """Mean outward normal, weighted by force; unit, or zero where normals cancel."""

    p_link: Float[np.ndarray, "3"]
    """The centre in the frame of `link` [m]."""

    link: str
    """Link of the most loaded taxel."""

    patch: str
    """Patch of the most loaded taxel."""


@dataclass(frozen=True)
class ContactConfig:
    """When a taxel is active and when two active taxels belong together."""

    on: float = 0.7
    """Pressure from which a taxel becomes active [kPa]."""

    off: float = 0.5
    """Pressure from which an active taxel stays active [kPa]."""

    on_share: float = 0.15
    """Part of its recent peak that a released taxel must exceed to be active again."""

    off_share: float = 0.1
    """Part of its recent peak that an active taxel must exceed to stay active."""

    fade_seconds: float = 5.0
    """Time in which half of the recent peak is forgotten [s]."""

    hold_seconds: float = 0.1
    """How long a taxel not received is remembered as active [s]."""

    reach: float = 1.6
    """How far active taxels connect, in units of the local spacing."""

    least_reach: float = 0.018
    """How far they connect anyway [m]: over the seams between patches."""

    def raised_to(self, floor: float) -> "ContactConfig":
        """The same, its thresholds in proportion, `on` at least `floor` [kPa]."""
        factor = max(1.0, floor / self.on)
        return replace(self, on=self.on * factor, off=self.off * factor)
