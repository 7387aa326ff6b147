"""This module reads and writes skins in the formats of other projects.

- URDF with `<sensor><tactile>`, as in `urdf_tactile` of the tactile_toolbox (Bielefeld
  University): an array of equal taxels, or a list of taxels with their poses.
- Text files of positions as in `skinGui` of the iCub: a line of six numbers for each
  channel, all zero where a channel has no taxel.
- CSV files of GenTact: positions with a radius and the path of the object they lie on,
  or positions in millimetres alone.

None of them holds bus addresses or units, so patches get the addresses 1, 2, 3 and so
on, and measure pressure in kPa.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from eskin.errors import RobotError, SkinError
from eskin.files import atomic_path, read_file
from eskin.robot import Robot, compute_surface_distance
from eskin.robot.urdf import (
    MAX_URDF_BYTES,
    find_child,
    parse_xml,
    read_numbers,
    read_origin,
    read_text,
)
from eskin.skin.check import check_crowding, find_direction_problems
from eskin.skin.files import compute_default_tangents
from eskin.skin.skin import Patch, Skin
from eskin.skin.taxel_table import MAX_TABLE_BYTES
from eskin.transforms import apply, make_transform, rpy_to_matrix

MAX_TAXELS = 200_000
"""Largest number of taxels that are read."""
MAX_SIDE = 65_535
"""Largest number of rows, and of columns, of a patch."""
ICUB_CHANNELS = 12
"""Number of channels of a triangle of the iCub's skin: a row of its patch."""
MIN_NORMAL = 0.5
"""Smallest length of a normal in a file, which is scaled to 1."""
SAME = 1e-9
"""Largest difference of two lengths that count as equal [m]."""
MM = 1e-3

Vectors = Float[np.ndarray, "taxel 3"]


@dataclass(frozen=True, eq=False)
class PatchTaxels:
    """A patch with its taxels, as they are read from a file."""

    id: str
    link: str
    rows: Int[np.ndarray, "taxel"]
    columns: Int[np.ndarray, "taxel"]
    extent: tuple[int, int]
    """Number of rows and of columns."""
    positions: Vectors
    normals: Vectors
    areas: Float[np.ndarray, "taxel"]
    tangents: Vectors


def join_patches(name: str, parts: Sequence[PatchTaxels], file: Path) -> Skin:
    """Join patches to a skin; its taxels are ordered by patch, row and column.

    Raises:
        SkinError: There are no taxels, too many, or some that no skin may have.
    """
    count = sum(len(part.rows) for part in parts)
    if not 1 <= count <= MAX_TAXELS:
        raise SkinError(f"{file} has {count} taxels; allowed are 1 to {MAX_TAXELS}")
    repeated = [part.id for part in parts]
    if len(set(repeated)) < len(repeated):
        twice = next(each for each in repeated if repeated.count(each) > 1)
        raise SkinError(
            f"{file} has patch '{twice}' twice; allowed is once; rename one"
        )
    orders = [np.lexsort((part.columns, part.rows)) for part in parts]

    def join(field: str) -> np.ndarray:
        return np.concatenate(
            [getattr(p, field)[order] for p, order in zip(parts, orders, strict=True)]
        )

    skin = Skin(
        name=name,
        patches=tuple(
            Patch(part.id, part.link, number, *part.extent)
            for number, part in enumerate(parts, 1)
        ),
        patch_index=np.repeat(
            np.arange(len(parts)), [len(part.rows) for part in parts]
        ),
        rows=join("rows"),
        columns=join("columns"),
        positions=join("positions"),
        normals=join("normals"),
        areas=join("areas"),
        tangents=join("tangents"),
    )
    if problems := find_direction_problems(skin):
        raise SkinError(f"{file}: {problems[0]}")
    check_crowding(skin, str(file))
    return skin


def read_source(file: Path, max_bytes: int) -> bytes:
    """Read a file of a limited size, and turn exceptions into a `SkinError`."""
    try:
        return read_file(file, max_bytes)
    except OSError as error:
        raise SkinError(f"cannot read {file}: {error.strerror}") from None


