"""Settings of the contact graph."""

import math
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class GraphConfig:
    """How the taxels of a touch become a graph."""

    fixed: int = 8
    """Nearest taxels of the same patch that each taxel is joined to (the paper's K)."""

    live: int = 4
    """Nearest taxels of other patches, found anew at every reading."""

    live_reach: float = 0.03
    """Farthest that a taxel of another patch is joined [m]."""

    shear_on: float = 1.5
    """On a skin that is not calibrated: shear from which a taxel belongs to the graph
    even where its pressure is too low for a contact [kPa]."""

    posed: bool = True
    """Whether the robot's pose is seen. Without it every joint is taken to be at 0, so
    that the same counts are the same touch in every pose."""

    def without_shear(self) -> "GraphConfig":
        """The same where shear is not used: it touches no taxel either."""
        return replace(self, shear_on=math.inf)
