"""Which stages of the sensor work."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Stages:
    """Which stages of the sensor work; one that does not passes on what it gets."""

    bending: bool = True
    """Bent laminate presses on itself."""
    threshold: bool = True
    """Small pressures do not close the gap."""
    hysteresis: bool = True
    """Load lags behind pressure."""
    power: bool = True
    """Conductance is a power of load."""
    creep: bool = True
    """Conductance grows under lasting load and is slow to forget it."""
    gain: bool = True
    """Taxels, patches and sessions differ."""
    ghosting: bool = True
    """A taxel reads others of its patch."""
    divider: bool = True
    """A divider stands before the converter."""
    drift: bool = True
    """Temperature, wandering baselines, and shifts of them after a touch."""
    noise: bool = True
    """Readings are noisy."""
    faults: bool = True
    """Taxels and lines are broken, readings do not arrive."""
    skew: bool = True
    """Patches and rows are scanned one after the other."""
