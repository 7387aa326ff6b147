"""This module draws the presses of the gestures of the vocabulary."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import ContactPads, Press, SoftTissue
from eskin.sim.people.gesture_sample import (
    GestureSample,
    Series,
    build_minimum_jerk,
    build_trapezoid,
    draw_duration,
    draw_force,
    scale_to_peak,
)
from eskin.sim.people.hand import build_body


def draw_poke(act: GestureSample) -> tuple[Press, ...]:
    """One push, sometimes pressed again before it leaves."""
    force = draw_force(act, "poke.force", "poke")
    duration = draw_duration(act, "poke")
    steps = act.count_steps(duration)
    shape = act.draw_push(steps)
    if act.draw_event("again", act.constants.value("poke.again") * act.difficulty):
        shape = resample_series(press_again(act, shape), steps)
    series = scale_to_peak(shape * act.draw_held_noise(steps), force)
    flesh = replace(act.person.tissue, conformity=act.draw("poke.conformity"))
    path, angle = act.draw_wander(steps), act.draw_angle()
    return (act.build_press(draw_poking_pads(act), flesh, series, path, angle),)


def draw_poking_pads(act: GestureSample) -> ContactPads:
    """What pokes."""
    if act.kind == "knuckle":
        return build_body("knuckle", act.constants)
    return act.draw_pads(act.kind)


def press_again(act: GestureSample, shape: Series) -> Float[np.ndarray, "longer"]:
    """The push, and another one that begins before it has left."""
    share, dip = act.draw("poke.again_share"), act.draw("poke.again_dip")
    later = int(np.flatnonzero(shape >= dip)[-1]) + 1
    both = np.zeros(later + len(shape))
    both[: len(shape)] = shape
    start = int(np.flatnonzero(share * shape >= dip * share)[0])
    tail = share * shape[start:]
    both[later : later + len(tail)] = np.maximum(both[later : later + len(tail)], tail)
    return both[: later + len(tail)]


def resample_series(shape: Float[np.ndarray, "longer"], steps: int) -> Series:
    """The same shape in so many steps: the law of durations is that of whole pokes."""
    places = np.linspace(0, len(shape) - 1, steps)
    return scale_to_peak(np.interp(places, np.arange(len(shape)), shape), 1.0)


def draw_double_pat(act: GestureSample) -> tuple[Press, ...]:
    """Two pats; sometimes more, which mean the same."""
    more = act.draw_event("more", act.constants.value("double_pat.more"))
    return draw_pats(act, draw_pat_count(act) if more else 2, act.kind)


def draw_many_taps(act: GestureSample) -> tuple[Press, ...]:
    """Three pats or more."""
    return draw_pats(act, draw_pat_count(act), act.choose("double_pat.kinds"))


def draw_pat_count(act: GestureSample) -> int:
    """How many pats, three or more."""
    return int(act.choose("unknown.taps"))


def draw_pats(act: GestureSample, count: int, group: str) -> tuple[Press, ...]:
    """Several pats by parts of a hand, each elsewhere and as firm as it happens."""
    force = draw_force(act, "double_pat.force", "double_pat")
    interval = draw_pat_interval(act)
    contact = draw_duration(act, "pat", "double_pat")
    contact = act.record(
        "contact", min(contact, act.constants.value("double_pat.filled") * interval)
    )
    firm = [force]
    for number in range(1, count):
        share = act.draw("double_pat.second")
        firm.append(act.record(f"force.{number}", force * share))
    length, apart = act.count_steps(contact), max(round(interval / act.step), 1)
    apart = max(apart, length)
    series = np.zeros((count - 1) * apart + length)
    path, noise = act.draw_wander(len(series)), act.draw_held_noise(len(series))
    for number, each in enumerate(firm):
        start = number * apart
        pat = scale_to_peak(act.draw_push(length) * noise[start : start + length], each)
        series[start : start + length] = pat
        if number:
            shift_hand(act, path, start - apart + length, start)
    keep_contact(act, series, min(firm), length // 2, len(series) - length // 2)
    flesh, angle = act.draw_tissue(), act.draw_angle()
    return (act.build_press(act.draw_pads(group), flesh, series, path, angle),)


def draw_pat_interval(act: GestureSample) -> float:
    """Time between the onsets of two pats [s]."""
    growth = act.constants.value("duration.repeat_growth") * act.difficulty
    usual = act.person.pat_interval * act.draw("double_pat.interval", 1 + growth)
    if act.regime == "cost":
        usual *= act.constants.value("double_pat.slower")
    low, high = act.constants.array("double_pat.interval_limits")
    return act.record("interval", float(np.clip(usual, low, high)))


def shift_hand(act: GestureSample, path: np.ndarray, leave: int, land: int) -> None:
    """Write the hand's way between two pats, and where it then stays."""
    length, way = (
        act.draw("double_pat.shift"),
        act.record("shift", act.rng.uniform(0, 2 * np.pi)),
    )
    shift = length * np.array([np.cos(way), np.sin(way)])
    path[leave:land] += shift * build_minimum_jerk(max(land - leave, 1))[:, None]
    path[land:] += shift


def keep_contact(
    act: GestureSample, series: np.ndarray, weakest: float, first: int, last: int
) -> None:
    """Let the hand not quite leave between the first and the last peak, sometimes."""
    chance = act.constants.value("double_pat.stays") * act.difficulty
    if act.draw_event("stays", chance):
        residue = act.constants.value("double_pat.residue") * act.person.force_scale
        residue = act.record("residue", min(residue, weakest / 2))
        series[first:last] = np.maximum(series[first:last], residue)


def draw_grab(act: GestureSample) -> tuple[Press, ...]:
    """One grab."""
    return (draw_hold(act, draw_duration(act, "grab"), act.kind),)


