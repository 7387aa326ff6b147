"""This module finds everything that is wrong with a skin, patch by patch."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import SkinError
from eskin.near import find_nearest, iterate_near_pairs
from eskin.robot import Robot, compute_surface_distance
from eskin.robot.urdf import LARGE
from eskin.skin.skin import Skin

MAX_NAMED = 8
"""Number of taxels that one line names."""


@dataclass(frozen=True)
class SkinProblem:
    """A problem says one thing that is wrong with a skin, and where."""

    text: str
    """The problem, the value that was found and those that are allowed."""
    kind: str
    """Word for the rule that is broken; problems of a kind differ in numbers alone."""
    patch: str | None = None
    taxel: int | None = None

    def __str__(self) -> str:
        """Return one line that names the patch and taxel."""
        where = []
        if self.patch is not None:
            where.append(f"patch '{' '.join(self.patch.split())}'")
        if self.taxel is not None:
            where.append(f"taxel {self.taxel}")
        return f"{', '.join(where)}: {self.text}" if where else self.text


def describe_problems(problems: Sequence[SkinProblem]) -> list[str]:
    """Describe problems in lines: ones of a patch that differ in numbers share one."""
    alike: dict[tuple[str | None, str], list[SkinProblem]] = {}
    for each in problems:
        alike.setdefault((each.patch, each.kind), []).append(each)
    lines = []
    for first, *others in alike.values():
        taxels = ", ".join(str(one.taxel) for one in others[:MAX_NAMED])
        rest = ", ..." if others[MAX_NAMED:] else ""
        more = f"; so {len(others)} more: taxels {taxels}{rest}" if others else ""
        lines.append(f"{first}{more}")
    return lines


@dataclass(frozen=True)
class CheckConfig:
    """A configuration holds the tolerances of the check."""

    max_surface_distance: float = 0.005
    """Largest distance of a taxel from its link's surface [m]."""
    min_taxel_distance: float = 0.0002
    """Smallest distance of two taxels of a link [m]."""
    min_fill: float = 0.2
    """Smallest ratio of the area of a taxel to the cell between its neighbours."""
    max_fill: float = 1.5
    """Largest ratio of the area of a taxel to its cell."""
    min_cosine: float = 0.5
    """Smallest cosine between a taxel's normal and its surface's."""


def check_skin(
    skin: Skin, robot: Robot | None = None, config: CheckConfig | None = None
) -> list[SkinProblem]:
    """Return everything that is wrong with a skin.

    Args:
        skin: the skin.
        robot: the robot with the skin; without one, links and surfaces are not checked.
        config: tolerances of the check.
    """
    config = config or CheckConfig()
    cell_areas, neighbour_normals = compare_neighbours(skin)
    problems = [
        *find_patch_problems(skin),
        *find_cell_problems(skin),
        *find_position_problems(skin),
        *find_fatal_problems(skin),
        *find_coincident_problems(skin, config),
        *find_area_problems(skin, cell_areas, config),
        *find_flipped_problems(skin, neighbour_normals),
    ]
    if robot is not None:
        problems += find_link_problems(skin, robot)
        problems += find_surface_problems(skin, robot, config)
    return problems


UNIT_ADVICE = "are its lengths millimetres? divide them by 1000"
FARTHEST = 1e6
"""Largest coordinate of a taxel in its link's frame [m]."""
EXACT = 4.0
"""Distance from a link up to which it is computed exactly, over the allowed one."""
TAXELS_AT_ONCE = 1000
"""Number of taxels between two updates of the progress."""
MAX_COINCIDENT = 64
"""Largest number of taxels in one point."""
MAX_CLOSE = 10
FREE_CLOSE = 100_000
"""Largest mean number of taxels within `CheckConfig.min_taxel_distance` of one, beyond
a number of pairs that is free."""


def check_crowding(skin: Skin, file: str) -> None:
    """Raise where so many taxels lie in one place that pairs of them fill the memory.

    Raises:
        SkinError: More than a few share a point, or lie closer than taxels can; the
            message names the file.
    """
    if not skin.count:
        return
    names = list(dict.fromkeys(skin.link_names))
    link_index = np.array([names.index(name) for name in skin.link_names])
    links = link_index[skin.patch_index]
    # The squares of distances must be finite.
    points = np.clip(skin.positions, -1e100, 1e100).round(6)
    _, counts = np.unique(np.column_stack([links, points]), axis=0, return_counts=True)
    close = 0
    most = MAX_CLOSE * skin.count + FREE_CLOSE
    if counts.max() <= MAX_COINCIDENT:
        for number in np.unique(links):
            on_link = points[links == number]
            close += count_close(on_link, CheckConfig.min_taxel_distance, most)
    if counts.max() > MAX_COINCIDENT or close > most:
        raise SkinError(
            f"{file}: got {max(counts.max(), close // skin.count)} taxels in one "
            f"place, allowed are up to {MAX_COINCIDENT} in a point, and {MAX_CLOSE} "
            f"within {1e3 * CheckConfig.min_taxel_distance:g} mm of one; correct the "
            "positions"
        )


