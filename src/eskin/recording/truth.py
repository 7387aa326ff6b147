"""What a recording keeps of one touch as it really was."""

from dataclasses import dataclass

from eskin.recording.detection import Vector


@dataclass(frozen=True)
class TruthRecord:
    """One touch at one reading, known where the skin is simulated."""

    stamp: int
    """Of the reading [ns since the epoch]."""
    touch: int
    """Number of the touch in its file."""
    gesture: str
    """Name of the gesture; `none` where it is none of the vocabulary."""
    kind: str
    """Variant of the gesture."""
    link: str
    """Link that bears most of it."""
    force: float
    """Total force on the skin [N]."""
    area: float
    """Contact area [m2]."""
    p_world: Vector
    """Centre of the force [m]."""
