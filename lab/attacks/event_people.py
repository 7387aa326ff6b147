"""This module draws what people do to a skin, with and without meaning a command."""

from dataclasses import replace

import numpy as np

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactPads, ContactSite, Press, SoftTissue
from eskin.sim.people.gesture_sample import (
    GestureSample,
    build_trapezoid,
    draw_duration,
    draw_force,
)
from eskin.sim.people.gestures import draw_angle_across, draw_closed_tissue
from eskin.sim.people.non_gestures import draw_single_push
from eskin.sim.people.perform import perform
from eskin.sim.people.person import Person, build_body
from lab.attacks.event_draws import (
    LEAD,
    STEP,
    EventDraw,
    Happening,
    Law,
    Series,
    World,
    build_hits,
    build_hold,
    build_pads,
    combine,
    get_radius,
    move,
    repeat,
)

UNMEANT = ("resting_hand", "lean", "single_pat", "press", "squeeze_hold") + (
    "guiding",
    "brush",
    "bump",
)
"""What other people do without meaning anything."""


def make(gesture: str, kind: str | None = None, **requested: Law) -> World:
    """Return the world in which a person does what `perform` draws."""
    return lambda draw: perform_at(
        draw, draw.site(gesture, kind), gesture, kind, requested
    )


def perform_at(
    draw: EventDraw,
    site: ContactSite,
    gesture: str,
    kind: str | None = None,
    requested: dict[str, Law] | None = None,
) -> Happening:
    """Return what `perform` draws at a site, with some values drawn from own laws."""
    constants = draw.skin.env.constants
    fixed = {name: draw.between(*law) for name, law in (requested or {}).items()}
    touch = perform(
        gesture, kind, draw.person, site, constants, draw.rng, 1.5, None, fixed
    )
    return Happening((site,), touch.bodies)


def others(draw: EventDraw) -> Happening:
    """Another person's hand or body rests, leans, pats once, presses or guides."""
    return make("none", draw.choose(*UNMEANT))(draw)


def wipe(draw: EventDraw) -> Happening:
    """A hand with a cloth wipes to and fro, or one way again and again."""
    site = draw.site("stroke")
    sample = draw.sample("flat_hand", site)
    group = draw.choose("flat_hand", "fingers", "finger_ends", "full_hand")
    passes = draw.count(2, 8)
    steps = round(draw.between(0.25, 1.0) / STEP)
    low, high = site.free_run
    reach = min(draw.between(0.02, 0.1), max(high - low, 0.03) / 2)
    swing_of = reach * np.sin(np.linspace(-np.pi / 2, np.pi / 2, steps))
    lifted = draw.chance(0.5)
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
    press = sample.build_press(sample.draw_pads(group), force, along)
    return Happening((site,), (press,))


def dab(draw: EventDraw) -> Happening:
    """A hand with a cloth dabs two to six times."""
    site = draw.site("double_pat")
    sample = draw.sample("tips", site)
    group = draw.choose("tips", "two_tips", "finger_ends", "fingers")
    hits = repeat(draw, draw.count(2, 6), (0.25, 1.2), (0.08, 0.5), (1, 12))
    force = build_hits(hits)
    path = np.cumsum(draw.rng.normal(0, 0.015, (len(hits), 2)), axis=0)
    landed = np.cumsum((force > 0) & (np.append(0.0, force[:-1]) == 0))
    along = path[np.clip(landed - 1, 0, len(path) - 1)]
    wide = replace(sample.draw_tissue(), area_scale=1.4 * draw.person.tissue.area_scale)
    press = sample.build_press(sample.draw_pads(group), force, along, wide)
    return Happening((site,), (press,))


def close_hand(
    draw: EventDraw,
    site: ContactSite,
    force: Series,
    group: str = "full_hand",
    person: Person | None = None,
) -> Press:
    """Close a hand round a link with a force."""
    sample = draw.sample(group, site)
    if person is not None:
        sample = replace(sample, person=person)
    pads = sample.person.select_pads(group, sample.draw("grab.splay"))
    noisy = force * sample.draw_held_noise(len(force))
    path = sample.draw_wander(len(force))
    tissue = draw_closed_tissue(sample)
    return sample.build_press(pads, noisy, path, tissue, draw_angle_across(sample))


def press_body(
    draw: EventDraw, site: ContactSite, pads: ContactPads, force: Series
) -> Press:
    """Press a part of a person's body against a link, with the sway of a person."""
    sample = draw.sample("lean", site)
    return sample.build_press(
        pads, force * sample.draw_leaning_noise(len(force)), tissue=soften(draw, sample)
    )


