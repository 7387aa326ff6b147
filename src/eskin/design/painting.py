"""This module turns what a person paints on a robot into regions of a specification."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from eskin.design.spec import MM, PER_CM2, Ball, RegionEntry, SpecFile, ZoneEntry
from eskin.design.surface import LinkSurface, build_link_surface
from eskin.design.zones import Vector, Zone
from eskin.errors import RobotError
from eskin.robot import Robot
from eskin.skin import Patch, Skin

SPACING = 0.01
"""Distance of neighbouring points [m]."""
MAX_POINTS = 20_000
"""Number of points above which they are laid less densely."""
DECIMALS = 3
"""Decimals of the lengths in a specification [mm]."""


@dataclass(frozen=True)
class PaintedBall:
    """A painted ball is one dab of the brush."""

    link: str
    """Link that was painted on."""
    point: Vector
    """Point of its surface [m]."""
    radius: float
    """Radius of the brush [m]."""
    keeps_out: bool
    """Whether no skin is to lie there."""


def sample_surfaces(robot: Robot, links: Sequence[str] = ()) -> Skin:
    """Spread points over the surfaces of links, as a skin with a patch for each link.

    Args:
        robot: the robot.
        links: names of the links; all that have a shape where none are given.

    Raises:
        RobotError: The robot lacks a link, or no link has a shape.
    """
    names = links or [link.name for link in robot.links if link.geoms]
    surfaces = []
    problems = []
    for name in names:
        link = robot.links[robot.link_index(name)]
        try:
            surfaces.append(build_link_surface(link, SPACING))
        except RobotError as error:
            if links:
                raise
            problems.append(error)
    if not surfaces and problems:
        raise problems[0]
    if not surfaces:
        raise RobotError(
            f"robot '{robot.name}' has no link with a shape to paint on; load it with "
            "its meshes, or choose another"
        )
    area = sum(compute_vertex_areas(surface).sum() for surface in surfaces)
    spacing = max(SPACING, float(np.sqrt(area / MAX_POINTS)))
    points = [thin_vertices(surface, spacing) for surface in surfaces]
    counts = [len(each) for each in points]
    rows = np.concatenate([np.arange(count) for count in counts])
    table = np.concatenate(points)
    return Skin(
        name="surface",
        patches=tuple(
            Patch(surface.link, surface.link, number + 1, count, 1)
            for number, (surface, count) in enumerate(
                zip(surfaces, counts, strict=True)
            )
        ),
        patch_index=np.repeat(np.arange(len(surfaces)), counts),
        rows=rows,
        columns=np.zeros_like(rows),
        positions=table[:, :3],
        normals=table[:, 3:6],
        areas=table[:, 6],
        tangents=find_tangents(table[:, 3:6]),
    )


def thin_vertices(surface: LinkSurface, spacing: float) -> Float[np.ndarray, "point 7"]:
    """Return position, normal and area of the mean vertex in each cube of a grid."""
    areas = compute_vertex_areas(surface)
    normals = surface.sum_at_vertices(surface.doubled_normals)
    length = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    normals /= length
    # Faces of a thin plate that share a cube are told apart by their normals.
    keys = np.column_stack(
        [np.floor(surface.vertices / spacing), np.round(normals)]
    ).astype(np.int64)
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    group = group.ravel()
    total = np.bincount(group, areas)
    # The vertex nearest to the middle of its group lies on the surface; a mean may not.
    middle = (
        np.column_stack(
            [np.bincount(group, areas * axis) for axis in surface.vertices.T]
        )
        / np.maximum(total, 1e-30)[:, None]
    )
    away = np.linalg.norm(surface.vertices - middle[group], axis=1)
    order = np.lexsort([away, group])
    chosen = order[np.searchsorted(group[order], np.arange(len(first)))]
    return np.column_stack([surface.vertices[chosen], normals[chosen], total])


def compute_vertex_areas(surface: LinkSurface) -> Float[np.ndarray, "vertex"]:
    """Return a third of the area of the triangles at each vertex [m2]."""
    return surface.sum_at_vertices(np.linalg.norm(surface.doubled_normals, axis=1) / 6)


def find_tangents(
    normals: Float[np.ndarray, "point 3"],
) -> Float[np.ndarray, "point 3"]:
    """Return a unit vector across each normal."""
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    across = np.cross(normals, least)
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def find_points(skin: Skin, zones: Iterable[Zone]) -> Bool[np.ndarray, "point"]:
    """Return which points of `sample_surfaces` lie in any of some zones."""
    found = np.zeros(skin.count, dtype=bool)
    links = np.array(skin.link_names)[skin.patch_index]
    for zone in zones:
        found |= zone.contains(skin.positions) & (links == zone.link)
    return found


def add_painted(
    entries: SpecFile, balls: Sequence[PaintedBall], density: float | None
) -> SpecFile:
    """Return a specification with what was painted before its other entries.

    Args:
        entries: the specification.
        balls: balls of all strokes; those on one link become one region.
        density: density of the painted regions [1/m2]; None for that of the command
            that designs the skin.
    """
    regions = []
    keep_outs = []
    for link in dict.fromkeys(ball.link for ball in balls):
        skin, none = (
            [describe_ball(b) for b in balls if (b.link, b.keeps_out) == (link, kind)]
            for kind in (False, True)
        )
        if skin:
            per_cm2 = None if density is None else density / PER_CM2
            regions.append(
                RegionEntry(link=link, balls_mm=skin, density_per_cm2=per_cm2)
            )
        if none:
            keep_outs.append(ZoneEntry(link=link, balls_mm=none))
    return SpecFile(
        regions=[*regions, *entries.regions], keep_out=[*keep_outs, *entries.keep_out]
    )


def describe_ball(ball: PaintedBall) -> Ball:
    """Return x, y, z and radius of a ball [mm]."""
    return [round(length / MM, DECIMALS) for length in (*ball.point, ball.radius)]
