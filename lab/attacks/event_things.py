"""This module draws what things do to a skin: they hit, press, wrap, clamp and wet it.

A bounce flies for 2 v / g; a pendulum of length l swings in 2 pi sqrt(l / g); air and
water press with at most half their density times the square of their speed; what is
pulled tight round a link with a tension T presses with at most 2 T in each direction.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactPads, ContactSite, Press
from eskin.sim.people.person import build_body
from lab.attacks.event_draws import (
    LEAD,
    STEP,
    THING,
    WRAP,
    EventDraw,
    Happening,
    Hits,
    Law,
    Pulses,
    Series,
    Where,
    World,
    build_hits,
    build_hold,
    build_level,
    build_pad,
    build_pads,
    build_wrap,
    either,
    get_radius,
    move,
    press_thing,
    repeat,
)

GRAVITY = 9.81
Laws = tuple[Law, Law, Law]
"""Laws of the interval [s], the duration [s] and the largest force of contacts [N]."""


def press_once(
    draw: EventDraw, site: ContactSite, pads: ContactPads, force: Series, shift: float
) -> Happening:
    """Return a thing that presses at one site."""
    return Happening((site,), (press_thing(draw, site, pads, force, shift),))


def draw_object(draw: EventDraw) -> ContactPads:
    """Draw a thing that falls or hits: a tip, an edge, a ball, a flat side."""
    kind = draw.rng.integers(4)
    if kind == 0:
        return build_pad(draw.between(3, 10), draw.between(3, 10), 30, 160)
    if kind == 1:
        return build_pad(draw.between(2, 6), draw.between(20, 60), 40, 400)
    if kind == 2:
        radius = draw.between(15, 60)
        area = draw.between(80, 600)
        return build_pad(radius, radius, area, 5 * area)
    area = draw.between(300, 4000)
    return build_pad(draw.between(40, 100), draw.between(60, 200), area, 2 * area)


def single(draw: EventDraw) -> Happening:
    """One hit, press or scrape by a thing."""
    site = draw.site("poke")
    hits = [(LEAD, draw.between(0.01, 3.0), draw.between(0.5, 60))]
    return press_once(draw, site, draw_object(draw), build_hits(hits), 0.0)


def bounce(draw: EventDraw) -> Happening:
    """A thing drops, bounces, and in one of three cases stays there."""
    site = draw.site("poke")
    mass = draw.between(0.03, 1.0)
    k = 1e3 * draw.between(0.5, 50)
    speed = np.sqrt(2 * GRAVITY * draw.between(0.02, 0.6))
    left = draw.rng.uniform(0.3, 0.85)
    contact = np.pi * np.sqrt(mass / k)
    hits: Hits = []
    at = LEAD
    for _ in range(draw.count(2, 6)):
        hits.append((at, contact, min(speed * np.sqrt(mass * k), 200.0)))
        speed *= left
        at += max(2 * speed / GRAVITY, 0.02) + contact
    force = build_hits(hits)
    if draw.chance(1 / 3):
        lying = np.full(round(draw.between(0.5, 2.5) / STEP), mass * GRAVITY)
        force = np.concatenate([force[: round(at / STEP)], lying, np.zeros(2)])
    return press_once(draw, site, draw_object(draw), force, 0.012)


def bump(draw: EventDraw) -> Happening:
    """A cart or a box hits two or three times, and may stay."""
    site = draw.site("poke")
    mass = draw.between(3, 60)
    k = 1e3 * draw.between(3, 75)
    speed = draw.rng.uniform(0.03, 0.3)
    contact = np.pi * np.sqrt(mass / k)
    hits: Hits = []
    at = LEAD
    for _ in range(draw.count(2, 3)):
        hits.append((at, contact, min(speed * np.sqrt(mass * k), 250.0)))
        speed *= draw.rng.uniform(0.3, 0.8)
        at += contact + draw.between(0.12, 0.9)
    if draw.chance(0.25):
        hits.append((at, draw.between(0.4, 2.5), draw.between(3, 40)))
    body = draw.choose("edge", "torso", "forearm")
    pads = build_body(body, draw.skin.env.constants)
    return press_once(draw, site, pads, build_hits(hits), 0.01)


def vibration(draw: EventDraw) -> Happening:
    """A thing that lies on the skin vibrates, seen at 0.5 to 5 Hz by the scans."""
    site = draw.site("poke")
    rate = draw.between(0.5, 5.0)
    times = np.arange(0.0, draw.between(0.8, 4.0), STEP)
    load = draw.between(0.5, 15)
    swing = draw.rng.uniform(0.3, 2.0)
    wave = np.sin(2 * np.pi * (rate * times + draw.rng.random()))
    force = np.append(np.maximum(load * (1 + swing * wave), 0.0), 0.0)
    return press_once(draw, site, draw_object(draw), force, 0.0)


def build_cable(draw: EventDraw) -> ContactPads:
    """Build a cable, or a dress pack of some."""
    if draw.chance(0.5):
        return build_body("cable", draw.skin.env.constants)
    return build_pad(draw.between(8, 30), 120, draw.between(150, 900), 3000)


def swing(seconds: Law) -> World:
    """Return the world in which a dress pack swings against the skin for a time [s]."""

    def world(draw: EventDraw) -> Happening:
        site = draw.site("poke")
        period = 2 * np.pi * np.sqrt(draw.between(0.05, 0.6) / GRAVITY)
        # It hits once or twice in a period, as it hangs on one side or between two.
        apart = period / draw.count(1, 2)
        peak = draw.between(3, 25)
        left = draw.rng.uniform(0.75, 0.97)
        count = max(int(draw.between(*seconds) / apart) + 2, 3)
        contact = min(draw.between(0.04, 0.3), 0.8 * apart)
        hits = [
            (LEAD + apart * i * draw.rng.uniform(0.97, 1.03), contact, peak * left**i)
            for i in range(count)
        ]
        return press_once(draw, site, build_cable(draw), build_hits(hits), 0.015)

    return world


def hit(
    count: tuple[int, int],
    laws: Laws,
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
        site = draw.site("poke")
        pads = build(draw)
        force = build_hits(repeat(draw, draw.count(*count), *laws))
        return press_once(draw, site, pads, force, shift)

    return world


def flow(count: tuple[int, int], laws: Laws, shift: float) -> World:
    """Return the world of jets or splashes, whose laws give a pressure [kPa]."""

    def world(draw: EventDraw) -> Happening:
        site = draw.site("stroke")
        area = draw.between(60, 1500)
        force = build_hits(repeat(draw, draw.count(*count), *laws))
        pads = build_pad(1e3, 1e3, area, area)
        newtons = force * area * MM**2 * 1e3
        return press_once(draw, site, pads, newtons, shift)

    return world


def pulse(count: tuple[int, int], laws: Laws, where: Where) -> World:
    """Return the world of disturbed counts, whose laws give a size in contacts."""

    def world(draw: EventDraw) -> Happening:
        site = draw.site("poke")
        level = build_level(repeat(draw, draw.count(*count), *laws))
        noise = float(draw.rng.choice([0.0, 0.2, 0.6]))
        pulses = Pulses(site, level, draw.between(0.012, 0.06), where, noise)
        return Happening((site,), pulses=(pulses,))

    return world


def build_ribbon(draw: EventDraw) -> ContactPads:
    """Build a pinched ribbon."""
    return build_pad(2, draw.between(15, 60), draw.between(30, 200), 600)


def build_flap(draw: EventDraw) -> ContactPads:
    """Build tape or a sleeve."""
    area = draw.between(100, 2500)
    return build_pad(draw.between(5, 60), draw.between(20, 150), area, 2 * area)


def build_tool(draw: EventDraw) -> ContactPads:
    """Build the tip or the shaft of a screwdriver."""
    return build_pad(3, 3, 15, 60) if draw.chance(0.5) else build_pad(4, 80, 60, 500)


def build_forearm(draw: EventDraw) -> ContactPads:
    """Build a forearm."""
    return build_body("forearm", draw.skin.env.constants)


def clamp(
    draw: EventDraw, site: ContactSite, pads: ContactPads, force: Series
) -> Happening:
    """Press two jaws against a link, from opposite sides."""
    half = np.pi * get_radius(site)
    presses = [
        press_thing(draw, move(site, side), pads, force, angle=0.0)
        for side in (0.0, half)
    ]
    return Happening((site,), tuple(presses))


def gripper(draw: EventDraw) -> Happening:
    """The two fingers of a gripper close on a link, once or twice, or hold it."""
    site = draw.site("grab")
    hits = repeat(draw, draw.count(1, 2), (0.4, 2.5), (0.2, 2.2), (5, 80))
    area = draw.between(150, 800)
    pads = build_pad(draw.between(20, 200), draw.between(20, 200), area, 1.3 * area)
    return clamp(draw, site, pads, build_hold(hits))


def wide_gripper(draw: EventDraw) -> Happening:
    """The two soft jaws of a gripper close, each 50 to 130 mm wide along the link."""
    site = draw.site("grab")
    hits = repeat(draw, draw.count(1, 2), (0.5, 3.0), (0.3, 3.0), (5, 140))
    width = draw.between(50, 130)
    y = (np.arange(4) - 1.5) * width / 4 * MM
    around = draw.rng.uniform(0.2, 0.8) * get_radius(site)
    x = np.array([-0.5, 0.0, 0.5]) * around
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    area = width * around / MM / len(centres)
    pads = build_pads(centres, (60, 60), 0.4 * area, area)
    jaws = clamp(draw, site, pads, build_hold(hits, draw.rng.uniform(0.03, 0.2)))
    tissue = replace(THING, conformity=draw.rng.uniform(0.6, 1.0))
    return Happening(
        jaws.sites, tuple(replace(one, tissue=tissue) for one in jaws.presses)
    )


def door(draw: EventDraw) -> Happening:
    """A door closes on a link with 20 to 200 N, and may open and close again."""
    site = draw.site("grab")
    count = 1 if draw.chance(0.6) else draw.count(2, 3)
    hits = repeat(draw, count, (0.8, 4.0), (0.3, 3.5), (20, 200))
    across = draw.between(2, 25)
    area = draw.between(60, 900)
    pads = build_pad(across, draw.between(60, 300), area, 2.5 * area)
    return clamp(draw, site, pads, build_hold(hits, draw.between(0.02, 0.15)))


def wrap(
    draw: EventDraw,
    site: ContactSite,
    hits: Hits,
    share: float,
    width: float,
    rows: int = 1,
    rise: float = 0.15,
) -> Press:
    """Pull something tight that covers a share of the way round a link.

    `hits` are the times in which it is tight; `width` is along the link [mm].
    """
    pads = build_wrap(draw, site, share, width, rows)
    force = build_hold(hits, rise)
    slant = draw.rng.normal(0.0, 0.1)
    return press_thing(draw, site, pads, force, tissue=WRAP, angle=slant)


def strap(draw: EventDraw) -> Happening:
    """A strap or a loop of hose is pulled tight round a link."""
    site = draw.site("grab")
    hits = repeat(draw, draw.count(1, 2), (0.5, 3), (0.3, 2.5), (5, 80))
    share = draw.rng.uniform(0.4, 0.95)
    return Happening((site,), (wrap(draw, site, hits, share, draw.between(8, 40)),))


def straps(draw: EventDraw) -> Happening:
    """Two or three straps or hoses are tightened side by side, together or in turn."""
    site = draw.site("grab")
    count = draw.count(2, 3)
    width = draw.between(8, 35)
    apart = width + draw.between(3, 40)
    hits = repeat(draw, draw.count(1, 2), (0.6, 3.0), (0.4, 3.0), (8, 60))
    lag = 0.0 if draw.chance(0.4) else draw.between(0.03, 0.4)
    share = draw.rng.uniform(0.4, 0.95)
    presses = []
    for number in range(count):
        place = move(site, along=(number - (count - 1) / 2) * apart * MM)
        scale = draw.between(0.6, 1.6)
        own = [(at + number * lag, held, scale * peak) for at, held, peak in hits]
        presses.append(wrap(draw, place, own, share, width))
    return Happening((site,), tuple(presses))


def bundle(draw: EventDraw) -> Happening:
    """A bundle of cables, 50 to 90 mm wide, is pulled against a link or round it."""
    site = draw.site("grab")
    hits = repeat(draw, draw.count(1, 2), (0.5, 3.0), (0.3, 3.0), (5, 90))
    share = draw.rng.uniform(0.25, 0.8)
    width = draw.rng.uniform(50, 90)
    rows = draw.count(3, 7)
    return Happening((site,), (wrap(draw, site, hits, share, width, rows),))


def sleeve(draw: EventDraw) -> Happening:
    """A sleeve or a jacket that covers a link is pulled, in jerks, and slides."""
    site = draw.site("grab")
    hits = repeat(draw, draw.count(1, 4), (0.3, 1.5), (0.2, 2.0), (2, 45))
    share = draw.rng.uniform(0.4, 1.0)
    press = wrap(draw, site, hits, share, draw.between(60, 200), draw.count(2, 4), 0.3)
    reach = draw.between(0.002, 0.03)
    low, high = site.free_run
    slid = reach * np.sin(np.linspace(0.0, np.pi, press.steps))
    centre = press.centre.copy()
    centre[:, 1] += np.clip(draw.rng.choice([-1.0, 1.0]) * slid, low, high)
    return Happening((site,), (replace(press, centre=centre),))


def cuff(draw: EventDraw) -> Happening:
    """A cuff round a link is inflated to 1 to 30 kPa, and let off."""
    site = draw.site("grab")
    width = draw.between(50, 150)
    share = draw.rng.uniform(0.8, 1.0)
    area = share * 2 * np.pi * get_radius(site) * width * MM
    newtons = min(1e3 * draw.between(1, 30) * area, 400.0)
    held = draw.between(0.5, 5.0)
    hits = [(LEAD, held, newtons)]
    press = wrap(draw, site, hits, share, width, 3, draw.rng.uniform(0.1, 0.45))
    return Happening((site,), (press,))


def cushion(draw: EventDraw) -> Happening:
    """A soft ball or a cushion is pressed against a link, once or a few times."""
    site = draw.site("grab")
    count = 1 if draw.chance(0.6) else draw.count(2, 3)
    hits = repeat(draw, count, (0.5, 3.0), (0.25, 3.0), (3, 70))
    size = draw.between(40, 160)
    area = draw.between(800, 5000)
    x = np.array([-1.0, 0.0, 1.0]) * 0.3 * size * MM
    centres = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    pads = build_pads(centres, (size, size), area / 9, 4 * area / 9)
    tissue = replace(
        THING, b=0.05 / MM, m=0.2 / MM, conformity=draw.rng.uniform(0.5, 1.0)
    )
    force = build_hold(hits, draw.rng.uniform(0.1, 0.45))
    return Happening((site,), (press_thing(draw, site, pads, force, 0.01, tissue),))


def blanket(draw: EventDraw) -> Happening:
    """A blanket falls over a link, lies in folds, and is pulled off or left."""
    site = draw.site("grab")
    width = draw.between(100, 250)
    pads = build_wrap(draw, site, draw.rng.uniform(0.3, 0.6), width, draw.count(3, 5))
    folds = np.exp(draw.rng.normal(0.0, 0.8, pads.count))
    weight = draw.between(2, 25)
    hits = [(LEAD, draw.between(0.8, 5.0), weight)]
    force = build_hold(hits, draw.rng.uniform(0.02, 0.2))
    landing = round(draw.between(0.05, 0.2) / STEP)
    force[2 : 2 + landing] += draw.rng.uniform(0.0, 1.5) * weight
    if draw.chance(0.5):
        pulled = round(draw.between(0.1, 0.6) / STEP)
        force[-pulled - 2 : -2] *= draw.rng.uniform(1.0, 3.0)
    press = press_thing(
        draw, site, replace(pads, stiffness=folds), force, tissue=WRAP, angle=0.0
    )
    slid = np.linspace(0.0, draw.rng.uniform(-0.03, 0.03), press.steps)
    return Happening(
        (site,), (replace(press, centre=press.centre + slid[:, None] * [1.0, 0.3]),)
    )


def temperature(draw: EventDraw) -> Happening:
    """The temperature of a patch steps: its counts shift within a time, and stay."""
    site = draw.site("poke")
    rise = draw.between(0.1, 3.0)
    times = np.arange(0.0, draw.between(4.0, 10.0), STEP)
    size = draw.between(0.5, 12.0)
    level = size * (1.0 - np.exp(-times / rise))
    reach = np.inf if draw.chance(0.7) else draw.between(0.03, 0.12)
    pulses = Pulses(site, np.append(0.0, level), reach, "patch", 0.02)
    return Happening((site,), pulses=(pulses,))


def puddle(draw: EventDraw) -> Happening:
    """Water runs onto the skin, stands there, and drops fall into it."""
    site = draw.site("stroke")
    times = np.arange(0.0, draw.between(3.0, 9.0), STEP)
    spread = draw.between(0.05, 1.0)
    level = draw.between(0.4, 10.0) * (1.0 - np.exp(-times / spread))
    if draw.chance(0.5):
        level *= np.exp(-times / draw.between(1.0, 10.0))
    pulses = Pulses(site, level, draw.between(0.015, 0.08), "near", 0.05)
    drops = build_hits(
        repeat(draw, draw.count(1, 8), (0.15, 1.5), (0.02, 0.2), (0.5, 8))
    )
    area = draw.between(60, 800)
    pads = build_pad(1e3, 1e3, area, area)
    newtons = drops * area * MM**2 * 1e3
    return Happening(
        (site,), (press_thing(draw, site, pads, newtons, 0.03),), (pulses,)
    )


def robot_link(draw: EventDraw) -> Happening:
    """Another robot's link comes against this one, presses, slides and leaves."""
    site = draw.site("poke")
    count = 1 if draw.chance(0.6) else draw.count(2, 3)
    hits = repeat(draw, count, (0.8, 4.0), (0.15, 3.0), (8, 160))
    area = draw.between(80, 700)
    pads = build_pad(draw.between(25, 70), draw.between(60, 250), area, 3 * area)
    press = press_thing(
        draw, site, pads, build_hold(hits, draw.rng.uniform(0.05, 0.4)), 0.005
    )
    times = STEP * np.arange(press.steps)
    way = draw.rng.uniform(-np.pi, np.pi)
    slid = draw.between(0.001, 0.03) * times[:, None] * [np.sin(way), np.cos(way)]
    return Happening((site,), (replace(press, centre=press.centre + slid),))


