"""Textbook touches drawn at random from a setting: what, where and when."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, pi, sin

import numpy as np

from benchmarks.textbook.skins import Site, SurfaceName
from benchmarks.textbook.touches import (
    Place,
    Spot,
    TextbookTouch,
    axes_of,
    fingertips,
    flat_hand,
    grip,
    laid,
)
from eskin.recording import NONE

CLIP = 2.0
"""Length of a clip [s]; touches tell their times from its start."""
LIFTED = (0.1, 0.5)
"""How long before the end of its clip a touch has ended, where it fits [s]."""
NO_SECOND = 0.45
"""From the onset of one pat to the end of its clip at least [s]: the longest interval
of two pats; before, nobody can know that there is no second one."""
PAT = (0.08, 0.16)
"""Contact of one pat [s]."""
PAT_SHARE = 0.6
"""Longest contact of a pat, in units of the interval between two."""
GRAB = (0.5, 1.2)
"""Contact of a grab [s]."""
STROKE, LONGEST_STROKE = (0.6, 1.2), 0.14
"""Contact of a stroke [s], and how far it goes at most [m]."""
RESTING, RESTING_RAMP = (-0.5, 0.3), (0.3, 0.5)
"""When a resting hand comes to lie, and how long that takes [s]."""
STAYS = 9.0
"""When it is taken away, long after its clip [s]."""
TRIES = 1000


@dataclass(frozen=True)
class TouchSetting:
    """The factors of a touch."""

    force: float
    """Of all spots together; of each finger of a grab [N]."""
    area: float
    """Of one fingertip; lying fingers and the palm follow it [m2]."""
    duration: float
    """Contact of a poke [s]."""
    press: float
    """Contact of a press, which is no poke [s]."""
    ramp: float
    """Rise and fall of force [s]."""
    gap: float
    """From the onset of one pat to that of the next [s]."""
    speed: float
    """Of a stroke [m/s]."""
    pitch: float
    """Distance of neighbouring taxels [m]; `ur5` has its own."""
    rate: float
    """Scans a second [Hz]."""
    surface: SurfaceName
    """What is touched."""


Rng = np.random.Generator


def poke(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """One fingertip that comes and goes."""
    return one_tip("poke", setting, setting.duration, rng)


def press(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """One fingertip that stays longer than a poke."""
    return one_tip("press", setting, setting.press, rng)


def one_tip(
    name: str, setting: TouchSetting, seconds: float, rng: Rng
) -> TextbookTouch:
    """One fingertip for so long [s]."""
    tip = Spot((0.0, 0.0), axes_of(setting.area), setting.force)
    return TextbookTouch(name, (tip,), (span(seconds, rng),), setting.ramp)


def one_pat(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """One pat of a hand, and no second one for as long as it might come."""
    hand, seconds = patting(setting, rng), rng.uniform(*PAT)
    lifted = NO_SECOND - seconds, LIFTED[1]
    return TextbookTouch("one pat", hand, (span(seconds, rng, lifted),), setting.ramp)


def double_pat(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """Two pats of a hand in the same place."""
    hand = patting(setting, rng)
    seconds = min(rng.uniform(*PAT), PAT_SHARE * setting.gap)
    first, end = span(setting.gap + seconds, rng)
    contacts = (first, first + seconds), (end - seconds, end)
    return TextbookTouch("double_pat", hand, contacts, setting.ramp)


def patting(setting: TouchSetting, rng: Rng) -> tuple[Spot, ...]:
    """Four fingertips or a flat hand, as often."""
    if rng.random() < 0.5:
        return fingertips(4, setting.force, setting.area)
    return flat_hand(setting.force, setting.area)


def stroke(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """One to four fingertips side by side that move at a constant speed along t."""
    tips = fingertips(int(rng.integers(1, 5)), setting.force, setting.area)
    seconds = min(rng.uniform(*STROKE), LONGEST_STROKE / setting.speed)
    contact = (span(seconds, rng),)
    return TextbookTouch("stroke", tips, contact, setting.ramp, (0.0, setting.speed))


def grab(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """A hand that closes round a tube and opens."""
    contact = span(rng.uniform(*GRAB), rng)
    return TextbookTouch("grab", grip(setting.force), (contact,), setting.ramp)


def resting_hand(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """A flat hand that lies still until after the clip."""
    hand = flat_hand(setting.force, setting.area)
    contact = rng.uniform(*RESTING), STAYS
    return TextbookTouch("resting hand", hand, (contact,), rng.uniform(*RESTING_RAMP))


TOUCHES: dict[str, Callable[[TouchSetting, Rng], TextbookTouch]] = {
    "poke": poke,
    "double_pat": double_pat,
    "stroke": stroke,
    "grab": grab,
    "resting hand": resting_hand,
    "one pat": one_pat,
    "press": press,
}
"""What is done, by its name."""

GESTURES = ("poke", "double_pat", "stroke", "grab")


def truth_of(name: str) -> str:
    """The right answer to a touch."""
    return name if name in GESTURES else NONE


def span(
    seconds: float, rng: Rng, lifted: tuple[float, float] = LIFTED
) -> tuple[float, float]:
    """Start and end of so long in a clip [s].

    Args:
        seconds: how long.
        rng: to draw from.
        lifted: how long before the end of the clip it has ended, where it fits [s].
    """
    end = CLIP - min(rng.uniform(*lifted), CLIP - seconds)
    return end - seconds, end


def draw_touch(name: str, setting: TouchSetting, site: Site, rng: Rng) -> TextbookTouch:
    """A touch of that name somewhere on a site, away from its edges.

    Args:
        name: one of `TOUCHES`.
        setting: its factors.
        site: where it takes place; a grab only where it is round.
        rng: to draw from.
    """
    made, placing = rng.spawn(2)
    touch = TOUCHES[name](setting, made)
    return placed(touch, site, placing)


def placed(touch: TextbookTouch, site: Site, rng: Rng) -> TextbookTouch:
    """The touch at a place and in a direction drawn until it lies inside.

    Raises:
        ValueError: the site is too small for it.
    """
    seconds = touch.contacts[-1][1] - touch.contacts[0][0]
    width = min(site.half[0], site.girth / 2)
    for _ in range(TRIES):
        angle = float(rng.uniform(-pi, pi))
        at = (
            float(rng.uniform(-width, width)),
            float(rng.uniform(-site.half[1], site.half[1])),
        )
        if touch.name == "grab":
            angle = float(rng.choice((0.0, pi)))
        velocity = turned(touch.velocity, angle)
        travel = velocity[0] * seconds, velocity[1] * seconds
        back = at[0] - travel[0] / 2, at[1] - travel[1] / 2
        spots = laid(touch.spots, angle, back)
        if site.holds(spots, travel):
            return replace(touch, spots=spots, velocity=velocity)
    raise ValueError(
        f"no room for a {touch.name} on {site.mounted.skin.name} in {TRIES} tries; "
        f"allowed are touches within {site.half} m; make it smaller"
    )


def turned(vector: Place, angle: float) -> Place:
    """A vector turned from s to t [rad]."""
    s, t = vector
    return cos(angle) * s - sin(angle) * t, sin(angle) * s + cos(angle) * t