def soften(draw: EventDraw, sample: GestureSample) -> SoftTissue:
    """Return soft tissue under cloth, which follows a link in part."""
    return replace(sample.draw_tissue(), conformity=draw.rng.uniform(0.3, 0.9))


def grip(draw: EventDraw, seconds: Law, newtons: Law, rise: float = 0.15) -> Series:
    """Draw the force of one grip within laws of duration [s] and force [N]."""
    return build_hold([(LEAD, draw.between(*seconds), draw.between(*newtons))], rise)


def push_aside(draw: EventDraw) -> Happening:
    """A person pushes the arm aside, with a closed or an open hand or a forearm."""
    site = draw.site("grab")
    force = grip(draw, (0.3, 2.0), (12, 110), draw.rng.uniform(0.15, 0.45))
    if draw.chance(0.6):
        group = draw.choose("full_hand", "fingers_thumb", "clasp")
        press = close_hand(draw, site, force, group)
    elif draw.chance(0.6):
        sample = draw.sample("flat_hand", site)
        pads = sample.draw_pads(draw.choose("flat_hand", "full_hand", "heel"))
        press = sample.build_press(pads, force * sample.draw_held_noise(len(force)))
    else:
        body = build_body("forearm", draw.skin.env.constants)
        press = press_body(draw, site, body, force)
    away = draw.rng.normal(0.0, 0.01, 2) * np.linspace(0.0, 1.0, press.steps)[:, None]
    return Happening((site,), (replace(press, centre=press.centre + away),))


def hold_on(draw: EventDraw) -> Happening:
    """A person who stumbles holds on to the arm, with one hand or both."""
    site = draw.site("grab")
    force = grip(draw, (0.4, 4.0), (20, 180), draw.rng.uniform(0.03, 0.15))
    times = STEP * np.arange(len(force))
    sway = 1.0 + draw.rng.uniform(0.0, 0.6) * np.sin(
        2 * np.pi * (draw.between(0.4, 1.5) * times + draw.rng.random())
    )
    first = Happening((site,), (close_hand(draw, site, force * sway),))
    if draw.chance(0.7):
        return first
    beside = move(site, along=draw.rng.choice([-1.0, 1.0]) * draw.between(0.08, 0.2))
    second = Happening((beside,), (close_hand(draw, beside, 0.8 * force),))
    return combine(first, second.delay(draw.between(0.05, 0.6)))


def hook_elbow(draw: EventDraw) -> Happening:
    """A person hooks an elbow round the arm: the forearm and the upper arm hold it."""
    site = draw.site("grab")
    force = grip(draw, (0.5, 6.0), (10, 90), draw.rng.uniform(0.08, 0.3))
    width = draw.between(60, 100) * MM
    round_way = get_radius(site) * draw.rng.uniform(2.5, 4.5)
    x = np.linspace(-0.5, 0.5, 7) * round_way
    y = np.array([-0.25, 0.25]) * width
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    pads = build_pads(centres, (45, 60), 180, 900)
    sample = draw.sample("lean", site)
    tissue = replace(sample.draw_tissue(), conformity=draw.rng.uniform(0.85, 1.0))
    noisy = force * sample.draw_leaning_noise(len(force))
    press = sample.build_press(
        pads, noisy, tissue=tissue, angle=draw.rng.normal(0, 0.2)
    )
    return Happening((site,), (press,))


def lean(draw: EventDraw) -> Happening:
    """A person leans on the arm with a hip, a back or a forearm, perhaps a hand too."""
    site = draw.site("poke")
    force = grip(draw, (0.5, 7.0), (15, 220), draw.rng.uniform(0.08, 0.4))
    body = build_body(draw.choose("torso", "forearm"), draw.skin.env.constants)
    leaning = Happening((site,), (press_body(draw, site, body, force),))
    if draw.chance(0.7):
        return leaning
    beside = move(site, along=draw.rng.choice([-1.0, 1.0]) * draw.between(0.08, 0.2))
    hand = close_hand(draw, beside, grip(draw, (0.4, 4.0), (5, 40)))
    return combine(
        leaning, Happening((beside,), (hand,)).delay(draw.between(0.02, 0.6))
    )


def shrink(person: Person, scale: float) -> Person:
    """Return a child: a person whose hands are smaller by a scale, and weaker."""
    hand = person.hand
    pads = replace(
        hand,
        centres=scale * hand.centres,
        radii=scale * hand.radii,
        area=scale**2 * hand.area,
        max_area=scale**2 * hand.max_area,
    )
    return replace(person, hand=pads, grip=scale**3 * person.grip)


