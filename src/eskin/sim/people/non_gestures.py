"""This module draws contacts that are no gesture of the vocabulary.

Hands rest, press and guide; other bodies lean and bump, or stand where the robot
brushes past them; unknown gestures rub, tickle and squeeze.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import MM
from eskin.sim.contact.press import Press, SoftTissue, WorldAnchor
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
from eskin.sim.people.person import build_body

FINGER_GROUPS = ("one_tip", "two_tips")
"""Pad groups whose brief push is a poke."""


def draw_resting_hand(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a hand that is put down and left there."""
    force = draw_force(sample, "none.resting_hand.force", "resting_hand")
    sample.draw_event(
        "began_before", sample.constants.value("none.resting_hand.before")
    )
    steps = sample.count_steps(sample.draw("none.resting_hand.hold"))
    ramp = sample.draw("none.resting_hand.ramp")
    pads = sample.draw_pads(sample.choose("none.resting_hand.kinds"))
    series = scale_to_peak(
        build_ramp(sample, steps, ramp, ramp) * sample.draw_held_noise(steps), force
    )
    lies_round = sample.draw_event(
        "round", sample.constants.value("none.resting_hand.round")
    )
    tissue = draw_closed_tissue(sample) if lies_round else sample.draw_tissue()
    angle = draw_angle_across(sample) if lies_round else sample.draw_angle()
    return (sample.build_press(pads, series, sample.draw_wander(steps), tissue, angle),)


def build_ramp(sample: GestureSample, steps: int, up: float, down: float) -> Series:
    """Build a series that rises in some time [s], holds, and falls in some time [s]."""
    whole = (steps - 1) * sample.step
    smooth = round(sample.constants.value("force.smooth") / sample.step / 2)
    max_share = 1 / 2
    return build_trapezoid(
        steps, min(up / whole, max_share), min(down / whole, max_share), smooth
    )


def draw_single_pat(sample: GestureSample) -> tuple[Press, ...]:
    """Draw one pat; slower ones are as long as a tap of Jung et al. 2017."""
    style = sample.choose("none.single_pat.kinds")
    if sample.regime == "paper":
        return draw_pats(sample, 1, style)
    force = draw_force(sample, "double_pat.force", "double_pat")
    steps = sample.count_steps(draw_duration(sample, "tap"))
    return (draw_single_push(sample, style, force, steps),)


