"""This module draws the parts of events: bodies, forces through time, and what follows.

Its laws are estimates within the physics of each thing: a body of mass m and stiffness
k that hits at a speed v presses with at most v sqrt(m k), for pi sqrt(m / k).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactPads, ContactSite, Press, SoftTissue
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.people.gesture_sample import (
    GestureSample,
    build_bell,
    build_trapezoid,
    scale_to_peak,
)
from eskin.sim.people.person import Person
from eskin.sim.scene.placement import draw_site

STEP = 0.01
"""Time between two values of a series [s]."""
LEAD = 0.02
"""Time before the first contact of an event [s]."""
THING = SoftTissue(
    b=0.19 / MM, m=2.1 / MM, area_scale=1.0, area_exponent=0.42, conformity=0.0
)
"""How a thing gives way that is no person."""
WRAP = replace(THING, conformity=1.0)
"""How a thing gives way that lies close round a link."""
FLAT_RADIUS = 0.04
"""Radius that is assumed of a link which is no tube [m]."""
Series = Float[np.ndarray, "time"]
Law = tuple[float, float]
"""Ends of a log-uniform law."""
Hits = list[tuple[float, float, float]]
"""Start [s], duration [s] and largest force [N] of each contact."""
Where = Literal["near", "row", "patch"]
"""Taxels that are disturbed: all near a point, of one row, or of one patch."""


@dataclass(frozen=True, eq=False)
class Pulses:
    """Pulses raise the counts of taxels near a site."""

    site: ContactSite
    """Where."""
    level: Series
    """What they add, in counts at which contact begins."""
    reach: float
    """Distance up to which taxels take part [m]."""
    where: Where
    """Which taxels within that distance take part."""
    noise: float = 0.0
    """Noise from scan to scan, by size."""
    first: int = 0
    """Step at which the series starts."""


@dataclass(frozen=True, eq=False)
class Happening:
    """A happening is what happens to a skin once: an event of the catalogue."""

    sites: tuple[ContactSite, ...]
    """Where."""
    presses: tuple[Press, ...] = ()
    """What presses on the skin."""
    pulses: tuple[Pulses, ...] = ()
    """What disturbs its counts."""

    @property
    def steps(self) -> int:
        """Return the number of steps until it is over."""
        ends = [press.first + press.steps for press in self.presses]
        ends += [pulses.first + len(pulses.level) for pulses in self.pulses]
        return max(ends, default=0)

    @property
    def seconds(self) -> float:
        """Return the time until it is over [s]."""
        return STEP * self.steps

    def delay(self, seconds: float) -> "Happening":
        """Return the same, later by a time [s]."""
        steps = round(seconds / STEP)
        return Happening(
            self.sites,
            tuple(replace(one, first=one.first + steps) for one in self.presses),
            tuple(replace(one, first=one.first + steps) for one in self.pulses),
        )


@dataclass(frozen=True)
class EventDraw:
    """A draw gives the numbers of one event."""

    skin: InteractiveSkin
    """Skin on which it happens."""
    q: Float[np.ndarray, "joint"]
    """Joint positions of the robot [rad]."""
    person: Person
    """Person who takes part."""
    rng: np.random.Generator
    """Random generator."""

    def site(self, law: str, kind: str | None = None) -> ContactSite:
        """Draw where it happens, as where people make a gesture."""
        return draw_site(self.skin.env, self.q, self.person, law, self.rng, kind)

    def between(self, low: float, high: float) -> float:
        """Draw a number from a log-uniform law."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def count(self, low: int, high: int) -> int:
        """Draw a whole number, both ends included."""
        return int(self.rng.integers(low, high + 1))

    def chance(self, share: float) -> bool:
        """Draw whether something happens that does in a share of all cases."""
        return bool(self.rng.random() < share)

    def choose(self, *names: str) -> str:
        """Draw one of some names."""
        return str(self.rng.choice(names))

    def sample(self, kind: str, site: ContactSite) -> GestureSample:
        """Begin a touch by the person."""
        constants = self.skin.env.constants
        regime = "paper" if self.chance(0.7) else "cost"
        return GestureSample(kind, self.person, site, constants, self.rng, 1.5, regime)


World = Callable[[EventDraw], Happening]
"""What draws an event of one kind."""


def combine(*parts: Happening) -> Happening:
    """Return several happenings as one."""
    return Happening(
        tuple(site for part in parts for site in part.sites),
        tuple(press for part in parts for press in part.presses),
        tuple(pulses for part in parts for pulses in part.pulses),
    )


def vary(draw: EventDraw, event: Happening, shift: float) -> Happening:
    """Return the same again, a little stronger or weaker and not quite there.

    Args:
        draw: gives the numbers.
        event: what happens again.
        shift: standard deviation of its place along each axis [m].
    """
    scale = float(np.exp(draw.rng.normal(0.0, 0.2)))
    away = draw.rng.normal(0.0, shift, 2)
    return Happening(
        event.sites,
        tuple(
            replace(one, force=scale * one.force, centre=one.centre + away)
            for one in event.presses
        ),
        tuple(replace(one, level=scale * one.level) for one in event.pulses),
    )


