"""Wrong robots are refused, each in one line that names what is wrong."""

import sys
from unittest.mock import patch

import numpy as np
import pytest

from eskin.errors import RobotError
from eskin.registry import advise_install
from eskin.robot import (
    ROBOT_PRESETS,
    Kinematics,
    Mimic,
    Sphere,
    build_shape_mesh,
    compute_surface_distance,
    load_robot,
)
from helpers.refusals import REFUSALS, check_refusal, refusal
from helpers.robots import (
    MESH,
    POINTER,
    TOY,
    build_chain,
    build_joint,
    build_robot,
    read_collada,
    read_part,
    read_shapes,
    write_off,
    write_stl,
)

LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
XACRO = "http://ros.org/wiki/xacro"
LAUGHS = """<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>
<robot name="r"><link name="&b;"/></robot>"""
EXTERNAL = """<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/passwd">]>
<robot name="&a;"><link name="base"/></robot>"""
PLY = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(
    f"property float {axis}\n" for axis in "xyz"
)
FACES = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
CORNERS = "0 0 0\n1 0 0\n0 1 0\n"
UR5 = load_robot("ur5")
NO_NUMBERS = ("0_1", "0x1", "inf", "nan", "1,5", "\u0661", "1e999")
"""Texts that Python or XML schemas take as numbers, and a URDF must not."""
NUMBERS = (
    ('xyz="0 0 1"/><axis', 'xyz="0 0 {}"/><axis'),
    ('rpy="0 0 1.57', 'rpy="0 {} 1.57'),
    ('lower="-1"', 'lower="{}"'),
    ('velocity="3"', 'velocity="{}"'),
    ('multiplier="2"', 'multiplier="{}"'),
    ('size="1 2 3"', 'size="1 {} 3"'),
    ('radius="0.5"', 'radius="{}"'),
)
SINGLE_ELEMENTS = (
    ('<parent link="base"/>', "<parent>"),
    ('<child link="arm"/>', "<child>"),
    ('<origin xyz="0 0 1"/>', "<origin>"),
    ('<axis xyz="0 2 0"/>', "<axis>"),
    (LIMIT, "<limit>"),
    ('<mimic joint="roll" multiplier="2"/>', "<mimic>"),
    ('<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>', "<origin>"),
    ('<geometry><box size="1 2 3"/></geometry>', "<geometry>"),
    ('<box size="1 2 3"/>', "<geometry> holds 2"),
)
"""Of two of these either could be meant; other programs take the first or the last."""
LOST_ELEMENTS = (
    ('<link name="tip"/>', '<link name="more"><link name="tip"/></link>'),
    ('<link name="tip"/>', '<link name="tip"><joint name="a"/></link>'),
    ("<parent", '<link name="more"/><parent'),
    ("<parent", '<joint name="more" type="fixed"/><parent'),
    ("<visual>", "<visual><collision/>"),
    ("<geometry>", "<geometry><collision/>"),
    ("<inertial>", "<inertial><collision/>"),
)
CIRCLES = (("j0", ""), ("j1", "j0", ""), ("j1", "j2", "j1"), ("j2", "j0", "j1"))
"""The joints that each joint of a chain follows."""


def tree(links, joints, *parts):
    """Return the row of a robot of links and joints that are no tree."""

    def call(folder):
        build_robot(links, *(build_joint(*joint) for joint in joints))

    name = f"links {links} and joints {joints}"
    return refusal(name, RobotError, call, "robot 'toy'", *parts)


def follow(leader):
    """Return the row of a joint that follows one that does not move by itself."""

    def call(folder):
        build_robot(
            "abcd",
            build_joint("weld", "a", "b", "fixed"),
            build_joint("lead", "a", "c"),
            build_joint("follow", "a", "d", mimic=Mimic(leader)),
        )

    parts = ("'follow'", f"'{leader}'", "lead")
    return refusal(f"joint follows {leader}", RobotError, call, *parts)


def text(name, content, *parts):
    """Return the row of a file of a URDF with some content."""

    def call(folder):
        path = folder / "toy.urdf"
        path.write_text(content)
        read_shapes(load_robot(path))

    return refusal(name, RobotError, call, "toy.urdf", *parts)


def change(old, new, *parts):
    """Return the row of a URDF of which some text is replaced."""
    assert old in TOY
    return text(new or f"no {old}", TOY.replace(old, new, 1), *parts)


def twice(element, part):
    """Return the row of a URDF with another element like one that stands once."""
    other = element.replace("1 2 3", "1 2 4").replace('"-1"', '"-2"')
    return change(element, element + other, part, "allowed: one")


def mesh(name, content, *parts):
    """Return the row of a link whose mesh is a file with some content."""

    def call(folder):
        pytest.importorskip("trimesh")
        (folder / name).write_text(content)
        path = folder / "toy.urdf"
        path.write_text(MESH.format(name, "1 1 1"))
        read_shapes(load_robot(path))

    return refusal(name, RobotError, call, "'base'", name, *parts)


