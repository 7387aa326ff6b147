"""This module draws what may happen to a skin: things, unmeant people, and gestures.

Each world draws the presses of one event at a site, or what it adds to the counts. The
laws are estimates within the physics of each thing: a body of mass m and stiffness k
that hits at a speed v presses with at most v sqrt(m k), for pi sqrt(m / k); a bounce
flies for 2 v / g; a pendulum of length l swings in 2 pi sqrt(l / g); air and water
press with at most half their density times the square of their speed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactPads, ContactSite, Press, SoftTissue
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.people.gesture_sample import (
    GestureSample,
    build_bell,
    build_trapezoid,
    draw_duration,
    draw_force,
    scale_to_peak,
)
from eskin.sim.people.non_gestures import draw_single_push
from eskin.sim.people.perform import perform
from eskin.sim.people.person import Person, build_body
from eskin.sim.scene.placement import draw_site

GRAVITY = 9.81
STEP = 0.01
"""Time between two values of a force [s]."""
THING = SoftTissue(
    b=0.19 / MM, m=2.1 / MM, area_scale=1.0, area_exponent=0.42, conformity=0.0
)
"""How a thing gives way that is no person."""
Series = Float[np.ndarray, "time"]
Law = tuple[float, float]
"""Ends of a log-uniform law."""
Hits = list[tuple[float, float, float]]
"""Start [s], duration [s] and largest force [N] of each contact."""
UNMEANT = ("resting_hand", "lean", "single_pat", "press", "squeeze_hold") + (
    "guiding",
    "brush",
    "bump",
)
"""What other people do without meaning anything."""


@dataclass(frozen=True)
class Pulses:
    """Pulses raise the counts of taxels near a point."""

    hits: Hits
    """Start, duration and size of each, in counts at which contact begins."""
    reach: float
    """Distance up to which taxels take part [m]."""
    along_row: bool
    """Whether only taxels of the nearest row do."""
    noise: float
    """Noise from scan to scan, by size."""


@dataclass(frozen=True)
class Happening:
    """A happening is what happens to a skin once: an event of the catalogue."""

    site: ContactSite
    """Where."""
    presses: tuple[Press, ...] = ()
    """What presses on the skin, from step 0."""
    pulses: Pulses | None = None
    """What disturbs its counts."""


@dataclass(frozen=True)
class EventDraw:
    """A draw gives the numbers of one event."""

    skin: InteractiveSkin
    q: Float[np.ndarray, "joint"]
    person: Person
    rng: np.random.Generator

    def site(self, law: str, kind: str | None = None) -> ContactSite:
        """Draw where it happens, as where people make a gesture."""
        return draw_site(self.skin.env, self.q, self.person, law, self.rng, kind)

    def between(self, low: float, high: float) -> float:
        """Draw a number from a log-uniform law."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def count(self, low: int, high: int) -> int:
        """Draw a whole number, both ends included."""
        return int(self.rng.integers(low, high + 1))

    def sample(self, kind: str, site: ContactSite) -> GestureSample:
        """Begin a touch by the person."""
        constants = self.skin.env.constants
        regime = "paper" if self.rng.random() < 0.7 else "cost"
        return GestureSample(kind, self.person, site, constants, self.rng, 1.5, regime)


World = Callable[[EventDraw], Happening]


def build_pad(across: float, along: float, area: float, most: float) -> ContactPads:
    """Build a thing of radii [mm], of an area at 1 N and a largest one [mm2]."""
    return ContactPads(
        np.zeros((1, 2)),
        np.array([[across, along]]) * MM,
        np.zeros(1),
        np.array([area]) * MM**2,
        np.array([most]) * MM**2,
        np.ones(1),
    )


def build_hits(hits: Hits) -> Series:
    """Build the force of contacts; one below a step keeps its impulse."""
    end = max(start + duration for start, duration, _ in hits)
    force = np.zeros(round(end / STEP) + 4)
    for start, duration, peak in hits:
        first, steps = round(start / STEP), round(duration / STEP)
        shape = build_bell(steps + 2, 1.0)[1:-1] if steps > 1 else np.ones(1)
        share = min(duration / STEP, 1.0) * (1.0 if steps > 1 else 2 / np.pi)
        part = slice(first + 1, first + 1 + len(shape))
        force[part] = np.maximum(force[part], peak * share * shape)
    return force


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


