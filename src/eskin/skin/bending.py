"""One patch, laid flat on a table or round a tube, for what bending alone tells."""

import numpy as np

from eskin.skin.layout import Grid, join_patches, without_corners
from eskin.skin.round import Tube
from eskin.skin.skin import Patch, Skin
from eskin.skin.surface import Plane, Surface

__all__ = ["bent_skin", "flat_skin"]

ROWS, COLUMNS, PITCH, CUT = 16, 24, 0.008, 3
RADIUS = 0.0375


def flat_skin() -> Skin:
    """The patch in the plane z = 0 of link `table`, columns along x."""
    return laid("flat", "table", Plane(np.eye(4)))


def bent_skin() -> Skin:
    """The same patch round link `tube`, its columns round the axis z."""
    return laid("bent", "tube", Tube(RADIUS, np.eye(4)))


def laid(name: str, link: str, surface: Surface) -> Skin:
    """The patch on a surface; 43 mm of the tube stay bare between its ends."""
    present = without_corners(ROWS, COLUMNS, (CUT, CUT, CUT, CUT))
    grid = Grid(ROWS, COLUMNS, PITCH, PITCH, present=present)
    return join_patches(name, [(Patch("sheet", link, 1, ROWS, COLUMNS), grid, surface)])
