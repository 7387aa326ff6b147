"""When the recogniser is sure enough to speak, kept with the weights."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class DecisionConfig:
    """How sure is sure."""

    threshold: float = 0.8
    """Probability from which a gesture is said while the touch goes on."""

    thresholds: Mapping[str, float] = field(default_factory=dict)
    """The same for single gestures, in place of `threshold`; above 1 waits for the
    touch to close."""

    lifted: float = 1.1
    """The same once there has been no contact for `lift_seconds`, where that is less:
    most of what there is to know of a touch is known then."""

    lift_seconds: float = 0.2
    """How long that is [s]; a second pat may still come."""

    hold_seconds: float = 0.06
    """How long it must stay above, and on a skin that is not calibrated how long
    another class must be likeliest until that is another touch [s]."""

    least: float = 0.3
    """Probability below which a touch that closes is unknown; 0 never abstains."""

    still: float = 0.02
    """Travel below which a touch has no direction [m]."""