def draw_object(draw: EventDraw) -> ContactPads:
    """Draw a thing that falls or hits: a tip, an edge, a ball, a flat side."""
    kind = draw.rng.integers(4)
    if kind == 0:
        return build_pad(draw.between(3, 10), draw.between(3, 10), 30, 160)
    if kind == 1:
        return build_pad(draw.between(2, 6), draw.between(20, 60), 40, 400)
    if kind == 2:
        radius, area = draw.between(15, 60), draw.between(80, 600)
        return build_pad(radius, radius, area, 5 * area)
    area = draw.between(300, 4000)
    return build_pad(draw.between(40, 100), draw.between(60, 200), area, 2 * area)


def repeat(
    draw: EventDraw,
    count: int,
    interval: Law,
    contact: Law,
    force: Law,
) -> Hits:
    """Draw contacts of one thing, that vary by a fifth around its own law."""
    usual = [draw.between(*law) for law in (interval, contact, force)]
    hits, at = [], 0.02
    for _ in range(count):
        own = [one * float(np.exp(draw.rng.normal(0, 0.2))) for one in usual]
        hits.append((at, min(own[1], 0.9 * own[0]), own[2]))
        at += own[0]
    return hits


def single(draw: EventDraw) -> Happening:
    """One hit, press or scrape by a thing."""
    site = draw.site("poke")
    hits = [(0.02, draw.between(0.01, 3.0), draw.between(0.5, 60))]
    return Happening(
        site, (press_thing(draw, site, draw_object(draw), build_hits(hits)),)
    )


def bounce(draw: EventDraw) -> Happening:
    """A thing drops, bounces, and in one of three cases stays there."""
    site, mass, k = (
        draw.site("poke"),
        draw.between(0.03, 1.0),
        1e3 * draw.between(0.5, 50),
    )
    speed = np.sqrt(2 * GRAVITY * draw.between(0.02, 0.6))
    left, contact = draw.rng.uniform(0.3, 0.85), np.pi * np.sqrt(mass / k)
    hits, at = [], 0.02
    for _ in range(draw.count(2, 6)):
        hits.append((at, contact, min(speed * np.sqrt(mass * k), 200.0)))
        speed *= left
        at += max(2 * speed / GRAVITY, 0.02) + contact
    force = build_hits(hits)
    if draw.rng.random() < 1 / 3:
        lying = np.full(round(draw.between(0.5, 2.5) / STEP), mass * GRAVITY)
        force = np.concatenate([force[: round(at / STEP)], lying, np.zeros(2)])
    return Happening(site, (press_thing(draw, site, draw_object(draw), force, 0.012),))


def bump(draw: EventDraw) -> Happening:
    """A cart or a box hits two or three times, and may stay."""
    site, mass, k = (
        draw.site("poke"),
        draw.between(3, 60),
        1e3 * draw.between(3, 75),
    )
    speed, contact = draw.rng.uniform(0.03, 0.3), np.pi * np.sqrt(mass / k)
    hits, at = [], 0.02
    for _ in range(draw.count(2, 3)):
        hits.append((at, contact, min(speed * np.sqrt(mass * k), 250.0)))
        speed *= draw.rng.uniform(0.3, 0.8)
        at += contact + draw.between(0.12, 0.9)
    if draw.rng.random() < 0.25:
        hits.append((at, draw.between(0.4, 2.5), draw.between(3, 40)))
    body = draw.rng.choice(["edge", "torso", "forearm"])
    pads = build_body(str(body), draw.skin.env.constants)
    return Happening(site, (press_thing(draw, site, pads, build_hits(hits), 0.01),))


def vibration(draw: EventDraw) -> Happening:
    """A thing that lies on the skin vibrates, seen at 0.5 to 5 Hz by the scans."""
    site, rate = draw.site("poke"), draw.between(0.5, 5.0)
    times = np.arange(0.0, draw.between(0.8, 4.0), STEP)
    load, swing = draw.between(0.5, 15), draw.rng.uniform(0.3, 2.0)
    wave = np.sin(2 * np.pi * (rate * times + draw.rng.random()))
    force = np.append(np.maximum(load * (1 + swing * wave), 0.0), 0.0)
    return Happening(site, (press_thing(draw, site, draw_object(draw), force, 0.0),))


