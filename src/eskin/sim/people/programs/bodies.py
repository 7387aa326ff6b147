"""Other bodies than hands: what leans, bumps, brushes or is caught."""

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import Flesh, Press
from eskin.sim.people.hand import MM, body_of
from eskin.sim.people.programs.act import Act
from eskin.sim.people.programs.amount import draw_force
from eskin.sim.people.programs.nothing import ramped
from eskin.sim.people.series import bell, peaked


def thing(act: Act) -> Flesh:
    """How something that is nobody's gives way."""
    value = act.constants.value
    return Flesh(
        b=value("body.stiffness") / MM,
        m=value("body.stiffness_growth") / MM,
        area_scale=1.0,
        area_exponent=value("body.area_exponent"),
        conformity=0.0,
    )


def lean(act: Act) -> tuple[Press, ...]:
    """A forearm or a hip rests its weight on the robot."""
    force = draw_force(act, "none.lean.force", "lean")
    steps = act.steps(act.draw("none.lean.hold"))
    up, down = (act.draw("none.lean.ramp") for _ in range(2))
    series = peaked(ramped(act, steps, up, down) * act.leant(steps), force)
    body = body_of(act.choose("none.lean.bodies"), act.constants)
    return (act.press(body, act.flesh(), series, act.wander(steps), act.turn()),)


def bump(act: Act) -> tuple[Press, ...]:
    """A body hits the robot and bounces: a mass on a spring for half a period."""
    speed, mass = act.draw("none.bump.speed"), act.draw("none.bump.mass")
    stiffness = act.draw("none.bump.stiffness") / MM
    force = act.note("force", speed * np.sqrt(mass * stiffness))
    contact = act.note("duration", np.pi * np.sqrt(mass / stiffness))
    series = force * bell(act.steps(contact), 1.0)
    if act.happens("rebound", act.constants.value("none.bump.rebound")):
        share = act.draw("none.bump.rebound_share")
        gap = np.zeros(round(act.draw("none.bump.rebound_after") / act.step))
        series = np.concatenate([series, gap, share * series])
    body = body_of(bumping(act, stiffness), act.constants)
    path = slid(act, act.draw("none.bump.slide"), len(series))
    return (act.press(body, act.flesh(), series, path, act.turn()),)


def bumping(act: Act, stiffness: float) -> str:
    """What bumps, by its stiffness [N/m]."""
    soft, hard = act.constants.array("none.bump.limits") / MM
    if stiffness > hard:
        return act.choose("none.bump.hard")
    return "torso" if stiffness < soft else "forearm"


def slid(act: Act, speed: float, steps: int) -> Float[np.ndarray, "time 2"]:
    """A way at even speed [m/s] in a direction that is drawn, about the site [m]."""
    way = act.note("direction", act.rng.uniform(-np.pi, np.pi))
    along = speed * act.step * (np.arange(steps) - (steps - 1) / 2)
    return along[:, None] * np.array([-np.sin(way), np.cos(way)])


def brush(act: Act) -> tuple[Press, ...]:
    """A sleeve, a seam or the back of a hand passes over the robot."""
    body = act.choose("none.brush.bodies")
    return (dragged(act, body, act.flesh()),)


def cable(act: Act) -> tuple[Press, ...]:
    """A cable drags over the robot."""
    return (dragged(act, "cable", thing(act)),)


def dragged(act: Act, body: str, flesh: Flesh) -> Press:
    """A body that passes lightly and unevenly, across its long axis."""
    force = act.note("force", act.draw("none.brush.force"))
    steps = act.steps(act.draw("none.brush.hold"))
    rise, fall = act.draw("stroke.rise"), act.draw("stroke.fall")
    whole = (steps - 1) * act.step
    shape = ramped(act, steps, rise * whole, fall * whole)
    path = slid(act, act.draw("none.brush.speed"), steps)
    angle = float(act.drawn["direction"]) + np.pi / 2 + act.draw("hand.turn")
    series = peaked(shape * act.rippled(steps), force)
    return act.press(
        body_of(body, act.constants), flesh, series, within(act, path), angle
    )


def within(act: Act, path: Float[np.ndarray, "time 2"]) -> Float[np.ndarray, "time 2"]:
    """The same way, held at the ends of the free run."""
    low, high = act.site.clear
    return np.column_stack([path[:, 0], np.clip(path[:, 1], low, high)])


def self_contact(act: Act) -> tuple[Press, ...]:
    """The robot's own links touch along an edge."""
    force = act.note("force", act.draw("none.self_contact.force"))
    steps = act.steps(act.draw("none.self_contact.hold"))
    series = force * bell(steps, 1.0)
    body = body_of("edge", act.constants)
    path = np.zeros((steps, 2))
    return (act.press(body, thing(act), series, path, act.site.angle),)