def count_close(
    points: Float[np.ndarray, "point 3"], distance: float, most: int
) -> int:
    """Count the neighbours of points within a distance, until there are too many."""
    count = 0
    for one, _, _ in iterate_near_pairs(points, distance):
        count += len(one)
        if count > most:
            break
    return count


def find_patch_problems(skin: Skin) -> Iterator[SkinProblem]:
    """Find repeated patch ids and addresses, and patches without taxels."""
    ids = Counter(patch.id for patch in skin.patches)
    addresses: dict[int, str] = {}
    filled = set(skin.patch_index.tolist())
    for number, patch in enumerate(skin.patches):
        if ids[patch.id] > 1:
            text = f"{ids[patch.id]} patches have this id, allowed one"
            yield SkinProblem(text, "repeated id", patch.id)
        if patch.address in addresses:
            other = addresses[patch.address]
            text = (
                f"address {patch.address} is that of patch '{other}' too, allowed once"
            )
            yield SkinProblem(f"{text} in a skin", "repeated address", patch.id)
        addresses.setdefault(patch.address, patch.id)
        if number not in filled:
            text = "has no taxels, allowed one or more"
            yield SkinProblem(text, "no taxels", patch.id)


def find_cell_problems(skin: Skin) -> Iterator[SkinProblem]:
    """Find cells outside the patch, and cells that hold two taxels."""
    seen: dict[tuple[int, int, int], int] = {}
    places = zip(skin.patch_index, skin.rows, skin.columns, strict=True)
    for taxel, (number, row, column) in enumerate(places):
        patch = skin.patches[number]
        cell = (int(number), int(row), int(column))
        text = f"lies in {patch.describe_cell(int(row), int(column))}"
        if not (0 <= row < patch.rows and 0 <= column < patch.columns):
            text += "; allowed is a cell of the grid"
            yield SkinProblem(text, "cell outside", patch.id, taxel)
        elif cell in seen:
            text += f", where taxel {seen[cell]} is; allowed one taxel a cell"
            yield SkinProblem(text, "repeated cell", patch.id, taxel)
        seen.setdefault(cell, taxel)


def find_position_problems(skin: Skin) -> Iterator[SkinProblem]:
    """Find positions that are not finite, or nowhere near a robot."""
    bad = ~are_near(skin)
    for taxel in np.flatnonzero(bad).tolist():
        position = skin.positions[taxel].tolist()
        text = (
            f"its position is {position}, allowed finite numbers up to {FARTHEST:g} m"
        )
        yield SkinProblem(text, "far position", get_patch_id(skin, taxel), taxel)


def are_near(skin: Skin) -> Bool[np.ndarray, "taxel"]:
    """Return which positions are finite and not too large to compute with."""
    return np.all(np.abs(skin.positions) <= FARTHEST, axis=1)


def find_coincident_problems(skin: Skin, config: CheckConfig) -> Iterator[SkinProblem]:
    """Find taxels of one link that coincide."""
    links = np.array(skin.link_names)[skin.patch_index]
    finite = np.flatnonzero(are_near(skin))
    near = []
    for one, other, _ in iterate_near_pairs(
        skin.positions[finite], config.min_taxel_distance
    ):
        near += zip(finite[one].tolist(), finite[other].tolist(), strict=True)
    for first, second in sorted(near):
        if first < second and links[first] == links[second]:
            gap = np.linalg.norm(skin.positions[first] - skin.positions[second])
            text = (
                f"lies {1e3 * gap:.3g} mm from taxel {first} of patch "
                f"'{get_patch_id(skin, first)}', allowed "
                f"{1e3 * config.min_taxel_distance:g} mm or more"
            )
            yield SkinProblem(text, "same place", get_patch_id(skin, second), second)


def find_area_problems(
    skin: Skin, cell_areas: Float[np.ndarray, "taxel"], config: CheckConfig
) -> Iterator[SkinProblem]:
    """Find areas that are not positive, or do not fit between the neighbours."""
    fill = skin.areas / cell_areas
    fits = (fill >= config.min_fill) & (fill <= config.max_fill)
    bad = ~(np.isfinite(skin.areas) & (skin.areas > 0))
    for taxel in np.flatnonzero(bad | (np.isfinite(fill) & ~fits)).tolist():
        cell = 1e6 * cell_areas[taxel]
        limits = f"{config.min_fill * cell:.4g} to {config.max_fill * cell:.4g} mm2"
        allowed = f"{limits} at this spacing" if np.isfinite(cell) else "more than 0"
        text = f"has an area of {1e6 * skin.areas[taxel]:.4g} mm2, allowed {allowed}"
        yield SkinProblem(text, "area", get_patch_id(skin, taxel), taxel)