def estimate_areas(positions: Vectors) -> Float[np.ndarray, "taxel"]:
    """Estimate the areas of taxels from the distance of nearest neighbours [m2]."""
    if len(positions) < 2:
        raise SkinError(
            "a patch of one taxel has no spacing to tell its area by; allowed are two "
            "taxels or more; leave it out"
        )
    nearest = KDTree(positions).query(positions, k=2)[0][:, 1]
    return np.full(len(positions), float(np.median(nearest)) ** 2)


# URDF


def read_tactile_urdf(path: Path, name: str) -> Skin:
    """Read the tactile sensors of a URDF, each as a patch.

    Args:
        path: the file.
        name: name of the skin.

    Raises:
        SkinError: The file cannot be read, has no tactile sensor, or has an error.
    """
    data = read_source(path, MAX_URDF_BYTES)
    try:
        root = parse_xml(data, path)
        parts = [
            read_tactile_sensor(sensor, tactile)
            for sensor in root.findall("sensor")
            if (tactile := sensor.find("tactile")) is not None
        ]
    except RobotError as error:
        text = str(error)
        raise SkinError(text if str(path) in text else f"{path}: {text}") from None
    if not parts:
        raise SkinError(
            f"{path} has no <sensor> with <tactile>; allowed is one or more; add one"
        )
    return join_patches(name, parts, path)


def read_tactile_sensor(sensor: Element, tactile: Element) -> PatchTaxels:
    """Read a sensor: one array, or a list of taxels.

    Raises:
        RobotError: It has an error.
    """
    name = read_text(sensor, "name", "a <sensor>")
    place = f"sensor '{name}'"
    link = read_text(find_child(sensor, "parent", place), "link", place)
    T_link_sensor = read_origin(sensor, place)
    arrays, taxels = tactile.findall("array"), tactile.findall("taxel")
    if len(arrays) + bool(taxels) != 1:
        raise RobotError(
            f"{place} has {len(arrays)} <array> and {len(taxels)} <taxel>; allowed is "
            "one array, or some taxels"
        )
    if arrays:
        return read_array(arrays[0], name, link, T_link_sensor, place)
    return read_taxels(taxels, name, link, T_link_sensor, place)


def read_array(
    array: Element, name: str, link: str, T_link_sensor: np.ndarray, place: str
) -> PatchTaxels:
    """Read an array, whose rows follow each other along x and columns along y."""
    sides = []
    for attribute in ("rows", "cols"):
        (side,) = read_numbers(array, attribute, place, 1)
        if side != int(side) or not 1 <= side <= MAX_SIDE:
            raise RobotError(
                f"{place}: <array> {attribute} is {side:g}; allowed are 1 to {MAX_SIDE}"
            )
        sides.append(int(side))
    order = array.get("order", "row-major")
    if order not in ("row-major", "column-major", "col-major"):
        raise RobotError(
            f"{place}: <array> order is '{order:.40}'; allowed are row-major and "
            "column-major"
        )
    size = np.array(read_numbers(array, "size", place, 2))
    if size.min() <= 0:
        raise RobotError(f"{place}: <array> size is {size.tolist()}; allowed above 0")
    spacing = np.array(read_numbers(array, "spacing", place, 2, size.tolist()))
    offset = np.array(read_numbers(array, "offset", place, 2, (0.0, 0.0)))
    if sides[0] * sides[1] > MAX_TAXELS:
        raise RobotError(
            f"{place} has {sides[0]} x {sides[1]} taxels; allowed are {MAX_TAXELS}"
        )
    rows, columns = np.divmod(np.arange(sides[0] * sides[1]), sides[1])
    flat = np.column_stack([rows, columns]) * spacing - offset
    points = np.column_stack([flat, np.zeros(len(flat))])
    count = len(rows)
    # Columns follow each other along a taxel's x axis.
    along = T_link_sensor[:3, 1] * np.sign(spacing[1] or 1.0)
    return PatchTaxels(
        id=name,
        link=link,
        rows=rows,
        columns=columns,
        extent=(sides[0], sides[1]),
        positions=apply(T_link_sensor, points),
        normals=np.tile(T_link_sensor[:3, 2], (count, 1)),
        areas=np.full(count, float(size[0] * size[1])),
        tangents=np.tile(along, (count, 1)),
    )