def child(draw: EventDraw) -> Happening:
    """A child closes both hands round the arm, once or a few times."""
    site = draw.site("grab")
    person = shrink(draw.person, draw.rng.uniform(0.55, 0.75))
    beside = move(site, along=draw.rng.choice([-1.0, 1.0]) * draw.between(0.05, 0.12))
    count = 1 if draw.chance(0.6) else draw.count(2, 3)
    hits = repeat(draw, count, (0.5, 2.5), (0.3, 2.5), (3, 35))
    hands = []
    for place in (site, beside):
        force = build_hold(hits) * draw.between(0.6, 1.6)
        hands.append(
            Happening((place,), (close_hand(draw, place, force, person=person),))
        )
    return combine(hands[0], hands[1].delay(draw.between(0.01, 0.4)))


def draw_place_beside(draw: EventDraw, site: ContactSite) -> ContactSite:
    """Draw where another hand grabs: beside a site, or anywhere."""
    if draw.chance(0.5):
        return draw.site("grab")
    return move(site, along=draw.rng.choice([-1.0, 1.0]) * draw.between(0.08, 0.3))


def rest_and_grab(draw: EventDraw) -> Happening:
    """One hand rests on the arm while another person grabs it."""
    site = draw.site("grab")
    resting = grip(draw, (2.5, 8.0), (3, 30), 0.1)
    if draw.chance(0.5):
        hand = Happening((site,), (close_hand(draw, site, resting),))
    else:
        sample = draw.sample("flat_hand", site)
        pads = sample.draw_pads(draw.choose("flat_hand", "full_hand", "fingers"))
        hand = Happening((site,), (sample.build_press(pads, resting),))
    place = draw_place_beside(draw, site)
    grab = perform_at(draw, place, "grab")
    return combine(hand, grab.delay(draw.rng.uniform(0.3, hand.seconds)))


def leave_and_let_go(draw: EventDraw) -> Happening:
    """Two people hold the arm; one leaves as the other lets go, or a little later."""
    site = draw.site("grab")
    first = Happening(
        (site,), (close_hand(draw, site, grip(draw, (0.6, 4.0), (5, 60))),)
    )
    place = draw_place_beside(draw, site)
    grab = perform_at(draw, place, "grab", requested={"duration": (0.4, 2.5)})
    # The later end differs from the earlier one by at most half a second.
    start = first.seconds - grab.seconds + draw.rng.uniform(-0.5, 0.5)
    if start < 0:
        first = first.delay(-start)
        start = 0.0
    return combine(first, grab.delay(start))


def hold_pat(draw: EventDraw, first_pat: bool) -> Happening:
    """A hand pats and stays, perhaps after a pat before."""
    site = draw.site("double_pat")
    sample = draw.sample("tips", site)
    style = sample.choose("double_pat.kinds")
    force = draw_force(sample, "double_pat.force", "double_pat")
    steps = sample.count_steps(draw.between(0.9, 2.0))
    press = draw_single_push(sample, style, force, steps)
    if not first_pat:
        return Happening((site,), (press,))
    contact = draw_duration(sample, "pat", "double_pat")
    gap = max(draw.person.pat_interval - contact, 0.1)
    pat = force * sample.draw_push(sample.count_steps(contact))
    lead = np.append(pat, np.zeros(round(gap / STEP)))
    centre = np.concatenate([np.tile(press.centre[0], (len(lead), 1)), press.centre])
    angle = np.full(len(centre), press.angle[0])
    both = np.append(lead, press.force)
    return Happening((site,), (replace(press, force=both, centre=centre, angle=angle),))


HOLDING: dict[str, World] = {
    "other people": others,
    "squeeze": make("squeeze"),
    "pushes it aside": push_aside,
    "holds on for balance": hold_on,
    "hooks an elbow": hook_elbow,
    "leans on it": lean,
    "a child's two hands": child,
    "one rests, another grabs": rest_and_grab,
    "one leaves as another lets go": leave_and_let_go,
}
"""Worlds of people who hold or press the arm and mean nothing."""
MOVING: dict[str, World] = {
    "wiping": wipe,
    "dabbing": dab,
    "tap_many": make("tap_many"),
    "rub": make("rub"),
}
"""Worlds of people whose hands move and mean nothing."""
PEOPLE = MOVING | HOLDING
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