def scale(values, part):
    """Return the row of a mesh of some scale."""

    def call(folder):
        write_off(folder)
        read_part(folder, f'<mesh filename="part.off" scale="{values}"/>')

    return refusal(f"scale {values}", RobotError, call, part)


def unit(length):
    """Return the row of a COLLADA file in some unit."""
    shown = f"part.dae has <unit meter='{length}'>"
    return refusal(
        f"unit {length}",
        RobotError,
        lambda folder: read_collada(folder, f'<unit meter="{length}"/>'),
        shown,
    )


def read_stl_without_trimesh(folder):
    """Read a URDF with a mesh as if trimesh were not installed."""
    write_stl(folder / "box.stl")
    (folder / "toy.urdf").write_text(MESH.format("box.stl", "1 1 1"))
    with patch.dict(sys.modules, {"trimesh": None}):
        read_shapes(load_robot(folder / "toy.urdf"))


def read_collada_without_reader(folder):
    """Read a COLLADA file as if pycollada were not installed."""
    pytest.importorskip("trimesh")
    (folder / "part.dae").write_text("")
    with patch.dict(sys.modules, {"collada": None}):
        read_part(folder, '<mesh filename="part.dae"/>')


def read_folder(folder):
    """Read a folder that is named as a file of a URDF."""
    (folder / "folder.urdf").mkdir()
    load_robot(folder / "folder.urdf")


def measure_tool(folder):
    """Measure distances from a link of the ur5 that has no shapes."""
    tool = UR5.links[UR5.link_index("tool0")]
    compute_surface_distance(tool, np.zeros((1, 3)))


def find_unknown_link(folder):
    """Look for a link that a robot does not have."""
    build_robot("ab", build_joint("j", "a", "b")).link_index("hand")


