"""Draw the type, place and time of textbook touches."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, pi, sin

import numpy as np

from eskin.recording import NONE
from lab.textbook.skins import Site, SurfaceName
from lab.textbook.touches import (
    Place,
    Spot,
    TextbookTouch,
    compute_semi_axes,
    fingertips,
    flat_hand,
    grip,
    place_spots,
)

CLIP = 2.0
"""Length of a clip, from whose start the times of touches count [s]."""
LIFTED = (0.1, 0.5)
"""Range of the time from the end of a touch to the end of its clip, if it fits [s]."""
NO_SECOND = 0.45
"""Shortest time from the onset of one pat to the end of its clip [s]: the longest
interval of two pats, before which a second one is possible."""
PAT = (0.08, 0.16)
"""Duration of the contact of one pat [s]."""
PAT_SHARE = 0.6
"""Longest contact of a pat, as a share of the interval between two."""
GRAB = (0.5, 1.2)
"""Duration of the contact of a grab [s]."""
STROKE, LONGEST_STROKE = (0.6, 1.2), 0.14
"""Duration of the contact of a stroke [s], and its greatest length [m]."""
RESTING, RESTING_RAMP = (-0.5, 0.3), (0.3, 0.5)
"""Onset of a resting hand, and the duration of its ramp [s]."""
STAYS = 9.0
"""End of a resting hand, long after its clip [s]."""
TRIES = 1000


@dataclass(frozen=True)
class TouchSetting:
    """Holds the factors of a touch."""

    force: float
    """Total force of all spots; of each finger of a grab [N]."""
    area: float
    """Area of one fingertip; those of fingers and palm are proportional to it [m2]."""
    duration: float
    """Duration of a poke [s]."""
    press: float
    """Duration of a press, which is no poke [s]."""
    ramp: float
    """Duration of the rise and of the fall of the force [s]."""
    gap: float
    """Time from the onset of one pat to that of the next [s]."""
    speed: float
    """Speed of a stroke [m/s]."""
    pitch: float
    """Distance of neighbouring taxels; unused for the surface `ur5` [m]."""
    rate: float
    """Rate of the scans [Hz]."""
    surface: SurfaceName
    """Surface that is touched."""


Rng = np.random.Generator


def poke(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """Build a poke of one fingertip."""
    return build_fingertip_touch("poke", setting, setting.duration, rng)


def press(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """Build a press of one fingertip, longer than a poke."""
    return build_fingertip_touch("press", setting, setting.press, rng)


def build_fingertip_touch(
    name: str, setting: TouchSetting, seconds: float, rng: Rng
) -> TextbookTouch:
    """Build a touch of one fingertip of a duration [s]."""
    tip = Spot((0.0, 0.0), compute_semi_axes(setting.area), setting.force)
    return TextbookTouch(name, (tip,), (span(seconds, rng),), setting.ramp)


def one_pat(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """Build one pat, with no second one within the longest interval."""
    hand, seconds = draw_patting_hand(setting, rng), rng.uniform(*PAT)
    lifted = NO_SECOND - seconds, LIFTED[1]
    return TextbookTouch("one pat", hand, (span(seconds, rng, lifted),), setting.ramp)


def double_pat(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """Build two pats of a hand in the same place."""
    hand = draw_patting_hand(setting, rng)
    seconds = min(rng.uniform(*PAT), PAT_SHARE * setting.gap)
    first, end = span(setting.gap + seconds, rng)
    contacts = (first, first + seconds), (end - seconds, end)
    return TextbookTouch("double_pat", hand, contacts, setting.ramp)


def draw_patting_hand(setting: TouchSetting, rng: Rng) -> tuple[Spot, ...]:
    """Draw four fingertips or a flat hand, with equal probability."""
    if rng.random() < 0.5:
        return fingertips(4, setting.force, setting.area)
    return flat_hand(setting.force, setting.area)


def stroke(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """Build a stroke of one to four fingertips, at constant speed along t."""
    tips = fingertips(int(rng.integers(1, 5)), setting.force, setting.area)
    seconds = min(rng.uniform(*STROKE), LONGEST_STROKE / setting.speed)
    contact = (span(seconds, rng),)
    return TextbookTouch("stroke", tips, contact, setting.ramp, (0.0, setting.speed))


def grab(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """Build a grab: a hand that closes round a tube and opens."""
    contact = span(rng.uniform(*GRAB), rng)
    return TextbookTouch("grab", grip(setting.force), (contact,), setting.ramp)


def resting_hand(setting: TouchSetting, rng: Rng) -> TextbookTouch:
    """Build a resting hand: a flat hand that stays still until after the clip."""
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
"""Functions that build each touch, by name."""

GESTURES = ("poke", "double_pat", "stroke", "grab")


def name_true_class(name: str) -> str:
    """Return the true class of a touch."""
    return name if name in GESTURES else NONE


def span(
    seconds: float, rng: Rng, lifted: tuple[float, float] = LIFTED
) -> tuple[float, float]:
    """Draw start and end of a contact in a clip [s].

    Args:
        seconds: duration of the contact [s].
        rng: random generator.
        lifted: range of the time from its end to the end of the clip, if it fits [s].
    """
    end = CLIP - min(rng.uniform(*lifted), CLIP - seconds)
    return end - seconds, end


def draw_touch(name: str, setting: TouchSetting, site: Site, rng: Rng) -> TextbookTouch:
    """Draw a touch by name, somewhere on a site, away from its edges.

    Args:
        name: one of `TOUCHES`.
        setting: factors of the touch.
        site: site of the touch; round for a grab.
        rng: random generator.
    """
    made, placing = rng.spawn(2)
    touch = TOUCHES[name](setting, made)
    return place_touch(touch, site, placing)


def place_touch(touch: TextbookTouch, site: Site, rng: Rng) -> TextbookTouch:
    """Draw place and direction of a touch until it lies inside.

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
        velocity = rotate(touch.velocity, angle)
        travel = velocity[0] * seconds, velocity[1] * seconds
        back = at[0] - travel[0] / 2, at[1] - travel[1] / 2
        spots = place_spots(touch.spots, angle, back)
        if site.holds(spots, travel):
            return replace(touch, spots=spots, velocity=velocity)
    raise ValueError(
        f"no room for a {touch.name} on {site.mounted.skin.name} in {TRIES} tries; "
        f"allowed are touches within {site.half} m; make it smaller"
    )


def rotate(vector: Place, angle: float) -> Place:
    """Rotate a vector by an angle from s to t [rad]."""
    s, t = vector
    return cos(angle) * s - sin(angle) * t, sin(angle) * s + cos(angle) * t
