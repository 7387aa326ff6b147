"""The skin of the `ur5` robot: 2112 taxels in nine patches, denser toward the tool.

Grids and pitches are our own, chosen to fit the arm's straight tubes and flat ends:
half shells with cut corners leave strips of 4 to 5 mm, the two on the forearm are
trapezoids that fit into each other, and the ring on wrist 3 nearly closes.
"""

from collections.abc import Collection

from eskin.skin.outline import (
    BACK,
    DOWN,
    LinkPart,
    Outline,
    X,
    Y,
    Z,
    denser,
    lay_outlines,
)
from eskin.skin.skin import Skin

__all__ = ["UR5_OUTLINES", "UR5_PARTS", "ur5_skin"]

UR5_PARTS = {
    "upper_arm": LinkPart("upper_arm_link", (0.0, 0.0, 0.2125), Z, 0.245, 0.0505),
    "elbow": LinkPart("forearm_link", (0.0, 0.0048, 0.0), Y, 0.086, 0.0575),
    "forearm": LinkPart("forearm_link", (0.0, 0.0, 0.215), Z, 0.28, 0.0375),
    "wrist_1": LinkPart("wrist_1_link", (0.0, 0.093, -0.0173), Z, 0.105, 0.039),
    "wrist_1_end": LinkPart("wrist_1_link", (0.0, 0.093, -0.0568), DOWN, 0.078),
    "wrist_2": LinkPart("wrist_2_link", (0.0, -0.0047, 0.09465), Y, 0.105, 0.039),
    "wrist_3": LinkPart("wrist_3_link", (0.0, 0.06505, 0.0), Y, 0.0345, 0.0375),
}
"""Tubes and flat ends of `load_robot("ur5")`."""

HALF_SHELL = (22, 16, 0.0098, 0.0096, (4, 4, 2, 2))
WIDE, NARROW = 0.0076, 0.0066

UR5_OUTLINES = (
    Outline("upper_arm_front", "upper_arm", X, *HALF_SHELL),
    Outline("upper_arm_back", "upper_arm", BACK, *HALF_SHELL),
    Outline("elbow_cap", "elbow", DOWN, 10, 10, 0.0081, 0.0081, (3, 3, 3, 3)),
    # One draws together toward the wrist as the other spreads.
    Outline(
        *("forearm_front", "forearm", X, 30, 16, 0.0077, WIDE),
        cuts=(0, 0, 3, 3),
        taper=NARROW / WIDE,
    ),
    Outline(
        *("forearm_back", "forearm", BACK, 30, 16, 0.0077, NARROW),
        cuts=(3, 3, 0, 0),
        taper=WIDE / NARROW,
    ),
    Outline("wrist_1", "wrist_1", Y, 9, 12, 0.0067, 0.0067, (1, 1, 2, 2)),
    Outline("wrist_1_cap", "wrist_1_end", X, 8, 8, 0.0066, 0.0066, (2, 2, 2, 2)),
    Outline("wrist_2", "wrist_2", Z, 9, 12, 0.0063, 0.0066, (2, 2, 1, 1), 0.9),
    Outline("wrist_3", "wrist_3", X, 5, 40, 0.0058, 0.0057, (1, 1, 1, 1)),
)
"""The nine patches."""


def ur5_skin(
    name: str = "ur5", density: float = 1.0, missing: Collection[str] = ()
) -> Skin:
    """Lay the nine patches on the links of `load_robot("ur5")`.

    Args:
        name: of the skin.
        density: how many times as dense as the usual one.
        missing: patches that are left out.
    """
    outlines = [denser(outline, density) for outline in UR5_OUTLINES]
    return lay_outlines(name, outlines, UR5_PARTS, missing)
