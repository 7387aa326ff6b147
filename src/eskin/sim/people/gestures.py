"""This module draws the presses of the gestures of the vocabulary.

The four of Jiang et al. 2025 (Fig. 2) are poke, double pat, grab and stroke.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import Press, SoftTissue
from eskin.sim.people.gesture_sample import (
    GestureSample,
    Series,
    build_minimum_jerk,
    build_trapezoid,
    draw_duration,
    draw_force,
    scale_to_peak,
)
from eskin.sim.people.person import build_body


def draw_poke(sample: GestureSample) -> tuple[Press, ...]:
    """Draw one push of a finger, sometimes pressed again before it leaves.

    Some are firm: harder than the person usually pokes, and longer, where the durations
    of Jung et al. 2017 do not include them already.
    """
    is_firm = sample.draw_event("firm", sample.constants.value("poke.firm"))
    firmer = sample.draw("poke.firm_force") if is_firm else 1.0
    force = draw_force(sample, "poke.force", "poke", firmer=firmer)
    if is_firm and sample.regime == "paper":
        duration = sample.record("duration", sample.draw("poke.firm_duration"))
    else:
        duration = draw_duration(sample, "poke")
    steps = sample.count_steps(duration)
    shape = sample.draw_push(steps)
    if sample.draw_event(
        "again", sample.constants.value("poke.again") * sample.difficulty
    ):
        # As many steps as before, since durations are of whole pokes.
        both = press_again(sample, shape)
        places = np.linspace(0, len(both) - 1, steps)
        again = np.interp(places, np.arange(len(both)), both)
        shape = scale_to_peak(again, 1.0)
    series = scale_to_peak(shape * sample.draw_held_noise(steps), force)
    tissue = replace(sample.person.tissue, conformity=sample.draw("poke.conformity"))
    path = sample.draw_wander(steps)
    angle = sample.draw_angle()
    if sample.kind == "knuckle":
        pads = build_body("knuckle", sample.constants)
    else:
        pads = sample.draw_pads(sample.kind)
    return (sample.build_press(pads, series, path, tissue, angle),)


def press_again(sample: GestureSample, shape: Series) -> Float[np.ndarray, "longer"]:
    """Append a second push that begins before the first has left."""
    share = sample.draw("poke.again_share")
    dip = sample.draw("poke.again_dip")
    later = int(np.flatnonzero(shape >= dip)[-1]) + 1
    both = np.zeros(later + len(shape))
    both[: len(shape)] = shape
    start = int(np.flatnonzero(share * shape >= dip * share)[0])
    tail = share * shape[start:]
    both[later : later + len(tail)] = np.maximum(both[later : later + len(tail)], tail)
    return both[: later + len(tail)]


def draw_double_pat(sample: GestureSample) -> tuple[Press, ...]:
    """Draw two pats; sometimes more, which mean the same."""
    more = sample.draw_event("more", sample.constants.value("double_pat.more"))
    count = int(sample.choose("unknown.taps")) if more else 2
    return draw_pats(sample, count, sample.kind)


def draw_many_taps(sample: GestureSample) -> tuple[Press, ...]:
    """Draw three pats or more."""
    count = int(sample.choose("unknown.taps"))
    return draw_pats(sample, count, sample.choose("double_pat.kinds"))


def draw_pats(sample: GestureSample, count: int, group: str) -> tuple[Press, ...]:
    """Draw several pats by pads of a hand, which differ in place and force."""
    force = draw_force(sample, "double_pat.force", "double_pat")
    interval = draw_pat_interval(sample)
    contact = draw_duration(sample, "pat", "double_pat")
    contact = sample.record(
        "contact", min(contact, sample.constants.value("double_pat.filled") * interval)
    )
    firm = [force]
    for number in range(1, count):
        share = sample.draw("double_pat.second")
        firm.append(sample.record(f"force.{number}", force * share))
    length = sample.count_steps(contact)
    apart = max(round(interval / sample.step), 1)
    apart = max(apart, length)
    series = np.zeros((count - 1) * apart + length)
    path = sample.draw_wander(len(series))
    noise = sample.draw_held_noise(len(series))
    for number, each in enumerate(firm):
        start = number * apart
        pat = scale_to_peak(
            sample.draw_push(length) * noise[start : start + length], each
        )
        series[start : start + length] = pat
        if number:
            shift_hand(sample, path, start - apart + length, start)
    keep_contact(sample, series, min(firm), length // 2, len(series) - length // 2)
    tissue = sample.draw_tissue()
    angle = sample.draw_angle()
    return (sample.build_press(sample.draw_pads(group), series, path, tissue, angle),)


def draw_pat_interval(sample: GestureSample) -> float:
    """Draw the time between the onsets of two pats [s]."""
    growth = sample.constants.value("duration.repeat_growth") * sample.difficulty
    usual = sample.person.pat_interval * sample.draw("double_pat.interval", 1 + growth)
    if sample.regime == "cost":
        usual *= sample.constants.value("double_pat.slower")
    low, high = sample.constants.array("double_pat.interval_limits")
    return sample.record("interval", float(np.clip(usual, low, high)))


def shift_hand(sample: GestureSample, path: np.ndarray, leave: int, land: int) -> None:
    """Write the hand's path between two pats, and where it then stays."""
    length = sample.draw("double_pat.shift")
    direction = sample.record("shift", sample.rng.uniform(0, 2 * np.pi))
    shift = length * np.array([np.cos(direction), np.sin(direction)])
    path[leave:land] += shift * build_minimum_jerk(max(land - leave, 1))[:, None]
    path[land:] += shift