def build_cable(draw: EventDraw) -> ContactPads:
    """Build a cable, or a dress pack of some."""
    if draw.rng.random() < 0.5:
        return build_body("cable", draw.skin.env.constants)
    return build_pad(draw.between(8, 30), 120, draw.between(150, 900), 3000)


def swing(draw: EventDraw) -> Happening:
    """A dress pack goes on swinging against the skin after the arm was paused."""
    site = draw.site("poke")
    period = 2 * np.pi * np.sqrt(draw.between(0.05, 0.6) / GRAVITY)
    # It hits once or twice in a period, as it hangs on one side or between two.
    apart = period / draw.count(1, 2)
    peak, left = draw.between(3, 25), draw.rng.uniform(0.75, 0.97)
    count = max(int(draw.between(3.0, 9.0) / apart), 3)
    contact = draw.between(0.04, 0.3)
    hits = [
        (
            0.02 + apart * i * draw.rng.uniform(0.97, 1.03),
            min(contact, 0.8 * apart),
            peak * left**i,
        )
        for i in range(count)
    ]
    return Happening(
        site, (press_thing(draw, site, build_cable(draw), build_hits(hits), 0.015),)
    )


def hit(
    count: tuple[int, int],
    laws: tuple[Law, Law, Law],
    build: Callable[[EventDraw], ContactPads],
    shift: float,
) -> World:
    """Return the world in which a thing hits several times, each time nearby.

    Args:
        count: least and largest number of contacts.
        laws: ranges of interval [s], duration [s] and largest force [N].
        build: draws the thing.
        shift: how far from the site it lands [m].
    """

    def world(draw: EventDraw) -> Happening:
        site, pads = draw.site("poke"), build(draw)
        force = build_hits(repeat(draw, draw.count(*count), *laws))
        return Happening(site, (press_thing(draw, site, pads, force, shift),))

    return world


def flow(count: tuple[int, int], laws: tuple[Law, Law, Law], shift: float) -> World:
    """Return the world of jets or splashes, whose laws give a pressure [kPa]."""

    def world(draw: EventDraw) -> Happening:
        site, area = draw.site("stroke"), draw.between(60, 1500)
        force = build_hits(repeat(draw, draw.count(*count), *laws))
        pads = build_pad(1e3, 1e3, area, area)
        newtons = force * area * MM**2 * 1e3
        return Happening(site, (press_thing(draw, site, pads, newtons, shift),))

    return world


def pulse(count: tuple[int, int], laws: tuple[Law, Law, Law], along_row: bool) -> World:
    """Return the world of disturbed counts, whose laws give a size in contacts."""

    def world(draw: EventDraw) -> Happening:
        hits = repeat(draw, draw.count(*count), *laws)
        noise = float(draw.rng.choice([0.0, 0.2, 0.6]))
        reach = draw.between(0.012, 0.06)
        return Happening(
            draw.site("poke"), pulses=Pulses(hits, reach, along_row, noise)
        )

    return world


def either(first: World, second: World) -> World:
    """Return the world of one of two, with equal chances."""
    return lambda draw: (first if draw.rng.random() < 0.5 else second)(draw)


def build_ribbon(draw: EventDraw) -> ContactPads:
    """Build a pinched ribbon."""
    return build_pad(2, draw.between(15, 60), draw.between(30, 200), 600)


def build_flap(draw: EventDraw) -> ContactPads:
    """Build tape or a sleeve."""
    area = draw.between(100, 2500)
    return build_pad(draw.between(5, 60), draw.between(20, 150), area, 2 * area)


def build_tool(draw: EventDraw) -> ContactPads:
    """Build the tip or the shaft of a screwdriver."""
    tip = draw.rng.random() < 0.5
    return build_pad(3, 3, 15, 60) if tip else build_pad(4, 80, 60, 500)


def build_forearm(draw: EventDraw) -> ContactPads:
    """Build a forearm."""
    return build_body("forearm", draw.skin.env.constants)