def read_taxels(
    taxels: Sequence[Element],
    name: str,
    link: str,
    T_link_sensor: np.ndarray,
    place: str,
) -> PatchTaxels:
    """Read a list of taxels as a patch of one row."""
    if len(taxels) > MAX_TAXELS:
        raise RobotError(f"{place} has {len(taxels)} taxels; allowed: {MAX_TAXELS}")
    columns, poses, areas = [], [], []
    for taxel in taxels:
        (index,) = read_numbers(taxel, "idx", place, 1)
        if index != int(index) or not 0 <= index < MAX_SIDE:
            raise RobotError(
                f"{place}: <taxel> idx is {index:g}; allowed are 0 to {MAX_SIDE - 1}"
            )
        columns.append(int(index))
        xyz = np.array(read_numbers(taxel, "xyz", place, 3, (0.0, 0.0, 0.0)))
        rpy = np.array(read_numbers(taxel, "rpy", place, 3, (0.0, 0.0, 0.0)))
        poses.append(T_link_sensor @ make_transform(rpy_to_matrix(rpy), xyz))
        areas.append(read_taxel_area(taxel, place))
    if len(set(columns)) < len(columns):
        raise RobotError(f"{place} has a <taxel> idx twice; allowed is each once")
    T = np.array(poses)
    if None in areas:
        areas = estimate_areas(T[:, :3, 3]).tolist()
    return PatchTaxels(
        id=name,
        link=link,
        rows=np.zeros(len(columns), dtype=np.int64),
        columns=np.array(columns),
        extent=(1, max(columns) + 1),
        positions=T[:, :3, 3],
        normals=T[:, :3, 2],
        areas=np.array(areas, dtype=np.float64),
        tangents=T[:, :3, 0],
    )


def read_taxel_area(taxel: Element, place: str) -> float | None:
    """Read the area of a taxel from its shape [m2]; None where a mesh gives it."""
    box, cylinder = (taxel.find(f"geometry/{kind}") for kind in ("box", "cylinder"))
    if box is not None:
        x, y, _ = read_numbers(box, "size", place, 3)
        area = x * y
    elif cylinder is not None:
        (radius,) = read_numbers(cylinder, "radius", place, 1)
        area = np.pi * radius**2
    else:
        return None
    if not area > 0:
        raise RobotError(f"{place}: a taxel has area {area:g}; allowed is above 0")
    return float(area)


def write_tactile_urdf(path: Path, skin: Skin, robot: Robot | None = None) -> None:
    """Write the patches of a skin as tactile sensors.

    A full, flat grid of equal cells is written as an array, any other patch as a list
    of taxels, whose index is row times columns plus column.

    Args:
        path: the file.
        skin: the skin.
        robot: robot whose URDF the sensors are added to, in place of its tactile
            sensors; without one, the file holds the sensors alone.
    """
    if robot is not None and robot.urdf:
        root = parse_xml(robot.urdf, path)
        for sensor in root.findall("sensor"):
            if sensor.find("tactile") is not None:
                root.remove(sensor)
    else:
        root = Element("robot", name=skin.name)
    for patch in skin.patches:
        root.append(build_sensor(skin, patch))
    ElementTree.indent(root)
    with atomic_path(path) as part:
        ElementTree.ElementTree(root).write(
            part, encoding="utf-8", xml_declaration=True
        )


