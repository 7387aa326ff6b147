"""This module draws what goes on for twelve seconds and more, and what mixes.

A stream is one event that comes again, or one contact that does. Its interval is steady
or wanders. In a mix, something wraps, clamps or holds the arm again and again while
something else hits or taps it.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lab.attacks.event_draws import (
    EventDraw,
    Happening,
    Law,
    World,
    build_hits,
    combine,
    press_thing,
    vary,
)
from lab.attacks.event_people import HOLDING, MOVING, make, perform_at
from lab.attacks.event_things import (
    REPETITIVE,
    SWINGING,
    WRAPPING,
    draw_object,
    swing,
)

SECONDS = (12.0, 16.0)
"""Duration of a stream [s]."""
INTERVAL = (0.3, 3.0)
"""Interval of what comes again [s]."""
WANDERING = (0.05, 0.4)
"""Standard deviation of the logarithm of an interval that wanders."""
TOUCH_RATES = (0.1, 0.3, 1.0, 3.0)
"""Rates of touches at random [1/s]."""


def draw_starts(draw: EventDraw, seconds: float, wandering: float) -> list[float]:
    """Draw when something begins, at an interval of its own.

    Args:
        draw: gives the numbers.
        seconds: time after which it begins no more than once [s].
        wandering: standard deviation of the logarithm of each interval.
    """
    interval = draw.between(*INTERVAL)
    starts = [0.0]
    while starts[-1] < seconds:
        wander = float(np.exp(draw.rng.normal(0.0, wandering)))
        starts.append(starts[-1] + interval * wander)
    return starts


def draw_random_starts(draw: EventDraw, seconds: float, rate: float) -> list[float]:
    """Draw when something begins at random, at a mean rate [1/s]."""
    count = draw.rng.poisson(rate * seconds)
    return sorted(draw.rng.uniform(0.0, seconds, count).tolist())


def again(world: World, pause: Law = INTERVAL) -> World:
    """Return the world in which an event comes again after pauses.

    Args:
        world: draws the event; each time it varies a little.
        pause: law of the pause between two [s].
    """

    def stream(draw: EventDraw) -> Happening:
        event = world(draw)
        usual = draw.between(*pause)
        wandering = draw.between(*WANDERING) if draw.chance(0.5) else 0.0
        end = draw.between(*SECONDS)
        parts = [vary(draw, event, 0.008)]
        while parts[-1].seconds < end:
            wander = float(np.exp(draw.rng.normal(0.0, wandering)))
            start = parts[-1].seconds + usual * wander
            parts.append(vary(draw, event, 0.008).delay(start))
        return keep_sites(event, combine(*parts))

    return stream


def keep_sites(event: Happening, parts: Happening) -> Happening:
    """Return a happening that takes place where another one does."""
    return replace(parts, sites=event.sites)


def beat(strike: World, wandering: Law | None) -> World:
    """Return the world of one contact that comes again at an interval.

    Args:
        strike: draws the contact.
        wandering: law of how far the interval wanders; None keeps it steady.
    """

    def stream(draw: EventDraw) -> Happening:
        one = strike(draw)
        wanders = draw.between(*wandering) if wandering else 0.0
        starts = draw_starts(draw, draw.between(*SECONDS), wanders)
        return strike_at(draw, one, starts)

    return stream


def strike_at(draw: EventDraw, one: Happening, starts: list[float]) -> Happening:
    """Return one contact at several times, each time a little different.

    It begins again only once it is over.
    """
    parts = []
    free = 0.0
    for start in starts:
        if start >= free:
            parts.append(vary(draw, one, 0.008).delay(start))
            free = start + one.seconds
    return keep_sites(one, combine(*parts))


def hit_once(draw: EventDraw) -> Happening:
    """A thing hits once."""
    site = draw.site("poke")
    hits = [(0.0, draw.between(0.02, 0.3), draw.between(1.0, 40.0))]
    press = press_thing(draw, site, draw_object(draw), build_hits(hits))
    return Happening((site,), (press,))


def tap_once(draw: EventDraw) -> Happening:
    """A hand taps or pokes once."""
    if draw.chance(0.5):
        return make("poke")(draw)
    return make("none", "single_pat")(draw)


def choose(worlds: dict[str, World]) -> World:
    """Return the world of one of several, with equal chances."""
    return lambda draw: worlds[draw.choose(*worlds)](draw)


def mix(first: dict[str, World], strike: World) -> World:
    """Return the world in which something holds the arm while something hits it.

    It holds it again and again, after pauses of 1 to 6 s. What hits does so 0.1 to 3
    times a second, at random or at an interval that wanders, at the same place or at
    another one.
    """

    def world(draw: EventDraw) -> Happening:
        held = again(choose(first), (1.0, 6.0))(draw)
        one = strike(draw)
        if draw.chance(0.5):
            one = bring(one, held)
        rate = draw.between(0.1, 3.0)
        if draw.chance(0.5):
            starts = draw_random_starts(draw, held.seconds, rate)
        else:
            count = max(round(rate * held.seconds), 1)
            wander = np.exp(draw.rng.normal(0.0, draw.between(*WANDERING), count))
            phase = draw.rng.random()
            starts = ((np.cumsum(wander) - phase) / rate).tolist()
        hits = strike_at(draw, one, [one for one in starts if one > 0])
        return combine(held, hits)

    return world


def bring(event: Happening, other: Happening) -> Happening:
    """Return a happening that takes place where another one does."""
    site = other.sites[0]
    return Happening(
        (site,),
        tuple(
            replace(
                press,
                chart=site.chart,
                centre=press.centre + (np.array(site.centre) - event.sites[0].centre),
            )
            for press in event.presses
        ),
        tuple(replace(pulses, site=site) for pulses in event.pulses),
    )


def touch_at_random(rate: float) -> World:
    """Return the world in which people poke at random after a grab.

    Pokes begin anywhere once the grab has let go, at a mean rate [1/s], for as long as
    a question may be open. What comes at random does so no less for not having come
    before, so that those which come earlier, and keep the arm from asking, need not be
    simulated.
    """

    def world(draw: EventDraw) -> Happening:
        grab = make("grab")(draw)
        starts = draw_random_starts(draw, 4.0, rate)
        pokes = [
            perform_at(draw, draw.site("poke"), "poke").delay(grab.seconds + start)
            for start in starts
        ]
        return combine(grab, *pokes)

    return world


def repeat_all(worlds: dict[str, World]) -> dict[str, World]:
    """Return each of some worlds as one in which its event comes again."""
    return {f"{name}, again": again(world) for name, world in worlds.items()}


SWINGING_ON = f"{SWINGING}, 12 s"
STREAMS: dict[str, World] = {
    **repeat_all(REPETITIVE),
    SWINGING_ON: swing((12.5, 16.0)),
    **repeat_all(MOVING),
    "things hit, steady": beat(hit_once, None),
    "things hit, wandering": beat(hit_once, WANDERING),
    "hands tap, steady": beat(tap_once, None),
    "hands tap, wandering": beat(tap_once, WANDERING),
    "things that wrap or clamp, again": again(choose(WRAPPING)),
    "people who hold or press, again": again(choose(HOLDING)),
}
"""Worlds of what goes on for 12 s and more."""
Strikes = dict[str, Callable[[EventDraw], Happening]]
STRIKES: Strikes = {"things hit": hit_once, "hands tap": tap_once}
MIXES: dict[str, World] = {
    f"{held}, {struck}": mix(worlds, strike)
    for held, worlds in (("things wrap", WRAPPING), ("people hold", HOLDING))
    for struck, strike in STRIKES.items()
}
"""Worlds in which something holds the arm while something else hits it."""
RANDOM: dict[str, World] = {
    f"pokes at random, {rate:g} a second": touch_at_random(rate) for rate in TOUCH_RATES
}
"""Worlds in which pokes come at random after a grab."""
PAUSED_NOW = (SWINGING, SWINGING_ON)
"""Worlds in which the arm is paused only as the event begins."""