def gripper(draw: EventDraw) -> Happening:
    """The two fingers of a gripper close on a link, once or twice, or hold it."""
    site = draw.site("grab")
    hits = repeat(draw, draw.count(1, 2), (0.4, 2.5), (0.2, 2.2), (5, 80))
    half = np.pi * site.radius if np.isfinite(site.radius) else 0.04
    area = draw.between(150, 800)
    pads = build_pad(draw.between(20, 200), draw.between(20, 200), area, 1.3 * area)
    presses = []
    for side in (0.0, half):
        place = (site.centre[0] + side, site.centre[1])
        there = replace(site, centre=place)
        presses.append(press_thing(draw, there, pads, build_hold(hits), 0.0, angle=0.0))
    return Happening(site, tuple(presses))


def build_hold(hits: Hits) -> Series:
    """Build forces that rise, hold and fall."""
    end = max(start + duration for start, duration, _ in hits)
    force = np.zeros(round(end / STEP) + 4)
    for start, duration, peak in hits:
        steps = max(round(duration / STEP), 3)
        first = round(start / STEP)
        part = force[first : first + steps]
        part[:] = scale_to_peak(build_trapezoid(steps, 0.15, 0.15, 2), peak)[
            : len(part)
        ]
    return force


def strap(draw: EventDraw) -> Happening:
    """A strap or a loop of hose is pulled tight round a link."""
    site = draw.site("grab")
    radius = site.radius if np.isfinite(site.radius) else 0.04
    count, width = draw.count(6, 14), draw.between(8, 40)
    covered = draw.rng.uniform(0.4, 0.95) * 2 * np.pi * radius
    x = (np.arange(count) / (count - 1) - 0.5) * covered
    one = covered / count / MM * width * draw.rng.uniform(0.3, 1.0)
    pads = ContactPads(
        np.column_stack([x, np.zeros(count)]),
        np.full((count, 2), 60.0) * MM,
        np.zeros(count),
        np.full(count, 0.4 * one) * MM**2,
        np.full(count, one) * MM**2,
        np.ones(count),
    )
    force = build_hold(repeat(draw, draw.count(1, 2), (0.5, 3), (0.3, 2.5), (5, 80)))
    tissue = replace(THING, conformity=1.0)
    return Happening(
        site, (press_thing(draw, site, pads, force, tissue=tissue, angle=0.0),)
    )


def make(
    gesture: str, kind: str | None = None, **requested: tuple[float, float]
) -> World:
    """Return the world in which a person does what `perform` draws."""

    def world(draw: EventDraw) -> Happening:
        site, constants = draw.site(gesture, kind), draw.skin.env.constants
        fixed = {name: draw.between(*law) for name, law in requested.items()}
        touch = perform(
            gesture, kind, draw.person, site, constants, draw.rng, 1.5, None, fixed
        )
        return Happening(site, tuple(p for p in touch.presses if isinstance(p, Press)))

    return world


def others(draw: EventDraw) -> Happening:
    """Another person's hand or body rests, leans, pats once, presses or guides."""
    return make("none", str(draw.rng.choice(UNMEANT)))(draw)


def wipe(draw: EventDraw) -> Happening:
    """A hand with a cloth wipes to and fro, or one way again and again."""
    site = draw.site("stroke")
    sample = draw.sample("flat_hand", site)
    group = str(draw.rng.choice(["flat_hand", "fingers", "finger_ends", "full_hand"]))
    passes, one = draw.count(2, 8), draw.between(0.25, 1.0)
    steps = round(one / STEP)
    low, high = site.free_run
    reach = min(draw.between(0.02, 0.1), max(high - low, 0.03) / 2)
    swing_of = reach * np.sin(np.linspace(-np.pi / 2, np.pi / 2, steps))
    lifted = draw.rng.random() < 0.5
    gap = round(draw.between(0.1, 0.5) / STEP) if lifted else 0
    stroke = build_trapezoid(steps, 0.1, 0.1, 2) if lifted else np.ones(steps)
    sign = 1.0 if lifted else -1.0
    path = [
        np.append(sign**i * swing_of, np.full(gap, sign**i * reach))
        for i in range(passes)
    ]
    force = np.tile(np.append(stroke, np.zeros(gap)), passes)
    force[[0, -1]] = 0.0
    force *= draw.between(2, 25) * sample.draw_held_noise(len(force))
    turn = draw.rng.choice([0.0, np.pi / 2])
    along = np.concatenate(path)[:, None] * [np.sin(turn), np.cos(turn)]
    return Happening(site, (sample.build_press(sample.draw_pads(group), force, along),))