def build_sensor(skin: Skin, patch: Patch) -> Element:
    """Build the <sensor> of a patch."""
    sensor = Element("sensor", name=patch.id)
    ElementTree.SubElement(sensor, "parent", link=patch.link)
    taxels = skin.find_taxels(patch.id)
    array = describe_array(skin, patch, taxels)
    if array is not None:
        T, spacing, size = array
        pose = {"xyz": format_numbers(T[:3, 3]), "rpy": format_rpy(T[:3, :3])}
        ElementTree.SubElement(sensor, "origin", pose)
        tactile = ElementTree.SubElement(sensor, "tactile")
        facts = {
            "rows": str(patch.rows),
            "cols": str(patch.columns),
            "order": "row-major",
            "size": format_numbers(size),
            "spacing": format_numbers(spacing),
        }
        ElementTree.SubElement(tactile, "array", facts)
        return sensor
    ElementTree.SubElement(sensor, "origin", {"xyz": "0 0 0", "rpy": "0 0 0"})
    tactile = ElementTree.SubElement(sensor, "tactile")
    for taxel in taxels.tolist():
        x, z = skin.tangents[taxel], skin.normals[taxel]
        rotation = np.column_stack([x, np.cross(z, x), z])
        index = skin.rows[taxel] * patch.columns + skin.columns[taxel]
        pose = {
            "idx": str(index),
            "xyz": format_numbers(skin.positions[taxel]),
            "rpy": format_rpy(rotation),
        }
        entry = ElementTree.SubElement(tactile, "taxel", pose)
        geometry = ElementTree.SubElement(entry, "geometry")
        side = float(np.sqrt(skin.areas[taxel]))
        size = format_numbers([side, side, MM])
        ElementTree.SubElement(geometry, "box", size=size)
    return sensor


