"""This module computes bodies that strike a skin, and the pressure under them.

A sphere presses a flat by the law of Hertz, with the dissipation of Hunt and Crossley
(1975): F = k d^1.5 (1 + c v), with depth d and approach v. Of all c, one gives the
coefficient of restitution e at an approach of v0: the work over a contact is that of
a mass which leaves with e v0 where c v0 (1 + e) = ln((1 + c v0) / (1 - e c v0)).
Friction follows Coulomb until the sphere rolls. Nothing of the simulator is in it.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float

from eskin.skin import Skin

DT = 2e-5
"""Step of integration [s]."""

LONGEST = 0.5
"""Time after which a body counts as gone [s]."""

AWAY = 0.02
"""Distance at which a body that is pushed by another counts as gone [m]."""

SLIP_PER_SLIDING = 3.5
"""Slip that friction takes from a solid sphere, by the velocity that it takes."""

FINER = 4
"""Points along a side of a taxel at which pressure is computed."""

Series = Float[np.ndarray, "time"]


@dataclass(frozen=True)
class Ball:
    """A ball strikes the skin."""

    radius: float
    """Radius [m]."""
    mass: float
    """Mass [kg]."""
    modulus: float
    """Effective modulus of ball and skin [Pa]."""
    restitution: float
    """Speed after a contact over that before."""
    friction: float
    """Coefficient of Coulomb friction."""

    @property
    def stiffness(self) -> float:
        """Return the force over depth^1.5 [N/m^1.5]."""
        return 4 / 3 * self.modulus * self.radius**0.5


@dataclass(frozen=True)
class PushingBody:
    """A follower is a second body that pushes the ball by a spring and a damper."""

    mass: float
    """Mass [kg]."""
    stiffness: float
    """Stiffness of the spring [N/m]."""
    damping: float
    """Damping [N s/m]."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion is what a ball does from its first contact on."""

    times: Series
    """Time since the first contact [s]."""
    depth: Series
    """Depth of the ball in the skin; negative without contact [m]."""
    force: Series
    """Normal force on the skin [N]."""
    approach: Series
    """Velocity into the skin [m/s]."""
    follower: Series
    """Velocity of the follower into the skin; zero without one [m/s]."""
    sliding: Series
    """Velocity of the ball along the skin [m/s]."""
    slip: Series
    """Velocity along the skin of the ball's lowest point [m/s]."""


@dataclass(frozen=True, eq=False)
class PressedEllipse:
    """A contact is an ellipse of pressure on the tangent plane at the first contact."""

    times: Series
    """Time since the first contact [s]."""
    force: Series
    """Normal force [N]."""
    axes: Float[np.ndarray, "time 2"]
    """Semi-axes of the ellipse [m]."""
    places: Float[np.ndarray, "time 2"]
    """Centre of the ellipse [m]."""

    def follow(self, other: Self, gap: float) -> "PressedEllipse":
        """Return this contact and then another, `gap` [s] after its end."""
        drift = self.places[-1] - self.places[-2]
        drift = drift / (self.times[-1] - self.times[-2]) * gap
        return PressedEllipse(
            np.concatenate([self.times, self.times[-1] + gap + other.times]),
            np.concatenate([self.force, other.force]),
            np.concatenate([self.axes, other.axes]),
            np.concatenate([self.places, self.places[-1] + drift + other.places]),
        )


def find_damping(restitution: float) -> float:
    """Return c v0 that gives a coefficient of restitution between 0 and 1."""
    low = 0.0
    high = 1 / restitution
    for _ in range(200):
        middle = (low + high) / 2
        left = (1 - restitution * middle) * np.exp(middle * (1 + restitution))
        low, high = (middle, high) if left > 1 + middle else (low, middle)
    return low