def keep_contact(
    sample: GestureSample, series: np.ndarray, weakest: float, first: int, last: int
) -> None:
    """Draw whether the hand stays in light contact between the outer peaks."""
    chance = sample.constants.value("double_pat.stays") * sample.difficulty
    if sample.draw_event("stays", chance):
        residue = (
            sample.constants.value("double_pat.residue") * sample.person.force_scale
        )
        residue = sample.record("residue", min(residue, weakest / 2))
        series[first:last] = np.maximum(series[first:last], residue)


def draw_grab(sample: GestureSample) -> tuple[Press, ...]:
    """Draw one grab."""
    return (draw_hold(sample, draw_duration(sample, "grab"), sample.kind),)


def draw_hold(
    sample: GestureSample, duration: float, group: str, firmer: float = 1.0
) -> Press:
    """Draw a hand round a tube for some time [s], `firmer` than in a grab."""
    max_grip = compute_max_grip(sample) / firmer
    force = firmer * draw_force(sample, "grab.force", "grab", max_grip)
    steps = sample.count_steps(duration)
    smooth = round(sample.constants.value("force.smooth") / sample.step / 2)
    rise = sample.draw("grab.rise")
    fall = sample.draw("grab.fall")
    series = scale_to_peak(
        build_trapezoid(steps, rise, fall, smooth) * sample.draw_held_noise(steps),
        force,
    )
    path = sample.draw_wander(steps)
    twist = sample.draw("grab.twist") * build_minimum_jerk(steps)
    series = np.minimum(series, max_grip * firmer)
    pads = sample.person.select_pads(group, sample.draw("grab.splay"))
    tissue = draw_closed_tissue(sample)
    angle = draw_angle_across(sample) + twist
    return sample.build_press(pads, series, path, tissue, angle)


def draw_closed_tissue(sample: GestureSample) -> SoftTissue:
    """Draw the tissue of a hand that wraps round what it holds."""
    return replace(sample.person.tissue, conformity=sample.draw("grab.conformity"))


def draw_angle_across(sample: GestureSample) -> float:
    """Draw the angle of a hand across the tube, turned as suits the person [rad]."""
    side = 1.0 if np.sin(sample.site.angle) >= 0 else -1.0
    return sample.record("angle", side * np.pi / 2 + sample.draw("grab.slant"))


def compute_max_grip(sample: GestureSample) -> float:
    """Return the person's largest grip on the site's tube [N]."""
    value = sample.constants.value
    if np.isinf(sample.site.radius):
        share = value("grab.weakest")
    else:
        wider = 2 * sample.site.radius - value("grab.reference")
        share = 1 - value("grab.weaker") * wider
        share = np.clip(share, value("grab.weakest"), value("grab.strongest"))
    return sample.record("largest", sample.person.grip * share)


WHOLE_HAND_GROUPS = ("flat_hand", "full_hand")
"""Pad groups that stroke as firmly as a hand rests."""


