"""This module draws the presses of contacts that are no gesture of the vocabulary."""

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import MM
from eskin.sim.contact.press import Press, SoftTissue
from eskin.sim.people.gesture_sample import (
    GestureSample,
    Series,
    build_bell,
    build_trapezoid,
    draw_duration,
    draw_force,
    draw_tremor,
    scale_to_peak,
)
from eskin.sim.people.gestures import (
    draw_angle_across,
    draw_closed_tissue,
    draw_hold,
    draw_pats,
    draw_sliding_force,
    draw_stroke_direction,
)
from eskin.sim.people.hand import build_body

FINGER_GROUPS = ("one_tip", "two_tips")
"""Parts of a hand whose brief push is a poke."""


def draw_resting_hand(act: GestureSample) -> tuple[Press, ...]:
    """A hand put down and left there."""
    force = draw_force(act, "none.resting_hand.force", "resting_hand")
    act.draw_event("began_before", act.constants.value("none.resting_hand.before"))
    steps = act.count_steps(act.draw("none.resting_hand.hold"))
    ramp = act.draw("none.resting_hand.ramp")
    stamps = act.draw_pads(act.choose("none.resting_hand.kinds"))
    series = scale_to_peak(
        build_ramp(act, steps, ramp, ramp) * act.draw_held_noise(steps), force
    )
    lies_round = act.draw_event("round", act.constants.value("none.resting_hand.round"))
    flesh = draw_closed_tissue(act) if lies_round else act.draw_tissue()
    angle = draw_angle_across(act) if lies_round else act.draw_angle()
    return (act.build_press(stamps, flesh, series, act.draw_wander(steps), angle),)


def build_ramp(act: GestureSample, steps: int, up: float, down: float) -> Series:
    """Up in some time [s], hold, down in some time [s]."""
    whole = (steps - 1) * act.step
    smooth = round(act.constants.value("force.smooth") / act.step / 2)
    most = 1 / 2
    return build_trapezoid(
        steps, min(up / whole, most), min(down / whole, most), smooth
    )


def draw_single_pat(act: GestureSample) -> tuple[Press, ...]:
    """One pat; slower ones are as long as a tap of Jung et al. 2017."""
    style = act.choose("none.single_pat.kinds")
    if act.regime == "paper":
        return draw_pats(act, 1, style)
    force = draw_force(act, "double_pat.force", "double_pat")
    steps = act.count_steps(draw_duration(act, "tap"))
    return (draw_single_push(act, style, force, steps),)


def draw_long_press(act: GestureSample) -> tuple[Press, ...]:
    """A hand or finger pushes and keeps pushing: a finger for longer than a poke."""
    force = draw_force(act, "none.press.force", "press")
    style = act.choose("none.press.kinds")
    length = "finger_press" if style in FINGER_GROUPS else "press"
    steps = act.count_steps(draw_duration(act, length, "press"))
    return (draw_single_push(act, style, force, steps),)


def draw_single_push(act: GestureSample, style: str, force: float, steps: int) -> Press:
    """Parts of a hand that push once, where they are."""
    series = scale_to_peak(act.draw_push(steps) * act.draw_held_noise(steps), force)
    stamps, flesh = act.draw_pads(style), act.draw_tissue()
    return act.build_press(
        stamps, flesh, series, act.draw_wander(steps), act.draw_angle()
    )


def draw_squeeze_hold(act: GestureSample) -> tuple[Press, ...]:
    """A grab that is held longer than a command."""
    style = act.choose("grab.kinds")
    return (draw_hold(act, act.draw("none.squeeze_hold.hold"), style),)


def draw_guiding(act: GestureSample) -> tuple[Press, ...]:
    """Two hands hold the arm and move it."""
    steps = act.count_steps(act.draw("none.guiding.hold"))
    total, share = act.draw("none.guiding.force"), act.draw("none.guiding.share")
    gap = draw_hand_positions(act)
    made = [
        draw_guiding_hand(act, total * part, steps, place)
        for part, place in zip((share, 1 - share), gap, strict=True)
    ]
    return tuple(made)


