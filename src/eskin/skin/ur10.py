"""The skin of the `ur10` robot: the patches of `ur5`, drawn on for a larger arm."""

from eskin.skin.outline import DOWN, LinkPart, Y, Z, fitted, lay_outlines
from eskin.skin.skin import Skin
from eskin.skin.ur5 import UR5_OUTLINES, UR5_PARTS

__all__ = ["ur10_skin"]

PARTS = {
    "upper_arm": LinkPart("upper_arm_link", (0.0, 0.0, 0.311), Z, 0.402, 0.064),
    "elbow": LinkPart("forearm_link", (0.0, 0.00685, 0.0), Y, 0.1235, 0.0725),
    "forearm": LinkPart("forearm_link", (0.0, 0.0, 0.31), Z, 0.44, 0.0458),
    "wrist_1": LinkPart("wrist_1_link", (0.0, 0.1149, -0.0202), Z, 0.1243, 0.0455),
    "wrist_1_end": LinkPart("wrist_1_link", (0.0, 0.1149, -0.0663), DOWN, 0.091),
    "wrist_2": LinkPart("wrist_2_link", (0.0, -0.00685, 0.1157), Y, 0.1197, 0.0455),
    "wrist_3": LinkPart("wrist_3_link", (0.0, 0.0726, 0.0), Y, 0.0392, 0.04375),
}
"""Tubes and flat ends of `load_robot("ur10")`."""


def ur10_skin() -> Skin:
    """Lay nine patches on the links of `load_robot("ur10")`."""
    outlines = [
        fitted(outline, UR5_PARTS[outline.part], PARTS[outline.part])
        for outline in UR5_OUTLINES
    ]
    return lay_outlines("ur10", outlines, PARTS)