ROWS = [
    tree("", [], "no links"),
    tree("aa", [], "'a' twice"),
    tree("abc", [("j", "a", "b"), ("j", "b", "c")], "'j' twice"),
    tree("ab", [("j", "x", "b")], "'j'", "parent link 'x'", "a, b"),
    tree("ab", [("j", "a", "x")], "'j'", "child link 'x'", "a, b"),
    tree("abc", [("j", "a", "c"), ("k", "b", "c")], "'c'", "(j, k)"),
    tree("abc", [("j", "a", "c")], "several roots (a, b)"),
    tree("abc", [("j", "b", "c"), ("k", "c", "b")], "links b, c", "cycle"),
    tree("a", [("j", "a", "a")], "links a", "cycle"),
    *(follow(leader) for leader in ("weld", "follow", "nobody")),
    refusal("unknown link", RobotError, find_unknown_link, "'toy'", "'hand'", "a, b"),
    refusal(
        "unknown robot",
        RobotError,
        lambda folder: load_robot("ur6"),
        "'ur6'",
        ", ".join(ROBOT_PRESETS),
        "urdf",
    ),
    refusal(
        "too few positions of joints",
        ValueError,
        lambda folder: Kinematics(UR5).poses(np.zeros(5)),
        "5 values",
        "'ur5'",
        "6",
    ),
    refusal("link without shapes", RobotError, measure_tool, "'tool0'", "<collision>"),
    refusal(
        "mesh of too few segments",
        ValueError,
        lambda folder: build_shape_mesh(Sphere(0.1), 2),
        "2 segments",
        " 3 ",
    ),
    refusal("folder", RobotError, read_folder, "folder.urdf", "directory"),
    refusal(
        "missing file",
        RobotError,
        lambda folder: load_robot(folder / "gone.urdf"),
        "gone.urdf",
        "No such file",
    ),
    text("pointer", POINTER, "Git LFS", "git lfs pull"),
    text("no XML", "not xml", "line 1, column 0"),
    text("MJCF", "<mujoco/>", "<mujoco>"),
    text("encoding", '<?xml version="1.0" encoding="bogus"?><robot/>', "bogus"),
    text(
        "xacro",
        f'<robot xmlns:xacro="{XACRO}"><xacro:macro/></robot>',
        "run xacro",
    ),
    text("no links in a file", "<robot/>", "no links"),
    text("entities", LAUGHS, "<!DOCTYPE>"),
    text("entity of another file", EXTERNAL, "<!DOCTYPE>"),
    text(
        "deep",
        '<robot name="r">' + "<a>" * 1000 + "</a>" * 1000 + "</robot>",
        "inside each other",
    ),
    text(
        "many elements", '<robot name="r">' + "<a/>" * 100_001 + "</robot>", "elements"
    ),
    text("many links", f'<robot name="r">{"<link/>" * 1001}</robot>', "1001 <link>"),
    text("many joints", f'<robot name="r">{"<joint/>" * 1001}</robot>', "1001 <joint>"),
    text(
        "many shapes",
        f'<robot name="r"><link name="a">{"<collision/>" * 2001}</link></robot>',
        "2001 <collision>",
    ),
    text(
        "long name",
        f'<robot name="r"><link name="{"a" * 1001}"/></robot>',
        "1001 characters",
    ),
    text("large file", " " * (8 << 20) + TOY, "8,388,608"),
    text(
        "missing mesh",
        MESH.format("package://toy/gone.stl", "1 1 1"),
        "package://toy/gone.stl",
    ),
    *(
        text(f"chain of {circle}", build_chain(*circle), "'j", "no value", "<mimic>")
        for circle in CIRCLES
    ),
    change('<link name="tip"/>', "<link/>", "<link>", "'name'"),
    change('<link name="tip"/>', "", "'weld'", "child link 'tip'", "arm, base"),
    change('<parent link="slider"/>', '<parent link="tip"/>', "links tip", "cycle"),
    change("<link name=", '<link name="stray"/><link name=', "roots (stray, base)"),
    change('"revolute"', '"screw"', "'lift'", "'screw'", "revolute, continuous"),
    change('"prismatic"', '"floating"', "'slide'", "'floating'", "root", "make it"),
    change('rpy="0 0 1', 'quat="0 0 1', "'base'", "<origin>", "quat", "quat_xyzw"),
    change('xyz="1 2 3"', 'quat_xyzw="0 0 0 1"', "'base'", "rpy or quat_xyzw"),
    change('xyz="0 0 1"/><a', 'quat_xyzw="0 0 0 0"/><a', "'lift'", "no length"),
    change('lower="-1"', 'lower="${-pi}"', "'lift'", "'${-pi}'", "run xacro"),
    change(' type="revolute"', "", "'lift'", "'type'"),
    change(LIMIT, "", "'lift'", "revolute", "<limit>", "continuous"),
    change(' velocity="3"', "", "'lift'", "<limit>", "'velocity'"),
    change('lower="-1"', 'lower="3"', "'lift'", "<limit> lower 3", "upper 2"),
    change('lower="-1"', 'lower="low"', "'lift'", "<limit> lower", "'low'", "1 finite"),
    change('velocity="3"', 'velocity="-3"', "'lift'", "<limit> velocity", "-3"),
    change('<parent link="base"/>', "", "'lift'", "<parent>"),
    change('<child link="arm"/>', "<child/>", "'lift'", "<child>", "'link'"),
    change('xyz="0 2 0"', 'xyz="0 0 0"', "'lift'", "<axis> xyz", "length"),
    change('xyz="0 0 1"/><axis', 'xyz="0 0"/><axis', "<origin> xyz", "'0 0'", "3 fini"),
    change('xyz="0 0 1"/><axis', 'rpy="0 nan 1"/><axis', "<origin> rpy", "'0 nan 1'"),
    change('joint="roll" multiplier', "multiplier", "'slide'", "<mimic>", "'joint'"),
    change('size="1 2 3"', 'size="1 0 3"', "'base'", "<box> size", "'1 0 3'"),
    change('radius="0.5"', 'radius="-1"', "'base'", "<sphere> radius", "-1"),
    change("<sphere", "<capsule", "'base'", "capsule", "cylinder, sphere, box, mesh"),
    change('<sphere radius="0.5"/>', "", "'base'", "nothing", "cylinder, sphere"),
    change(' length="2"', "", "'arm'", "<cylinder>", "'length'"),
    *(
        change(old, new.format(word), "finite number", word)
        for old, new in NUMBERS
        for word in NO_NUMBERS
    ),
    *(twice(*both) for both in SINGLE_ELEMENTS),
    *(change(*both, "line ", "allowed: in ", "move it") for both in LOST_ELEMENTS),
    mesh("a.ply", f"{PLY}{FACES}{CORNERS}3 0 1 9\n"),
    mesh("a.ply", f"{PLY}{FACES}{CORNERS}3 0 1 -9\n"),
    mesh("a.ply", f"{PLY}{FACES}{CORNERS.replace('1', 'nan')}3 0 1 2\n"),
    mesh("a.ply", PLY.replace("x 3", "x 99999999999") + FACES),
    mesh("a.3mf", "PK\x03\x04", "convert it"),
    mesh("a.glb", "glTF", "convert it"),
    mesh("a.stl", "nonsense"),
    mesh("a.dae", "<!DOCTYPE a [<!ENTITY b 'c'>]><COLLADA/>", "<!DOCTYPE>"),
    mesh("a.dae", "<instance_node/>" * 40, "repeats"),
    mesh("a.stl", "\0" * ((32 << 20) + 1), "33,554,432"),
    refusal(
        "mesh without trimesh",
        RobotError,
        read_stl_without_trimesh,
        "'base'",
        "box.stl",
        advise_install("design"),
    ),
    refusal(
        "COLLADA without its reader",
        RobotError,
        read_collada_without_reader,
        "part.dae cannot be read: needs pycollada; " + advise_install("design"),
    ),
    *map(unit, ("0", "-1", "nan", "inf", "0,01", "cm")),
    scale("0 0 0", "scale is '0 0 0'"),
    scale("1 0 1", "other than 0"),
    scale("1e300 1 1", "allowed: 1e+06 m"),
    scale("1e308 1e308 1e308", "allowed: 1e+06 m"),
]


@pytest.mark.parametrize(REFUSALS, ROWS)
def test_wrong_robot_is_refused_in_one_line(error, call, parts, tmp_path):
    check_refusal(error, call, parts, tmp_path)