def draw_hand_positions(act: GestureSample) -> tuple[float, float]:
    """Where along the tube the two hands are, from the site's centre [m]."""
    low, high = act.site.free_run
    gap = min(act.draw("none.guiding.gap"), high - low)
    first = float(np.clip(-gap / 2, low, high - gap))
    return first, first + gap


def draw_guiding_hand(
    act: GestureSample, force: float, steps: int, place: float
) -> Press:
    """One of the two hands."""
    sway = act.draw("none.guiding.sway")
    rate = act.draw("none.guiding.sway_rate")
    swaying = 1 + sway * draw_tremor(steps, act.step, rate, act.rng)
    shape = build_ramp(act, steps, *(act.draw("none.lean.ramp") for _ in range(2)))
    stamps = act.draw_pads("full_hand")
    path = act.draw_wander(steps) + np.array([0.0, place])
    series = scale_to_peak(shape * swaying * act.draw_held_noise(steps), force)
    return act.build_press(
        stamps, draw_closed_tissue(act), series, path, draw_angle_across(act)
    )


def build_object_tissue(act: GestureSample) -> SoftTissue:
    """How something that is nobody's gives way."""
    value = act.constants.value
    return SoftTissue(
        b=value("body.stiffness") / MM,
        m=value("body.stiffness_growth") / MM,
        area_scale=1.0,
        area_exponent=value("body.area_exponent"),
        conformity=0.0,
    )


def draw_lean(act: GestureSample) -> tuple[Press, ...]:
    """A forearm or a hip rests its weight on the robot."""
    force = draw_force(act, "none.lean.force", "lean")
    steps = act.count_steps(act.draw("none.lean.hold"))
    up, down = (act.draw("none.lean.ramp") for _ in range(2))
    series = scale_to_peak(
        build_ramp(act, steps, up, down) * act.draw_leaning_noise(steps), force
    )
    body = build_body(act.choose("none.lean.bodies"), act.constants)
    return (
        act.build_press(
            body, act.draw_tissue(), series, act.draw_wander(steps), act.draw_angle()
        ),
    )


def draw_bump(act: GestureSample) -> tuple[Press, ...]:
    """A body hits the robot and bounces: a mass on a spring for half a period."""
    speed, mass = act.draw("none.bump.speed"), act.draw("none.bump.mass")
    stiffness = act.draw("none.bump.stiffness") / MM
    force = act.record("force", speed * np.sqrt(mass * stiffness))
    contact = act.record("duration", np.pi * np.sqrt(mass / stiffness))
    series = force * build_bell(act.count_steps(contact), 1.0)
    if act.draw_event("rebound", act.constants.value("none.bump.rebound")):
        share = act.draw("none.bump.rebound_share")
        gap = np.zeros(round(act.draw("none.bump.rebound_after") / act.step))
        series = np.concatenate([series, gap, share * series])
    body = build_body(choose_bumping_body(act, stiffness), act.constants)
    path = draw_slide(act, act.draw("none.bump.slide"), len(series))
    return (act.build_press(body, act.draw_tissue(), series, path, act.draw_angle()),)


def choose_bumping_body(act: GestureSample, stiffness: float) -> str:
    """What bumps, by its stiffness [N/m]."""
    soft, hard = act.constants.array("none.bump.limits") / MM
    if stiffness > hard:
        return act.choose("none.bump.hard")
    return "torso" if stiffness < soft else "forearm"


def draw_slide(
    act: GestureSample, speed: float, steps: int
) -> Float[np.ndarray, "time 2"]:
    """A way at even speed [m/s] in a direction that is drawn, about the site [m]."""
    way = act.record("direction", act.rng.uniform(-np.pi, np.pi))
    along = speed * act.step * (np.arange(steps) - (steps - 1) / 2)
    return along[:, None] * np.array([-np.sin(way), np.cos(way)])


def draw_brush(act: GestureSample) -> tuple[Press, ...]:
    """A sleeve, a seam or the back of a hand passes over the robot."""
    body = act.choose("none.brush.bodies")
    return (draw_dragged_body(act, body, act.draw_tissue()),)


