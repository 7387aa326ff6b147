"""This module draws the flexible circuit of a patch, and writes it as DXF and SVG.

Lengths of drawings are in millimetres, in the plane of the patch: its coordinates
(s, t), seen from outside.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from io import StringIO
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from jaxtyping import Bool, Float
from shapely import Polygon, box, get_coordinates, union_all

from eskin.design.patches import PatchLayout
from eskin.files import atomic_path
from eskin.registry import find_package

ezdxf = find_package("ezdxf", "ezdxf", "design", "skin design")

MM = 1e3
MILLIMETRES = 4
"""Number of the unit in a DXF."""
PAD = 0.75
"""Side of a pad over the spacing of the taxels."""
SEAM = 0.2
"""Width of the gap between neighbouring patches [mm]."""
TAIL_LENGTH = 12.0
"""Length of the tail, which ends in the contacts of the connector [mm]."""
BAND = 0.9
"""Width of the tail over the spacing of the taxels."""
CONTACT_LENGTH = 3.0
"""Length of a contact of the connector [mm]."""
FIDUCIALS = 3
"""Number of fiducials of a patch."""
MAX_FIDUCIAL = 0.5
"""Largest radius of a fiducial [mm]."""
TEXT_HEIGHT = 2.0
"""Height of the patch's name [mm]."""
SHEET_GAP = 8.0
"""Distance of the drawings on a sheet [mm]."""

LAYERS = {
    "OUTLINE": (7, "#222222"),
    "PADS": (2, "#c9982b"),
    "ROWS": (1, "#c0392b"),
    "COLUMNS": (5, "#2c5fa8"),
    "RETURNS": (3, "#3a8f4d"),
    "CONNECTOR": (6, "#8e44ad"),
    "FIDUCIALS": (4, "#111111"),
    "NAME": (7, "#222222"),
}
"""Colour of every layer, as an index of DXF and as of SVG."""