def draw_hold(
    act: GestureSample, duration: float, group: str, firmer: float = 1.0
) -> Press:
    """Parts of a hand round a tube for some time [s], `firmer` than in a grab."""
    most = compute_max_grip(act) / firmer
    force = firmer * draw_force(act, "grab.force", "grab", most)
    steps = act.count_steps(duration)
    smooth = round(act.constants.value("force.smooth") / act.step / 2)
    rise, fall = act.draw("grab.rise"), act.draw("grab.fall")
    series = scale_to_peak(
        build_trapezoid(steps, rise, fall, smooth) * act.draw_held_noise(steps), force
    )
    path = act.draw_wander(steps)
    twist = act.draw("grab.twist") * build_minimum_jerk(steps)
    series = np.minimum(series, most * firmer)
    stamps = act.person.select_pads(group, act.draw("grab.splay"))
    return act.build_press(
        stamps, draw_closed_tissue(act), series, path, draw_angle_across(act) + twist
    )


def draw_closed_tissue(act: GestureSample) -> SoftTissue:
    """A hand that wraps round what it holds."""
    return replace(act.person.tissue, conformity=act.draw("grab.conformity"))


def draw_angle_across(act: GestureSample) -> float:
    """Angle of a hand across the tube, the way round that suits the person [rad]."""
    side = 1.0 if np.sin(act.site.angle) >= 0 else -1.0
    return act.record("angle", side * np.pi / 2 + act.draw("grab.slant"))


def compute_max_grip(act: GestureSample) -> float:
    """The person's largest grip on the site's tube [N]."""
    value = act.constants.value
    if np.isinf(act.site.radius):
        share = value("grab.weakest")
    else:
        wider = 2 * act.site.radius - value("grab.reference")
        share = 1 - value("grab.weaker") * wider
        share = np.clip(share, value("grab.weakest"), value("grab.strongest"))
    return act.record("largest", act.person.grip * share)


WHOLE_HAND_GROUPS = ("flat_hand", "full_hand")
"""Parts of a hand that stroke as firmly as a hand rests."""


def draw_stroke(act: GestureSample) -> tuple[Press, ...]:
    """One stroke, or there and back."""
    law = "stroke.hand_force" if act.kind in WHOLE_HAND_GROUPS else "stroke.force"
    force = draw_force(act, law, "stroke")
    duration = draw_duration(act, "stroke")
    steps = act.count_steps(duration)
    way = draw_stroke_direction(act)
    back = act.draw_event("return", act.constants.value("stroke.return"))
    legs = 2 if back else 1
    speed = act.draw("stroke.speed")
    start, length = fit_stroke(act, way, speed * duration / legs)
    act.record("speed", legs * length / duration)
    along = start + length * build_travel(steps, back)
    path = along[:, None] * way + act.draw_wander(steps)
    series = scale_to_peak(draw_sliding_force(act, steps), force)
    flesh, angle = act.draw_tissue(), act.draw_angle()
    return (act.build_press(act.draw_pads(act.kind), flesh, series, path, angle),)


def draw_stroke_direction(act: GestureSample) -> Float[np.ndarray, "2"]:
    """Unit direction (s, t) of the stroke."""
    path = act.choose("stroke.path")
    if path == "along":
        slant = 0.0
    else:
        slant = np.pi / 2 if path == "around" else act.draw("stroke.oblique")
    signs = act.rng.choice([-1.0, 1.0], 2)
    way = signs * np.array([np.sin(slant), np.cos(slant)])
    act.record("direction", float(np.arctan2(-way[0], way[1])))
    return way


def fit_stroke(
    act: GestureSample, way: Float[np.ndarray, "2"], wanted: float
) -> tuple[float, float]:
    """Where along its way a stroke begins, and its length, in the room there is [m].

    It passes the site's centre.
    """
    low, high = find_slide_limits(act, way)
    shortest = act.constants.value("stroke.shortest")
    length = min(wanted, max(high - low, shortest))
    first, last = max(low, -length), min(0.0, high - length)
    if first > last:
        first = last = (low + high - length) / 2
    start = float(act.rng.uniform(first, last))
    act.record("start", start)
    return start, act.record("length", length)


def find_slide_limits(
    act: GestureSample, way: Float[np.ndarray, "2"]
) -> tuple[float, float]:
    """How far one may slide back and forth along a way [m]."""
    low, high = act.site.free_run
    arc = act.constants.value("stroke.arc") * 2 * np.pi * act.site.radius / 2
    limits = [(-np.inf, np.inf)]
    if abs(way[0]) > 1e-9:
        arc = min(arc, high - low) if np.isinf(arc) else arc
        limits.append((-arc / abs(way[0]), arc / abs(way[0])))
    if abs(way[1]) > 1e-9:
        both = sorted((low / way[1], high / way[1]))
        limits.append((both[0], both[1]))
    return max(each[0] for each in limits), min(each[1] for each in limits)


def build_travel(steps: int, back: bool) -> Series:
    """Share of the way through time."""
    if not back:
        return build_minimum_jerk(steps)
    half = (steps + 1) // 2
    out = build_minimum_jerk(half)
    return np.concatenate([out, build_minimum_jerk(steps - half + 1)[::-1][1:]])


def draw_sliding_force(act: GestureSample, steps: int) -> Series:
    """Force of a sliding hand, around 1: it ripples, and lifts off slowly."""
    smooth = round(act.constants.value("force.smooth") / act.step / 2)
    shape = build_trapezoid(
        steps, act.draw("stroke.rise"), act.draw("stroke.fall"), smooth
    )
    return shape * act.draw_ripple(steps) * act.draw_held_noise(steps)