def draw_cable(act: GestureSample) -> tuple[Press, ...]:
    """A cable drags over the robot."""
    return (draw_dragged_body(act, "cable", build_object_tissue(act)),)


def draw_dragged_body(act: GestureSample, body: str, flesh: SoftTissue) -> Press:
    """A body that passes lightly and unevenly, across its long axis."""
    force = act.record("force", act.draw("none.brush.force"))
    steps = act.count_steps(act.draw("none.brush.hold"))
    rise, fall = act.draw("stroke.rise"), act.draw("stroke.fall")
    whole = (steps - 1) * act.step
    shape = build_ramp(act, steps, rise * whole, fall * whole)
    path = draw_slide(act, act.draw("none.brush.speed"), steps)
    angle = float(act.drawn["direction"]) + np.pi / 2 + act.draw("hand.turn")
    series = scale_to_peak(shape * act.draw_ripple(steps), force)
    return act.build_press(
        build_body(body, act.constants),
        flesh,
        series,
        clip_to_free_run(act, path),
        angle,
    )


def clip_to_free_run(
    act: GestureSample, path: Float[np.ndarray, "time 2"]
) -> Float[np.ndarray, "time 2"]:
    """The same way, held at the ends of the free run."""
    low, high = act.site.free_run
    return np.column_stack([path[:, 0], np.clip(path[:, 1], low, high)])


def draw_self_contact(act: GestureSample) -> tuple[Press, ...]:
    """The robot's own links touch along an edge."""
    force = act.record("force", act.draw("none.self_contact.force"))
    steps = act.count_steps(act.draw("none.self_contact.hold"))
    series = force * build_bell(steps, 1.0)
    body = build_body("edge", act.constants)
    path = np.zeros((steps, 2))
    return (
        act.build_press(body, build_object_tissue(act), series, path, act.site.angle),
    )


def draw_rub(act: GestureSample) -> tuple[Press, ...]:
    """To and fro, firmly, several times."""
    force = draw_force(act, "unknown.rub.force", "stroke")
    steps = act.count_steps(draw_duration(act, "rub", "stroke"))
    swing = draw_swing(act, steps, "unknown.rub")
    path = swing[:, None] * draw_stroke_direction(act) + act.draw_wander(steps)
    stamps = act.draw_pads(act.choose("stroke.kinds"))
    series = scale_to_peak(draw_sliding_force(act, steps), force)
    return (act.build_press(stamps, act.draw_tissue(), series, path, act.draw_angle()),)


def draw_swing(act: GestureSample, steps: int, name: str) -> Float[np.ndarray, "time"]:
    """To and fro, in the room there is [m]."""
    low, high = act.site.free_run
    reach = min(act.draw(f"{name}.reach"), (high - low) / 2)
    return reach * draw_tremor(steps, act.step, act.draw(f"{name}.rate"), act.rng)


def draw_tickle(act: GestureSample) -> tuple[Press, ...]:
    """Fingertips, lightly and quickly."""
    force = draw_force(act, "unknown.tickle.force", "tickle")
    steps = act.count_steps(draw_duration(act, "tickle"))
    swings = [draw_swing(act, steps, "unknown.tickle") for _ in "st"]
    path = np.column_stack(swings) + act.draw_wander(steps)
    depth = act.draw("unknown.tickle.depth")
    rate = act.draw("unknown.tickle.rate")
    beats = 1 - depth * (1 + draw_tremor(steps, act.step, rate, act.rng)) / 2
    ramp = 2 * act.constants.value("force.smooth")
    series = scale_to_peak(build_ramp(act, steps, ramp, ramp) * beats, force)
    stamps = act.draw_pads("tips")
    return (act.build_press(stamps, act.draw_tissue(), series, path, act.draw_angle()),)


def draw_squeeze(act: GestureSample) -> tuple[Press, ...]:
    """A firmer grab that is held."""
    duration = draw_duration(act, "squeeze", "grab")
    firmer = act.constants.value("unknown.squeeze.firmer")
    return (draw_hold(act, duration, act.choose("grab.kinds"), firmer),)
