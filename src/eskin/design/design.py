"""This module designs the skin of a robot from its shapes and a specification."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np
from jaxtyping import Bool

from eskin.design.patches import (
    PatchLayout,
    RegionTask,
    compute_area,
    find_adjacency,
    lay_patches,
)
from eskin.design.spec import PER_CM2, DesignLimits, DesignSpec, RegionSpec
from eskin.design.surface import (
    MAX_TRIANGLES,
    LinkSurface,
    build_two_surfaces,
    find_invented_vertices,
)
from eskin.design.zones import (
    compute_exposure,
    find_close_points,
    iterate_combined_poses,
    iterate_relative_poses,
)
from eskin.errors import RobotError, SkinError
from eskin.progress import track_progress
from eskin.robot import Robot
from eskin.skin import Patch, Skin, build_skin
from eskin.skin.files import MAX_PATCHES
from eskin.skin.taxel_table import MAX_TAXELS

EDGE = 0.45
"""Length of the triangles' edges over the spacing of the taxels."""
LEAST_EDGE = 0.0015
MOST_EDGE = 0.01
"""Smallest and largest length of the triangles' edges [m]."""


@dataclass(frozen=True, eq=False)
class RegionResult:
    """A result says what was reached in one region."""

    region: RegionSpec
    """Region that was asked for."""
    area: float
    """Area of the region on the surface of its link [m2]."""
    allowed_area: float
    """Area without keep-out zones, hidden places and swept clearances [m2]."""
    patches: tuple[int, ...]
    """Indices of its patches."""


@dataclass(frozen=True, eq=False)
class SkinDesign:
    """A design holds a skin, and the flat layout of every patch."""

    skin: Skin
    layouts: tuple[PatchLayout, ...]
    """Layout of each patch, in the order of the skin."""
    regions: tuple[RegionResult, ...]
    """Results of the regions, in the order of the specification."""
    spec: DesignSpec
    close: Bool[np.ndarray, "taxel"]
    """Taxels that come within the clearance of another link in a combined pose."""
    warnings: tuple[str, ...]
    """What was repaired or left out, one line each."""


def design_skin(robot: Robot, spec: DesignSpec, seed: int = 0) -> SkinDesign:
    """Design a skin.

    The same robot, specification and seed give the same skin. The seed chooses where
    the grids of the patches begin.

    Args:
        robot: the robot.
        spec: the specification.
        seed: seed of the random choices.

    Raises:
        RobotError: A region lies on a link that the robot lacks, or that has no shape.
        SkinError: The regions have no room for a patch, or the density asks for a
            smaller spacing than is allowed.
    """
    check_spec(robot, spec)
    fine, coarse, warnings = build_surfaces(robot, spec)
    allowed = find_allowed_vertices(robot, spec, fine, coarse)
    taken = {name: np.zeros(len(own.faces), bool) for name, own in fine.items()}
    layouts: list[PatchLayout] = []
    patches: list[Patch] = []
    results = []
    for number, region in enumerate(spec.regions):
        link = region.zone.link
        surface = fine[link]
        corners = region.zone.contains(surface.vertices)[surface.faces].all(axis=1)
        own = corners & ~taken[link]
        taken[link] |= own
        usable = own & allowed[link][surface.faces].all(axis=1)
        task = RegionTask(
            surface,
            find_adjacency(surface, spec.limits.max_bend),
            compute_pitch(region),
            spec.limits,
            spec.keep_outs,
            np.random.default_rng([seed, number]),
        )
        first = len(layouts)
        laid = lay_patches(task, np.flatnonzero(usable))
        found = list(islice(laid, MAX_PATCHES + 1))
        layouts += found
        if len(layouts) > MAX_PATCHES:
            raise SkinError(
                f"{len(spec.regions)} regions need more than {MAX_PATCHES} patches, "
                "which are allowed; lower the density, choose fewer links, or boards "
                "of more rows and columns"
            )
        patches += name_patches(found, region, first, patches)
        results.append(
            RegionResult(
                region,
                compute_area(surface, np.flatnonzero(own)),
                compute_area(surface, np.flatnonzero(usable)),
                tuple(range(first, len(layouts))),
            )
        )
    if not layouts:
        raise SkinError(
            f"no patch of {spec.limits.min_taxels} taxels has room on "
            f"{len(spec.regions)} regions; ask for a higher density, a smaller "
            "clearance, or other links"
        )
    placed = [
        (patch, layout.grid, layout.surface)
        for patch, layout in zip(patches, layouts, strict=True)
    ]
    skin = build_skin(spec.name, placed)
    close = find_close_taxels(robot, skin, coarse, spec.limits)
    return SkinDesign(
        skin, tuple(layouts), tuple(results), spec, close, tuple(warnings)
    )


