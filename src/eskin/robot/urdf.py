"""This module reads robots from URDF files.

It reads links with their collision geoms, and joints with their limits and mimic rules.
Everything else (visuals, inertials, transmissions, sensors, simulator tags) is ignored.
"""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import cast, get_args
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.robot.robot import Joint, JointKind, Link, Mimic, Robot
from eskin.robot.shapes import Box, Cylinder, Geom, Shape, Sphere, TriangleMesh
from eskin.transforms import make_transform, rpy_to_matrix

KINDS = get_args(JointKind)


def load_urdf(path: str | Path, *, meshes: bool = True) -> Robot:
    """Read a robot from a URDF file.

    Args:
        path: the file. Meshes given as `package://` are looked up in its folder and in
            every folder above.
        meshes: whether to read `<mesh>` geoms, which needs the extra `models`. Links
            without them have no surface; kinematics do not need one.

    Raises:
        RobotError: The file is missing or is no URDF that can be used.
    """
    path = Path(path)
    root = parse_urdf(path)
    folder = path.resolve().parent if meshes else None
    try:
        links = tuple(read_link(element, folder) for element in root.findall("link"))
        joints = tuple(read_joint(element) for element in root.findall("joint"))
        return Robot(root.get("name") or path.stem, links, joints)
    except RobotError as error:
        raise RobotError(f"{path}: {error}") from None


def parse_urdf(path: Path) -> Element:
    """Return the <robot> element of a file."""
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise RobotError(f"cannot read URDF {path}: {error.strerror}") from None
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(f"{path} is not XML ({error}); a URDF is wanted") from None
    if root.tag != "robot":
        raise RobotError(f"{path} holds <{root.tag}>; a URDF with <robot> is wanted")
    if any("xacro" in element.tag for element in root.iter()):
        raise RobotError(f"{path} still holds xacro macros; run xacro on it first")
    return root


def read_link(element: Element, folder: Path | None) -> Link:
    """Read a link with its collision geoms."""
    name = read_text(element, "name", "robot")
    place = f"link '{name}'"
    geoms = []
    for collision in element.findall("collision"):
        geometry = find_child(collision, "geometry", place)
        if folder is None and geometry.find("mesh") is not None:
            continue
        shape = read_shape(geometry, folder, place)
        geoms.append(Geom(shape, read_origin(collision, place)))
    return Link(name, tuple(geoms))


def read_shape(geometry: Element, folder: Path | None, place: str) -> Shape:
    """Read the one shape inside a <geometry>."""
    shape = next(iter(geometry), None)
    match shape.tag if shape is not None else "nothing", shape:
        case "cylinder", Element():
            radius = read_number(shape, "radius", place, above=0.0)
            return Cylinder(radius, read_number(shape, "length", place, above=0.0))
        case "sphere", Element():
            return Sphere(read_number(shape, "radius", place, above=0.0))
        case "box", Element():
            x, y, z = read_numbers(shape, "size", place, 3)
            if min(x, y, z) <= 0:
                raise RobotError(
                    f"{place}: <box> size is '{shape.get('size')}'; "
                    "wanted: each above 0"
                )
            return Box((x, y, z))
        case "mesh", Element() if folder is not None:
            scale = read_numbers(shape, "scale", place, 3, (1.0, 1.0, 1.0))
            return load_mesh(read_text(shape, "filename", place), folder, scale, place)
        case tag, _:
            raise RobotError(
                f"{place}: <geometry> holds {tag}; allowed: cylinder, sphere, box, mesh"
            )


def read_joint(element: Element) -> Joint:
    """Read a joint with its axis, limits and mimic rule."""
    name = read_text(element, "name", "robot")
    place = f"joint '{name}'"
    kind = read_text(element, "type", place)
    if kind not in KINDS:
        raise RobotError(f"{place} is of type '{kind}'; allowed: {', '.join(KINDS)}")
    kind = cast(JointKind, kind)
    lower, upper, velocity = read_limits(element, kind, place)
    return Joint(
        name=name,
        kind=kind,
        parent=read_text(find_child(element, "parent", place), "link", place),
        child=read_text(find_child(element, "child", place), "link", place),
        T_parent_joint=read_origin(element, place),
        axis=read_axis(element, place),
        lower=lower,
        upper=upper,
        velocity=velocity,
        mimic=read_mimic(element, kind, place),
    )


def read_axis(element: Element, place: str) -> np.ndarray:
    """Read the unit axis of a joint, which is x where none is given."""
    found = element.find("axis")
    if found is None or element.get("type") == "fixed":
        return np.array([1.0, 0.0, 0.0])
    axis = np.array(read_numbers(found, "xyz", place, 3, (1.0, 0.0, 0.0)))
    length = np.linalg.norm(axis)
    if length < 1e-9:
        raise RobotError(f"{place}: <axis> xyz has no length; give a direction")
    return axis / length