@dataclass(frozen=True, eq=False)
class Line:
    """A line runs through points of one layer of a drawing."""

    layer: str
    points: Float[np.ndarray, "point 2"]
    """Its points [mm]."""
    closed: bool = False
    """Whether the last point is joined with the first."""

    @property
    def length(self) -> float:
        """Return its length without the closing piece [mm]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


@dataclass(frozen=True, eq=False)
class PatchDrawing:
    """A drawing holds the flexible circuit of one patch.

    Rows, columns, and the lines from both to the connector are on a conductor layer
    each; a line ends where it is joined to one of another layer. No two lines of a
    layer cross.
    """

    name: str
    """Id of the patch."""
    lines: tuple[Line, ...]
    """Outline, pads in the order of the taxels, traces and contacts."""
    fiducials: Float[np.ndarray, "fiducial 2"]
    """Centres of the fiducials [mm]."""
    fiducial_radius: float
    """Radius of the fiducials [mm]."""
    name_place: Float[np.ndarray, "2"]
    """Left end of the base line of the name [mm]."""
    trace_pitch: float
    """Smallest distance of two lines of a layer [mm]."""

    def select(self, layer: str) -> list[Line]:
        """Return the lines of one layer, in order."""
        return [line for line in self.lines if line.layer == layer]

    @property
    def trace_length(self) -> float:
        """Return the length of all traces [mm]."""
        traces = ("ROWS", "COLUMNS", "RETURNS")
        return sum(line.length for line in self.lines if line.layer in traces)

    @cached_property
    def bounds(self) -> Float[np.ndarray, "2 2"]:
        """Return the smallest and the largest coordinates, with the name [mm]."""
        right = self.name_place + [0.62 * TEXT_HEIGHT * len(self.name), TEXT_HEIGHT]
        parts = [line.points for line in self.lines]
        points = np.concatenate([*parts, self.name_place[None], right[None]])
        return np.stack([points.min(axis=0), points.max(axis=0)])

    def move(self, offset: Float[np.ndarray, "2"]) -> "PatchDrawing":
        """Return the drawing, shifted [mm]."""
        lines = [replace(line, points=line.points + offset) for line in self.lines]
        return replace(
            self,
            lines=tuple(lines),
            fiducials=self.fiducials + offset,
            name_place=self.name_place + offset,
        )


def draw_patch(name: str, layout: PatchLayout) -> PatchDrawing:
    """Draw the flexible circuit of a patch.

    All rows cross one column of the grid and all columns one row. From these crossings
    lines run in a band along that column, side by side, to the connector. Fig. 6b of
    Jiang et al. 2025 shows one of their circuits.

    Args:
        name: id of the patch.
        layout: its layout.
    """
    grid = layout.grid
    pitch = MM * grid.column_pitch
    centres = MM * grid.unrolled()
    present = np.ones((grid.rows, grid.columns), bool)
    if grid.present is not None:
        present = grid.present
    x = centre_lines(grid.columns, grid.column_pitch)
    y = centre_lines(grid.rows, grid.row_pitch)
    row, column = find_spine(present)
    lines = [
        Line("OUTLINE", build_outline(centres, pitch, x[column], y[0]), closed=True),
        *(Line("PADS", c + square(PAD * pitch), closed=True) for c in centres),
    ]
    paths, step = route_returns(x, y, row, column, pitch)
    for i in range(grid.rows):
        # A line reaches to where its return begins.
        used = np.append(x[present[i]], paths[i][0, 0])
        ends = np.array([used.min(), used.max()])
        lines.append(Line("ROWS", np.column_stack([ends, [y[i]] * 2])))
    for j in range(grid.columns):
        used = np.append(y[present[:, j]], paths[grid.rows + j][0, 1])
        ends = np.array([used.min(), used.max()])
        lines.append(Line("COLUMNS", np.column_stack([[x[j]] * 2, ends])))
    end = y[0] - pitch / 2 - TAIL_LENGTH
    for path in paths:
        stop = [path[-1, 0], end + CONTACT_LENGTH / 2]
        lines.append(Line("RETURNS", np.vstack([path, stop])))
        contact = box(
            stop[0] - 0.3 * step, end, stop[0] + 0.3 * step, end + CONTACT_LENGTH
        )
        corners = get_coordinates(contact)[:4]
        lines.append(Line("CONNECTOR", corners, closed=True))
    marks = place_fiducials(present, x, y)
    return PatchDrawing(
        name,
        tuple(lines),
        marks,
        min(MAX_FIDUCIAL, 0.3 * (1 - PAD) * pitch),
        np.array([x[column] + pitch / 2 + 1.0, end]),
        step,
    )


def centre_lines(count: int, pitch: float) -> Float[np.ndarray, "line"]:
    """Return coordinates of rows or columns a pitch [m] apart, centred on 0 [mm]."""
    return MM * ((np.arange(count) - (count - 1) / 2) * pitch)


def find_spine(present: Bool[np.ndarray, "row column"]) -> tuple[int, int]:
    """Return the row that all columns cross, and the column that all rows cross.

    Of several the one nearest to the middle is taken.

    Raises:
        ValueError: There is none.
    """
    rows, columns = np.flatnonzero(present.all(1)), np.flatnonzero(present.all(0))
    if not len(rows) or not len(columns):
        raise ValueError(
            f"got a grid of {present.shape[0]} x {present.shape[1]} cells without a "
            "full row and a full column; allowed are grids with both; cut it first"
        )
    middle = (np.array(present.shape) - 1) / 2
    return (
        int(rows[np.argmin(np.abs(rows - middle[0]))]),
        int(columns[np.argmin(np.abs(columns - middle[1]))]),
    )


def route_returns(
    x: Float[np.ndarray, "column"],
    y: Float[np.ndarray, "row"],
    row: int,
    column: int,
    pitch: float,
) -> tuple[list[Float[np.ndarray, "point 2"]], float]:
    """Route a line from every row and column into the band along one column.

    That column itself keeps its place in the middle of the band, with half of the rows
    on either side. Columns on its left take the lanes on the left, the farthest one the
    outermost, and those on its right the lanes on the right. A nearer column leaves the
    row at a greater height, so that no two lines cross.

    Returns:
        The lines of the rows, then of the columns, each to where it enters the band;
        and the smallest distance of two lines [mm].
    """
    half = len(y) // 2
    count = len(x) + len(y)
    step = BAND * pitch / (2 * max(column + half, count - 1 - column - half) + 1)
    lanes = x[column] + step * (np.arange(count) - column - half)
    row_lanes = np.delete(lanes[column : column + len(y) + 1], half)
    paths = [np.array([place]) for place in zip(row_lanes, y, strict=True)]
    sides = max(column, len(x) - 1 - column, 1)
    for j in range(len(x)):
        if j == column:
            paths.append(np.array([[x[column], y[row]]]))
            continue
        lane = lanes[j] if j < column else lanes[j + len(y)]
        rank = sides - abs(j - column)
        height = y[row] + BAND * pitch * ((rank + 0.5) / sides - 0.5)
        paths.append(np.array([[x[j], height], [lane, height]]))
    return paths, min(step, BAND * pitch / sides)


def square(side: float) -> Float[np.ndarray, "4 2"]:
    """Return the corners of a square centred on (0, 0)."""
    half = side / 2
    return np.array([[-half, -half], [half, -half], [half, half], [-half, half]])


def build_outline(
    centres: Float[np.ndarray, "taxel 2"], pitch: float, tail: float, low: float
) -> Float[np.ndarray, "corner 2"]:
    """Build the outline of all cells, less half a seam, with the tail [mm]."""
    cells = union_all([Polygon(c + square(pitch * (1 + 1e-9))) for c in centres])
    body = cells.buffer(-SEAM / 2, join_style="mitre")
    half = BAND * pitch / 2
    bottom = low - pitch / 2
    tongue = box(tail - half, bottom - TAIL_LENGTH, tail + half, low)
    outline = union_all([body, tongue])
    if not isinstance(outline, Polygon):
        raise ValueError("the cells of a patch are not connected")
    return get_coordinates(outline.simplify(1e-6))[:-1]


def place_fiducials(
    present: Bool[np.ndarray, "row column"],
    x: Float[np.ndarray, "column"],
    y: Float[np.ndarray, "row"],
) -> Float[np.ndarray, "fiducial 2"]:
    """Place fiducials between pads, as far from each other as there is room [mm]."""
    whole = present[:-1, :-1] & present[1:, :-1] & present[:-1, 1:] & present[1:, 1:]
    rows, columns = np.nonzero(whole)
    places = np.column_stack([x[columns] + x[columns + 1], y[rows] + y[rows + 1]]) / 2
    chosen: list[int] = []
    gap = -places.sum(axis=1)
    while len(chosen) < min(FIDUCIALS, len(places)):
        chosen.append(int(np.argmax(gap)))
        near = np.linalg.norm(places - places[chosen[-1]], axis=1)
        gap = near if len(chosen) == 1 else np.minimum(gap, near)
    return places[np.array(chosen, dtype=np.int64)]


def arrange_sheet(drawings: Sequence[PatchDrawing]) -> list[PatchDrawing]:
    """Place drawings beside each other on one sheet, in rows from the top."""
    sizes = np.array([np.diff(drawing.bounds, axis=0)[0] for drawing in drawings])
    width = max(
        1.25 * np.sqrt((sizes + SHEET_GAP).prod(axis=1).sum()), sizes[:, 0].max()
    )
    order = np.argsort(-sizes[:, 1], kind="stable")
    left = 0.0
    top = 0.0
    placed = list(drawings)
    height = 0.0
    for number in order:
        if left > 0 and left + sizes[number, 0] > width:
            left = 0.0
            top = top - height - SHEET_GAP
            height = 0.0
        low, high = drawings[number].bounds
        placed[number] = drawings[number].move(np.array([left - low[0], top - high[1]]))
        left += sizes[number, 0] + SHEET_GAP
        height = max(height, sizes[number, 1])
    return placed


def save_dxf(path: Path, drawings: Sequence[PatchDrawing]) -> None:
    """Write drawings as one DXF R2010, in millimetres; the same ones give the same."""
    fixed = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        document = ezdxf.new("R2010", units=MILLIMETRES)
        for layer, (colour, _) in LAYERS.items():
            document.layers.add(layer, color=colour)
        space = document.modelspace()
        for drawing in drawings:
            add_to_dxf(space, drawing)
        text = StringIO()
        document.write(text)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = fixed
    with atomic_path(path) as part:
        part.write_text(text.getvalue(), encoding="utf-8")


def add_to_dxf(space: Any, drawing: PatchDrawing) -> None:  # noqa: ANN401
    """Add a drawing to the model space of a DXF."""
    for line in drawing.lines:
        attributes = {"layer": line.layer}
        points = line.points.tolist()
        space.add_lwpolyline(points, close=line.closed, dxfattribs=attributes)
    for centre in drawing.fiducials.tolist():
        attributes = {"layer": "FIDUCIALS"}
        space.add_circle(centre, drawing.fiducial_radius, dxfattribs=attributes)
    name = space.add_text(
        drawing.name, height=TEXT_HEIGHT, dxfattribs={"layer": "NAME"}
    )
    name.set_placement(drawing.name_place.tolist())


def save_svg(path: Path, drawings: Sequence[PatchDrawing]) -> None:
    """Write drawings as one SVG, to scale in millimetres, seen from outside."""
    bounds = np.array([drawing.bounds for drawing in drawings])
    low = bounds[:, 0].min(axis=0) - SHEET_GAP / 2
    width, height = bounds[:, 1].max(axis=0) + SHEET_GAP / 2 - low
    # The t axis points up, that of an SVG down.
    top = low[1] + height

    def flip(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
        return np.column_stack([points[:, 0] - low[0], top - points[:, 1]])

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}mm" '
        f'height="{height:.2f}mm" viewBox="0 0 {width:.2f} {height:.2f}">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for layer, (_, colour) in LAYERS.items():
        lines = [line for drawing in drawings for line in drawing.select(layer)]
        filled = layer in ("PADS", "CONNECTOR")
        style = (
            f'fill="{colour}" stroke="none"'
            if filled
            else f'fill="none" stroke="{colour}" stroke-width="0.15"'
        )
        paths = "".join(format_path(flip(line.points), line.closed) for line in lines)
        if paths:
            parts.append(f'<path id="{layer}" {style} d="{paths}"/>')
    for drawing in drawings:
        parts += [
            f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{drawing.fiducial_radius:.2f}"/>'
            for x, y in flip(drawing.fiducials)
        ]
        ((x, y),) = flip(drawing.name_place[None])
        parts.append(
            f'<text x="{x:.2f}" y="{y:.2f}" font-family="sans-serif" '
            f'font-size="{TEXT_HEIGHT * 1.35:.2f}">{escape(drawing.name)}</text>'
        )
    with atomic_path(path) as part:
        part.write_text("\n".join([*parts, "</svg>\n"]), encoding="utf-8")


def format_path(points: Float[np.ndarray, "point 2"], closed: bool) -> str:
    """Return the path of a line as SVG writes it."""
    corners = "L".join(f"{x:.2f} {y:.2f}" for x, y in points)
    return f"M{corners}{'Z' if closed else ''}"
