"""This module reads and writes the CSV files of GenTact.

They hold positions with a radius and the path of the object they lie on, or positions
in millimetres alone. Normals are those of the robot's surface.
"""

import csv
from io import StringIO
from pathlib import Path

import numpy as np
from jaxtyping import Float

from eskin.errors import SkinError
from eskin.files import atomic_path
from eskin.robot import Robot, compute_surface_distance
from eskin.skin.patch_taxels import (
    PatchTaxels,
    estimate_areas,
    join_patches,
    read_source,
)
from eskin.skin.skin import Skin
from eskin.skin.taxel_table import (
    MAX_TABLE_BYTES,
    MAX_TAXELS,
    compute_default_tangents,
)

GENTACT_HEAD = ("Index", "X", "Y", "Z", "Radius", "Parent")
GENTACT_ELECTRODES = ("Index", "X (mm)", "Y (mm)", "Z (mm)")
MM = 1e-3


def read_gentact(path: Path, name: str, robot: Robot, link: str | None = None) -> Skin:
    """Read a CSV file of GenTact; its normals are those of the robot's surface.

    A patch is one parent in the file: the last part of its path that is a link of the
    robot, and what follows as the name of the patch.

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
        rows = [row for row in csv.reader(StringIO(text)) if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise SkinError(f"{path} is no CSV text ({error}); correct it") from None
    head = tuple(cell.strip() for cell in rows[0]) if rows else ()
    if head not in (GENTACT_HEAD, GENTACT_ELECTRODES):
        raise SkinError(
            f"{path} begins with {','.join(head)!r:.60}; allowed are "
            f"'{','.join(GENTACT_HEAD)}' and '{','.join(GENTACT_ELECTRODES)}'"
        )
    has_parents = head == GENTACT_HEAD
    if not has_parents and link is None:
        raise SkinError(
            f"{path} does not say which link its electrodes lie on; allowed is a link "
            "of the robot; give it with --link"
        )
    if len(rows) - 1 > MAX_TAXELS:
        raise SkinError(f"{path} has {len(rows) - 1} taxels; allowed: {MAX_TAXELS}")
    found: dict[tuple[str, str], list[list[float]]] = {}
    for number, row in enumerate(rows[1:], 2):
        try:
            if len(row) != len(head):
                raise ValueError
            values = [float(cell) for cell in row[: 5 if has_parents else 4]]
            if not np.isfinite(values).all() or (has_parents and values[4] <= 0):
                raise ValueError
        except ValueError:
            raise SkinError(
                f"{path}: line {number} is {','.join(row)!r:.60}; allowed are "
                f"{','.join(head)}, with numbers and a radius above 0; correct it"
            ) from None
        if link is None:
            key = find_parent(row[5], robot, f"{path}: line {number}")
        else:
            key = link, link
        found.setdefault(key, []).append(values[1:])
    scale = 1.0 if has_parents else MM
    parts = [
        build_gentact_patch(patch, on, np.array(values), scale, robot)
        for (on, patch), values in found.items()
    ]
    return join_patches(name, parts, path)


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
    values: Float[np.ndarray, "taxel column"],
    scale: float,
    robot: Robot,
) -> PatchTaxels:
    """Build a patch of one row from x, y, z and perhaps a radius of each taxel."""
    positions = scale * values[:, :3]
    shape = robot.links[robot.link_index(link)]
    _, normals = compute_surface_distance(shape, positions)
    radii = values[:, 3] if values.shape[1] > 3 else None
    areas = estimate_areas(positions) if radii is None else np.pi * radii**2
    count = len(positions)
    return PatchTaxels(
        id=patch,
        link=link,
        rows=np.zeros(count, dtype=np.int64),
        columns=np.arange(count),
        extent=(1, count),
        positions=positions,
        normals=normals,
        areas=areas,
        tangents=compute_default_tangents(normals),
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
