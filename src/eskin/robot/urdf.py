"""This module reads robots from URDF files.

It reads links with their collision geoms, and joints with their limits and mimic rules.
Everything else (visuals, inertials, transmissions, sensors, simulator tags) is ignored.
Shapes are read when they are needed: kinematics need none.
"""

import codecs
from collections.abc import Sequence, Set
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import cast, final, get_args
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError, warn_once
from eskin.files import parse_number, read_file
from eskin.robot.meshes import MeshReader
from eskin.robot.robot import Joint, JointKind, Link, Mimic, Robot
from eskin.robot.shapes import (
    Box,
    Cylinder,
    Geom,
    Shape,
    Sphere,
    TriangleMesh,
    build_shape_mesh,
)
from eskin.transforms import make_transform, quaternion_to_matrix, rpy_to_matrix

# Names in a URDF.
KINDS = get_args(JointKind)
BASE_KINDS = ("floating", "planar")
"""Kinds of joints by which a robot may stand in the world; they are taken as fixed."""
POSE = {"xyz", "rpy", "quat_xyzw"}
"""Attributes of an <origin>."""
PARENTS = {
    "link": ("robot",),
    "joint": ("robot",),
    "visual": ("link",),
    "collision": ("link",),
    "inertial": ("link",),
    "geometry": ("visual", "collision"),
    "origin": ("visual", "collision", "inertial", "joint"),
    "parent": ("joint",),
    "child": ("joint",),
    "axis": ("joint",),
    "limit": ("joint",),
    "mimic": ("joint",),
}
"""Elements in which others may stand. What other programs add is not looked into."""

# Limits of a file.
MAX_URDF_BYTES = 8 << 20
"""Largest size of a URDF [bytes]."""
MAX_ELEMENTS = 100_000
MAX_DEPTH = 50
"""Largest number of XML elements, and of elements inside each other."""
MAX_LINKS = MAX_JOINTS = 1000
MAX_GEOMS = 2000
"""Largest numbers of links, joints, and collision shapes of all links."""
MAX_TEXT = 1000
"""Largest length of an attribute that is used, such as a name."""
MAX_SIZE = 1e6
"""Largest length [m]."""

# Numbers whose unit is doubted, and what is said then.
LARGE = 5.0
"""Length from which its unit is doubted [m]."""
METRES = "divide by 1000: lengths of a URDF are in metres"
TURN = 2 * np.pi + 0.01
"""Angle of an <origin> from which its unit is doubted [rad]."""
TURNS = 4 * np.pi
"""Limit of a joint from which its unit is doubted [rad]."""
ENDLESS = 1e4
"""Limit from which a joint is taken as one without limits [rad] or [m]."""
RADIANS = "divide by 57.29578: angles of a URDF are in radians"
URDF_SUFFIX = ".urdf"
"""End of the name of a URDF file."""
RUN_XACRO = "run xacro first, as in 'xacro FILE > out.urdf'"


def load_urdf(path: str | Path, *, meshes: bool = True, mimics: bool = True) -> Robot:
    """Read a robot from a URDF file.

    Args:
        path: the file. Its meshes lie in its folder or in its packages, see
            `MeshReader`. They need the extra `design`, and are read when they are
            needed.
        meshes: whether links have their `<mesh>` geoms.
        mimics: whether to read mimic rules; without them every joint has a value.

    Raises:
        RobotError: The file is missing or is no URDF that can be used.
    """
    path = Path(path)
    try:
        data = read_file(path, MAX_URDF_BYTES)
    except OSError as error:
        raise RobotError(f"cannot read URDF {path}: {error.strerror}") from None
    reader = MeshReader(path.resolve().parent) if meshes else None
    return parse_urdf(data, path, reader, mimics)


def parse_urdf(
    data: bytes, path: Path, reader: MeshReader | None = None, mimics: bool = True
) -> Robot:
    """Read a robot from the bytes of a URDF.

    Args:
        data: the URDF.
        path: where it comes from, for messages, and for a robot without a name.
        reader: reader of its meshes; links have none without it.
        mimics: whether to read mimic rules; without them every joint has a value.

    Raises:
        RobotError: It is no URDF that can be used.
    """
    data = move_declaration(data)
    root = parse_xml(data, path)
    try:
        check_counts(root)
        check_places(root, path)
        links = tuple(read_link(each, reader, path) for each in root.findall("link"))
        moved = {child.get("link") for child in root.findall("joint/child")}
        joints = [read_joint(each, mimics, moved) for each in root.findall("joint")]
        joints = compose_mimics(root, joints)
        return Robot(root.get("name") or path.stem, links, joints, data)
    except ElementError as error:
        line = find_line(data, list(root.iter()).index(error.element))
        raise RobotError(f"{path} line {line}: {error}") from None
    except RobotError as error:
        raise RobotError(f"{path}: {error}") from None


