"""This module finds touch targets: the places on a skin that a touch may aim at."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.constants import MM, Constants
from eskin.sim.contact.chart import Chart
from eskin.skin import Skin, Tube

REGIONS = ("forearm", "upper_arm", "wrists")
INNER, EDGE, SEAM = 0, 1, 2
TARGET_BLOCK = 1024
"""Targets whose distances are held in memory at a time."""
QUARTERS = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]])
"""Centres of the quarters of a cell, in half cells along columns and rows."""


@dataclass(frozen=True, eq=False)
class PatchEdges:
    """Patch edges are points along the outlines of the patches of a chart."""

    points: Float[np.ndarray, "point 2"]
    """Points along the edges (s, t) [m]."""
    outward: Float[np.ndarray, "point 2"]
    """Unit directions (s, t) off the patch."""


@dataclass(frozen=True, eq=False)
class TouchTargets:
    """Touch targets are quarters of taxel cells and points of seams between patches."""

    chart: Int[np.ndarray, "target"]
    """Index of the chart."""
    region: Int[np.ndarray, "target"]
    """Index into `REGIONS`."""
    kind: Int[np.ndarray, "target"]
    """`INNER` of a patch, `EDGE` near its outline, or `SEAM` between two patches."""
    unrolled: Float[np.ndarray, "target 2"]
    """Position (s, t) on the chart [m]."""
    half_cells: Float[np.ndarray, "target 2 2"]
    """Half of the quarter cell as two vectors (s, t) [m]; zero for seams."""
    positions: Float[np.ndarray, "target 3"]
    """Positions in the frame of the chart's link [m]."""
    normals: Float[np.ndarray, "target 3"]
    """Outward unit normals in that frame."""
    areas: Float[np.ndarray, "target"]
    """Areas [m2]."""
    edges: tuple[PatchEdges, ...]
    """Edges of the patches of each chart."""
    tubes: tuple[bool, ...]
    """Whether a hand can close round each chart and slide along it."""

    @cached_property
    def by_kind(self) -> dict[tuple[int, int, bool], Int[np.ndarray, "_"]]:
        """Return targets by region, kind, and whether they must be on a tube."""
        tube = np.array(self.tubes, dtype=bool)[self.chart]
        return {
            (region, kind, only): np.flatnonzero(
                (self.region == region) & (self.kind == kind) & (tube | (not only))
            )
            for region in range(len(REGIONS))
            for kind in (INNER, EDGE, SEAM)
            for only in (False, True)
        }


def build_targets(
    skin: Skin, charts: tuple[Chart, ...], constants: Constants
) -> TouchTargets:
    """Build all targets on a skin."""
    all_edges = tuple(find_patch_edges(skin, chart) for chart in charts)
    tubes = tuple(is_tube(chart, constants) for chart in charts)
    parts = [
        build_chart_targets(chart, edges, constants)
        for chart, edges in zip(charts, all_edges, strict=True)
    ]
    counts = [len(part[0]) for part in parts]
    regions = [find_region(c, tube) for c, tube in zip(charts, tubes, strict=True)]
    unrolled, half, kind = (
        np.concatenate([part[i] for part in parts]) for i in range(3)
    )
    wraps = [
        chart.surface.wrap(part[0]) for chart, part in zip(charts, parts, strict=True)
    ]
    # Seams are drawn as a kind of their own, so all of them may have the same area.
    areas = 4 * np.abs(np.linalg.det(half))
    return TouchTargets(
        chart=np.repeat(np.arange(len(charts)), counts),
        region=np.repeat(np.array(regions, dtype=np.int64), counts),
        kind=kind,
        unrolled=unrolled,
        half_cells=half,
        positions=np.concatenate([wrap.positions for wrap in wraps]),
        normals=np.concatenate([wrap.normals for wrap in wraps]),
        areas=np.where(kind == SEAM, np.mean(areas[kind != SEAM]), areas),
        edges=all_edges,
        tubes=tubes,
    )


def find_region(chart: Chart, tube: bool) -> int:
    """Return the region of a chart; all but the two long tubes count as wrists."""
    long = {"forearm_link": "forearm", "upper_arm_link": "upper_arm"}
    return REGIONS.index(long.get(chart.link, "wrists") if tube else "wrists")


