"""Grab: a hand closes round a tube and holds it."""

from dataclasses import replace

import numpy as np

from eskin.sim.contact.press import Flesh, Press
from eskin.sim.people.programs.act import Act
from eskin.sim.people.programs.amount import draw_duration, draw_force
from eskin.sim.people.series import minimum_jerk, peaked, trapezoid


def grab(act: Act) -> tuple[Press, ...]:
    """One grab."""
    return (hold(act, draw_duration(act, "grab"), act.kind),)


def hold(act: Act, duration: float, group: str, firmer: float = 1.0) -> Press:
    """Parts of a hand round a tube for some time [s], `firmer` than in a grab."""
    most = largest(act) / firmer
    force = firmer * draw_force(act, "grab.force", "grab", most)
    steps = act.steps(duration)
    smooth = round(act.constants.value("force.smooth") / act.step / 2)
    rise, fall = act.draw("grab.rise"), act.draw("grab.fall")
    series = peaked(trapezoid(steps, rise, fall, smooth) * act.held(steps), force)
    path = act.wander(steps)
    twist = act.draw("grab.twist") * minimum_jerk(steps)
    series = np.minimum(series, most * firmer)
    stamps = act.person.part(group, act.draw("grab.splay"))
    return act.press(stamps, closed(act), series, path, across(act) + twist)


def closed(act: Act) -> Flesh:
    """A hand that wraps round what it holds."""
    return replace(act.person.flesh, conformity=act.draw("grab.conformity"))


def across(act: Act) -> float:
    """Angle of a hand across the tube, the way round that suits the person [rad]."""
    side = 1.0 if np.sin(act.site.angle) >= 0 else -1.0
    return act.note("angle", side * np.pi / 2 + act.draw("grab.slant"))


def largest(act: Act) -> float:
    """The person's largest grip on the site's tube [N]."""
    value = act.constants.value
    if np.isinf(act.site.radius):
        share = value("grab.weakest")
    else:
        wider = 2 * act.site.radius - value("grab.reference")
        share = 1 - value("grab.weaker") * wider
        share = np.clip(share, value("grab.weakest"), value("grab.strongest"))
    return act.note("largest", act.person.grip * share)