def compose_mimics(root: Element, joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Return the joints, each of which follows only one with a value of its own.

    Raises:
        ElementError: A joint follows one that is missing or fixed, or itself.
    """
    moving = [j.name for j in joints if j.kind != "fixed" and j.mimic is None]
    rules = {joint.name: joint.mimic for joint in joints}
    composed = []
    for joint, element in zip(joints, root.findall("joint"), strict=True):
        rule = joint.mimic
        seen = {joint.name}
        while rule and rule.joint not in seen and (other := rules.get(rule.joint)):
            seen.add(rule.joint)
            factor = rule.multiplier
            offset = rule.offset
            rule = Mimic(
                other.joint, factor * other.multiplier, factor * other.offset + offset
            )
        if rule and rule.joint not in moving:
            near = get_close_matches(rule.joint, moving, 3) or moving[:3] or ["none"]
            raise ElementError(
                f"joint '{joint.name}' follows '{rule.joint}', which has no value of "
                f"its own; allowed: a joint such as {', '.join(near)}; name one, or "
                "take the <mimic> out",
                find_child(element, "mimic", joint.name),
            )
        composed.append(replace(joint, mimic=rule))
    return tuple(composed)


class ElementError(RobotError):
    """An element of a URDF cannot be used."""

    def __init__(self, message: str, element: Element) -> None:
        """Store the message and the element."""
        super().__init__(message)
        self.element = element


def find_line(data: bytes, index: int) -> int:
    """Return the line of a URDF in which its n-th XML element begins, from 0."""
    parser = expat.ParserCreate()
    lines: list[int] = []
    parser.StartElementHandler = lambda *_: lines.append(parser.CurrentLineNumber)
    parser.Parse(data, True)
    return lines[index]


def move_declaration(data: bytes) -> bytes:
    """Return a URDF whose XML declaration comes before the comments in front of it."""
    before, start, rest = data.partition(b"<?xml ")
    declaration, end, rest = rest.partition(b"?>")
    if not end or b"<robot" in before:
        return data
    before = before.removeprefix(codecs.BOM_UTF8)
    return start + declaration + end + before + rest


def parse_xml(data: bytes, path: Path) -> Element:
    """Return the <robot> element of a URDF; the path is for messages.

    A prefix is part of a name, declared or not, and a namespace without one is ignored.
    """
    parser = expat.ParserCreate()
    tree = LimitedTreeBuilder(path)
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = tree.refuse_doctype
    parser.StartElementHandler = tree.start
    parser.EndElementHandler = tree.end
    parser.CharacterDataHandler = tree.data
    try:
        parser.Parse(move_declaration(data), True)
        root = tree.close()
    except RobotError:
        raise
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise RobotError(
            f"{path} is not XML ({error}); a URDF in UTF-8 is wanted"
        ) from None
    if root.tag != "robot":
        raise RobotError(f"{path} holds <{root.tag}>; a URDF with <robot> is wanted")
    if any("xacro" in element.tag for element in root.iter()):
        raise RobotError(f"{path} still holds xacro macros; {RUN_XACRO}")
    return root


@final
class LimitedTreeBuilder(ElementTree.TreeBuilder):
    """Builds the elements of a URDF, and stops where it is made to take much memory."""

    def __init__(self, path: Path) -> None:
        """Start without elements; the path is for messages."""
        super().__init__()
        self.path = path
        self.count = 0
        self.depth = 0

    def refuse_doctype(self, *_: object) -> None:
        """Refuse a document type: it can define entities that expand without end."""
        raise RobotError(
            f"{self.path} has a <!DOCTYPE>; a URDF needs none, take it out"
        )

    def start(self, tag: str, attrs: dict[str, str], /) -> Element:
        """Open an element."""
        self.count = self.count + 1
        self.depth = self.depth + 1
        if self.count > MAX_ELEMENTS or self.depth > MAX_DEPTH:
            raise RobotError(
                f"{self.path} has more than {MAX_ELEMENTS:,} elements or {MAX_DEPTH} "
                "inside each other; a URDF with fewer is wanted"
            )
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> Element:
        """Close an element."""
        self.depth -= 1
        return super().end(tag)


def check_counts(root: Element) -> None:
    """Raise where a robot has too many parts."""
    for tag, found, most in (
        ("link", root.findall("link"), MAX_LINKS),
        ("joint", root.findall("joint"), MAX_JOINTS),
        ("collision", root.findall("link/collision"), MAX_GEOMS),
    ):
        if len(found) > most:
            raise RobotError(f"it has {len(found)} <{tag}>; allowed: {most}")


def check_places(root: Element, path: Path) -> None:
    """Raise where a link, joint or shape would be lost; tell of the rest."""
    waiting = [root]
    while waiting:
        element = waiting.pop()
        name = f" '{element.get('name')}'" if element.get("name") else ""
        place = f"<{element.tag}>{name}"
        for child in element:
            if child.tag not in PARENTS:
                continue
            allowed = f"allowed: in {', '.join(PARENTS[child.tag])}"
            if element.tag in PARENTS[child.tag]:
                waiting.append(child)
            elif child.tag in ("link", "joint", "collision"):
                raise ElementError(
                    f"{place} holds a <{child.tag}>; {allowed}; move it there", child
                )
            else:
                warn_once(
                    f"{path}: {place} holds <{child.tag}>, which counts for nothing "
                    f"there; {allowed}"
                )


def read_link(element: Element, reader: MeshReader | None, path: Path) -> Link:
    """Read a link with its collision geoms, whose shapes are read when needed."""
    name = read_text(element, "name", "robot")
    place = f"link '{name}'"
    geoms = []
    lacks_meshes = False
    for collision in element.findall("collision"):
        geometry = find_child(collision, "geometry", place)
        if reader is None and geometry.find("mesh") is not None:
            lacks_meshes = True
            continue
        shape = partial(read_sized_shape, geometry, reader, f"{path}: {place}")
        geoms.append(Geom(shape, read_origin(collision, place)))
    return Link(name, tuple(geoms), lacks_meshes)


def read_sized_shape(geometry: Element, reader: MeshReader | None, place: str) -> Shape:
    """Read a shape; warn where it is larger than parts of robots are."""
    shape = read_shape(geometry, reader, place)
    vertices = build_shape_mesh(shape).vertices
    size = vertices.max(axis=0) - vertices.min(axis=0)
    large = f"{place} is {' x '.join(f'{side:.3g}' for side in size)} m large"
    if not size.max() <= MAX_SIZE:
        raise RobotError(f"{large}; allowed: {MAX_SIZE:g} m; scale it")
    if size.max() > LARGE:
        is_mesh = isinstance(shape, TriangleMesh)
        remedy = 'add scale="0.001 0.001 0.001" to its <mesh>' if is_mesh else METRES
        warn_once(f"{large}; if that should be millimetres, {remedy}")
    return shape


def read_shape(geometry: Element, reader: MeshReader | None, place: str) -> Shape:
    """Read the one shape inside a <geometry>."""
    shape = next(iter(geometry), None)
    if len(geometry) > 1:
        raise RobotError(
            f"{place}: <geometry> holds {len(geometry)} shapes; allowed: one; give "
            "each a <collision> of its own"
        )
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
        case "mesh", Element() if reader is not None:
            scale = read_numbers(shape, "scale", place, 3, (1.0, 1.0, 1.0))
            return reader.read(read_text(shape, "filename", place), scale, place)
        case tag, _:
            raise RobotError(
                f"{place}: <geometry> holds {tag}; allowed: cylinder, sphere, box, mesh"
            )


def read_joint(element: Element, mimics: bool, moved: Set[str | None]) -> Joint:
    """Read a joint with its axis, limits and mimic rule.

    Args:
        element: the joint.
        mimics: whether to read its mimic rule.
        moved: names of the links that are the child of a joint.
    """
    name = read_text(element, "name", "robot")
    place = f"joint '{name}'"
    kind = read_text(element, "type", place)
    parent = read_text(find_child(element, "parent", place), "link", place)
    child = read_text(find_child(element, "child", place), "link", place)
    if kind in BASE_KINDS and parent not in moved:
        warn_once(
            f"{place} is {kind}, and nothing says where it is: '{child}' is taken as "
            f"fixed to '{parent}'"
        )
        kind = "fixed"
    if kind not in KINDS:
        raise RobotError(
            f"{place} is of type '{kind}'; allowed: {', '.join(KINDS)}, and "
            f"{' or '.join(BASE_KINDS)} of the root link alone; make it fixed"
        )
    kind = cast(JointKind, kind)
    lower, upper, velocity = read_limits(element, kind, place)
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        T_parent_joint=read_origin(element, place),
        axis=read_axis(element, place),
        lower=lower,
        upper=upper,
        velocity=velocity,
        mimic=read_mimic(element, kind, place) if mimics else None,
    )


def read_axis(element: Element, place: str) -> np.ndarray:
    """Read the unit axis of a joint, which is x where none is given."""
    found = find_optional(element, "axis", place)
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
    limit = find_optional(element, "limit", place)
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
    farthest = max(abs(lower), abs(upper))
    limits = f"{place} moves from {lower:g} to {upper:g}"
    if kind == "revolute" and TURNS < farthest < ENDLESS:
        warn_once(f"{limits} rad; if that should be degrees, {RADIANS}")
    if kind == "prismatic" and LARGE < farthest < ENDLESS:
        warn_once(f"{limits} m; if that should be millimetres, {METRES}")
    return lower, upper, velocity


def read_mimic(element: Element, kind: JointKind, place: str) -> Mimic | None:
    """Read the rule by which a joint follows another, if there is one."""
    found = find_optional(element, "mimic", place)
    if found is None or kind == "fixed":
        return None
    if not found.get("joint", "").strip():
        raise ElementError(
            f"{place}: <mimic> has no 'joint'; add it, or take the <mimic> out", found
        )
    multiplier = read_number(found, "multiplier", place, 1.0)
    offset = read_number(found, "offset", place, 0.0)
    return Mimic(read_text(found, "joint", place), multiplier, offset)


def find_child(element: Element, tag: str, place: str) -> Element:
    """Return the one child with a tag; raise where there is none, or more."""
    found = find_optional(element, tag, place)
    if found is None:
        raise RobotError(f"{place} has no <{tag}>; add one")
    return found


def find_optional(element: Element, tag: str, place: str) -> Element | None:
    """Return the one child with a tag, None where there is none; raise where more."""
    found = element.findall(tag)
    if len(found) > 1:
        raise ElementError(
            f"{place} has {len(found)} <{tag}>; allowed: one; take out what is wrong",
            found[1],
        )
    return found[0] if found else None


def read_text(element: Element, attribute: str, place: str) -> str:
    """Read an attribute; raise where it is missing or empty."""
    value = element.get(attribute, "").strip()
    if not value:
        raise RobotError(f"{place}: <{element.tag}> has no '{attribute}'; add it")
    if len(value) > MAX_TEXT:
        raise RobotError(
            f"{place:.100}: <{element.tag}> has a '{attribute}' of {len(value)} "
            f"characters; allowed: {MAX_TEXT}"
        )
    if "$(" in value or "${" in value:
        raise RobotError(
            f"{place}: <{element.tag}> {attribute} is '{value}', which is xacro; "
            f"{RUN_XACRO}"
        )
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
        values = tuple(map(parse_number, given.replace(", ", " ").split()))
    except ValueError:
        values = ()
    if len(values) != count:
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


def read_rotation(element: Element, place: str) -> Float[np.ndarray, "3 3"]:
    """Read the rotation of an element's roll, pitch and yaw [rad]."""
    rpy = read_numbers(element, "rpy", place, 3, (0.0, 0.0, 0.0))
    if max(map(abs, rpy)) > TURN:
        warn_once(
            f"{place}: <{element.tag}> rpy is '{element.get('rpy')}' rad; if that "
            f"should be degrees, {RADIANS}"
        )
    return rpy_to_matrix(np.array(rpy))


def read_origin(element: Element, place: str) -> Float[np.ndarray, "4 4"]:
    """Read the pose of an element's <origin> [m]; without one it is the identity."""
    found = find_optional(element, "origin", place)
    if found is None:
        return np.eye(4)
    given = {name for name in found.attrib if ":" not in name}
    if given - POSE or POSE - {"xyz"} <= given:
        raise RobotError(
            f"{place}: <origin> has {', '.join(sorted(given))}; allowed: xyz, and rpy "
            "or quat_xyzw"
        )
    xyz = np.array(read_numbers(found, "xyz", place, 3, (0.0, 0.0, 0.0)))
    if (away := np.linalg.norm(xyz)) > LARGE:
        warn_once(
            f"{place} lies {away:.3g} m from the frame that it is given in; if that "
            f"should be millimetres, {METRES}"
        )
    if "quat_xyzw" not in given:
        return make_transform(read_rotation(found, place), xyz)
    quaternion = np.array(read_numbers(found, "quat_xyzw", place, 4))
    if not quaternion.any():
        raise RobotError(f"{place}: <origin> quat_xyzw has no length; give a rotation")
    quaternion = np.roll(quaternion / np.abs(quaternion).max(), 1)
    return make_transform(quaternion_to_matrix(quaternion), xyz)
