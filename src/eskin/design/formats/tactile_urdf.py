"""This module reads and writes the patches of a skin as tactile sensors of a URDF.

`<sensor><tactile>` is that of `urdf_tactile` of the tactile_toolbox (Bielefeld
University): an array of equal taxels, or a list of taxels with their poses.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float, Int

from eskin.design.formats.patch_taxels import (
    MAX_SIDE,
    PatchTaxels,
    estimate_areas,
    format_numbers,
    join_patches,
    number_taxels,
    read_source,
)
from eskin.errors import RobotError, SkinError
from eskin.files import atomic_path
from eskin.robot import Robot
from eskin.robot.urdf import (
    MAX_URDF_BYTES,
    find_child,
    find_optional,
    parse_xml,
    read_numbers,
    read_origin,
    read_rotation,
    read_text,
)
from eskin.skin.skin import Patch, Skin
from eskin.skin.taxel_table import MAX_TAXELS
from eskin.transforms import apply, make_transform

SAME = 1e-9
"""Largest difference of two lengths that count as equal [m]."""
THICKNESS = 1e-3
"""Thickness of the boxes that are written as the shapes of taxels [m]."""


def read_tactile_urdf(path: Path, name: str) -> Skin:
    """Read the tactile sensors of a URDF, each as a patch, as a skin of a name.

    Raises:
        SkinError: The file cannot be read, has no tactile sensor, or has an error.
    """
    data = read_source(path, MAX_URDF_BYTES)
    try:
        root = parse_xml(data, path)
    except RobotError as error:
        raise SkinError(str(error)) from None
    try:
        parts = [
            read_tactile_sensor(sensor, tactile)
            for sensor in root.findall("sensor")
            if (tactile := find_optional(sensor, "tactile", "a <sensor>")) is not None
        ]
    except RobotError as error:
        raise SkinError(f"{path}: {error}") from None
    if not parts:
        raise SkinError(
            f"{path} has no <sensor> with <tactile>; allowed is one or more"
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
    channel = tactile.get("channel")
    channel = None if channel is None else f"channel '{channel:.40}'"
    arrays = tactile.findall("array")
    taxels = tactile.findall("taxel")
    if len(arrays) + bool(taxels) != 1:
        raise RobotError(
            f"{place} has {len(arrays)} <array> and {len(taxels)} <taxel>; allowed is "
            "one array, or some taxels; give each a <sensor> of its own"
        )
    if arrays:
        part = read_array(arrays[0], name, link, T_link_sensor, place)
    else:
        part = read_taxels(taxels, name, link, T_link_sensor, place)
    return replace(part, channel=channel)


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
            "col-major"
        )
    size = np.array(read_numbers(array, "size", place, 2))
    if size.min() <= 0:
        raise RobotError(
            f"{place}: <array> size is {size.tolist()}; allowed are numbers above 0"
        )
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
    by_rows = order == "row-major"
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
        index=np.arange(count) if by_rows else columns * sides[0] + rows,
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
    columns = []
    poses = []
    areas = []
    for taxel in taxels:
        (index,) = read_numbers(taxel, "idx", place, 1)
        if index != int(index) or not 0 <= index < MAX_SIDE:
            raise RobotError(
                f"{place}: <taxel> idx is {index:g}; allowed are 0 to {MAX_SIDE - 1}"
            )
        columns.append(int(index))
        xyz = np.array(read_numbers(taxel, "xyz", place, 3, (0.0, 0.0, 0.0)))
        rotation = read_rotation(taxel, place)
        poses.append(T_link_sensor @ make_transform(rotation, xyz))
        areas.append(read_taxel_area(taxel, place))
    T = np.array(poses)
    if None in areas:
        areas = estimate_areas(T[:, :3, 3], place).tolist()
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
        index=np.array(columns),
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
    of taxels. A patch is a channel, unless the data of patches are mixed.

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
    mixed = bool((np.diff(skin.patch_index) < 0).any())
    channel = skin.name if mixed else patch.id
    order = None if mixed else find_order(skin.rows[taxels], skin.columns[taxels])
    array = describe_array(skin, patch, taxels)
    if order is not None and array is not None:
        T, spacing, size = array
        pose = {"xyz": format_numbers(T[:3, 3]), "rpy": format_rpy(T[:3, :3])}
        ElementTree.SubElement(sensor, "origin", pose)
        tactile = ElementTree.SubElement(sensor, "tactile", channel=channel)
        facts = {
            "rows": str(patch.rows),
            "cols": str(patch.columns),
            "order": order,
            "size": format_numbers(size),
            "spacing": format_numbers(spacing),
        }
        ElementTree.SubElement(tactile, "array", facts)
        return sensor
    ElementTree.SubElement(sensor, "origin", {"xyz": "0 0 0", "rpy": "0 0 0"})
    tactile = ElementTree.SubElement(sensor, "tactile", channel=channel)
    every = np.arange(skin.count)
    numbers = (
        number_taxels(skin, every)[taxels] if mixed else (number_taxels(skin, taxels))
    )
    for taxel, index in zip(taxels.tolist(), numbers.tolist(), strict=True):
        x = skin.tangents[taxel]
        z = skin.normals[taxel]
        rotation = np.column_stack([x, np.cross(z, x), z])
        pose = {
            "idx": str(index),
            "xyz": format_numbers(skin.positions[taxel]),
            "rpy": format_rpy(rotation),
        }
        entry = ElementTree.SubElement(tactile, "taxel", pose)
        geometry = ElementTree.SubElement(entry, "geometry")
        side = float(np.sqrt(skin.areas[taxel]))
        size = format_numbers([side, side, THICKNESS])
        ElementTree.SubElement(geometry, "box", size=size)
    return sensor


def find_order(
    rows: Int[np.ndarray, "own"], columns: Int[np.ndarray, "own"]
) -> str | None:
    """Return the order in which the cells of a grid follow each other, None for no."""
    for name, keys in (("row-major", (columns, rows)), ("col-major", (rows, columns))):
        if (np.lexsort(keys) == np.arange(len(rows))).all():
            return name
    return None


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
        y = -y
        z = -z
        spacing = spacing * [1.0, -1.0]
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


def format_rpy(rotation: Float[np.ndarray, "3 3"]) -> str:
    """Format a rotation as roll, pitch and yaw [rad], as in URDF."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) > 1e-9:
        roll = np.arctan2(rotation[2, 1], rotation[2, 2])
        yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    else:
        # Roll and yaw are about one axis; all of it is yaw.
        roll = 0.0
        yaw = np.arctan2(-rotation[0, 1], rotation[1, 1])
    return format_numbers([roll, pitch, yaw])
