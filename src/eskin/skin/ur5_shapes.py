"""Another skin of the `ur5` robot: rings, hexagons and triangles instead of shells.

It is as dense as the skin `ur5`, with seams in other places: rings whose seams face
different ways, hexagons with free wedges between them, two triangles that fit into each
other, and a ring on wrist 3 in two slanted halves.
"""

from eskin.skin.outline import BACK, DOWN, Outline, X, Y, Z, lay_outlines
from eskin.skin.skin import Skin
from eskin.skin.ur5 import UR5_PARTS

__all__ = ["shapes_skin"]

RING = (10, 32, 0.0097, 0.0097, (1, 1, 1, 1), 1.0)
HEXAGON = (16, 15, 0.0073, 0.0072, (5, 5, 5, 5), 1.0)
TRIANGLE = (8, 16, 0.0073, 0.0071)

OUTLINES = (
    Outline("upper_arm_ring_1", "upper_arm", X, *RING, -0.056),
    Outline("upper_arm_ring_2", "upper_arm", Y, *RING, 0.053),
    Outline("elbow_hexagon", "elbow", DOWN, 9, 13, 0.0081, 0.0081, (4, 4, 4, 4)),
    Outline(
        *("forearm_ring", "forearm", Y, 8, 32, 0.0074, 0.0072),
        along=-0.095,
    ),
    Outline("forearm_hexagon_front", "forearm", X, *HEXAGON, 0.0),
    Outline("forearm_hexagon_back", "forearm", BACK, *HEXAGON, 0.0),
    Outline("forearm_triangle_1", "forearm", Y, *TRIANGLE, (0, 0, 7, 7), 1.0, 0.096),
    Outline(
        *("forearm_triangle_2", "forearm", (0.0, -1.0, 0.0), *TRIANGLE),
        *((7, 7, 0, 0), 1.0, 0.096),
    ),
    Outline("wrist_1_hexagon", "wrist_1", Y, 9, 12, 0.0067, 0.0067, (4, 4, 4, 4)),
    Outline("wrist_1_cap", "wrist_1_end", X, 9, 7, 0.0066, 0.0066, (2, 2, 2, 2)),
    Outline("wrist_2_triangle", "wrist_2", Z, 9, 12, 0.0063, 0.0064, (0, 0, 5, 5)),
    Outline("wrist_3_front", "wrist_3", X, 5, 19, 0.0058, 0.0057, (3, 0, 0, 3)),
    Outline("wrist_3_back", "wrist_3", BACK, 5, 19, 0.0058, 0.0057, (3, 0, 0, 3)),
)


def shapes_skin() -> Skin:
    """Lay the patches on the links of `load_robot("ur5")`."""
    return lay_outlines("ur5-shapes", OUTLINES, UR5_PARTS)
