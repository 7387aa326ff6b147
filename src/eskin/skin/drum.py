"""Skins of upright drums: a ring of patches round the side, two on a wide lid."""

from math import cos, pi, sin

from eskin.skin.outline import BACK, LinkPart, Outline, X, Z, lay_outlines
from eskin.skin.skin import Skin

__all__ = ["drum_skin"]

PITCH = 0.008
LIDDED = 0.23
"""Radius from which two patches fit on the lid [m]."""
SLANTED, BLUNT = (6, 2, 2, 6), (3, 5, 5, 3)
"""Corners cut off neighbours on the side, in turn."""


def drum_skin(name: str, link: str, radius: float, height: float, ring: int) -> Skin:
    """Lay the patches on an upright drum that stands on its link's origin.

    Args:
        name: Of the skin.
        link: The drum.
        radius: Of the drum [m]; from `LIDDED` on its lid has two patches.
        height: Of the drum [m].
        ring: Patches round the side, each 256 mm of its girth and 160 mm high.
    """
    parts = {
        "side": LinkPart(link, (0.0, 0.0, height - 0.12), Z, height, radius),
        "lid": LinkPart(link, (0.0, 0.0, height), Z, 2 * radius),
    }
    outlines = [
        Outline(
            *(f"side_{number + 1}", "side", facing(number, ring), 20, 32, PITCH, PITCH),
            cuts=BLUNT if number % 2 else SLANTED,
        )
        for number in range(ring)
    ]
    if radius >= LIDDED:
        outlines += [
            Outline(
                half, "lid", front, 14, 40, PITCH, PITCH, (0, 0, 10, 10), along=0.06
            )
            for half, front in (("lid_front", X), ("lid_back", BACK))
        ]
    return lay_outlines(name, outlines, parts)


def facing(number: int, ring: int) -> tuple[float, float, float]:
    """Where a patch of the side faces."""
    angle = 2 * pi * number / ring
    return cos(angle), sin(angle), 0.0