def read_limits(
    element: Element, kind: JointKind, place: str
) -> tuple[float, float, float]:
    """Read the smallest and largest value of a joint, and its largest speed."""
    limit = element.find("limit")
    if kind == "fixed" or (kind == "continuous" and limit is None):
        return -np.inf, np.inf, np.inf
    if limit is None:
        raise RobotError(
            f"{place} is {kind} and has no <limit>; add one with lower, upper and "
            "velocity, or make it continuous"
        )
    default = np.inf if kind == "continuous" else None
    velocity = read_number(limit, "velocity", place, default)
    if velocity < 0:
        raise RobotError(
            f"{place}: <limit> velocity is {velocity:g}; wanted: 0 or more"
        )
    if kind == "continuous":
        return -np.inf, np.inf, velocity
    lower = read_number(limit, "lower", place, 0.0)
    upper = read_number(limit, "upper", place, 0.0)
    if lower > upper:
        raise RobotError(
            f"{place}: <limit> lower {lower:g} is above upper {upper:g}; swap them"
        )
    return lower, upper, velocity


def read_mimic(element: Element, kind: JointKind, place: str) -> Mimic | None:
    """Read the rule by which a joint follows another, if there is one."""
    found = element.find("mimic")
    if found is None or kind == "fixed":
        return None
    multiplier = read_number(found, "multiplier", place, 1.0)
    offset = read_number(found, "offset", place, 0.0)
    return Mimic(read_text(found, "joint", place), multiplier, offset)


def find_child(element: Element, tag: str, place: str) -> Element:
    """Return the first child with a tag; raise where there is none."""
    found = element.find(tag)
    if found is None:
        raise RobotError(f"{place} has no <{tag}>; add one")
    return found


def read_text(element: Element, attribute: str, place: str) -> str:
    """Read an attribute; raise where it is missing or empty."""
    value = element.get(attribute, "").strip()
    if not value:
        raise RobotError(f"{place}: <{element.tag}> has no '{attribute}'; add it")
    return value


def read_numbers(
    element: Element,
    attribute: str,
    place: str,
    count: int,
    default: Sequence[float] | None = None,
) -> tuple[float, ...]:
    """Read a given count of finite numbers from an attribute, which may be required."""
    if default is not None and element.get(attribute) is None:
        return tuple(default)
    given = read_text(element, attribute, place)
    try:
        values = tuple(float(word) for word in given.split())
    except ValueError:
        values = ()
    if len(values) != count or not np.all(np.isfinite(values)):
        raise RobotError(
            f"{place}: <{element.tag}> {attribute} is '{given}'; "
            f"wanted: {count} finite number{'s' if count > 1 else ''}"
        )
    return values


def read_number(
    element: Element,
    attribute: str,
    place: str,
    default: float | None = None,
    above: float = -np.inf,
) -> float:
    """Read one finite number above a bound from an attribute."""
    defaults = None if default is None else (default,)
    (value,) = read_numbers(element, attribute, place, 1, defaults)
    if value <= above:
        raise RobotError(
            f"{place}: <{element.tag}> {attribute} is {value:g}; "
            f"wanted: more than {above:g}"
        )
    return value


def read_origin(element: Element, place: str) -> Float[np.ndarray, "4 4"]:
    """Read the pose of an element's <origin> [m]; without one it is the identity."""
    found = element.find("origin")
    if found is None:
        return np.eye(4)
    rpy = np.array(read_numbers(found, "rpy", place, 3, (0.0, 0.0, 0.0)))
    xyz = np.array(read_numbers(found, "xyz", place, 3, (0.0, 0.0, 0.0)))
    return make_transform(rpy_to_matrix(rpy), xyz)


def load_mesh(
    uri: str, folder: Path, scale: tuple[float, ...], place: str
) -> TriangleMesh:
    """Read a mesh file, scaled along x, y and z, with trimesh (extra `models`)."""
    path = resolve_mesh_path(uri, folder, place)
    try:
        trimesh = importlib.import_module("trimesh")
    except ImportError:
        raise RobotError(
            f"{place} has mesh {uri}, which needs trimesh: "
            "pip install 'eskin[models]', or load the URDF with meshes=False"
        ) from None
    try:
        mesh = trimesh.load(path, force="mesh")
        vertices = np.asarray(mesh.vertices, dtype=np.float64) * np.array(scale)
        faces = np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:  # trimesh's readers raise anything.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RobotError(f"{place}: {path} is no mesh ({reason})") from None
    if not len(faces):
        raise RobotError(f"{place}: mesh {path} holds no triangles; give one that does")
    # A mirroring scale turns triangles inside out.
    return TriangleMesh(vertices, faces[:, ::-1] if np.prod(scale) < 0 else faces)


def resolve_mesh_path(uri: str, folder: Path, place: str) -> Path:
    """Return the file of a path, `file://` or `package://` address in a URDF."""
    if uri.startswith("package://"):
        relative = uri.removeprefix("package://")
        # A package's folder may have another name than the package.
        inside = relative.partition("/")[2]
        above = (folder, *folder.parents)
        candidates = [base / path for path in (relative, inside) for base in above]
    else:
        candidates = [folder / uri.removeprefix("file://")]
    found = next((path for path in candidates if path.is_file()), None)
    if found is None:
        raise RobotError(
            f"{place}: mesh {uri} is not in {folder}"
            f"{' or any folder above' if len(candidates) > 1 else ''}; put it there"
        )
    return found
