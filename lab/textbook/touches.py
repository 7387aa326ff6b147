"""Describe touches as sums of moving spots of pressure, with raised-cosine ramps.

Hands are drawn in unrolled coordinates (s, t) about the origin, the fingers along t.
Every spot of a poke, pat, stroke or resting hand bears force in proportion to its
area, so that the mean pressure is the same under all of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin, sqrt

import numpy as np
from jaxtyping import Float

Place = tuple[float, float]

SPREAD = 0.020
"""Distance of neighbouring fingers [m]."""
SLENDER = 3.0
"""Ratio of the length of a lying finger to its width."""
LYING, PALM = 1.5, 3.0
"""Area of a lying finger and of the palm, in units of that of a fingertip."""
PALM_BEHIND = 0.060
"""Distance from the middle of the lying fingers to that of the palm [m]."""
FINGERS = tuple(SPREAD * (n - 1.5) for n in range(4))


@dataclass(frozen=True)
class Spot:
    """Describes a paraboloid of pressure, `p = peak * max(0, 1 - r^2)`."""

    centre: Place
    """Centre in unrolled coordinates [m]."""
    axes: Place
    """Semi-axes of the ellipse, along s and t before it is turned [m]."""
    force: float
    """Force [N]."""
    angle: float = 0.0
    """Rotation from s to t [rad]."""

    @property
    def reach(self) -> float:
        """Greatest distance of its edge from its centre [m]."""
        return max(self.axes)

    @property
    def peak(self) -> float:
        """Pressure at its centre, `2 F / A` [kPa]."""
        return 2e-3 * self.force / (pi * self.axes[0] * self.axes[1])

    def turned(self, angle: float) -> "Spot":
        """Return the spot rotated about the origin [rad]."""
        (s, t), c, d = self.centre, cos(angle), sin(angle)
        centre = (c * s - d * t, d * s + c * t)
        return replace(self, centre=centre, angle=self.angle + angle)

    def moved(self, by: Place) -> "Spot":
        """Return the shifted spot [m]."""
        centre = (self.centre[0] + by[0], self.centre[1] + by[1])
        return replace(self, centre=centre)


@dataclass(frozen=True)
class TextbookTouch:
    """Describes spots that are pressed in one or more contacts, and may move."""

    name: str
    """Name of a gesture, or of a kind of `none`."""
    spots: tuple[Spot, ...]
    """Spots at the start of the first contact."""
    contacts: tuple[tuple[float, float], ...]
    """Start and end of each contact [s]."""
    ramp: float
    """Duration of rise and fall of the force, at most half of a contact [s]."""
    velocity: Place = (0.0, 0.0)
    """Velocity of all spots from the first contact on [m/s]."""

    def share(self, times: Float[np.ndarray, "step"]) -> Float[np.ndarray, "step"]:
        """Return the share of the full force at each time [s]."""
        return np.sum([pulse(times, *c, self.ramp) for c in self.contacts], axis=0)

    def shift(self, times: Float[np.ndarray, "step"]) -> Float[np.ndarray, "step 2"]:
        """Return the displacement of the spots at each time [m]."""
        start, end = self.contacts[0][0], self.contacts[-1][1]
        return (np.clip(times, start, end) - start)[:, None] * np.array(self.velocity)

    @property
    def moves(self) -> bool:
        """Return whether the spots move."""
        return self.velocity != (0.0, 0.0)


def pulse(
    times: Float[np.ndarray, "step"], start: float, end: float, ramp: float
) -> Float[np.ndarray, "step"]:
    """Return a pulse from 0 to 1 and back, with raised-cosine ramps.

    Args:
        times: times at which it is evaluated [s].
        start: start of the contact [s].
        end: end of the contact [s].
        ramp: length of either ramp, shortened to half of the contact [s].
    """
    ramp = min(ramp, (end - start) / 2)
    part = np.clip(np.minimum(times - start, end - times) / ramp, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(pi * part)


def compute_semi_axes(area: float, slender: float = 1.0) -> Place:
    """Return the semi-axes [m] of an ellipse of an area [m2] and a slenderness."""
    width = sqrt(area / (pi * slender))
    return width, slender * width


def fingertips(count: int, force: float, area: float) -> tuple[Spot, ...]:
    """Build fingertips in a row along s.

    Args:
        count: number of fingertips.
        force: total force [N].
        area: area of each [m2].
    """
    row = [SPREAD * (n - (count - 1) / 2) for n in range(count)]
    return tuple(Spot((s, 0.0), compute_semi_axes(area), force / count) for s in row)


def flat_hand(force: float, area: float) -> tuple[Spot, ...]:
    """Build four lying fingers and the palm.

    Args:
        force: total force [N].
        area: area of a fingertip, to which those of fingers and palm are proportional
        [m2].
    """
    whole = 4 * LYING + PALM
    lying, palm = (
        compute_semi_axes(LYING * area, SLENDER),
        compute_semi_axes(PALM * area),
    )
    fingers = [Spot((s, 0.03), lying, force * LYING / whole) for s in FINGERS]
    return *fingers, Spot((0.0, 0.03 - PALM_BEHIND), palm, force * PALM / whole)


def grip(force: float) -> tuple[Spot, ...]:
    """Build a hand closed along s round 300 of 360 degrees of a forearm.

    The palm lies at the origin, four fingers wrap to one side and the thumb to the
    other; they cover 75 cm2, whatever the force.

    Args:
        force: force of each finger and of the thumb; the palm bears twice as much [N].
    """
    fingers = [Spot((0.070, t), (0.040, 0.008), force) for t in FINGERS]
    thumb = Spot((-0.060, 0.010), (0.030, 0.010), force)
    return *fingers, thumb, Spot((0.0, 0.0), (0.030, 0.035), 2 * force)


def place_spots(spots: Sequence[Spot], angle: float, by: Place) -> tuple[Spot, ...]:
    """Rotate spots about the origin [rad], then shift them [m]."""
    return tuple(spot.turned(angle).moved(by) for spot in spots)


def path_ends(spots: Sequence[Spot], travel: Place) -> list[tuple[float, float, float]]:
    """Return centre (s, t) and reach of every spot [m], before and after its travel."""
    ends = [spot for by in ((0.0, 0.0), travel) for spot in place_spots(spots, 0.0, by)]
    return [(*spot.centre, spot.reach) for spot in ends]