def is_tube(chart: Chart, constants: Constants) -> bool:
    """Tell whether a hand can be closed round a chart and slide along it."""
    length = np.ptp(chart.unrolled[:, 1])
    long = length >= constants.value("place.tube") * MM
    return bool(long) and isinstance(chart.surface, Tube)


def find_patch_edges(skin: Skin, chart: Chart) -> PatchEdges:
    """Find points on the edges of cells that no cell of the patch adjoins."""
    patch, rows = skin.patch_index[chart.taxels], skin.rows[chart.taxels]
    columns = skin.columns[chart.taxels]
    taken = set(zip(patch.tolist(), rows.tolist(), columns.tolist(), strict=True))
    points, outward = [], []
    for axis, (row_step, column_step) in enumerate(((0, 1), (1, 0))):
        along, across = chart.cells[:, axis], chart.cells[:, 1 - axis]
        for sign in (-1, 1):
            beside = zip(
                patch.tolist(),
                (rows + sign * row_step).tolist(),
                (columns + sign * column_step).tolist(),
                strict=True,
            )
            free = np.array([cell not in taken for cell in beside], dtype=bool)
            for share in (-2 / 3, 0.0, 2 / 3):
                offset = sign * along[free] + share * across[free]
                points.append(chart.unrolled[free] + offset)
                outward.append(sign * along[free])
    directions = np.concatenate(outward)
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    return PatchEdges(np.concatenate(points), directions / lengths)


def compute_offsets(
    chart: Chart, places: Float[np.ndarray, "place 2"], to: Float[np.ndarray, "point 2"]
) -> Float[np.ndarray, "place point 2"]:
    """Return the offset from each place to each point, the shorter way round [m]."""
    away = to[None] - places[:, None]
    away[..., 0] = chart.wrap_s(away[..., 0])
    return away


def compute_edge_distance(
    chart: Chart, edges: PatchEdges, places: Float[np.ndarray, "place 2"]
) -> Float[np.ndarray, "place"]:
    """Return how far each place is from the nearest edge of a patch [m]."""
    nearest = np.empty(len(places))
    for first in range(0, len(places), TARGET_BLOCK):
        part = slice(first, first + TARGET_BLOCK)
        away = compute_offsets(chart, places[part], edges.points)
        nearest[part] = np.sqrt(np.min(np.sum(away**2, axis=2), axis=1))
    return nearest


def build_chart_targets(
    chart: Chart, edges: PatchEdges, constants: Constants
) -> tuple[
    Float[np.ndarray, "target 2"],
    Float[np.ndarray, "target 2 2"],
    Int[np.ndarray, "target"],
]:
    """Return positions (s, t), half cells and kinds of the targets on one chart."""
    at = chart.unrolled[:, None] + np.einsum("qa,tad->tqd", QUARTERS, chart.cells)
    unrolled = at.reshape(-1, 2)
    half = np.repeat(chart.cells / 2, len(QUARTERS), axis=0)
    near = compute_edge_distance(chart, edges, unrolled) <= (
        constants.value("place.edge_within") * MM
    )
    seam = find_seams(chart, edges, constants.value("place.seam_gap") * MM)
    kind = np.concatenate([np.where(near, EDGE, INNER), np.full(len(seam), SEAM)])
    half = np.concatenate([half, np.zeros((len(seam), 2, 2))])
    return np.concatenate([unrolled, seam]), half, kind


def find_seams(
    chart: Chart, edges: PatchEdges, widest: float
) -> Float[np.ndarray, "target 2"]:
    """Find the points (s, t) midway between edges that face each other [m]."""
    away = compute_offsets(chart, edges.points, edges.points)
    length = np.linalg.norm(away, axis=2)
    ahead = np.einsum("ijd,id->ij", away, edges.outward)
    facing = edges.outward @ edges.outward.T < -0.5
    gap = np.where(facing & (ahead > 0) & (length <= widest), length, np.inf)
    first = np.flatnonzero(np.isfinite(gap.min(axis=1)))
    other = np.argmin(gap[first], axis=1)
    return edges.points[first] + away[first, other] / 2
