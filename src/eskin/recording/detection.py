"""What a recording keeps of one detection."""

from dataclasses import dataclass

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class DetectionRecord:
    """What was said of one touch, and when."""

    stamp: int
    """When it was said [ns since the epoch]."""
    gesture: str
    """Name of the gesture."""
    confidence: float
    """Calibrated probability."""
    onset: int
    """First instant of the touch [ns since the epoch]."""
    end: int
    """Last instant of the touch so far [ns since the epoch]."""
    link: str
    """Link touched most."""
    patch: str
    """Patch touched most."""
    p_world: Vector
    """Force-weighted centre [m]."""
    n_world: Vector
    """Mean outward normal, unit."""
    direction_world: Vector
    """Direction of travel, unit; zero where the touch stood still."""
    peak_force: float
    """Largest force of the touch [N]."""
