"""Presses describe what bodies do to a surface, before any taxel is reached."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class ContactPads:
    """The parts of a body that can bear load, each pressed on as a small ellipse.

    They lie in the body's own plane, seen from outside the skin that it presses on: a
    hand is seen from its back, with y to the fingertips and x to the right, the
    thumb's side of a left hand and the little finger's of a right one.
    """

    centres: Float[np.ndarray, "part 2"]
    """(x, y) in the body's plane, x a quarter turn clockwise from y [m]."""
    radii: Float[np.ndarray, "part 2"]
    """Radii of curvature across and along the part [m]."""
    angles: Float[np.ndarray, "part"]
    """Angle of the part's long axis from y, counter-clockwise seen from outside the
    skin [rad]."""
    area: Float[np.ndarray, "part"]
    """Contact area on a flat at 1 N [m2]."""
    max_area: Float[np.ndarray, "part"]
    """Largest contact area [m2]."""
    stiffness: Float[np.ndarray, "part"]
    """Relative stiffness in sharing the load."""

    @property
    def count(self) -> int:
        """Number of parts."""
        return len(self.area)


@dataclass(frozen=True)
class SoftTissue:
    """How a body gives way."""

    b: float
    """Stiffness at first touch: F = k (b / m) (exp(m d) - 1 - m d) [N/m]."""
    m: float
    """Growth of the stiffness with depth d [1/m]."""
    area_scale: float
    """Contact area relative to that of the average body."""
    area_exponent: float
    """Growth of the contact area with force."""
    conformity: float
    """How far it wraps round what it touches: 0 stays flat, 1 follows the surface."""


@dataclass(frozen=True, eq=False)
class Press:
    """One body pressing on one chart through time."""

    chart: int
    """Index into the skin's charts."""
    first: int
    """Step of the scene's clock at which the series start; may be negative."""
    pads: ContactPads
    """The parts that bear load; their mean centre is put on `centre`."""
    tissue: SoftTissue
    """How they give way."""
    force: Float[np.ndarray, "time"]
    """Total force on the surface [N]."""
    centre: Float[np.ndarray, "time 2"]
    """Where the stamps' mean centre lies on the chart, unrolled (s, t) [m]."""
    angle: Float[np.ndarray, "time"]
    """Angle from the chart's t axis to the body's y axis, counter-clockwise seen from
    outside the skin [rad]."""

    @property
    def steps(self) -> int:
        """Length of the series."""
        return len(self.force)


@dataclass(frozen=True)
class ContactSite:
    """A place on a chart and the room around it."""

    chart: int
    """Index into the skin's charts."""
    centre: tuple[float, float]
    """(s, t) on the unrolled chart [m]."""
    radius: float
    """Radius of curvature of the chart [m]; infinite on a plane."""
    free_run: tuple[float, float]
    """Free run along t from the centre, (low, high) with low <= 0 <= high [m]."""
    angle: float
    """Angle from t to the hand's y axis that suits the person, counter-clockwise seen
    from outside the skin [rad]."""

    def __post_init__(self) -> None:
        """Refuse a free run that the centre is not part of."""
        low, high = self.free_run
        if not low <= 0 <= high:
            raise ValueError(
                f"the free run {self.free_run} does not hold the centre; give it from the "
                "centre, (low, high) with low <= 0 <= high"
            )


@dataclass(frozen=True, eq=False)
class TrueTouch:
    """One thing that somebody or something did to the skin."""

    gesture: str
    """Of the vocabulary: poke, double_pat, grab, stroke or none; an unknown gesture
    such as rub has its own name."""
    kind: str
    """Variant, such as `two_tips` or `bump`."""
    subject: str
    """Who did it; empty where it was nobody."""
    presses: tuple[Press, ...]
    """What presses where; more than one body, or one on two charts."""
    drawn: dict[str, float | str]
    """Every parameter that was drawn for it, by name."""