def either(first: World, second: World) -> World:
    """Return the world of one of two, with equal chances."""
    return lambda draw: (first if draw.chance(0.5) else second)(draw)


def build_pad(across: float, along: float, area: float, most: float) -> ContactPads:
    """Build a thing of radii [mm], of an area at 1 N and a largest one [mm2]."""
    return build_pads(np.zeros((1, 2)), (across, along), area, most)


def build_pads(
    centres: Float[np.ndarray, "part 2"],
    radii: tuple[float, float],
    area: float,
    most: float,
) -> ContactPads:
    """Build a thing of equal parts, each of radii [mm] and areas [mm2] as one.

    `centres` are in the thing's plane [m].
    """
    count = len(centres)
    return ContactPads(
        centres,
        np.tile(radii, (count, 1)) * MM,
        np.zeros(count),
        np.full(count, area) * MM**2,
        np.full(count, most) * MM**2,
        np.ones(count),
    )


def get_radius(site: ContactSite) -> float:
    """Return the radius of the link at a site [m]."""
    return site.radius if np.isfinite(site.radius) else FLAT_RADIUS


def build_wrap(
    draw: EventDraw, site: ContactSite, share: float, width: float, rows: int = 1
) -> ContactPads:
    """Build a thing that lies round a link, with gaps here and there.

    Args:
        draw: gives the numbers.
        site: where it lies; its x axis is round the link.
        share: share of the way round that it covers.
        width: its width along the link [mm].
        rows: number of parts side by side along the link.
    """
    count = draw.count(6, 14)
    covered = share * 2 * np.pi * get_radius(site)
    x = (np.arange(count) / (count - 1) - 0.5) * covered
    y = (np.arange(rows) - (rows - 1) / 2) * width / rows * MM
    most = covered / count / MM * width / rows * draw.rng.uniform(0.3, 1.0)
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pads = build_pads(centres, (60, 60), 0.4 * most, most)
    spread = np.exp(draw.rng.normal(0.0, 0.3, pads.count))
    return replace(pads, stiffness=spread)


def build_hits(hits: Hits) -> Series:
    """Build the force of contacts; one below a step keeps its impulse."""
    end = max(start + duration for start, duration, _ in hits)
    force = np.zeros(round(end / STEP) + 4)
    for start, duration, peak in hits:
        first = round(start / STEP)
        steps = round(duration / STEP)
        shape = build_bell(steps + 2, 1.0)[1:-1] if steps > 1 else np.ones(1)
        share = min(duration / STEP, 1.0) * (1.0 if steps > 1 else 2 / np.pi)
        part = slice(first + 1, first + 1 + len(shape))
        force[part] = np.maximum(force[part], peak * share * shape)
    return force


def build_hold(hits: Hits, rise: float = 0.15) -> Series:
    """Build forces that rise and fall in a share of their duration, and hold."""
    end = max(start + duration for start, duration, _ in hits)
    force = np.zeros(round(end / STEP) + 4)
    for start, duration, peak in hits:
        steps = max(round(duration / STEP), 3)
        first = round(start / STEP)
        part = force[first : first + steps]
        shape = scale_to_peak(build_trapezoid(steps, rise, rise, 2), peak)
        part[:] = shape[: len(part)]
    return force


def build_level(hits: Hits) -> Series:
    """Build a series that is constant during each contact, and zero between them."""
    end = max(start + duration for start, duration, _ in hits)
    level = np.zeros(round(end / STEP) + 1)
    for start, duration, size in hits:
        part = slice(round(start / STEP), round((start + duration) / STEP))
        level[part] = np.maximum(level[part], size)
    return level


def press_thing(
    draw: EventDraw,
    site: ContactSite,
    pads: ContactPads,
    force: Series,
    shift: float = 0.0,
    tissue: SoftTissue = THING,
    angle: float | None = None,
) -> Press:
    """Press a thing with a force; it lands up to a shift [m] away after each gap."""
    landed = np.cumsum((force > 0) & (np.append(0.0, force[:-1]) == 0))
    places = draw.rng.uniform(-shift, shift, (int(landed[-1]) + 1, 2))
    centre = np.asarray(site.centre) + places[landed]
    turn = draw.rng.uniform(-np.pi, np.pi) if angle is None else angle
    return Press(site.chart, 0, force, centre, np.full(len(force), turn), pads, tissue)


def move(site: ContactSite, round_way: float = 0.0, along: float = 0.0) -> ContactSite:
    """Return a site moved round its link and along it, within its free run [m]."""
    low, high = site.free_run
    kept = float(np.clip(along, low, high))
    centre = (site.centre[0] + round_way, site.centre[1] + kept)
    return replace(site, centre=centre, free_run=(low - kept, high - kept))


def repeat(
    draw: EventDraw,
    count: int,
    interval: Law,
    contact: Law,
    force: Law,
) -> Hits:
    """Draw contacts of one thing, that vary by a fifth around its own law."""
    usual = [draw.between(*law) for law in (interval, contact, force)]
    hits: Hits = []
    at = LEAD
    for _ in range(count):
        own = [one * float(np.exp(draw.rng.normal(0, 0.2))) for one in usual]
        hits.append((at, min(own[1], 0.9 * own[0]), own[2]))
        at += own[0]
    return hits