def draw_stroke(sample: GestureSample) -> tuple[Press, ...]:
    """Draw one stroke, or one there and back, of a hand or of two side by side."""
    whole = sample.kind in WHOLE_HAND_GROUPS
    law = "stroke.hand_force" if whole else "stroke.force"
    force = draw_force(sample, law, "stroke")
    duration = draw_duration(sample, "stroke")
    steps = sample.count_steps(duration)
    direction = draw_stroke_direction(sample)
    back = sample.draw_event("return", sample.constants.value("stroke.return"))
    legs = 2 if back else 1
    speed = sample.draw("stroke.speed")
    start, length = fit_stroke(sample, direction, speed * duration / legs)
    sample.record("speed", legs * length / duration)
    travel = build_minimum_jerk((steps + 1) // 2 if back else steps)
    if back:
        returned = build_minimum_jerk(steps - len(travel) + 1)[::-1]
        travel = np.concatenate([travel, returned[1:]])
    along = start + length * travel
    path = along[:, None] * direction
    series = scale_to_peak(draw_sliding_force(sample, steps), force)
    # Side by side on a tube two hands need no more room along it than one.
    alone = not whole or direction[0] != 0.0
    both = 0.0 if alone else sample.constants.value("stroke.both")
    if not sample.draw_event("both", both):
        return (build_stroke(sample, path, series),)
    gap = sample.draw("stroke.both_gap")
    share = sample.draw("stroke.both_share")
    aside = gap / 2 * np.array([direction[1], -direction[0]])
    return (
        build_stroke(sample, path - aside, share * series),
        build_stroke(sample, path + aside, (1 - share) * series),
    )


def build_stroke(
    sample: GestureSample, path: Float[np.ndarray, "time 2"], series: Series
) -> Press:
    """Build the press of a hand that strokes along a path with some force [N]."""
    path = path + sample.draw_wander(len(series))
    return sample.build_press(sample.draw_pads(sample.kind), series, path)


def draw_stroke_direction(sample: GestureSample) -> Float[np.ndarray, "2"]:
    """Draw the unit direction (s, t) of the stroke."""
    path = sample.choose("stroke.path")
    if path == "along":
        slant = 0.0
    else:
        slant = np.pi / 2 if path == "around" else sample.draw("stroke.oblique")
    signs = sample.rng.choice([-1.0, 1.0], 2)
    direction = signs * np.array([np.sin(slant), np.cos(slant)])
    sample.record("direction", float(np.arctan2(-direction[0], direction[1])))
    return direction


def fit_stroke(
    sample: GestureSample, direction: Float[np.ndarray, "2"], wanted: float
) -> tuple[float, float]:
    """Draw where along its direction a stroke begins, and its length [m].

    It fits into the room there is and passes the site's centre.
    """
    low, high = draw_slide_limits(sample, direction)
    shortest = sample.constants.value("stroke.shortest")
    length = min(wanted, max(high - low, shortest))
    first, last = max(low, -length), min(0.0, high - length)
    if first > last:
        first = last = (low + high - length) / 2
    start = float(sample.rng.uniform(first, last))
    sample.record("start", start)
    return start, sample.record("length", length)


def draw_slide_limits(
    sample: GestureSample, direction: Float[np.ndarray, "2"]
) -> tuple[float, float]:
    """Draw how far a hand may slide back and forth along a direction [m].

    A whole hand, which reaches back onto the skin, may go beyond its ends.
    """
    low, high = sample.site.free_run
    whole = sample.kind in WHOLE_HAND_GROUPS
    chance = sample.constants.value("stroke.beyond") if whole else 0.0
    if sample.draw_event("beyond", chance):
        low -= min(sample.draw("stroke.beyond_by"), sample.site.beyond[0])
        high += min(sample.draw("stroke.beyond_by"), sample.site.beyond[1])
    arc = sample.constants.value("stroke.arc") * 2 * np.pi * sample.site.radius / 2
    limits = [(-np.inf, np.inf)]
    if abs(direction[0]) > 1e-9:
        arc = min(arc, high - low) if np.isinf(arc) else arc
        limits.append((-arc / abs(direction[0]), arc / abs(direction[0])))
    if abs(direction[1]) > 1e-9:
        both = sorted((low / direction[1], high / direction[1]))
        limits.append((both[0], both[1]))
    return max(each[0] for each in limits), min(each[1] for each in limits)


def draw_sliding_force(sample: GestureSample, steps: int) -> Series:
    """Draw the force of a sliding hand, around 1: it ripples, and lifts off slowly."""
    smooth = round(sample.constants.value("force.smooth") / sample.step / 2)
    shape = build_trapezoid(
        steps, sample.draw("stroke.rise"), sample.draw("stroke.fall"), smooth
    )
    return shape * sample.draw_ripple(steps) * sample.draw_held_noise(steps)
