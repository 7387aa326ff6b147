"""Patches drawn in outline and laid on parts of a robot, at any density and size."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, inf, isinf, pi, sqrt

import numpy as np

from eskin.skin.layout import Grid, join_patches, without_corners
from eskin.skin.round import Tube
from eskin.skin.skin import Patch, Skin
from eskin.skin.surface import Plane, Surface
from eskin.transforms import make_transform

__all__ = ["LinkPart", "Outline", "denser", "fitted", "lay_outlines"]

Vector = tuple[float, float, float]

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
BACK, DOWN = (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)


@dataclass(frozen=True)
class LinkPart:
    """A straight tube or a flat end of a link, which patches are laid on."""

    link: str
    """Link that it is part of."""

    centre: Vector
    """Where the middle of a patch comes to lie, on the axis of a tube [m]."""

    axis: Vector
    """Along a tube; out of a flat end."""

    length: float
    """Of a tube; diameter of a flat end [m]."""

    radius: float = inf
    """Of a tube; infinite where it is flat [m]."""

    @property
    def girth(self) -> float:
        """Once round a tube; diameter of a flat end [m]."""
        return self.length if isinf(self.radius) else 2 * pi * self.radius

    def surface(self, front: Vector, along: float) -> Surface:
        """The part unrolled: s = 0 toward its front, t = 0 so far along [m]."""
        z, x = np.array(self.axis), np.array(front)
        t_axis = np.cross(z, x) if isinf(self.radius) else z
        rotation = np.column_stack([x, np.cross(z, x), z])
        placed = make_transform(rotation, np.array(self.centre) + along * t_axis)
        return Plane(placed) if isinf(self.radius) else Tube(self.radius, placed)


@dataclass(frozen=True)
class Outline:
    """A patch before it has a place: a grid with corners cut off."""

    name: str
    """Id of the patch."""

    part: str
    """Name of the part that it is laid on."""

    front: Vector
    """Direction in the link's frame that the middle of its columns faces; along the
    columns on a flat end."""

    rows: int
    columns: int
    row_pitch: float
    """[m]"""

    column_pitch: float
    """In the first row [m]."""

    cuts: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Cells missing at the corners, as in `without_corners`."""

    taper: float = 1.0
    """Column pitch of the last row over that of the first."""

    along: float = 0.0
    """Its middle from that of the part, along t [m]."""

    def grid(self) -> Grid:
        """Its cells."""
        present = without_corners(self.rows, self.columns, self.cuts)
        pitches = self.row_pitch, self.column_pitch
        return Grid(self.rows, self.columns, *pitches, self.taper, present)


def denser(outline: Outline, factor: float) -> Outline:
    """The same outline with so many times the taxels, as far as whole rows allow."""
    rows = round(outline.rows * sqrt(factor))
    columns = round(outline.rows * outline.columns * factor / rows)
    first, first_last, last, last_last = (
        round(cut * sqrt(factor)) for cut in outline.cuts
    )
    return replace(
        outline,
        rows=rows,
        columns=columns,
        row_pitch=outline.row_pitch * (outline.rows / rows),
        column_pitch=outline.column_pitch * (outline.columns / columns),
        cuts=(first, first_last, last, last_last),
    )


def fitted(outline: Outline, drawn_for: LinkPart, part: LinkPart) -> Outline:
    """The outline for a part of another size: as dense, with more rows and columns."""
    longer, wider = part.length / drawn_for.length, part.girth / drawn_for.girth
    return replace(
        outline,
        rows=whole(outline.rows * longer),
        columns=whole(outline.columns * wider),
        along=outline.along * longer,
    )


def whole(number: float) -> int:
    """The whole number below, for which there is room."""
    return floor(number + 1e-9)


def lay_outlines(
    name: str,
    outlines: Sequence[Outline],
    parts: Mapping[str, LinkPart],
    missing: Collection[str] = (),
) -> Skin:
    """Lay every outline on its part; one that is missing leaves its address free.

    Raises:
        ValueError: what should be missing is not there anyhow.
    """
    names = [outline.name for outline in outlines]
    if not set(missing) <= set(names):
        raise ValueError(
            f"no patch {sorted(set(missing) - set(names))} to leave out; the patches: "
            f"{', '.join(names)}"
        )
    laid = []
    for number, outline in enumerate(outlines, 1):
        part, grid = parts[outline.part], outline.grid()
        patch = Patch(outline.name, part.link, number, grid.rows, grid.columns)
        if outline.name not in missing:
            surface = part.surface(outline.front, outline.along)
            laid.append((patch, grid, surface))
    return join_patches(name, laid)