def find_flipped_problems(
    skin: Skin, neighbour_normals: Float[np.ndarray, "taxel 3"]
) -> Iterator[SkinProblem]:
    """Find normals that point against the neighbours' normals."""
    product = np.sum(skin.normals * neighbour_normals, axis=1)
    text = "its normal points against its neighbours' normals, allowed outward"
    for taxel in np.flatnonzero(product < -FLIPPED).tolist():
        yield SkinProblem(text, "flipped normal", get_patch_id(skin, taxel), taxel)


def find_link_problems(skin: Skin, robot: Robot) -> Iterator[SkinProblem]:
    """Find patches on links that the robot does not have."""
    for patch in skin.patches:
        if patch.link not in robot.link_names:
            yield SkinProblem(
                f"lies on link '{patch.link}', which robot '{robot.name}' does not "
                f"have; allowed {', '.join(robot.link_names)}",
                "unknown link",
                patch.id,
            )


def find_surface_problems(
    skin: Skin, robot: Robot, config: CheckConfig
) -> Iterator[SkinProblem]:
    """Find taxels off their link's surface, and normals that do not point outward."""
    limit = config.max_surface_distance
    distances, cosines = compute_clearances(skin, robot, EXACT * limit)
    off = ~(np.abs(distances) <= limit)
    for number, patch in enumerate(skin.patches):
        own = skin.patch_index == number
        for taxel in np.flatnonzero(own & off).tolist():
            distance = float(distances[taxel])
            side = "off" if distance > 0 else "below"
            about = "about " if abs(distance) > EXACT * limit else ""
            text = (
                f"lies {about}{1e3 * abs(distance):.3g} mm {side} the surface of link "
                f"'{patch.link}', allowed up to {1e3 * limit:g} mm"
            )
            yield SkinProblem(text, f"{side} the surface", patch.id, taxel)
        for taxel in np.flatnonzero(own & ~off & ~(cosines >= config.min_cosine)):
            text = f"its normal does not point out of link '{patch.link}'"
            yield SkinProblem(text, "inward normal", patch.id, int(taxel))