def strike(
    ball: Ball,
    approach: float,
    sliding: float = 0.0,
    slip: float | None = None,
    follower: PushingBody | None = None,
) -> Motion:
    """Return the motion of a ball that touches the skin at given velocities [m/s].

    Args:
        ball: the ball.
        approach: velocity into the skin, of the follower too.
        sliding: velocity along the skin, positive.
        slip: slip of its lowest point; `sliding` without spin.
        follower: body that pushes the ball, if any.
    """
    damping = find_damping(ball.restitution) / approach
    slip = sliding if slip is None else slip
    behind = approach if follower else 0.0
    depth = 0.0
    squeeze = 0.0
    rows = []
    gone = AWAY if follower else 0.0
    while depth >= -gone and len(rows) * DT < LONGEST:
        force = ball.stiffness * max(depth, 0.0) ** 1.5 * (1 + damping * approach)
        force = max(force, 0.0)
        rows.append((depth, force, approach, behind, sliding, slip))
        push = 0.0
        if follower:
            rate = behind - approach
            push = follower.stiffness * squeeze + follower.damping * rate
            squeeze += rate * DT
            behind -= push / follower.mass * DT
        approach += (push - force) / ball.mass * DT
        lost = min(SLIP_PER_SLIDING * ball.friction * force / ball.mass * DT, slip)
        slip -= lost
        sliding -= lost / SLIP_PER_SLIDING
        depth += approach * DT
    return Motion(np.arange(len(rows)) * DT, *np.array(rows).T)


def press_sphere(motion: Motion, ball: Ball) -> PressedEllipse:
    """Return the contact under a ball: a disc that moves with it, along the first axis.

    Its radius is sqrt(R d), at most R.
    """
    radius = np.sqrt(ball.radius * np.clip(motion.depth, 0, ball.radius))
    along = np.cumsum(motion.sliding) * DT
    places = np.column_stack([along, np.zeros_like(along)])
    return PressedEllipse(
        motion.times, motion.force, np.column_stack([radius] * 2), places
    )


def push_ellipse(
    peak: float, seconds: float, axes: tuple[float, float]
) -> PressedEllipse:
    """Return a push whose force is half a sine, by a body with an elliptical contact.

    Args:
        peak: greatest force [N].
        seconds: duration.
        axes: semi-axes at the greatest force; they grow with its cube root [m].
    """
    times = np.arange(0, seconds, DT)
    share = np.sin(np.pi * times / seconds)
    grown = np.cbrt(share)[:, None] * np.array(axes)
    return PressedEllipse(times, peak * share, grown, np.zeros((len(times), 2)))


def press_taxels(
    contact: PressedEllipse, skin: Skin, taxel: int, turn: float, times: Series
) -> Float[np.ndarray, "reading taxel"]:
    """Return the mean pressure on each taxel of a skin at times of a contact [kPa].

    The contact lies on the plane that touches the skin at a taxel, its first axis
    turned by `turn` from the taxel's tangent. Taxels of the same link whose normals
    are within 60 degrees are projected onto it.
    """
    links = np.array([patch.link for patch in skin.patches])[skin.patch_index]
    normal = skin.normals[taxel]
    same = (links == links[taxel]) & (skin.normals @ normal > 0.5)
    tangents = skin.tangents[same]
    across = np.cross(skin.normals[same], tangents)
    steps = ((np.arange(FINER) + 0.5) / FINER - 0.5) * np.sqrt(skin.areas[same])[
        :, None
    ]
    points = (
        (skin.positions[same] - skin.positions[taxel])[:, None, None]
        + steps[:, :, None, None] * tangents[:, None, None]
        + steps[:, None, :, None] * across[:, None, None]
    )
    first = skin.tangents[taxel]
    second = np.cross(normal, first)
    x = points @ (np.cos(turn) * first + np.sin(turn) * second)
    y = points @ (np.cos(turn) * second - np.sin(turn) * first)

    def at(values: Series) -> Series:
        return np.interp(times, contact.times, values, left=0.0, right=0.0)

    out = np.zeros((len(times), skin.count))
    series = [contact.force, *contact.axes.T, *contact.places.T]
    for row, values in zip(out, np.column_stack([at(s) for s in series]), strict=True):
        force, a, b, u, v = values
        if force > 0 and a * b > 0:
            inside = 1 - ((x - u) / a) ** 2 - ((y - v) / b) ** 2
            top = 1.5 * force / (np.pi * a * b) / 1000
            row[same] = top * np.sqrt(np.clip(inside, 0, None)).mean((1, 2))
    return out
