"""Stroke: a hand slides over the surface."""

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import Press
from eskin.sim.people.programs.act import Act
from eskin.sim.people.programs.amount import draw_duration, draw_force
from eskin.sim.people.series import Series, minimum_jerk, peaked, trapezoid

WHOLE_HAND = ("flat_hand", "full_hand")
"""Parts of a hand that stroke as firmly as a hand rests."""


def stroke(act: Act) -> tuple[Press, ...]:
    """One stroke, or there and back."""
    law = "stroke.hand_force" if act.kind in WHOLE_HAND else "stroke.force"
    force = draw_force(act, law, "stroke")
    duration = draw_duration(act, "stroke")
    steps = act.steps(duration)
    way = draw_way(act)
    back = act.happens("return", act.constants.value("stroke.return"))
    legs = 2 if back else 1
    speed = act.draw("stroke.speed")
    start, length = fit(act, way, speed * duration / legs)
    act.note("speed", legs * length / duration)
    along = start + length * there(steps, back)
    path = along[:, None] * way + act.wander(steps)
    series = peaked(sliding(act, steps), force)
    flesh, angle = act.flesh(), act.turn()
    return (act.press(act.stamps(act.kind), flesh, series, path, angle),)


def draw_way(act: Act) -> Float[np.ndarray, "2"]:
    """Unit direction (s, t) of the stroke."""
    path = act.choose("stroke.path")
    if path == "along":
        slant = 0.0
    else:
        slant = np.pi / 2 if path == "around" else act.draw("stroke.oblique")
    signs = act.rng.choice([-1.0, 1.0], 2)
    way = signs * np.array([np.sin(slant), np.cos(slant)])
    act.note("direction", float(np.arctan2(-way[0], way[1])))
    return way


def fit(act: Act, way: Float[np.ndarray, "2"], wanted: float) -> tuple[float, float]:
    """Where along its way a stroke begins, and its length, in the room there is [m].

    It passes the site's centre.
    """
    low, high = room(act, way)
    shortest = act.constants.value("stroke.shortest")
    length = min(wanted, max(high - low, shortest))
    first, last = max(low, -length), min(0.0, high - length)
    if first > last:
        first = last = (low + high - length) / 2
    start = float(act.rng.uniform(first, last))
    act.note("start", start)
    return start, act.note("length", length)


def room(act: Act, way: Float[np.ndarray, "2"]) -> tuple[float, float]:
    """How far one may slide back and forth along a way [m]."""
    low, high = act.site.clear
    arc = act.constants.value("stroke.arc") * 2 * np.pi * act.site.radius / 2
    limits = [(-np.inf, np.inf)]
    if abs(way[0]) > 1e-9:
        arc = min(arc, high - low) if np.isinf(arc) else arc
        limits.append((-arc / abs(way[0]), arc / abs(way[0])))
    if abs(way[1]) > 1e-9:
        both = sorted((low / way[1], high / way[1]))
        limits.append((both[0], both[1]))
    return max(each[0] for each in limits), min(each[1] for each in limits)


def there(steps: int, back: bool) -> Series:
    """Share of the way through time."""
    if not back:
        return minimum_jerk(steps)
    half = (steps + 1) // 2
    out = minimum_jerk(half)
    return np.concatenate([out, minimum_jerk(steps - half + 1)[::-1][1:]])


def sliding(act: Act, steps: int) -> Series:
    """Force of a sliding hand, around 1: it ripples, and lifts off slowly."""
    smooth = round(act.constants.value("force.smooth") / act.step / 2)
    shape = trapezoid(steps, act.draw("stroke.rise"), act.draw("stroke.fall"), smooth)
    return shape * act.rippled(steps) * act.held(steps)
