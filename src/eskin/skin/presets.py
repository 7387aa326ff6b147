"""This module builds the skins that come with eskin."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from math import cos, pi, sin

import numpy as np

from eskin.robot import Robot, load_robot
from eskin.skin.layout import (
    BACK,
    DOWN,
    LinkPart,
    PatchOutline,
    TaxelGrid,
    X,
    Y,
    Z,
    build_grid_skin,
    build_outline_skin,
    build_skin,
    cut_corners,
    fit_to_part,
    scale_density,
)
from eskin.skin.skin import Patch, Skin
from eskin.skin.surfaces import Plane, Surface, Tube

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
    PatchOutline("upper_arm_front", "upper_arm", X, *HALF_SHELL),
    PatchOutline("upper_arm_back", "upper_arm", BACK, *HALF_SHELL),
    PatchOutline("elbow_cap", "elbow", DOWN, 10, 10, 0.0081, 0.0081, (3, 3, 3, 3)),
    # One draws together toward the wrist as the other spreads.
    PatchOutline(
        *("forearm_front", "forearm", X, 30, 16, 0.0077, WIDE),
        cuts=(0, 0, 3, 3),
        taper=NARROW / WIDE,
    ),
    PatchOutline(
        *("forearm_back", "forearm", BACK, 30, 16, 0.0077, NARROW),
        cuts=(3, 3, 0, 0),
        taper=WIDE / NARROW,
    ),
    PatchOutline("wrist_1", "wrist_1", Y, 9, 12, 0.0067, 0.0067, (1, 1, 2, 2)),
    PatchOutline("wrist_1_cap", "wrist_1_end", X, 8, 8, 0.0066, 0.0066, (2, 2, 2, 2)),
    PatchOutline("wrist_2", "wrist_2", Z, 9, 12, 0.0063, 0.0066, (2, 2, 1, 1), 0.9),
    PatchOutline("wrist_3", "wrist_3", X, 5, 40, 0.0058, 0.0057, (1, 1, 1, 1)),
)
"""The nine patches."""


def build_ur5_skin(
    name: str = "ur5", density: float = 1.0, missing: Collection[str] = ()
) -> Skin:
    """Lay the nine patches on the links of `load_robot("ur5")`.

    Args:
        name: of the skin.
        density: how many times as dense as the usual one.
        missing: patches that are left out.
    """
    outlines = [scale_density(outline, density) for outline in UR5_OUTLINES]
    return build_outline_skin(name, outlines, UR5_PARTS, missing)


DRUM_PITCH = 0.008
LIDDED = 0.23
"""Radius from which two patches fit on the lid [m]."""
SLANTED, BLUNT = (6, 2, 2, 6), (3, 5, 5, 3)
"""Corners cut off neighbours on the side, in turn."""


def build_drum_skin(
    name: str, link: str, radius: float, height: float, ring: int
) -> Skin:
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
        PatchOutline(
            *(
                f"side_{number + 1}",
                "side",
                facing(number, ring),
                20,
                32,
                DRUM_PITCH,
                DRUM_PITCH,
            ),
            cuts=BLUNT if number % 2 else SLANTED,
        )
        for number in range(ring)
    ]
    if radius >= LIDDED:
        outlines += [
            PatchOutline(
                half,
                "lid",
                front,
                14,
                40,
                DRUM_PITCH,
                DRUM_PITCH,
                (0, 0, 10, 10),
                along=0.06,
            )
            for half, front in (("lid_front", X), ("lid_back", BACK))
        ]
    return build_outline_skin(name, outlines, parts)


def facing(number: int, ring: int) -> tuple[float, float, float]:
    """Where a patch of the side faces."""
    angle = 2 * pi * number / ring
    return cos(angle), sin(angle), 0.0


SHEET_ROWS, SHEET_COLUMNS, SHEET_PITCH, SHEET_CUT = 16, 24, 0.008, 3
BENT_RADIUS = 0.0375


def build_flat_skin() -> Skin:
    """The patch in the plane z = 0 of link `table`, columns along x."""
    return sheet_skin("flat", "table", Plane(np.eye(4)))


def build_bent_skin() -> Skin:
    """The same patch round link `tube`, its columns round the axis z."""
    return sheet_skin("bent", "tube", Tube(BENT_RADIUS, np.eye(4)))


def sheet_skin(name: str, link: str, surface: Surface) -> Skin:
    """The patch on a surface; 43 mm of the tube stay bare between its ends."""
    present = cut_corners(
        SHEET_ROWS, SHEET_COLUMNS, (SHEET_CUT, SHEET_CUT, SHEET_CUT, SHEET_CUT)
    )
    grid = TaxelGrid(
        SHEET_ROWS, SHEET_COLUMNS, SHEET_PITCH, SHEET_PITCH, present=present
    )
    return build_skin(
        name, [(Patch("sheet", link, 1, SHEET_ROWS, SHEET_COLUMNS), grid, surface)]
    )


UR10_PARTS = {
    "upper_arm": LinkPart("upper_arm_link", (0.0, 0.0, 0.311), Z, 0.402, 0.064),
    "elbow": LinkPart("forearm_link", (0.0, 0.00685, 0.0), Y, 0.1235, 0.0725),
    "forearm": LinkPart("forearm_link", (0.0, 0.0, 0.31), Z, 0.44, 0.0458),
    "wrist_1": LinkPart("wrist_1_link", (0.0, 0.1149, -0.0202), Z, 0.1243, 0.0455),
    "wrist_1_end": LinkPart("wrist_1_link", (0.0, 0.1149, -0.0663), DOWN, 0.091),
    "wrist_2": LinkPart("wrist_2_link", (0.0, -0.00685, 0.1157), Y, 0.1197, 0.0455),
    "wrist_3": LinkPart("wrist_3_link", (0.0, 0.0726, 0.0), Y, 0.0392, 0.04375),
}
"""Tubes and flat ends of `load_robot("ur10")`."""


def build_ur10_skin() -> Skin:
    """Lay nine patches on the links of `load_robot("ur10")`."""
    outlines = [
        fit_to_part(outline, UR5_PARTS[outline.part], UR10_PARTS[outline.part])
        for outline in UR5_OUTLINES
    ]
    return build_outline_skin("ur10", outlines, UR10_PARTS)


RING = (10, 32, 0.0097, 0.0097, (1, 1, 1, 1), 1.0)
HEXAGON = (16, 15, 0.0073, 0.0072, (5, 5, 5, 5), 1.0)
TRIANGLE = (8, 16, 0.0073, 0.0071)

SHAPES_OUTLINES = (
    PatchOutline("upper_arm_ring_1", "upper_arm", X, *RING, -0.056),
    PatchOutline("upper_arm_ring_2", "upper_arm", Y, *RING, 0.053),
    PatchOutline("elbow_hexagon", "elbow", DOWN, 9, 13, 0.0081, 0.0081, (4, 4, 4, 4)),
    PatchOutline(
        *("forearm_ring", "forearm", Y, 8, 32, 0.0074, 0.0072),
        along=-0.095,
    ),
    PatchOutline("forearm_hexagon_front", "forearm", X, *HEXAGON, 0.0),
    PatchOutline("forearm_hexagon_back", "forearm", BACK, *HEXAGON, 0.0),
    PatchOutline(
        "forearm_triangle_1", "forearm", Y, *TRIANGLE, (0, 0, 7, 7), 1.0, 0.096
    ),
    PatchOutline(
        *("forearm_triangle_2", "forearm", (0.0, -1.0, 0.0), *TRIANGLE),
        *((7, 7, 0, 0), 1.0, 0.096),
    ),
    PatchOutline("wrist_1_hexagon", "wrist_1", Y, 9, 12, 0.0067, 0.0067, (4, 4, 4, 4)),
    PatchOutline("wrist_1_cap", "wrist_1_end", X, 9, 7, 0.0066, 0.0066, (2, 2, 2, 2)),
    PatchOutline("wrist_2_triangle", "wrist_2", Z, 9, 12, 0.0063, 0.0064, (0, 0, 5, 5)),
    PatchOutline("wrist_3_front", "wrist_3", X, 5, 19, 0.0058, 0.0057, (3, 0, 0, 3)),
    PatchOutline("wrist_3_back", "wrist_3", BACK, 5, 19, 0.0058, 0.0057, (3, 0, 0, 3)),
)


def build_ur5_shapes_skin() -> Skin:
    """Lay the patches on the links of `load_robot("ur5")`."""
    return build_outline_skin("ur5-shapes", SHAPES_OUTLINES, UR5_PARTS)


@dataclass(frozen=True)
class SkinPreset:
    """A skin that comes with eskin, and the robot it is made for."""

    build: Callable[[], Skin]
    """Makes the skin."""

    robot: str
    """What `load_robot` calls the robot."""


SKIN_PRESETS = {
    "ur5": SkinPreset(build_ur5_skin, "ur5"),
    "ur5-half": SkinPreset(partial(build_ur5_skin, "ur5-half", density=0.5), "ur5"),
    "ur5-double": SkinPreset(partial(build_ur5_skin, "ur5-double", density=2.0), "ur5"),
    "ur5-sparse": SkinPreset(partial(build_ur5_skin, "ur5-sparse", density=0.7), "ur5"),
    "ur5-dense": SkinPreset(partial(build_ur5_skin, "ur5-dense", density=1.4), "ur5"),
    "ur5-shapes": SkinPreset(build_ur5_shapes_skin, "ur5"),
    "ur5-missing": SkinPreset(
        partial(build_ur5_skin, "ur5-missing", missing=("forearm_back",)), "ur5"
    ),
    "ur10": SkinPreset(build_ur10_skin, "ur10"),
    "base": SkinPreset(
        partial(build_drum_skin, "base", "base_link", 0.25, 0.5, ring=6), "base"
    ),
    "post": SkinPreset(
        partial(build_drum_skin, "post", "post_link", 0.17, 0.6, ring=4), "post"
    ),
    "sleeve": SkinPreset(partial(build_grid_skin, 19, 27, name="sleeve"), "table"),
    "shearsense": SkinPreset(
        partial(build_grid_skin, 6, 6, kind="shear", name="shearsense"), "table"
    ),
    "socialtouch": SkinPreset(
        partial(build_grid_skin, 19, 24, name="socialtouch"), "table"
    ),
    "bent": SkinPreset(build_bent_skin, "tube"),
    "flat": SkinPreset(build_flat_skin, "table"),
}
"""The skins that `load_skin` knows by name; public sets' have a nominal pitch."""


def load_robot_for_skin(skin_name: str, robot_name: str | None = None) -> Robot | None:
    """The robot of that name, else the one a preset skin is made for, else None."""
    if robot_name is not None:
        return load_robot(robot_name)
    return (
        load_robot(SKIN_PRESETS[skin_name].robot) if skin_name in SKIN_PRESETS else None
    )