def tray(draw: EventDraw) -> Happening:
    """A tray tips against a link, rocks, lies there, and slides off."""
    site = draw.site("poke")
    load = draw.between(2, 45)
    rock = draw.between(0.25, 1.0)
    left = draw.rng.uniform(0.3, 0.8)
    hits: Hits = []
    at = LEAD
    for number in range(draw.count(1, 4)):
        hits.append((at, draw.between(0.03, 0.2), 3 * load * left**number))
        at += rock * left**number + 0.05
    edge = build_pad(draw.between(1.5, 6), draw.between(60, 250), 40, 800)
    lying = build_hold([(at, draw.between(0.4, 4.0), load)], 0.05)
    rocked = build_hits(hits)
    force = lying
    force[: len(rocked)] = np.maximum(force[: len(rocked)], rocked[: len(force)])
    press = press_thing(draw, site, edge, force, 0.004)
    way = draw.rng.uniform(-np.pi, np.pi)
    slid = draw.between(0.001, 0.05) * np.linspace(0.0, 1.0, press.steps) ** 2
    centre = press.centre + slid[:, None] * [np.sin(way), np.cos(way)]
    return Happening((site,), (replace(press, centre=centre),))


SPLASH = flow((2, 8), ((0.08, 0.9), (0.02, 0.4), (0.5, 12)), 0.025)
REPETITIVE: dict[str, World] = {
    "bounce": bounce,
    "cart or box, 2 to 3 hits": bump,
    "rebound": hit((2, 2), ((0.1, 0.5), (0.02, 0.15), (5, 60)), build_forearm, 0.01),
    "vibration at 0.5 to 5 Hz": vibration,
    "cable, 2 to 5 hits": hit(
        (2, 5), ((0.15, 1.0), (0.03, 0.3), (1, 25)), build_cable, 0.015
    ),
    "ribbon's pulses": either(
        hit((2, 6), ((0.15, 1.0), (0.04, 0.4), (1, 15)), build_ribbon, 0.0),
        pulse((2, 6), ((0.15, 1.0), (0.04, 0.4), (2, 40)), "row"),
    ),
    "flapping": hit((2, 10), ((0.12, 0.7), (0.03, 0.3), (0.3, 6)), build_flap, 0.015),
    "local bursts": pulse((1, 5), ((0.12, 1.0), (0.04, 0.5), (1.5, 60)), "near"),
    "compressed air": flow((1, 5), ((0.2, 1.2), (0.08, 0.9), (1, 25)), 0.02),
    "water": SPLASH,
    "screwdriver": hit((1, 4), ((0.15, 1.2), (0.03, 1.2), (1, 40)), build_tool, 0.006),
}
"""Worlds of things that come again and again."""
SWINGING = "swings on after a pause"
"""World in which the arm is paused only as the event begins."""
WRAPPING: dict[str, World] = {
    "gripper's fingers": gripper,
    "strap pulled tight": strap,
    "two or three straps or hoses": straps,
    "cable bundle of 50 to 90 mm": bundle,
    "sleeve or jacket pulled": sleeve,
    "inflated cuff": cuff,
    "wide gripper": wide_gripper,
    "soft ball or cushion": cushion,
    "door, 20 to 200 N": door,
    "blanket": blanket,
}
"""Worlds of things that wrap or clamp a link."""
THINGS: dict[str, World] = {
    "single contact": single,
    **REPETITIVE,
    SWINGING: swing((3.0, 9.0)),
    **WRAPPING,
    "temperature step of a patch": temperature,
    "standing water": puddle,
    "another robot's link": robot_link,
    "tipping tray": tray,
}
"""Worlds of inanimate events."""
