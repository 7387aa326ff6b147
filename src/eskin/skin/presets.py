"""This module builds the skins that come with eskin.

The skin `ur5` has 2112 taxels in nine patches, denser toward the tool, as the skin of
Jiang et al. 2025 has (section IV-B, Fig. 7a). Its grids are designed for the straight
tubes and flat ends of the arm: half shells with cut corners leave gaps of 4 to 5 mm,
those on the forearm are complementary trapezoids, and the ring on wrist 3 nearly
closes.

The skin `ur5-shapes` is as dense, with seams in other places: rings with seams on
different sides, hexagons with gaps between them, two complementary triangles, and a
ring on wrist 3 in two slanted halves.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from math import cos, pi, sin

import numpy as np

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
"""Rows, columns, their pitches [m], and cut corners; so for the shapes below."""
WIDE = 0.0076
NARROW = 0.0066
"""Column pitches at the two ends of a trapezoid on the forearm [m]."""

UR5_OUTLINES = (
    PatchOutline("upper_arm_front", "upper_arm", X, *HALF_SHELL),
    PatchOutline("upper_arm_back", "upper_arm", BACK, *HALF_SHELL),
    PatchOutline("elbow_cap", "elbow", DOWN, 10, 10, 0.0081, 0.0081, (3, 3, 3, 3)),
    # One narrows toward the wrist as the other widens.
    PatchOutline(
        "forearm_front",
        "forearm",
        X,
        rows=30,
        columns=16,
        row_pitch=0.0077,
        column_pitch=WIDE,
        cuts=(0, 0, 3, 3),
        taper=NARROW / WIDE,
    ),
    PatchOutline(
        "forearm_back",
        "forearm",
        BACK,
        rows=30,
        columns=16,
        row_pitch=0.0077,
        column_pitch=NARROW,
        cuts=(3, 3, 0, 0),
        taper=WIDE / NARROW,
    ),
    PatchOutline("wrist_1", "wrist_1", Y, 9, 12, 0.0067, 0.0067, (1, 1, 2, 2)),
    PatchOutline("wrist_1_cap", "wrist_1_end", X, 8, 8, 0.0066, 0.0066, (2, 2, 2, 2)),
    PatchOutline("wrist_2", "wrist_2", Z, 9, 12, 0.0063, 0.0066, (2, 2, 1, 1), 0.9),
    PatchOutline("wrist_3", "wrist_3", X, 5, 40, 0.0058, 0.0057, (1, 1, 1, 1)),
)
"""Patches of the skin `ur5`."""

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

RIGHT = (0.0, -1.0, 0.0)
RING = (10, 32, 0.0097, 0.0097, (1, 1, 1, 1))
HEXAGON = (16, 15, 0.0073, 0.0072, (5, 5, 5, 5))
TRIANGLE = (8, 16, 0.0073, 0.0071)
HALF_RING = (5, 19, 0.0058, 0.0057, (3, 0, 0, 3))
UR5_SHAPES_OUTLINES = (
    PatchOutline("upper_arm_ring_1", "upper_arm", X, *RING, offset=-0.056),
    PatchOutline("upper_arm_ring_2", "upper_arm", Y, *RING, offset=0.053),
    PatchOutline("elbow_hexagon", "elbow", DOWN, 9, 13, 0.0081, 0.0081, (4, 4, 4, 4)),
    PatchOutline("forearm_ring", "forearm", Y, 8, 32, 0.0074, 0.0072, offset=-0.095),
    PatchOutline("forearm_hexagon_front", "forearm", X, *HEXAGON),
    PatchOutline("forearm_hexagon_back", "forearm", BACK, *HEXAGON),
    PatchOutline(
        "forearm_triangle_1", "forearm", Y, *TRIANGLE, (0, 0, 7, 7), offset=0.096
    ),
    PatchOutline(
        "forearm_triangle_2", "forearm", RIGHT, *TRIANGLE, (7, 7, 0, 0), offset=0.096
    ),
    PatchOutline("wrist_1_hexagon", "wrist_1", Y, 9, 12, 0.0067, 0.0067, (4, 4, 4, 4)),
    PatchOutline("wrist_1_cap", "wrist_1_end", X, 9, 7, 0.0066, 0.0066, (2, 2, 2, 2)),
    PatchOutline("wrist_2_triangle", "wrist_2", Z, 9, 12, 0.0063, 0.0064, (0, 0, 5, 5)),
    PatchOutline("wrist_3_front", "wrist_3", X, *HALF_RING),
    PatchOutline("wrist_3_back", "wrist_3", BACK, *HALF_RING),
)
"""Patches of the skin `ur5-shapes`."""


def build_ur5_skin(
    name: str = "ur5", density: float = 1.0, missing: Collection[str] = ()
) -> Skin:
    """Build the skin of nine patches on the links of `load_robot("ur5")`.

    `density` is that of its taxels over that of the skin `ur5`; patches in `missing`
    are left out.
    """
    outlines = [scale_density(outline, density) for outline in UR5_OUTLINES]
    return build_outline_skin(name, outlines, UR5_PARTS, missing)


def build_ur10_skin() -> Skin:
    """Build the patches of `ur5`, fitted to the links of `load_robot("ur10")`."""
    outlines = [
        fit_to_part(outline, UR5_PARTS[outline.part], UR10_PARTS[outline.part])
        for outline in UR5_OUTLINES
    ]
    return build_outline_skin("ur10", outlines, UR10_PARTS)


DRUM_PITCH = 0.008
"""Distance of neighbouring taxels on a drum [m]."""
MIN_LID_RADIUS = 0.23
"""Radius from which two patches fit on the lid [m]."""


def build_drum_skin(
    name: str, link: str, radius: float, height: float, ring: int
) -> Skin:
    """Build the skin of an upright drum that stands on its link's origin.

    Args:
        name: name of the skin.
        link: name of the drum's link.
        radius: radius of the drum [m]; from `MIN_LID_RADIUS` its lid has two patches.
        height: height of the drum [m].
        ring: number of patches around the side, each 256 mm wide and 160 mm high.
    """
    parts = {
        "side": LinkPart(link, (0.0, 0.0, height - 0.12), Z, height, radius),
        "lid": LinkPart(link, (0.0, 0.0, height), Z, 2 * radius),
    }
    outline = partial(PatchOutline, row_pitch=DRUM_PITCH, column_pitch=DRUM_PITCH)
    outlines = [
        outline(
            f"side_{number + 1}",
            "side",
            front=(cos(2 * pi * number / ring), sin(2 * pi * number / ring), 0.0),
            rows=20,
            columns=32,
            cuts=(3, 5, 5, 3) if number % 2 else (6, 2, 2, 6),
        )
        for number in range(ring)
    ]
    if radius >= MIN_LID_RADIUS:
        half = partial(
            outline, part="lid", rows=14, columns=40, cuts=(0, 0, 10, 10), offset=0.06
        )
        outlines += [half("lid_front", front=X), half("lid_back", front=BACK)]
    return build_outline_skin(name, outlines, parts)


def build_sheet_skin(name: str, link: str, surface: Surface) -> Skin:
    """Build a skin of one patch, 16 x 24 taxels with cut corners, on a surface.

    Around the preset tube, it leaves 43 mm uncovered.
    """
    grid = TaxelGrid(16, 24, 0.008, 0.008, present=cut_corners(16, 24, (3, 3, 3, 3)))
    patch = Patch("sheet", link, 1, grid.rows, grid.columns)
    return build_skin(name, [(patch, grid, surface)])


@dataclass(frozen=True)
class SkinPreset:
    """A preset builds a skin that comes with eskin, and names its robot."""

    build: Callable[[], Skin]
    """Function that builds the skin."""
    robot: str
    """Name of the robot that it is made for, as in `load_robot`."""


SKIN_PRESETS = {
    "ur5": SkinPreset(build_ur5_skin, "ur5"),
    "ur5-half": SkinPreset(partial(build_ur5_skin, "ur5-half", density=0.5), "ur5"),
    "ur5-double": SkinPreset(partial(build_ur5_skin, "ur5-double", density=2.0), "ur5"),
    "ur5-sparse": SkinPreset(partial(build_ur5_skin, "ur5-sparse", density=0.7), "ur5"),
    "ur5-dense": SkinPreset(partial(build_ur5_skin, "ur5-dense", density=1.4), "ur5"),
    "ur5-shapes": SkinPreset(
        partial(build_outline_skin, "ur5-shapes", UR5_SHAPES_OUTLINES, UR5_PARTS), "ur5"
    ),
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
    "bent": SkinPreset(
        partial(build_sheet_skin, "bent", "tube", Tube(0.0375, np.eye(4))), "tube"
    ),
    "flat": SkinPreset(
        partial(build_sheet_skin, "flat", "table", Plane(np.eye(4))), "table"
    ),
}
"""Skins that `load_skin` knows by name; those of public data sets have a nominal
pitch."""
