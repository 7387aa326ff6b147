"""What the kernels that follow touches are told."""

from typing import NamedTuple

import numpy as np


class Rules(NamedTuple):
    """The configuration of contacts, tracks and touches as the kernels want it."""

    on: float
    """Pressure from which a taxel becomes active [kPa]."""
    off: float
    """Pressure from which it stays active [kPa]."""
    on_share: float
    """Part of the recent peak that goes with `on`."""
    off_share: float
    """Part of the recent peak that goes with `off`."""
    fade: float
    """Half-life of the recent peak [s]."""
    hold: float
    """How long a taxel not received is held [s]."""
    gate: float
    """Distance that a contact may jump at once [m]."""
    speed: float
    """Speed by which that grows [m/s]."""
    coast: float
    """How long a track waits [s]."""
    gap: float
    """Time between readings that ends every track [ns]."""
    near: float
    """How far a track may begin from where one ended [m]."""
    pause: int
    """How long after it, and when a touch closes [ns]."""
    beside: float
    """How far contacts of one touch may be apart [m]."""
    calibrated: bool
    """Whether distances mean anything."""


class Instant(NamedTuple):
    """A reading as the kernels want it."""

    stamp: int
    """When it was taken [ns]."""
    elapsed: int
    """Time since the reading before [ns]; 0 at the first."""
    now: float
    """When it was taken, since the first reading [s]."""
    before: float
    """When the reading before was, or itself [s]."""
    pressure: np.ndarray
    """(taxel) [kPa]."""
    valid: np.ndarray
    """(taxel) whether that is to be believed."""
    T_world_link: np.ndarray
    """(link, 4, 4) poses of the robot's links."""