def check_spec(robot: Robot, spec: DesignSpec) -> None:
    """Raise where a specification does not fit the robot, or asks for too much."""
    for zone in (*(region.zone for region in spec.regions), *spec.keep_outs):
        robot.link_index(zone.link)
    if not spec.regions:
        raise SkinError(
            f"robot '{robot.name}' has no link with a shape to cover; load it with its "
            "meshes, or give regions"
        )
    for region in spec.regions:
        pitch = compute_pitch(region)
        if pitch < spec.limits.min_spacing:
            most = 1 / spec.limits.min_spacing**2 / PER_CM2
            raise SkinError(
                f"region on link '{region.zone.link}' asks for "
                f"{region.density / PER_CM2:g} taxels/cm2, which lie {1e3 * pitch:.3g} "
                f"mm apart; allowed are {1e3 * spec.limits.min_spacing:g} mm or more, "
                f"up to {most:.3g} taxels/cm2; lower the density or the least spacing"
            )


def compute_pitch(region: RegionSpec) -> float:
    """Return the distance of neighbouring taxels at a region's density [m]."""
    return 1.0 / np.sqrt(region.density)


def build_surfaces(
    robot: Robot, spec: DesignSpec
) -> tuple[dict[str, LinkSurface], dict[str, LinkSurface], list[str]]:
    """Build the surfaces of the links to cover, and simpler ones of all links.

    Returns:
        Surfaces of small triangles of the links with regions, those of all links with
        a shape, and what was repaired.
    """
    fine = {}
    coarse = {}
    warnings = []
    room = MAX_TRIANGLES
    pitches: dict[str, float] = {}
    for region in spec.regions:
        pitch = compute_pitch(region)
        pitches[region.zone.link] = min(pitch, pitches.get(region.zone.link, np.inf))
    for link in track_progress(robot.links, "links read", len(robot.links)):
        if not link.geoms and link.name not in pitches:
            continue
        edge = None
        if link.name in pitches:
            edge = float(np.clip(EDGE * pitches[link.name], LEAST_EDGE, MOST_EDGE))
        try:
            coarse[link.name], small = build_two_surfaces(link, edge, room)
        except RobotError as error:
            if link.name in pitches:
                raise
            warnings.append(f"{error}; it is no obstacle")
            continue
        warnings += coarse[link.name].warnings
        if small is not None:
            fine[link.name] = small
            room -= len(small.faces)
    check_taxels(spec, fine)
    return fine, coarse, warnings


def check_taxels(spec: DesignSpec, fine: dict[str, LinkSurface]) -> None:
    """Raise where the regions have room for more taxels than a skin may have."""
    total = 0.0
    for region in spec.regions:
        surface = fine[region.zone.link]
        inside = region.zone.contains(surface.vertices)[surface.faces].all(axis=1)
        area = compute_area(surface, np.flatnonzero(inside))
        total += area * region.density
        if total > MAX_TAXELS:
            raise SkinError(
                f"link '{surface.link}' is {surface.describe_size()} large: its region "
                f"of {area:.3g} m2 has room for {area * region.density:.3g} taxels; "
                f"allowed: {MAX_TAXELS:,} on all links; lower the density, choose "
                "fewer links, or scale its shape if its lengths are not metres"
            )


def find_allowed_vertices(
    robot: Robot,
    spec: DesignSpec,
    fine: dict[str, LinkSurface],
    coarse: dict[str, LinkSurface],
) -> dict[str, Bool[np.ndarray, "vertex"]]:
    """Return the vertices that can be touched, and lie in no keep-out or clearance."""
    poses = iterate_relative_poses(robot, list(coarse))
    if spec.limits.clears_poses:
        combined = iterate_combined_poses(robot, list(coarse), spec.limits.poses)
        poses = chain(poses, combined)
    points = {name: surface.vertices for name, surface in fine.items()}
    swept = find_close_points(points, coarse, poses, spec.limits.clearance)
    for name, surface in fine.items():
        if surface.warnings:
            link = robot.links[robot.link_index(name)]
            swept[name] |= find_invented_vertices(link, surface)
        exposure = compute_exposure(surface, coarse[name])
        swept[name] |= exposure < spec.limits.min_exposure
    for zone in spec.keep_outs:
        if zone.link in swept:
            swept[zone.link] |= zone.contains(fine[zone.link].vertices)
    return {name: ~mask for name, mask in swept.items()}


def find_close_taxels(
    robot: Robot, skin: Skin, surfaces: dict[str, LinkSurface], limits: DesignLimits
) -> Bool[np.ndarray, "taxel"]:
    """Find the taxels that come close to another link in combined poses."""
    links = np.array([patch.link for patch in skin.patches])[skin.patch_index]
    own = {str(name): np.flatnonzero(links == name) for name in np.unique(links)}
    points = {name: skin.positions[taxels] for name, taxels in own.items()}
    poses = iterate_combined_poses(robot, list(surfaces), limits.poses)
    found = find_close_points(points, surfaces, poses, limits.clearance)
    close = np.zeros(skin.count, dtype=bool)
    for name, taxels in own.items():
        close[taxels] = found[name]
    return close


def name_patches(
    found: Sequence[PatchLayout],
    region: RegionSpec,
    first: int,
    earlier: Sequence[Patch],
) -> list[Patch]:
    """Give the patches of a region names, and addresses from 1 on."""
    link = region.zone.link
    before = sum(patch.link == link for patch in earlier)
    return [
        Patch(
            f"{link}_{before + number + 1}",
            link,
            first + number + 1,
            layout.grid.rows,
            layout.grid.columns,
        )
        for number, layout in enumerate(found)
    ]
