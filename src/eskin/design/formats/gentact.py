"""This module reads and writes the CSV files of GenTact.

They hold numbered positions, most with a radius and the path of the object they lie
on. Normals are taken from the robot's surface.
"""

import csv
import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import numpy as np

from eskin.design.formats.patch_taxels import (
    PatchTaxels,
    estimate_areas,
    join_patches,
    read_source,
)
from eskin.errors import SkinError
from eskin.files import atomic_path, parse_number
from eskin.robot import Robot, compute_surface_distance
from eskin.skin.skin import Skin
from eskin.skin.taxel_table import (
    MAX_TABLE_BYTES,
    MAX_TAXELS,
    compute_default_tangents,
)

GENTACT_HEAD = ("Index", "X", "Y", "Z", "Radius", "Parent")
ELECTRODES = "Index,X (mm),Y (mm),Z (mm)"
VERTICES = "Index,X,Y,Z,Object Name"
HEADS = (
    ",".join(GENTACT_HEAD),
    "Index,X,Y,Z,NormX,NormY,NormZ,Radius,Parent,Object Name in Blender",
    "Index,X,Y,Z,Stem X,Stem Y,Stem Z,Radius,Parent",
    ELECTRODES,
    VERTICES,
)
"""Headers of the files that the versions of GenTact write."""
MM = 1e-3
MAX_RADIUS = 0.1
"""Largest radius of a taxel that is told in metres; larger ones are millimetres."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Electrode:
    """An electrode is one taxel of a file."""

    index: int
    skin: str
    """Name of the skin inside which the index counts; empty where it is the file."""
    parent: str
    place: tuple[float, ...]
    """Position in the unit of the file."""
    radius: float
    """Radius in that unit; NaN where the file has none."""


def read_gentact(path: Path, name: str, robot: Robot, link: str | None = None) -> Skin:
    """Read a CSV file of GenTact; normals are taken from the robot's surface.

    A patch is one parent in the file: the last part of its path that is a link of the
    robot, and what follows as the name of the patch; or a skin that the file names.
    Taxels are in the order of their `Index`.

    Args:
        path: the file.
        name: name of the skin.
        robot: robot with the shapes of its links.
        link: link that all lie on; None for the parents in the file.

    Raises:
        SkinError: The file cannot be read, has an error, or names no link.
        RobotError: A link has no shape.
    """
    try:
        text = read_source(path, MAX_TABLE_BYTES).decode("utf-8-sig")
        lines = list(csv.reader(StringIO(text)))
    except (UnicodeDecodeError, csv.Error) as error:
        raise SkinError(f"{path} is no CSV text ({error})") from None
    head = ",".join(cell.strip() for cell in lines[0]) if lines else ""
    if head not in HEADS:
        raise SkinError(
            f"{path} begins with {head!r:.60}; allowed are {' or '.join(HEADS)}; write "
            "it as one of them"
        )
    if "Parent" not in head and link is None:
        raise SkinError(
            f"{path} does not say which link its electrodes lie on; allowed is a link "
            "of the robot; give it with --link"
        )
    if len(lines) - 1 > MAX_TAXELS:
        raise SkinError(f"{path} has {len(lines) - 1} taxels; allowed: {MAX_TAXELS}")
    electrodes = read_electrodes(path, head, lines[1:])
    scale = MM if head == ELECTRODES else 1.0
    if np.median([each.radius for each in electrodes] or [0.0]) > MAX_RADIUS:
        logger.warning("%s is read in millimetres, by the size of its radii", path)
        scale = MM
    found: dict[tuple[str, str, str], list[Electrode]] = {}
    for each in electrodes:
        on = link or ""
        patch = link or ""
        if link is None:
            on, patch = find_parent(each.parent, robot, f"{path}: Index {each.index}")
        found.setdefault((on, each.skin or patch, each.skin), []).append(each)
    parts = [
        replace(
            build_gentact_patch(patch, on, own, scale, robot),
            channel=f"skin '{skin}'" if skin else "the file",
        )
        for (on, patch, skin), own in found.items()
    ]
    return join_patches(name, parts, path)


def read_electrodes(
    path: Path, head: str, lines: Sequence[Sequence[str]]
) -> list[Electrode]:
    """Read the taxels of a file, and tell which lines are none.

    A line with a name alone is the title of the skin that follows. One with another
    word in place of its index, such as CLIP, is the place of something else.
    """
    names = head.split(",")
    skin = ""
    others = Counter()
    electrodes = []
    for number, line in enumerate(lines, 2):
        cells = dict(zip(names, line, strict=False))
        first = line[0].strip() if line else ""
        if not any(cell.strip() for cell in line):
            continue
        if first and not first[0].isdigit() and len(line) == len(names):
            if any(cell.strip() for cell in line[1:]):
                others[first] += 1
            else:
                skin = first
            continue
        try:
            if len(line) != len(names):
                raise ValueError
            place = tuple(map(parse_number, line[1:4]))
            radius = np.nan
            if "Radius" in cells:
                radius = parse_number(cells["Radius"])
            index = parse_number(first)
            if radius <= 0 or not index.is_integer():
                raise ValueError
        except ValueError:
            raise SkinError(
                f"{path}: line {number} is {','.join(line)!r:.60}; allowed are {head}, "
                "with numbers and a radius above 0"
            ) from None
        # The index of a vertex counts inside its object.
        own = cells[names[-1]].strip() if head == VERTICES else skin
        parent = cells.get("Parent", "")
        electrodes.append(Electrode(int(index), own, parent, place, radius))
    if others:
        words = ", ".join(f"{count} {word}" for word, count in others.items())
        logger.warning("%s: left out is what is no taxel: %.200s", path, words)
    return electrodes


def find_parent(path: str, robot: Robot, place: str) -> tuple[str, str]:
    """Return the link in the path of a parent, and the name of the patch."""
    words = [word for word in path.strip().split("/") if word]
    for number in range(len(words) - 1, -1, -1):
        if words[number] in robot.link_names:
            rest = words[number + 1 :]
            return words[number], "/".join(rest) or words[number]
    raise SkinError(
        f"{place} has parent '{path:.60}', which names no link of robot "
        f"'{robot.name}'; allowed are {', '.join(robot.link_names[:8])} and so on; "
        "correct it, or give --link"
    )


def build_gentact_patch(
    patch: str,
    link: str,
    electrodes: Sequence[Electrode],
    scale: float,
    robot: Robot,
) -> PatchTaxels:
    """Build a patch of one row, in the order of the indices."""
    electrodes = sorted(electrodes, key=lambda each: each.index)
    positions = scale * np.array([each.place for each in electrodes])
    radii = scale * np.array([each.radius for each in electrodes])
    shape = robot.links[robot.link_index(link)]
    _, normals = compute_surface_distance(shape, positions)
    count = len(positions)
    return PatchTaxels(
        id=patch,
        link=link,
        rows=np.zeros(count, dtype=np.int64),
        columns=np.arange(count),
        extent=(1, count),
        positions=positions,
        normals=normals,
        areas=(
            estimate_areas(positions, f"patch '{patch}'")
            if np.isnan(radii[0])
            else np.pi * radii**2
        ),
        tangents=compute_default_tangents(normals),
        index=np.array([each.index for each in electrodes]),
    )


def write_gentact(path: Path, skin: Skin) -> None:
    """Write a skin as a CSV file of GenTact, with a radius of equal area."""
    out = StringIO()
    write = csv.writer(out, lineterminator="\n").writerow
    write(GENTACT_HEAD)
    for taxel, patch in enumerate(skin.patch_index.tolist()):
        own = skin.patches[patch]
        parent = f"/{own.link}" if own.id == own.link else f"/{own.link}/{own.id}"
        radius = float(np.sqrt(skin.areas[taxel] / np.pi))
        write([taxel, *map(repr, skin.positions[taxel].tolist()), repr(radius), parent])
    with atomic_path(path) as part:
        part.write_text(out.getvalue(), encoding="utf-8", newline="\n")
