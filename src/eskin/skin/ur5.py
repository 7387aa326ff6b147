"""The skin of the `ur5` robot: 2112 taxels in nine patches, denser toward the tool.

Grids and pitches are our own, chosen to fit the arm's straight tubes and flat ends:
half shells with cut corners leave strips of 4 to 5 mm, the two on the forearm are
trapezoids that fit into each other, and the ring on wrist 3 nearly closes.
"""

import numpy as np
from jaxtyping import Float

from eskin.skin.layout import Grid, join_patches, without_corners
from eskin.skin.round import Tube
from eskin.skin.skin import Patch, Skin
from eskin.skin.surface import Plane, Surface
from eskin.transforms import make_transform

__all__ = ["ur5_skin"]

Vector = tuple[float, float, float]

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
BACK, DOWN = (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)

UPPER_ARM_CENTRE = (0.0, 0.0, 0.2125)
FOREARM_CENTRE = (0.0, 0.0, 0.215)


def ur5_skin() -> Skin:
    """Lay the nine patches on the links of `load_robot("ur5")`."""
    names = ("upper_arm_front", "upper_arm_back", "elbow_cap", "forearm_front")
    names += ("forearm_back", "wrist_1", "wrist_1_cap", "wrist_2", "wrist_3")
    pieces = (*upper_arm(), elbow_cap(), *forearm(), *wrists())
    laid = []
    for number, (name, piece) in enumerate(zip(names, pieces, strict=True)):
        link, grid, surface = piece
        patch = Patch(name, link, number + 1, grid.rows, grid.columns)
        laid.append((patch, grid, surface))
    return join_patches("ur5", laid)


Piece = tuple[str, Grid, Surface]


def upper_arm() -> list[Piece]:
    """Two half shells, each short of its corners."""
    present = without_corners(22, 16, (4, 4, 2, 2))
    grid = Grid(22, 16, row_pitch=0.0098, column_pitch=0.0096, present=present)
    return [
        ("upper_arm_link", grid, tube(0.0505, UPPER_ARM_CENTRE, Z, front))
        for front in (X, BACK)
    ]


def forearm() -> list[Piece]:
    """Two trapezoids: one draws together toward the wrist as the other spreads."""
    wide, narrow = 0.0076, 0.0066
    pieces = []
    for front, first, last in ((X, wide, narrow), (BACK, narrow, wide)):
        cuts = (0, 0, 3, 3) if first > last else (3, 3, 0, 0)
        present = without_corners(30, 16, cuts)
        grid = Grid(30, 16, 0.0077, first, taper=last / first, present=present)
        surface = tube(0.0375, FOREARM_CENTRE, Z, front)
        pieces.append(("forearm_link", grid, surface))
    return pieces


def elbow_cap() -> Piece:
    """A rounded square on the elbow's housing, away from the tube."""
    grid = Grid(10, 10, 0.0081, 0.0081, present=without_corners(10, 10, (3, 3, 3, 3)))
    return "forearm_link", grid, tube(0.0575, (0.0, 0.0048, 0.0), Y, DOWN)


def wrists() -> list[Piece]:
    """A shell and a cap on wrist 1, a trapezoid on wrist 2, a ring on wrist 3."""
    shell = Grid(9, 12, 0.0067, 0.0067, present=without_corners(9, 12, (1, 1, 2, 2)))
    cap = Grid(8, 8, 0.0066, 0.0066, present=without_corners(8, 8, (2, 2, 2, 2)))
    trapezoid = Grid(
        *(9, 12, 0.0063, 0.0066),
        taper=0.9,
        present=without_corners(9, 12, (2, 2, 1, 1)),
    )
    ring = Grid(5, 40, 0.0058, 0.0057, present=without_corners(5, 40, (1, 1, 1, 1)))
    return [
        ("wrist_1_link", shell, tube(0.039, (0.0, 0.093, -0.0173), Z, Y)),
        ("wrist_1_link", cap, plane((0.0, 0.093, -0.0568), DOWN, X)),
        (
            "wrist_2_link",
            trapezoid,
            tube(0.039, (0.0, -0.0047, 0.09465), Y, Z),
        ),
        ("wrist_3_link", ring, tube(0.0375, (0.0, 0.06505, 0.0), Y, X)),
    ]


def tube(radius: float, centre: Vector, axis: Vector, front: Vector) -> Tube:
    """A tube about an axis through its centre; s = 0 lies toward its front."""
    return Tube(radius, placed(centre, axis, front))


def plane(centre: Vector, normal: Vector, s_axis: Vector) -> Plane:
    """A plane through its centre, with s along the axis given."""
    return Plane(placed(centre, normal, s_axis))


def placed(origin: Vector, z_axis: Vector, x_axis: Vector) -> Float[np.ndarray, "4 4"]:
    """T_link_surface from an origin [m] and two axes at right angles."""
    z, x = np.array(z_axis, dtype=float), np.array(x_axis, dtype=float)
    rotation = np.column_stack([x, np.cross(z, x), z])
    return make_transform(rotation, np.array(origin, dtype=float))
