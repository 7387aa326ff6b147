"""A chart holds one surface of the robot, unrolled, with all taxels that lie on it.

A skin whose patches all lie on planes, tubes and domes has one chart for each of these
surfaces. Any other skin has one chart for each patch: a sheet that goes on over the
patches around it, so charts overlap, and each taxel is the own one of a single chart.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.contact.sheet import Sheet, build_sheet, build_skin_mesh
from eskin.skin import MountedSkin, Surface, Tube, fit_surface

TOLERANCE = 1e-4
"""Distance within which taxels belong to a surface [m]."""
MIN_CURVATURE = 0.1
"""Curvature below which a sheet counts as one of this curvature [1/m]."""


@dataclass(frozen=True, eq=False)
class Chart:
    """A chart holds one unrolled surface of a link and the taxels of its patches."""

    link: str
    """Link that the surface is part of."""
    surface: Surface
    """Surface that maps unrolled coordinates (s, t) to the link's frame and back."""
    taxels: Int[np.ndarray, "part"]
    """Indices into the skin's taxels, ascending."""
    unrolled: Float[np.ndarray, "part 2"]
    """Centre (s, t) of each of those taxels [m]."""
    cells: Float[np.ndarray, "part 2 2"]
    """Half the cell of each taxel as two vectors: along its row, then across it [m]."""
    rim: float = np.inf
    """Distance that the surface goes on beyond its taxels [m]."""
    others: Bool[np.ndarray, "part"] | None = None
    """Which of its taxels belong to another chart; None where none do."""

    @cached_property
    def own(self) -> Int[np.ndarray, "own"]:
        """Return the places in `taxels` of those that are of no other chart."""
        if self.others is None:
            return np.arange(len(self.taxels))
        return np.flatnonzero(~self.others)

    @cached_property
    def radius(self) -> float:
        """Return the radius of curvature across t [m], infinite on a plane.

        On a sheet it is the radius of the mean largest curvature, and finite.
        """
        if isinstance(self.surface, Sheet):
            largest = np.linalg.eigvalsh(self.surface.curvatures[self.own])[:, 1]
            return 1.0 / max(float(largest.mean()), MIN_CURVATURE)
        return float(getattr(self.surface, "radius", np.inf))

    @property
    def circumference(self) -> float:
        """Return the length after which s repeats [m], infinite unless it is a tube."""
        return compute_circumference(self.surface)

    def is_beyond(
        self, unrolled: Float[np.ndarray, "*batch 2"]
    ) -> Bool[np.ndarray, "*batch"]:
        """Tell which points (s, t) [m] lie off the ends of the surface."""
        if np.isinf(self.rim):
            return np.zeros(unrolled.shape[:-1], dtype=bool)
        if isinstance(self.surface, Sheet):
            return self.surface.is_beyond(unrolled, self.rim)
        low = self.unrolled.min(axis=0) - self.rim
        high = self.unrolled.max(axis=0) + self.rim
        off = (unrolled < low) | (unrolled > high)
        # A tube has no end around it.
        return off[..., 1] if isinstance(self.surface, Tube) else off.any(axis=-1)

    def wrap_s(self, s: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Return differences of s, taken the shorter way round [m]."""
        return wrap_difference(s, self.circumference)


def compute_circumference(surface: Surface) -> float:
    """Return the length after which s repeats [m], infinite unless it is a tube."""
    return 2 * np.pi * surface.radius if isinstance(surface, Tube) else np.inf


def wrap_difference(
    s: Float[np.ndarray, "*any"], whole: float
) -> Float[np.ndarray, "*any"]:
    """Return differences of s, taken the shorter way round [m]."""
    return s if np.isinf(whole) else (s + whole / 2) % whole - whole / 2


def build_charts(mounted: MountedSkin, rim: float = np.inf) -> tuple[Chart, ...]:
    """Build the charts of a skin, in the order of their first own taxels.

    Surfaces go on for `rim` [m] beyond their taxels.
    """
    skin = mounted.skin
    found: list[tuple[str, Surface, list[int]]] = []
    for index, patch in enumerate(skin.patches):
        taxels = np.flatnonzero(skin.patch_index == index)
        positions = skin.positions[taxels]
        normals = skin.normals[taxels]
        for link, surface, members in found:
            gaps = surface.fit_errors(positions, normals)
            if link == patch.link and gaps.max(initial=0.0) < TOLERANCE:
                members.extend(taxels.tolist())
                break
        else:
            surface = fit_surface(positions, normals)
            if surface is None:
                return build_sheet_charts(mounted, rim)
            found.append((patch.link, surface, taxels.tolist()))
    return tuple(build_chart(mounted, *parts, rim) for parts in found)


def build_sheet_charts(mounted: MountedSkin, rim: float) -> tuple[Chart, ...]:
    """Build a chart of the sheet around each patch; see `build_charts`."""
    skin = mounted.skin
    charts = []
    mesh = build_skin_mesh(skin)
    for index, patch in enumerate(skin.patches):
        own = np.flatnonzero(skin.patch_index == index)
        if not len(own):
            continue
        sheet, taxels = build_sheet(mesh, own)
        columns = np.einsum("tij,tj->ti", sheet.axes, skin.tangents[taxels])
        columns /= np.linalg.norm(columns, axis=1, keepdims=True)
        rows = np.column_stack([-columns[:, 1], columns[:, 0]])
        half = sheet.sides[:, None, None] / 2
        charts.append(
            Chart(
                link=patch.link,
                surface=sheet,
                taxels=taxels,
                unrolled=sheet.flat,
                cells=half * np.stack([columns, rows], axis=1),
                rim=rim,
                others=skin.patch_index[taxels] != index,
            )
        )
    return tuple(charts)


def build_chart(
    mounted: MountedSkin, link: str, surface: Surface, members: list[int], rim: float
) -> Chart:
    """Build the chart of a surface and its taxels."""
    taxels = np.sort(np.array(members, dtype=np.int64))
    skin = mounted.skin
    unrolled = surface.unroll(skin.positions[taxels])
    columns = compute_column_directions(surface, skin.tangents[taxels], unrolled)
    flat_areas = skin.areas[taxels] / surface.wrap(unrolled).area_scale
    cells = np.empty((len(taxels), 2, 2))
    for index in np.unique(skin.patch_index[taxels]):
        part = skin.patch_index[taxels] == index
        # A patch may lie across the line where s jumps.
        places = unrolled[part] - unrolled[part][0]
        places[:, 0] = wrap_difference(places[:, 0], compute_circumference(surface))
        rows = skin.rows[taxels[part]]
        cells[part] = compute_cells(places, columns[part], rows, flat_areas[part])
    return Chart(link, surface, taxels, unrolled, cells, rim)


def compute_column_directions(
    surface: Surface,
    tangents: Float[np.ndarray, "part 3"],
    unrolled: Float[np.ndarray, "part 2"],
) -> Float[np.ndarray, "part 2"]:
    """Return each taxel's tangent as a unit vector (s, t)."""
    wrapped = surface.wrap(unrolled)
    along_s = np.sum(tangents * wrapped.tangents, axis=1)
    t_axis = np.cross(wrapped.normals, wrapped.tangents)
    return np.column_stack([along_s, np.sum(tangents * t_axis, axis=1)])


def compute_cells(
    unrolled: Float[np.ndarray, "part 2"],
    columns: Float[np.ndarray, "part 2"],
    rows: Int[np.ndarray, "part"],
    areas: Float[np.ndarray, "part"],
) -> Float[np.ndarray, "part 2 2"]:
    """Return the half vectors of the cells of one patch, whose rows are evenly spaced.

    Args:
        unrolled: centres of taxels, near each other where the taxels are [m].
        columns: directions in which the columns follow each other.
        rows: row of each taxel.
        areas: area of each taxel as drawn flat [m2].
    """
    across = np.column_stack([-columns[:, 1], columns[:, 0]])
    height = np.sum(unrolled * across.mean(axis=0), axis=1)
    levels = [height[rows == row].mean() for row in np.unique(rows)]
    steps = np.abs(np.diff(levels)) / np.diff(np.unique(rows))
    pitch = np.median(steps) if len(steps) else np.sqrt(areas.mean())
    along = columns * (areas / pitch / 2)[:, None]
    return np.stack([along, across * pitch / 2], axis=1)