def draw_long_press(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a hand or finger that keeps pushing: a finger for longer than a poke."""
    force = draw_force(sample, "none.press.force", "press")
    style = sample.choose("none.press.kinds")
    length = "finger_press" if style in FINGER_GROUPS else "press"
    steps = sample.count_steps(draw_duration(sample, length, "press"))
    return (draw_single_push(sample, style, force, steps),)


def draw_single_push(
    sample: GestureSample, style: str, force: float, steps: int
) -> Press:
    """Draw pads of a hand that push once, where they are."""
    series = scale_to_peak(
        sample.draw_push(steps) * sample.draw_held_noise(steps), force
    )
    return sample.build_press(sample.draw_pads(style), series)


def draw_squeeze_hold(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a grab that is held longer than a command."""
    style = sample.choose("grab.kinds")
    return (draw_hold(sample, sample.draw("none.squeeze_hold.hold"), style),)


def draw_guiding(sample: GestureSample) -> tuple[Press, ...]:
    """Draw two hands that hold the arm and move it."""
    steps = sample.count_steps(sample.draw("none.guiding.hold"))
    total = sample.draw("none.guiding.force")
    share = sample.draw("none.guiding.share")
    # Both hands are along the tube, within its free run.
    low, high = sample.site.free_run
    gap = min(sample.draw("none.guiding.gap"), high - low)
    first = float(np.clip(-gap / 2, low, high - gap))
    return (
        draw_guiding_hand(sample, total * share, steps, first),
        draw_guiding_hand(sample, total * (1 - share), steps, first + gap),
    )


def draw_guiding_hand(
    sample: GestureSample, force: float, steps: int, place: float
) -> Press:
    """Draw one of the two hands."""
    sway = sample.draw("none.guiding.sway")
    rate = sample.draw("none.guiding.sway_rate")
    swaying = 1 + sway * draw_tremor(steps, sample.step, rate, sample.rng)
    shape = build_ramp(
        sample, steps, *(sample.draw("none.lean.ramp") for _ in range(2))
    )
    pads = sample.draw_pads("full_hand")
    path = sample.draw_wander(steps) + np.array([0.0, place])
    series = scale_to_peak(shape * swaying * sample.draw_held_noise(steps), force)
    tissue = draw_closed_tissue(sample)
    angle = draw_angle_across(sample)
    return sample.build_press(pads, series, path, tissue, angle)


def build_object_tissue(sample: GestureSample) -> SoftTissue:
    """Return how an object gives way that is no person."""
    value = sample.constants.value
    return SoftTissue(
        b=value("body.stiffness") / MM,
        m=value("body.stiffness_growth") / MM,
        area_scale=1.0,
        area_exponent=value("body.area_exponent"),
        conformity=0.0,
    )


def draw_lean(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a forearm or a hip that rests its weight on the robot."""
    force = draw_force(sample, "none.lean.force", "lean")
    steps = sample.count_steps(sample.draw("none.lean.hold"))
    up, down = (sample.draw("none.lean.ramp") for _ in range(2))
    series = scale_to_peak(
        build_ramp(sample, steps, up, down) * sample.draw_leaning_noise(steps), force
    )
    body = build_body(sample.choose("none.lean.bodies"), sample.constants)
    return (sample.build_press(body, series),)


def draw_brush(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a person or a thing that stands and touches the robot lightly."""
    body = sample.choose("none.brush.bodies")
    steps = sample.count_steps(sample.draw("none.brush.hold"))
    path = sample.draw_wander(steps)
    return (draw_standing_body(sample, "brush", body, sample.draw_tissue(), path),)


def draw_cable(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a cable that hangs in the world, lies on the robot and swings a little."""
    steps = sample.count_steps(sample.draw("none.cable.hold"))
    size = sample.draw("none.cable.swing")
    rate = sample.draw("none.cable.swing_rate")
    direction = sample.record("direction", sample.rng.uniform(-np.pi, np.pi))
    swing = size * draw_tremor(steps, sample.step, rate, sample.rng)
    path = swing[:, None] * np.array([-np.sin(direction), np.cos(direction)])
    tissue = build_object_tissue(sample)
    return (draw_standing_body(sample, "cable", "cable", tissue, path),)


def draw_standing_body(
    sample: GestureSample,
    kind: str,
    body: str,
    tissue: SoftTissue,
    path: Float[np.ndarray, "time 2"],
) -> Press:
    """Draw a body that rests lightly on the robot and stands while the robot moves.

    `path` is its own small motion about the site [m].
    """
    steps = len(path)
    whole = (steps - 1) * sample.step
    force = sample.record("force", sample.draw("none.brush.force"))
    rise = sample.draw("stroke.rise")
    fall = sample.draw("stroke.fall")
    shape = build_ramp(sample, steps, rise * whole, fall * whole)
    series = scale_to_peak(shape * sample.draw_leaning_noise(steps), force)
    angle = sample.record("angle", sample.rng.uniform(-np.pi, np.pi))
    pads = build_body(body, sample.constants)
    press = sample.build_press(pads, series, path, tissue, angle)
    anchor = WorldAnchor(
        centre=sample.site.centre,
        run=sample.site.free_run,
        give=sample.draw("none.standing.give"),
        most=sample.constants.value("none.standing.most"),
        dragged=sample.draw(f"none.{kind}.dragged"),
        ripple=sample.draw("slide.ripple"),
        ripple_length=sample.draw("none.standing.ripple_length"),
    )
    return replace(press, anchor=anchor)


def draw_self_contact(sample: GestureSample) -> tuple[Press, ...]:
    """Draw the robot's own links that touch along an edge."""
    force = sample.record("force", sample.draw("none.self_contact.force"))
    steps = sample.count_steps(sample.draw("none.self_contact.hold"))
    series = force * build_bell(steps, 1.0)
    body = build_body("edge", sample.constants)
    path = np.zeros((steps, 2))
    tissue = build_object_tissue(sample)
    return (sample.build_press(body, series, path, tissue, sample.site.angle),)


def draw_rub(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a hand that slides to and fro, firmly, several times."""
    force = draw_force(sample, "unknown.rub.force", "stroke")
    steps = sample.count_steps(draw_duration(sample, "rub", "stroke"))
    swing = draw_swing(sample, steps, "unknown.rub")
    path = swing[:, None] * draw_stroke_direction(sample) + sample.draw_wander(steps)
    pads = sample.draw_pads(sample.choose("stroke.kinds"))
    series = scale_to_peak(draw_sliding_force(sample, steps), force)
    return (sample.build_press(pads, series, path),)


def draw_swing(
    sample: GestureSample, steps: int, name: str
) -> Float[np.ndarray, "time"]:
    """Draw a motion to and fro in the room there is [m]."""
    low, high = sample.site.free_run
    reach = min(sample.draw(f"{name}.reach"), (high - low) / 2)
    return reach * draw_tremor(
        steps, sample.step, sample.draw(f"{name}.rate"), sample.rng
    )


def draw_tickle(sample: GestureSample) -> tuple[Press, ...]:
    """Draw fingertips that move lightly and quickly."""
    force = draw_force(sample, "unknown.tickle.force", "tickle")
    steps = sample.count_steps(draw_duration(sample, "tickle"))
    swings = [draw_swing(sample, steps, "unknown.tickle") for _ in "st"]
    path = np.column_stack(swings) + sample.draw_wander(steps)
    depth = sample.draw("unknown.tickle.depth")
    rate = sample.draw("unknown.tickle.rate")
    beats = 1 - depth * (1 + draw_tremor(steps, sample.step, rate, sample.rng)) / 2
    ramp = 2 * sample.constants.value("force.smooth")
    series = scale_to_peak(build_ramp(sample, steps, ramp, ramp) * beats, force)
    pads = sample.draw_pads("tips")
    return (sample.build_press(pads, series, path),)


def draw_squeeze(sample: GestureSample) -> tuple[Press, ...]:
    """Draw a firmer grab that is held."""
    duration = draw_duration(sample, "squeeze", "grab")
    firmer = sample.constants.value("unknown.squeeze.firmer")
    return (draw_hold(sample, duration, sample.choose("grab.kinds"), firmer),)