def dab(draw: EventDraw) -> Happening:
    """A hand with a cloth dabs two to six times."""
    site = draw.site("double_pat")
    sample = draw.sample("tips", site)
    group = str(draw.rng.choice(["tips", "two_tips", "finger_ends", "fingers"]))
    hits = repeat(draw, draw.count(2, 6), (0.25, 1.2), (0.08, 0.5), (1, 12))
    force = build_hits(hits)
    path = np.cumsum(draw.rng.normal(0, 0.015, (len(hits), 2)), axis=0)
    landed = np.cumsum((force > 0) & (np.append(0.0, force[:-1]) == 0))
    along = path[np.clip(landed - 1, 0, len(path) - 1)]
    wide = replace(sample.draw_tissue(), area_scale=1.4 * draw.person.tissue.area_scale)
    pads = sample.draw_pads(group)
    return Happening(site, (sample.build_press(pads, force, along, wide),))


def hold_pat(draw: EventDraw, first_pat: bool) -> Happening:
    """A hand pats and stays, perhaps after a pat before."""
    site = draw.site("double_pat")
    sample = draw.sample("tips", site)
    style = sample.choose("double_pat.kinds")
    force = draw_force(sample, "double_pat.force", "double_pat")
    steps = sample.count_steps(draw.between(0.9, 2.0))
    press = draw_single_push(sample, style, force, steps)
    if not first_pat:
        return Happening(site, (press,))
    contact = draw_duration(sample, "pat", "double_pat")
    gap = max(draw.person.pat_interval - contact, 0.1)
    pat = force * sample.draw_push(sample.count_steps(contact))
    lead = np.append(pat, np.zeros(round(gap / STEP)))
    centre = np.concatenate([np.tile(press.centre[0], (len(lead), 1)), press.centre])
    angle = np.full(len(centre), press.angle[0])
    both = np.append(lead, press.force)
    return Happening(site, (replace(press, force=both, centre=centre, angle=angle),))


THINGS: dict[str, World] = {
    "single contact": single,
    "bounce": bounce,
    "cart or box, 2 to 3 hits": bump,
    "rebound": hit((2, 2), ((0.1, 0.5), (0.02, 0.15), (5, 60)), build_forearm, 0.01),
    "vibration at 0.5 to 5 Hz": vibration,
    "cable, 2 to 5 hits": hit(
        (2, 5), ((0.15, 1.0), (0.03, 0.3), (1, 25)), build_cable, 0.015
    ),
    "ribbon's pulses": either(
        hit((2, 6), ((0.15, 1.0), (0.04, 0.4), (1, 15)), build_ribbon, 0.0),
        pulse((2, 6), ((0.15, 1.0), (0.04, 0.4), (2, 40)), True),
    ),
    "flapping": hit((2, 10), ((0.12, 0.7), (0.03, 0.3), (0.3, 6)), build_flap, 0.015),
    "local bursts": pulse((1, 5), ((0.12, 1.0), (0.04, 0.5), (1.5, 60)), False),
    "compressed air": flow((1, 5), ((0.2, 1.2), (0.08, 0.9), (1, 25)), 0.02),
    "water": flow((2, 8), ((0.08, 0.9), (0.02, 0.4), (0.5, 12)), 0.025),
    "screwdriver": hit((1, 4), ((0.15, 1.2), (0.03, 1.2), (1, 40)), build_tool, 0.006),
    "gripper's fingers": gripper,
    "strap pulled tight": strap,
    "swings on after a pause": swing,
}
"""Worlds of inanimate events."""
PEOPLE: dict[str, World] = {
    "wiping": wipe,
    "dabbing": dab,
    "other people": others,
    "tap_many": make("tap_many"),
    "rub": make("rub"),
    "squeeze": make("squeeze"),
}
"""Worlds of people who mean nothing."""
GESTURES: dict[str, World] = {
    "poke": make("poke"),
    "double_pat": make("double_pat"),
    "grab": make("grab"),
    "grab, held for 1 to 2.5 s": make("grab", duration=(1.0, 2.5)),
    "stroke": make("stroke"),
    "held pat": lambda draw: hold_pat(draw, False),
    "pat, then hold": lambda draw: hold_pat(draw, True),
}
"""Worlds of people who mean to command."""
WORLDS = THINGS | PEOPLE | GESTURES
