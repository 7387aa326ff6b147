"""Presses describe what bodies do to a surface, before any taxel is reached."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class ContactPads:
    """Contact pads are the parts of a body that bear load, each pressed as an ellipse.

    They lie in the body's own plane, seen from outside the skin that it presses on: a
    hand is seen from its back, with y to the fingertips and x to the right, the thumb's
    side of a left hand and the little finger's of a right one.
    """

    centres: Float[np.ndarray, "part 2"]
    """Centre (x, y) in the body's plane, x a quarter turn clockwise from y [m]."""
    radii: Float[np.ndarray, "part 2"]
    """Radii of curvature across and along the pad [m]."""
    angles: Float[np.ndarray, "part"]
    """Angle of the pad's long axis from y, counter-clockwise seen from outside the skin
    [rad]."""
    area: Float[np.ndarray, "part"]
    """Contact area on a flat at 1 N [m2]."""
    max_area: Float[np.ndarray, "part"]
    """Largest contact area [m2]."""
    stiffness: Float[np.ndarray, "part"]
    """Relative stiffness in sharing the load."""

    @property
    def count(self) -> int:
        """Return the number of pads."""
        return len(self.area)


@dataclass(frozen=True)
class SoftTissue:
    """Soft tissue describes how a body gives way under load."""

    b: float
    """Stiffness at first touch: F = k (b / m) (exp(m d) - 1 - m d) [N/m]."""
    m: float
    """Growth of the stiffness with depth d [1/m]."""
    area_scale: float
    """Contact area over the contact area of the average body."""
    area_exponent: float
    """Growth of the contact area with force."""
    conformity: float
    """Degree to which it wraps round a surface: 0 stays flat, 1 follows the surface."""


@dataclass(frozen=True, eq=False)
class SurfacePress:
    """A surface press moves something that presses on one chart through time."""

    chart: int
    """Index into the skin's charts."""
    first: int
    """Step of the scene's clock at which the series start; may be negative."""
    force: Float[np.ndarray, "time"]
    """Total force on the surface; 0 while nothing touches [N]."""
    centre: Float[np.ndarray, "time 2"]
    """Centre of what presses on the chart, unrolled (s, t) [m]."""
    angle: Float[np.ndarray, "time"]
    """Angle from the chart's t axis to the y axis of what presses, counter-clockwise
    seen from outside the skin [rad]."""

    @property
    def steps(self) -> int:
        """Return the length of the series."""
        return len(self.force)


@dataclass(frozen=True)
class WorldAnchor:
    """An anchor describes a body that stands in the world while the robot moves."""

    centre: tuple[float, float]
    """Place on the chart at which the body lands, unrolled (s, t) [m]."""
    run: tuple[float, float]
    """Lowest and highest t of the body from its landing, beyond which it is off [m]."""
    give: float
    """Distance by which the surface leaves it along the normal until contact ends
    [m]."""
    most: float
    """Largest force over the force at rest, but for the ripple, as the body is pushed
    aside."""
    dragged: float
    """Share of the motion of the surface that friction makes the body follow."""
    ripple: float
    """Amplitude by which the force varies along the way, as a share of the force."""
    ripple_length: float
    """Length of the way after which this variation repeats [m]."""


@dataclass(frozen=True, eq=False)
class Press(SurfacePress):
    """A press moves one body; its centre is the mean centre of the body's pads."""

    pads: ContactPads
    """Pads that bear load."""
    tissue: SoftTissue
    """Tissue of the body."""
    anchor: WorldAnchor | None = None
    """How the body stands in the world; None for a hand, which follows the robot."""


@dataclass(frozen=True, eq=False)
class MoviePress(SurfacePress):
    """A movie press plays recorded pressure, as a body would press there.

    Rows of the movie follow each other along its y axis, columns along its x axis.
    """

    pressure: Float[np.ndarray, "time row column"]
    """Pressure at the points of the movie's grid [kPa]."""
    pitch: float
    """Distance of neighbouring points [m]."""
    middle: tuple[float, float]
    """Row and column of the movie that are put on `centre`."""


AnyPress = TypeVar("AnyPress", bound=SurfacePress)
"""One kind of press, for functions that return the kind that they are given."""


@dataclass(frozen=True)
class ContactSite:
    """A contact site is a place on a chart with the room around it."""

    chart: int
    """Index into the skin's charts."""
    centre: tuple[float, float]
    """Unrolled coordinates (s, t) on the chart [m]."""
    radius: float
    """Radius of curvature of the chart [m]; infinite on a plane."""
    free_run: tuple[float, float]
    """Free run along t from the centre, (low, high) with low <= 0 <= high [m]."""
    angle: float
    """Angle from t to the hand's y axis that suits the person, counter-clockwise seen
    from outside the skin [rad]."""
    beyond: tuple[float, float] = (0.0, 0.0)
    """Room beyond either end of the free run, without skin [m]."""
    can_close: bool = True
    """Whether a hand could close round the surface there, if it is not too wide."""

    def __post_init__(self) -> None:
        """Refuse a free run that does not contain the centre."""
        low, high = self.free_run
        if not low <= 0 <= high:
            raise ValueError(
                f"free run is {self.free_run} and does not contain the centre; give it "
                "from the centre, (low, high) with low <= 0 <= high"
            )


@dataclass(frozen=True, eq=False)
class TrueTouch:
    """A true touch is one thing that a person or an object did to the skin."""

    gesture: str
    """Gesture of the vocabulary: poke, double_pat, grab, stroke or none; an unknown
    gesture such as rub has its own name."""
    kind: str
    """Variant, such as `two_tips` or `bump`."""
    subject: str
    """Name of the person; empty where no person touched."""
    presses: tuple[Press | MoviePress, ...]
    """Presses, of more than one body or of one body on two charts."""
    drawn: dict[str, float | str]
    """Every parameter that was drawn for it, by name."""

    @property
    def bodies(self) -> tuple[Press, ...]:
        """Return the presses of simulated bodies, which are all but recorded ones."""
        return tuple(press for press in self.presses if isinstance(press, Press))
