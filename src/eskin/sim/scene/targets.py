"""This module finds touch targets: the places on a skin that a touch may aim at."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from eskin.sim.constants import MM, Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.sheet import Sheet
from eskin.skin import Skin, Tube

REGIONS = ("forearm", "upper_arm", "wrists")
SLIDE = 1
CLOSE = 2
"""What a place must allow: that a hand slides along it, or closes round it."""
INNER = 0
EDGE = 1
SEAM = 2
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
    allows: tuple[int, ...]
    """What each chart allows: `CLOSE`, and so `SLIDE`; `SLIDE` alone; or 0."""

    @cached_property
    def by_kind(self) -> dict[tuple[int, int, int], Int[np.ndarray, "_"]]:
        """Return targets by region, kind, and what they must allow."""
        allows = np.array(self.allows, dtype=np.int64)[self.chart]
        return {
            (region, kind, least): np.flatnonzero(
                (self.region == region) & (self.kind == kind) & (allows >= least)
            )
            for region in range(len(REGIONS))
            for kind in (INNER, EDGE, SEAM)
            for least in (0, SLIDE, CLOSE)
        }


def build_targets(
    skin: Skin, charts: tuple[Chart, ...], constants: Constants
) -> TouchTargets:
    """Build all targets on a skin."""
    all_edges = tuple(find_patch_edges(skin, chart) for chart in charts)
    allows = tuple(find_allowed(chart, constants) for chart in charts)
    parts = [
        build_chart_targets(chart, edges, constants)
        for chart, edges in zip(charts, all_edges, strict=True)
    ]
    counts = [len(part[0]) for part in parts]
    regions = [
        find_region(chart, least > 0)
        for chart, least in zip(charts, allows, strict=True)
    ]
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
        allows=allows,
    )


def find_region(chart: Chart, tube: bool) -> int:
    """Return the region of a chart; all but the two long tubes count as wrists."""
    long = {"forearm_link": "forearm", "upper_arm_link": "upper_arm"}
    return REGIONS.index(long.get(chart.link, "wrists") if tube else "wrists")


def find_allowed(chart: Chart, constants: Constants) -> int:
    """Find whether a hand can be closed round a chart and slide along it.

    A hand closes round a tube, and round a sheet that is bent as much as a limb and has
    skin on its other side.
    """
    length = np.ptp(chart.unrolled[:, 1])
    if length < constants.value("place.tube") * MM:
        return 0
    if not isinstance(chart.surface, Sheet):
        return CLOSE if isinstance(chart.surface, Tube) else 0
    normals = chart.surface.normals
    cosine = normals @ chart.surface.T_link_surface[:3, 2]
    limb = constants.value("place.limb") * MM
    near = np.linalg.norm(chart.unrolled, axis=1) <= np.pi * limb
    thin = chart.radius <= limb and bool(np.any(near & (cosine < OTHER_SIDE)))
    return CLOSE if thin else SLIDE


OTHER_SIDE = -0.5
"""Cosine of the angle of normals from which on skin is on the other side of a limb."""
NEAR_OWN = 0.02
"""Distance from a chart's own taxels within which edges are looked for [m]."""


def find_patch_edges(skin: Skin, chart: Chart) -> PatchEdges:
    """Find points on the edges of cells that no cell of the patch adjoins."""
    if chart.others is not None:
        own = chart.unrolled[chart.own]
        low, high = own.min(axis=0) - NEAR_OWN, own.max(axis=0) + NEAR_OWN
        near = ((chart.unrolled >= low) & (chart.unrolled <= high)).all(axis=1)
        chart = replace(
            chart,
            taxels=chart.taxels[near],
            unrolled=chart.unrolled[near],
            cells=chart.cells[near],
            others=chart.others[near],
        )
    patch = skin.patch_index[chart.taxels]
    rows = skin.rows[chart.taxels]
    columns = skin.columns[chart.taxels]
    taken = set(zip(patch.tolist(), rows.tolist(), columns.tolist(), strict=True))
    points = []
    outward = []
    for axis, (row_step, column_step) in enumerate(((0, 1), (1, 0))):
        along = chart.cells[:, axis]
        across = chart.cells[:, 1 - axis]
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


def compute_edge_distance(
    chart: Chart, edges: PatchEdges, places: Float[np.ndarray, "place 2"]
) -> Float[np.ndarray, "place"]:
    """Return how far each place is from the nearest edge of a patch [m]."""
    if chart.others is not None:
        return KDTree(edges.points).query(places)[0]
    nearest = np.empty(len(places))
    for first in range(0, len(places), TARGET_BLOCK):
        part = slice(first, first + TARGET_BLOCK)
        away = edges.points[None] - places[part][:, None]
        away[..., 0] = chart.wrap_s(away[..., 0])
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
    cells = chart.cells[chart.own]
    at = chart.unrolled[chart.own][:, None] + np.einsum("qa,tad->tqd", QUARTERS, cells)
    unrolled = at.reshape(-1, 2)
    half = np.repeat(cells / 2, len(QUARTERS), axis=0)
    near = compute_edge_distance(chart, edges, unrolled) <= (
        constants.value("place.edge_within") * MM
    )
    seam = find_seams(chart, edges, constants.value("place.seam_gap") * MM)
    if chart.others is not None:
        # A seam between two patches is on the charts of both; each has half of it.
        nearest = np.argmin(
            np.linalg.norm(seam[:, None] - chart.unrolled[None], axis=2), axis=1
        )
        seam = seam[~chart.others[nearest]]
    kind = np.concatenate([np.where(near, EDGE, INNER), np.full(len(seam), SEAM)])
    half = np.concatenate([half, np.zeros((len(seam), 2, 2))])
    return np.concatenate([unrolled, seam]), half, kind


def find_seams(
    chart: Chart, edges: PatchEdges, widest: float
) -> Float[np.ndarray, "target 2"]:
    """Find the points (s, t) midway between edges that face each other [m]."""
    points = edges.points
    outward = edges.outward
    # Around a tube, points are repeated a turn before and a turn after.
    turns = (0.0,) if np.isinf(chart.circumference) else (0.0, -1.0, 1.0)
    whole = chart.circumference if len(turns) > 1 else 0.0
    repeated = np.concatenate([points + [turn * whole, 0.0] for turn in turns])
    tree = KDTree(repeated)
    near = tree.query_ball_point(points, widest * (1 + 1e-9))
    first = np.repeat(np.arange(len(points)), [len(each) for each in near])
    other = np.concatenate(near).astype(np.int64) % len(points)
    away = points[other] - points[first]
    away[:, 0] = chart.wrap_s(away[:, 0])
    length = np.linalg.norm(away, axis=1)
    ahead = np.sum(away * outward[first], axis=1)
    facing = np.sum(outward[first] * outward[other], axis=1) < -0.5
    kept = np.flatnonzero(facing & (ahead > 0) & (length <= widest))
    # Of the edges that face one, the nearest counts, and of those the first.
    kept = kept[np.lexsort((other[kept], length[kept], first[kept]))]
    _, nearest = np.unique(first[kept], return_index=True)
    kept = kept[nearest]
    return points[first[kept]] + away[kept] / 2
