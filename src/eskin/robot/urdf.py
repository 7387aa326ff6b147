"""This module reads robots from URDF files."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, cast
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.robot.robot import Joint, Link, Mimic, Robot
from eskin.robot.shapes import Box, Cylinder, Geom, Shape, Sphere, TriangleMesh
from eskin.transforms import make_transform, rpy_to_matrix


def child(element: Element, tag: str, place: str) -> Element:
    """The first child with a tag.

    Raises:
        RobotError: There is none.
    """
    found = element.find(tag)
    if found is None:
        raise RobotError(f"{place} has no <{tag}>; add one")
    return found


def text(element: Element, attribute: str, place: str) -> str:
    """An attribute that must be there.

    Raises:
        RobotError: It is missing or empty.
    """
    value = element.get(attribute, "").strip()
    if not value:
        raise RobotError(f"{place}: <{element.tag}> has no '{attribute}'; add it")
    return value


def numbers(
    element: Element,
    attribute: str,
    place: str,
    count: int,
    default: Sequence[float] | None = None,
) -> tuple[float, ...]:
    """So many finite numbers from an attribute.

    Raises:
        RobotError: They are missing and have no default, or are not so many numbers.
    """
    if default is not None and element.get(attribute) is None:
        return tuple(default)
    given = text(element, attribute, place)
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


def number(
    element: Element,
    attribute: str,
    place: str,
    default: float | None = None,
    above: float = -np.inf,
) -> float:
    """One finite number from an attribute.

    Raises:
        RobotError: It is missing, no number, or not above what it must exceed.
    """
    default_values = None if default is None else (default,)
    (value,) = numbers(element, attribute, place, 1, default_values)
    if value <= above:
        raise RobotError(
            f"{place}: <{element.tag}> {attribute} is {value:g}; "
            f"wanted: more than {above:g}"
        )
    return value


def origin(element: Element, place: str) -> Float[np.ndarray, "4 4"]:
    """The pose in an element's <origin>, or none at all [m].

    Raises:
        RobotError: Its xyz or rpy are not three numbers each.
    """
    found = element.find("origin")
    if found is None:
        return np.eye(4)
    rpy = np.array(numbers(found, "rpy", place, 3, (0.0, 0.0, 0.0)))
    xyz = np.array(numbers(found, "xyz", place, 3, (0.0, 0.0, 0.0)))
    return make_transform(rpy_to_matrix(rpy), xyz)


def load_mesh(
    uri: str, folder: Path, scale: tuple[float, ...], place: str
) -> TriangleMesh:
    """Read a mesh file through trimesh, which the extra `models` brings.

    Args:
        uri: A path, `file://` or `package://` address, as in the URDF.
        folder: The URDF's folder.
        scale: Factors along x, y and z.
        place: Where in the URDF the mesh is named, for messages.

    Raises:
        RobotError: trimesh is not installed, or the file is missing or no mesh.
    """
    path = resolve(uri, folder, place)
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
    except Exception as error:  # trimesh's readers raise whatever their formats do.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise RobotError(f"{place}: {path} is no mesh ({reason})") from None
    if not len(faces):
        raise RobotError(f"{place}: mesh {path} holds no triangles; give one that does")
    # A mirroring scale turns triangles inside out.
    return TriangleMesh(vertices, faces[:, ::-1] if np.prod(scale) < 0 else faces)


def resolve(uri: str, folder: Path, place: str) -> Path:
    """The file that an address in a URDF means."""
    if uri.startswith("package://"):
        relative = uri.removeprefix("package://")
        # A package's folder may bear another name than the package: try without too.
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


JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]
KINDS = ("revolute", "continuous", "prismatic", "fixed")


def load_urdf(path: str | Path, *, meshes: bool = True) -> Robot:
    """Read a robot from a URDF file.

    Args:
        path: The file. Meshes given as `package://` are sought in its folder and in
            every folder above.
        meshes: Read `<mesh>` geoms, which needs the extra `models`; otherwise they
            are passed over, which is enough for kinematics.

    Raises:
        RobotError: The file is missing or is no URDF that can be used.
    """
    path = Path(path)
    root = parse(path)
    name = root.get("name") or path.stem
    folder = path.resolve().parent if meshes else None
    try:
        links = tuple(read_link(element, folder) for element in root.findall("link"))
        joints = tuple(read_joint(element) for element in root.findall("joint"))
        return Robot(name, links, joints)
    except RobotError as error:
        raise RobotError(f"{path}: {error}") from None


def parse(path: Path) -> Element:
    """The <robot> element of a file."""
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
    """A link with its collision geoms."""
    name = text(element, "name", "robot")
    place = f"link '{name}'"
    geoms = []
    for collision in element.findall("collision"):
        geometry = child(collision, "geometry", place)
        if folder is None and geometry.find("mesh") is not None:
            continue
        shape = read_shape(geometry, folder, place)
        geoms.append(Geom(shape, origin(collision, place)))
    return Link(name, tuple(geoms))


def read_shape(geometry: Element, folder: Path | None, place: str) -> Shape:
    """The one shape inside a <geometry>."""
    shape = next(iter(geometry), None)
    match shape.tag if shape is not None else "nothing", shape:
        case "cylinder", Element():
            radius = number(shape, "radius", place, above=0.0)
            return Cylinder(radius, number(shape, "length", place, above=0.0))
        case "sphere", Element():
            return Sphere(number(shape, "radius", place, above=0.0))
        case "box", Element():
            x, y, z = numbers(shape, "size", place, 3)
            if min(x, y, z) <= 0:
                raise RobotError(
                    f"{place}: <box> size is '{shape.get('size')}'; "
                    "wanted: each above 0"
                )
            return Box((x, y, z))
        case "mesh", Element() if folder is not None:
            scale = numbers(shape, "scale", place, 3, (1.0, 1.0, 1.0))
            return load_mesh(text(shape, "filename", place), folder, scale, place)
        case tag, _:
            raise RobotError(
                f"{place}: <geometry> holds {tag}; allowed: cylinder, sphere, box, mesh"
            )


def read_joint(element: Element) -> Joint:
    """A joint with its axis, limits and mimic."""
    name = text(element, "name", "robot")
    place = f"joint '{name}'"
    kind = text(element, "type", place)
    if kind not in KINDS:
        raise RobotError(f"{place} is of type '{kind}'; allowed: {', '.join(KINDS)}")
    kind = cast(JointKind, kind)
    lower, upper, velocity = read_limits(element, kind, place)
    return Joint(
        name=name,
        kind=kind,
        parent=text(child(element, "parent", place), "link", place),
        child=text(child(element, "child", place), "link", place),
        T_parent_joint=origin(element, place),
        axis=read_axis(element, place),
        lower=lower,
        upper=upper,
        velocity=velocity,
        mimic=read_mimic(element, kind, place),
    )


def read_axis(element: Element, place: str) -> np.ndarray:
    """The unit axis of a joint; x where none is given."""
    found = element.find("axis")
    if found is None or element.get("type") == "fixed":
        return np.array([1.0, 0.0, 0.0])
    axis = np.array(numbers(found, "xyz", place, 3, (1.0, 0.0, 0.0)))
    length = np.linalg.norm(axis)
    if length < 1e-9:
        raise RobotError(f"{place}: <axis> xyz has no length; give a direction")
    return axis / length


def read_limits(
    element: Element, kind: JointKind, place: str
) -> tuple[float, float, float]:
    """Least and greatest value, and greatest speed."""
    limit = element.find("limit")
    if kind == "fixed" or (kind == "continuous" and limit is None):
        return -np.inf, np.inf, np.inf
    if limit is None:
        raise RobotError(
            f"{place} is {kind} and has no <limit>; add one with lower, upper and "
            "velocity, or make it continuous"
        )
    default = np.inf if kind == "continuous" else None
    velocity = number(limit, "velocity", place, default)
    if velocity < 0:
        raise RobotError(
            f"{place}: <limit> velocity is {velocity:g}; wanted: 0 or more"
        )
    if kind == "continuous":
        return -np.inf, np.inf, velocity
    lower = number(limit, "lower", place, 0.0)
    upper = number(limit, "upper", place, 0.0)
    if lower > upper:
        raise RobotError(
            f"{place}: <limit> lower {lower:g} is above upper {upper:g}; swap them"
        )
    return lower, upper, velocity


def read_mimic(element: Element, kind: JointKind, place: str) -> Mimic | None:
    """Which joint this one follows, if any."""
    found = element.find("mimic")
    if found is None or kind == "fixed":
        return None
    multiplier = number(found, "multiplier", place, 1.0)
    offset = number(found, "offset", place, 0.0)
    return Mimic(text(found, "joint", place), multiplier, offset)
