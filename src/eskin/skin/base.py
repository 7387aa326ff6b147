"""The skin of the robot `base`: six patches round an upright drum, two on its lid."""

from math import cos, pi, sin

from eskin.skin.outline import BACK, LinkPart, Outline, X, Z, lay_outlines
from eskin.skin.skin import Skin

__all__ = ["base_skin"]

PARTS = {
    "side": LinkPart("base_link", (0.0, 0.0, 0.38), Z, 0.5, 0.25),
    "lid": LinkPart("base_link", (0.0, 0.0, 0.5), Z, 0.5),
}
"""Of `load_robot("base")`."""

PITCH = 0.008
ROUND = 6
"""Patches round the side."""
SLANTED, BLUNT = (6, 2, 2, 6), (3, 5, 5, 3)
"""Corners cut off neighbours on the side, in turn."""


def base_skin() -> Skin:
    """Lay the eight patches on the link of `load_robot("base")`."""
    side = [
        Outline(
            *(f"side_{number + 1}", "side", facing(number), 20, 32, PITCH, PITCH),
            cuts=BLUNT if number % 2 else SLANTED,
        )
        for number in range(ROUND)
    ]
    lid = [
        Outline(name, "lid", front, 14, 40, PITCH, PITCH, (0, 0, 10, 10), along=0.06)
        for name, front in (("lid_front", X), ("lid_back", BACK))
    ]
    return lay_outlines("base", [*side, *lid], PARTS)


def facing(number: int) -> tuple[float, float, float]:
    """Where a patch of the side faces."""
    angle = 2 * pi * number / ROUND
    return cos(angle), sin(angle), 0.0