def compute_clearances(
    skin: Skin, robot: Robot, exact_to: float
) -> tuple[Float[np.ndarray, "taxel"], Float[np.ndarray, "taxel"]]:
    """Compute distances from links [m], and cosines between normals and theirs.

    The distance is 0 and the cosine 1 where a link has no shape or a position is not
    finite.
    """
    from eskin.progress import track_progress

    distances = np.zeros(skin.count)
    cosines = np.ones(skin.count)
    finite = are_near(skin)
    names = np.array(skin.link_names)[skin.patch_index]
    parts = [
        (link, part)
        for link in robot.links
        if link.geoms
        for own in [np.flatnonzero(finite & (names == link.name))]
        for part in np.array_split(own, len(own) // TAXELS_AT_ONCE + 1)
        if len(part)
    ]
    for link, part in track_progress(parts, "Checking", len(parts)):
        found, outward = compute_surface_distance(link, skin.positions[part], exact_to)
        distances[part] = found
        cosines[part] = np.sum(outward * skin.normals[part], axis=1)
    return distances, cosines


def get_patch_id(skin: Skin, taxel: int) -> str:
    """Return the id of a taxel's patch."""
    return skin.patches[skin.patch_index[taxel]].id


@np.errstate(over="ignore", invalid="ignore")
def compare_neighbours(
    skin: Skin,
) -> tuple[Float[np.ndarray, "taxel"], Float[np.ndarray, "taxel 3"]]:
    """Compute the cell of each taxel between its neighbours, and their normals.

    Neighbours are next to each other in the grid. In a patch of one row or column,
    which may be a list of taxels in any order, they are the nearest in space.

    Returns:
        The distance to the next taxel in the row times that in the column, NaN where
        unknown [m2]; and the sum of the neighbours' normals.
    """
    steps = np.full((2, skin.count), np.inf)
    normals = np.zeros((skin.count, 3))
    for row_step, column_step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        beside = find_neighbours(skin, row_step, column_step)
        known = np.flatnonzero(beside >= 0)
        axis = abs(row_step)
        other = beside[known]
        gap = np.linalg.norm(skin.positions[known] - skin.positions[other], axis=1)
        steps[axis, known] = np.minimum(steps[axis, known], gap)
        normals[known] += skin.normals[other]
    near = are_near(skin)
    for number, patch in enumerate(skin.patches):
        if min(patch.rows, patch.columns) > 1:
            continue
        # A list has cells that follow each other, wherever its taxels are.
        own = np.flatnonzero(near & (skin.patch_index == number))
        one, other, squared = find_nearest(skin.positions[own], LIST_NEIGHBOURS)
        steps[:, own] = np.inf
        normals[own] = 0.0
        np.minimum.at(steps[0], own[one], np.sqrt(squared))
        np.add.at(normals, own[one], skin.normals[own[other]])
    # Where only one direction is known, the cell is assumed to be a square.
    first = np.where(np.isfinite(steps[0]), steps[0], steps[1])
    second = np.where(np.isfinite(steps[1]), steps[1], steps[0])
    areas = first * second
    return np.where(np.isfinite(areas) & (areas > 0), areas, np.nan), normals


def find_neighbours(
    skin: Skin, row_step: int, column_step: int
) -> Int[np.ndarray, "taxel"]:
    """Return the taxel at an offset of rows and columns in the same patch, or -1."""
    if skin.count == 0:
        return np.zeros(0, dtype=np.int64)
    # Keys have a margin of one cell all round, so that no neighbour wraps around.
    height, width = int(skin.rows.max()) + 3, int(skin.columns.max()) + 3

    def keys(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        return (skin.patch_index * height + rows + 1) * width + columns + 1

    own = keys(skin.rows, skin.columns)
    order = np.argsort(own, kind="stable")
    wanted = keys(skin.rows + row_step, skin.columns + column_step)
    place = np.minimum(np.searchsorted(own[order], wanted), skin.count - 1)
    found = order[place]
    return np.where(own[found] == wanted, found, -1)


FLIPPED = 0.5
"""Negative of the largest inner product of a flipped normal and the sum of its
neighbours' normals; where one of two neighbours is flipped, it is about zero."""
LIST_NEIGHBOURS = 2
"""Number of nearest taxels that are neighbours in a patch of one row or column."""
DIRECTION_TOLERANCE = 1e-3
"""Largest error of the lengths of normal and tangent, and of their inner product."""


def find_fatal_problems(skin: Skin) -> list[SkinProblem]:
    """Find what a skin may not have in any file: wrong lengths and directions."""
    return [*find_size_problems(skin), *find_direction_problems(skin)]


def find_size_problems(skin: Skin) -> Iterator[SkinProblem]:
    """Find patches whose lengths seem to be in another unit than metres.

    Lengths of a skin that is not calibrated are nominal, and mean little.
    """
    if not skin.calibrated:
        return
    near = are_near(skin)
    for number, patch in enumerate(skin.patches):
        places = skin.positions[near & (skin.patch_index == number)]
        if len(places) == 0:
            continue
        width = float(np.ptp(places, axis=0).max())
        away = float(np.linalg.norm(places, axis=1).max())
        if width > LARGE:
            text = f"is {width:.3g} m wide"
        elif away > LARGE:
            text = f"lies {away:.3g} m from the frame of link '{patch.link}'"
        else:
            continue
        text = f"{text}, allowed up to {LARGE:g} m: {UNIT_ADVICE}"
        yield SkinProblem(text, "large patch", patch.id)


@np.errstate(over="ignore", invalid="ignore")
def find_direction_problems(skin: Skin) -> list[SkinProblem]:
    """Find normals and tangents that are not unit vectors at right angles."""
    lengths = np.linalg.norm(skin.normals, axis=1)
    spans = np.linalg.norm(skin.tangents, axis=1)
    units = ~is_not_unit(lengths) & ~is_not_unit(spans)
    products = np.abs(np.sum(skin.normals * skin.tangents, axis=1))
    right_angle = "tangent is not at a right angle to the normal: their product is"
    skewed = ~(products <= DIRECTION_TOLERANCE) & units
    return [
        SkinProblem(
            f"{what} {got[taxel]:.6g}, allowed {allowed} {DIRECTION_TOLERANCE:g}",
            what,
            get_patch_id(skin, taxel),
            taxel,
        )
        for what, got, wrong, allowed in (
            ("normal has length", lengths, is_not_unit(lengths), "1 +-"),
            ("tangent has length", spans, is_not_unit(spans), "1 +-"),
            (right_angle, products, skewed, "up to"),
        )
        for taxel in np.flatnonzero(wrong).tolist()
    ]


def is_not_unit(lengths: Float[np.ndarray, "taxel"]) -> np.ndarray:
    """Return where a length is not 1; NaN is not."""
    return ~(np.abs(lengths - 1.0) <= DIRECTION_TOLERANCE)