def describe_array(
    skin: Skin, patch: Patch, taxels: Int[np.ndarray, "own"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return pose, spacing and size of a patch as an array; None where it is none."""
    rows, columns = skin.rows[taxels], skin.columns[taxels]
    if len(taxels) != patch.rows * patch.columns or min(patch.rows, patch.columns) < 2:
        return None
    grid = np.empty((patch.rows, patch.columns), dtype=np.int64)
    grid[rows, columns] = taxels
    places = skin.positions
    first = places[grid[0, 0]]
    along_rows = (places[grid[-1, 0]] - first) / (patch.rows - 1)
    along_columns = (places[grid[0, -1]] - first) / (patch.columns - 1)
    spacing = np.array([np.linalg.norm(along_rows), np.linalg.norm(along_columns)])
    x, y = along_rows / spacing[0], along_columns / spacing[1]
    z = np.cross(x, y)
    if skin.normals[taxels[0]] @ z < 0:
        # The columns are counted the other way: the spacing is negative.
        y, z, spacing = -y, -z, spacing * [1.0, -1.0]
    ideal = first + rows[:, None] * along_rows + columns[:, None] * along_columns
    areas = skin.areas[taxels]
    same = (
        np.abs(places[taxels] - ideal).max() < SAME
        and np.abs(skin.normals[taxels] - z).max() < SAME
        and np.abs(skin.tangents[taxels] - y * np.sign(spacing[1])).max() < SAME
        and abs(x @ y) < SAME
        and np.ptp(areas) <= SAME * areas[0]
    )
    if not same:
        return None
    # The size of a cell that the file told, else a square of its area.
    size = np.abs(spacing)
    if abs(size.prod() - areas[0]) > SAME * areas[0]:
        size = np.full(2, np.sqrt(areas[0]))
    return make_transform(np.column_stack([x, y, z]), first), spacing, size


def format_numbers(numbers: Sequence[float] | np.ndarray) -> str:
    """Format numbers without loss, with spaces between them."""
    return " ".join(repr(float(number) + 0.0) for number in numbers)


def format_rpy(rotation: Float[np.ndarray, "3 3"]) -> str:
    """Format a rotation as roll, pitch and yaw [rad], as in URDF."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) > 1e-9:
        roll = np.arctan2(rotation[2, 1], rotation[2, 2])
        yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    else:
        # Roll and yaw are about one axis; all of it is yaw.
        roll, yaw = 0.0, np.arctan2(-rotation[0, 1], rotation[1, 1])
    return format_numbers([roll, pitch, yaw])


# iCub


def read_icub_positions(
    files: Sequence[Path], name: str, link: str | None = None
) -> Skin:
    """Read files of positions as in the iCub's `skinGui`, each as a patch.

    A row of the patch is a triangle of 12 channels, unless the file says `columns`.

    Args:
        files: the files.
        name: name of the skin.
        link: link of the patches; None for the `name` in each file.

    Raises:
        SkinError: A file cannot be read, or has an error.
    """
    parts = [read_icub_part(file, link) for file in files]
    return join_patches(name, parts, files[0] if len(files) == 1 else files[0].parent)


def read_icub_part(file: Path, link: str | None) -> PatchTaxels:
    """Read one file of positions."""
    try:
        lines = read_source(file, MAX_TABLE_BYTES).decode().splitlines()
    except UnicodeDecodeError as error:
        raise SkinError(f"{file}: byte {error.start} is not UTF-8") from None
    heads = [line.strip().lower() for line in lines]
    if "[calibration]" not in heads:
        raise SkinError(
            f"{file} has no line [calibration]; allowed is one, above the positions; "
            "name a file of positions of the iCub's skin"
        )
    start = heads.index("[calibration]") + 1
    facts = dict(
        line.split(None, 1) for line in lines[: start - 1] if len(line.split()) > 1
    )
    link = link or facts.get("name", "").strip()
    if not link:
        raise SkinError(
            f"{file} has no name, which tells the link; allowed is a line 'name LINK'; "
            "give it with --link"
        )
    width = facts.get("columns", str(ICUB_CHANNELS)).strip()
    if not width.isdecimal() or not 1 <= int(width) <= MAX_SIDE:
        raise SkinError(
            f"{file}: columns is '{width:.40}'; allowed are 1 to {MAX_SIDE}; correct it"
        )
    table = read_icub_table(file, lines, start)
    used = np.flatnonzero(np.any(table != 0.0, axis=1))
    if len(used) == 0:
        raise SkinError(f"{file} has no taxels, only zeros; allowed is one or more")
    columns = int(width)
    lengths = np.linalg.norm(table[used, 3:], axis=1)
    short = used[lengths < MIN_NORMAL]
    if len(short):
        raise SkinError(
            f"{file}: the normal of channel {short[0]} has length "
            f"{np.linalg.norm(table[short[0], 3:]):.3g}; allowed is 1; correct it"
        )
    normals = table[used, 3:] / lengths[:, None]
    return PatchTaxels(
        id=file.stem,
        link=link,
        rows=used // columns,
        columns=used % columns,
        extent=(-(-len(table) // columns), columns),
        positions=table[used, :3],
        normals=normals,
        areas=estimate_areas(table[used, :3]),
        tangents=compute_default_tangents(normals),
    )


def read_icub_table(
    file: Path, lines: Sequence[str], start: int
) -> Float[np.ndarray, "channel 6"]:
    """Read the positions and normals of all channels, zeros where there is no taxel."""
    rows = []
    for number, line in enumerate(lines[start:], start + 1):
        words = line.split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
            # Older files have a seventh number: the confidence of the position.
            if len(row) not in (6, 7) or not np.isfinite(row).all():
                raise ValueError
        except ValueError:
            raise SkinError(
                f"{file}: line {number} is '{line.strip():.60}'; allowed are x, y, z "
                "and the normal's x, y, z; correct it"
            ) from None
        rows.append(row[:6])
    if not 1 <= len(rows) <= MAX_TAXELS:
        raise SkinError(f"{file} has {len(rows)} positions; allowed: 1 to {MAX_TAXELS}")
    return np.array(rows)


def write_icub_positions(folder: Path, skin: Skin) -> None:
    """Write a file of positions for each patch of a skin, named by its id."""
    for patch in skin.patches:
        taxels = skin.find_taxels(patch.id)
        channels = skin.rows[taxels] * patch.columns + skin.columns[taxels]
        table = np.zeros((patch.rows * patch.columns, 6))
        table[channels, :3], table[channels, 3:] = (
            skin.positions[taxels],
            skin.normals[taxels],
        )
        own = np.full(len(table), -1)
        own[channels] = channels
        lines = [f"name\t{patch.link}", "spatial_sampling\ttaxel"]
        if patch.columns != ICUB_CHANNELS:
            lines.append(f"columns\t{patch.columns}")
        lines.append(f"taxel2Repr ( {'  '.join(map(str, own.tolist()))} )")
        lines.append("[calibration]")
        lines += map(format_numbers, table)
        with atomic_path(folder / f"{patch.id}.txt") as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")


# GenTact

GENTACT_HEAD = ("Index", "X", "Y", "Z", "Radius", "Parent")
GENTACT_ELECTRODES = ("Index", "X (mm)", "Y (mm)", "Z (mm)")


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
