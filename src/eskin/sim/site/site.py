"""Where on the robot a touch takes place."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Site:
    """A place on a chart and the room around it."""

    chart: int
    """Index into the skin's charts."""
    centre: tuple[float, float]
    """(s, t) on the unrolled chart [m]."""
    radius: float
    """Radius of curvature of the chart [m]; infinite on a plane."""
    clear: tuple[float, float]
    """Free run along t from the centre, (low, high) with low <= 0 <= high [m]."""
    angle: float
    """Angle from t to the hand's y axis that suits the person, counter-clockwise seen
    from outside the skin [rad]."""

    def __post_init__(self) -> None:
        """Refuse a free run that the centre is not part of."""
        low, high = self.clear
        if not low <= 0 <= high:
            raise ValueError(
                f"the free run {self.clear} does not hold the centre; give it from the "
                "centre, (low, high) with low <= 0 <= high"
            )
