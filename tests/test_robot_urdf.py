"""Tests of URDF files: usual ones are read, others refused in one line with a place."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from eskin.errors import RobotError
from eskin.registry import advise_install
from eskin.robot import (
    Box,
    Cylinder,
    Kinematics,
    Sphere,
    TriangleMesh,
    build_shape_mesh,
    load_robot,
    load_urdf,
)
from eskin.robot.urdf import parse_urdf, warn_once

TOY = """<?xml version="1.0"?>
<robot name="toy">
  <!-- a comment -->
  <material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="base">
    <inertial><mass value="1"/></inertial>
    <visual><geometry><mesh filename="package://nowhere/base.dae"/></geometry></visual>
    <collision>
      <origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>
      <geometry><box size="1 2 3"/></geometry>
    </collision>
    <collision><geometry><sphere radius="0.5"/></geometry></collision>
  </link>
  <link name="arm">
    <collision><geometry><cylinder radius="0.1" length="2"/></geometry></collision>
  </link>
  <link name="wheel"/>
  <link name="slider"/>
  <link name="tip"/>
  <joint name="lift" type="revolute">
    <parent link="base"/><child link="arm"/><origin xyz="0 0 1"/><axis xyz="0 2 0"/>
    <limit lower="-1" upper="2" effort="10" velocity="3"/>
    <dynamics damping="0.1"/><safety_controller k_velocity="1"/>
  </joint>
  <joint name="roll" type="continuous"><parent link="arm"/><child link="wheel"/></joint>
  <joint name="slide" type="prismatic">
    <parent link="arm"/><child link="slider"/><axis xyz="0 0 1"/>
    <limit upper="0.2" effort="1" velocity="0.5"/><mimic joint="roll" multiplier="2"/>
  </joint>
  <joint name="weld" type="fixed"><parent link="slider"/><child link="tip"/></joint>
  <transmission name="t"><joint name="lift"/><type>x</type></transmission>
  <gazebo reference="arm"><sensor name="s" type="contact"/></gazebo>
  <sensor name="skin"><parent link="arm"/><tactile/></sensor>
  <ros2_control name="c" type="system"><joint name="lift"/></ros2_control>
</robot>
"""
XACRO = "http://ros.org/wiki/xacro"
LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
MESH = """<robot name="toy"><link name="base">
  <collision><geometry><mesh filename="{}" scale="{}"/></geometry></collision>
</link></robot>"""


@pytest.fixture
def write(tmp_path):
    """Return a function that writes the text of a URDF and returns its path."""

    def write(text):
        path = tmp_path / "toy.urdf"
        path.write_text(text)
        return path

    return write


def read_shapes(robot):
    """Return all shapes of a robot, which are read when they are needed."""
    return [geom.shape for link in robot.links for geom in link.geoms]


def check_refusal(path, *texts):
    """Check that a URDF is refused in one line with its path and some texts."""
    with pytest.raises(RobotError) as error:
        read_shapes(load_robot(path))
    message = str(error.value)
    assert "\n" not in message and str(path) in message
    assert all(text in message for text in texts), message


def test_links_joints_and_limits_are_read_and_the_rest_ignored(write):
    path = write(TOY)
    robot = load_urdf(path)
    assert robot.name == load_robot(path).name == load_robot(str(path)).name == "toy"
    assert robot.link_names == ("base", "arm", "wheel", "slider", "tip")
    assert robot.joint_names == ("lift", "roll")
    np.testing.assert_array_equal(robot.lower, [-1, -np.inf])
    np.testing.assert_array_equal(robot.upper, [2, np.inf])
    np.testing.assert_array_equal(robot.velocity, [3, np.inf])
    lift, roll, slide, weld = robot.joints
    np.testing.assert_array_equal(lift.axis, [0, 1, 0])
    np.testing.assert_array_equal(roll.axis, [1, 0, 0])
    assert (slide.lower, slide.upper, slide.velocity) == (0, 0.2, 0.5)
    assert slide.mimic is not None
    assert (slide.mimic.joint, slide.mimic.multiplier) == ("roll", 2)
    assert (weld.kind, weld.parent, weld.child) == ("fixed", "slider", "tip")


def test_shapes_are_read_with_their_poses(write):
    base, arm, *others = load_urdf(write(TOY)).links
    box, sphere = base.geoms
    assert box.shape == Box((1.0, 2.0, 3.0))
    expected = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(box.T_link_shape, expected, atol=1e-15)
    assert sphere.shape == Sphere(0.5)
    np.testing.assert_array_equal(sphere.T_link_shape, np.eye(4))
    assert arm.geoms[0].shape == Cylinder(0.1, 2.0)
    assert all(link.geoms == () for link in others)


def test_limits_of_the_angle_of_a_continuous_joint_are_ignored(write):
    lift = load_urdf(write(TOY.replace('"revolute"', '"continuous"'))).joints[0]
    assert (lift.lower, lift.upper, lift.velocity) == (-np.inf, np.inf, 3)


def test_robot_without_a_name_has_that_of_its_file(write):
    assert load_urdf(write(TOY.replace(' name="toy"', ""))).name == "toy"


@pytest.mark.parametrize(
    ("old", "new", "texts"),
    [
        ('<link name="tip"/>', "<link/>", ["<link>", "'name'"]),
        ('<link name="tip"/>', "", ["'weld'", "child link 'tip'", "arm, base"]),
        ('<parent link="slider"/>', '<parent link="tip"/>', ["links tip", "cycle"]),
        ("<link name=", '<link name="stray"/><link name=', ["roots (stray, base)"]),
        ('"revolute"', '"screw"', ["'lift'", "'screw'", "revolute, continuous"]),
        ('"prismatic"', '"floating"', ["'slide'", "'floating'", "root", "make it"]),
        (
            'rpy="0 0 1.57',
            'quat="0 0 1.57',
            ["'base'", "<origin>", "quat", "quat_xyzw"],
        ),
        ('xyz="1 2 3"', 'quat_xyzw="0 0 0 1"', ["'base'", "rpy or quat_xyzw"]),
        ('xyz="0 0 1"/><a', 'quat_xyzw="0 0 0 0"/><a', ["'lift'", "no length"]),
        ('lower="-1"', 'lower="${-pi}"', ["'lift'", "'${-pi}'", "run xacro"]),
        (' type="revolute"', "", ["'lift'", "'type'"]),
        (LIMIT, "", ["'lift'", "revolute", "<limit>", "continuous"]),
        (' velocity="3"', "", ["'lift'", "<limit>", "'velocity'"]),
        ('lower="-1"', 'lower="3"', ["'lift'", "<limit> lower 3", "upper 2"]),
        ('lower="-1"', 'lower="low"', ["'lift'", "<limit> lower", "'low'", "1 finite"]),
        ('velocity="3"', 'velocity="-3"', ["'lift'", "<limit> velocity", "-3"]),
        ('<parent link="base"/>', "", ["'lift'", "<parent>"]),
        ('<child link="arm"/>', "<child/>", ["'lift'", "<child>", "'link'"]),
        ('xyz="0 2 0"', 'xyz="0 0 0"', ["'lift'", "<axis> xyz", "length"]),
        ('xyz="0 0 1"/><axis', 'xyz="0 0"/><axis', ["<origin> xyz", "'0 0'", "3 fini"]),
        ('xyz="0 0 1"/><axis', 'rpy="0 nan 1"/><axis', ["<origin> rpy", "'0 nan 1'"]),
        ('joint="roll" multiplier', "multiplier", ["'slide'", "<mimic>", "'joint'"]),
        ('size="1 2 3"', 'size="1 0 3"', ["'base'", "<box> size", "'1 0 3'"]),
        ('radius="0.5"', 'radius="-1"', ["'base'", "<sphere> radius", "-1"]),
        ("<sphere", "<capsule", ["'base'", "capsule", "cylinder, sphere, box, mesh"]),
        ('<sphere radius="0.5"/>', "", ["'base'", "nothing", "cylinder, sphere"]),
        (' length="2"', "", ["'arm'", "<cylinder>", "'length'"]),
    ],
)
def test_invalid_element_is_refused_with_its_place(write, old, new, texts):
    assert old in TOY
    check_refusal(write(TOY.replace(old, new, 1)), *texts)


@pytest.mark.parametrize("text", ["0_1", "0x1", "inf", "nan", "1,5", "\u0661", "1e999"])
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('xyz="0 0 1"/><axis', 'xyz="0 0 {}"/><axis'),
        ('rpy="0 0 1.57', 'rpy="0 {} 1.57'),
        ('lower="-1"', 'lower="{}"'),
        ('velocity="3"', 'velocity="{}"'),
        ('multiplier="2"', 'multiplier="{}"'),
        ('size="1 2 3"', 'size="1 {} 3"'),
        ('radius="0.5"', 'radius="{}"'),
    ],
)
def test_text_that_is_no_decimal_number_is_refused(write, old, new, text):
    assert old in TOY
    check_refusal(write(TOY.replace(old, new.format(text), 1)), "finite number")


@pytest.mark.parametrize(
    "element",
    [
        '<parent link="base"/>',
        '<child link="arm"/>',
        '<origin xyz="0 0 1"/>',
        '<axis xyz="0 2 0"/>',
        '<limit lower="-1" upper="2" effort="10" velocity="3"/>',
        '<mimic joint="roll" multiplier="2"/>',
        '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>',
        '<geometry><box size="1 2 3"/></geometry>',
        '<box size="1 2 3"/>',
    ],
)
def test_element_that_stands_twice_is_refused(write, element):
    """Either could be meant, and other programs take the first or the last."""
    assert element in TOY
    twice = element + element.replace("1 2 3", "1 2 4").replace('"-1"', '"-2"')
    check_refusal(write(TOY.replace(element, twice, 1)), "allowed: one")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<link name="tip"/>', '<link name="more"><link name="tip"/></link>'),
        ('<link name="tip"/>', '<link name="tip"><joint name="a"/></link>'),
        ("<parent", '<link name="more"/><parent'),
        ("<parent", '<joint name="more" type="fixed"/><parent'),
        ("<visual>", "<visual><collision/>"),
        ("<geometry>", "<geometry><collision/>"),
        ("<inertial>", "<inertial><collision/>"),
    ],
)
def test_element_that_would_be_lost_where_it_stands_is_refused(write, old, new):
    assert old in TOY
    check_refusal(write(TOY.replace(old, new, 1)), "line ", "allowed: in ", "move it")


@pytest.mark.parametrize(
    ("old", "new", "texts"),
    [
        ('rpy="0 0 1.57', 'rpy="0 0 90"  x:n="', ["'base'", "rpy is '0 0 90' rad"]),
        ('rpy="0 0 1.57', 'rpy="-180 0 0"  x:n="', ["degrees, divide by 57.29578"]),
        ('lower="-1" upper="2"', 'lower="-90" upper="90"', ["'lift'", "-90 to 90 rad"]),
        ('upper="0.2"', 'upper="200"', ["'slide'", "0 to 200 m", "divide by 1000"]),
        ('<link name="tip"/>', '<link name="tip"><origin/></link>', ["'tip'", "<ori"]),
        ("<visual>", '<geometry><box size="1 1 1"/></geometry><visual>', ["<geom"]),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"><axis/></axis>', ["nothing"]),
    ],
)
def test_unit_and_place_that_are_doubted_are_told(write, caplog, old, new, texts):
    assert old in TOY
    warn_once.cache_clear()
    load_urdf(write(TOY))
    assert caplog.messages == []
    load_urdf(write(TOY.replace(old, new, 1)))
    [line] = caplog.messages
    for text in texts:
        assert text in line


def nest(depth):
    return '<robot name="r">' + "<a>" * depth + "</a>" * depth + "</robot>"


LAUGHS = """<!DOCTYPE robot [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>
<robot name="r"><link name="&b;"/></robot>"""
EXTERNAL = """<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/passwd">]>
<robot name="&a;"><link name="base"/></robot>"""


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("not xml", "line 1, column 0"),
        ("<mujoco/>", "<mujoco>"),
        ('<?xml version="1.0" encoding="bogus"?><robot/>', "bogus"),
        (f'<robot xmlns:xacro="{XACRO}"><xacro:macro/></robot>', "run xacro"),
        ("<robot/>", "no links"),
        (LAUGHS, "<!DOCTYPE>"),
        (EXTERNAL, "<!DOCTYPE>"),
        (nest(1000), "inside each other"),
        ('<robot name="r">' + "<a/>" * 100_001 + "</robot>", "elements"),
        (f'<robot name="r">{"<link/>" * 1001}</robot>', "1001 <link>"),
        (f'<robot name="r">{"<joint/>" * 1001}</robot>', "1001 <joint>"),
        (
            f'<robot name="r"><link name="a">{"<collision/>" * 2001}</link></robot>',
            "2001 <collision>",
        ),
        (f'<robot name="r"><link name="{"a" * 1001}"/></robot>', "1001 characters"),
        (" " * (8 << 20) + TOY, "8,388,608"),
        (MESH.format("package://toy/gone.stl", "1 1 1"), "package://toy/gone.stl"),
    ],
)
def test_file_that_is_no_urdf_or_would_take_much_memory_is_refused(write, text, part):
    check_refusal(write(text), part)


def test_missing_file_and_folder_are_refused(tmp_path):
    (tmp_path / "folder.urdf").mkdir()
    check_refusal(tmp_path / "folder.urdf", "directory")
    check_refusal(tmp_path / "gone.urdf", "No such file")


def write_stl(path, size=(1.0, 2.0, 3.0)):
    """Write a box as the text form of STL, in which triangles share no corners."""
    mesh = build_shape_mesh(Box(size))
    lines = ["solid thing"]
    for triangle in mesh.vertices[mesh.faces]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, "endsolid thing", ""]))


@pytest.mark.parametrize(
    ("uri", "stored", "scale", "volume"),
    [
        ("box.stl", "urdf/box.stl", "0.5 1 1", 3),
        ("box.stl", "urdf/box.stl", "1 -1 1", 6),
        ("../meshes/box.stl", "meshes/box.stl", "1 1 1", 6),
        ("package://toy/meshes/box.stl", "meshes/box.stl", "1 1 1", 6),
        ("package://toy/box.stl", "urdf/toy/box.stl", "1 1 1", 6),
        ("package://other_name/meshes/box.stl", "meshes/box.stl", "1 1 1", 6),
    ],
)
def test_mesh_is_found_scaled_and_faces_outward(tmp_path, uri, stored, scale, volume):
    pytest.importorskip("trimesh")
    folder = tmp_path / "robots" / "toy"
    write_stl(folder / stored)
    (folder / "urdf").mkdir(exist_ok=True)
    (folder / "urdf" / "toy.urdf").write_text(MESH.format(uri, scale))
    shape = load_urdf(folder / "urdf" / "toy.urdf").links[0].geoms[0].shape
    assert isinstance(shape, TriangleMesh)
    assert shape.vertices.shape == (8, 3)
    a, b, c = np.moveaxis(shape.vertices[shape.faces], 1, 0)
    np.testing.assert_allclose(np.sum(a * np.cross(b, c)) / 6, volume)


def test_mesh_without_trimesh_names_the_extra(write, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    write_stl(tmp_path / "box.stl")
    path = write(MESH.format("box.stl", "1 1 1"))
    check_refusal(path, "'base'", "box.stl", advise_install("design"))


def test_urdf_is_read_without_its_meshes(write):
    robot = load_urdf(write(MESH.format("gone.stl", "1 1 1")), meshes=False)
    assert robot.links[0].geoms == ()
    assert Kinematics(robot).poses(np.zeros(0)).shape == (1, 4, 4)


FIND = "file://$(find arm)/meshes/box.stl"


@pytest.mark.parametrize(
    ("shape", "texts"),
    [
        ('<mesh filename="gone.stl"/>', ["gone.stl"]),
        ('<mesh filename="pointer.stl"/>', ["pointer.stl", "git lfs pull"]),
        (f'<mesh filename="{FIND}"/>', [FIND, "run xacro", "> out.urdf"]),
        ('<mesh filename="../../elsewhere.stl"/>', ["elsewhere.stl"]),
        ('<mesh filename="a.glb"/>', ["a.glb", "convert it"]),
        ('<sphere radius="0"/>', ["radius is 0"]),
        ("<ellipsoid/>", ["ellipsoid", "allowed"]),
    ],
)
def test_kinematics_need_no_shape_and_what_does_names_the_remedy(
    write, tmp_path, shape, texts
):
    """The other links, and the link's other shapes, can be used too."""
    (tmp_path / "pointer.stl").write_text(POINTER)
    (tmp_path / "a.glb").touch()
    text = TOY.replace('<sphere radius="0.5"/>', shape)
    robot = load_robot(write(text))
    path = tmp_path / "toy.urdf"
    expected = Kinematics(load_robot(write(TOY))).poses(np.zeros(2))
    np.testing.assert_array_equal(Kinematics(robot).poses(np.zeros(2)), expected)
    assert robot.links[0].geoms[0].shape == Box((1.0, 2.0, 3.0))
    check_refusal(write(text), f"{path}: link 'base'", *texts)


POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 684\n"


def test_urdf_that_is_a_pointer_of_git_lfs_is_told(write):
    check_refusal(write(POINTER), "Git LFS", "git lfs pull")


@pytest.mark.parametrize(
    "change",
    [
        lambda text: f"<!-- for {LATE} -->\n{text}",
        lambda text: f"\ufeff\n <!-- first -->{text}",
        lambda text: text.replace("<robot", '<robot xmlns="http://a.org/b"'),
        lambda text: text.replace("<limit", '<limit drake:acceleration="2"', 1),
        lambda text: text.replace("</robot>", f"<a>{LATE}<x:b/></a></robot>"),
        lambda text: text.replace("<safety", '<calibration rising="0"/><safety'),
        lambda text: text.replace("0 2 0", "0, 2, 0"),
        lambda text: text.replace("0 0 1.5707963267948966", "0,  0 1.5707963267948966"),
    ],
)
def test_what_does_not_change_a_urdf_is_accepted(write, change):
    """Comments before the declaration, namespaces, prefixes, commas, other tags."""
    before = load_urdf(write(TOY))
    after = load_urdf(write(change(TOY)))
    assert after.joint_names == before.joint_names
    assert read_shapes(after) == read_shapes(before)
    q = np.array([0.3, -0.4])
    poses = (Kinematics(robot).poses(q) for robot in (before, after))
    np.testing.assert_array_equal(*poses)
    assert parse_urdf(after.urdf, Path("again")).joint_names == before.joint_names


LATE = "xml version"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
def test_urdf_in_another_encoding_is_read(tmp_path, encoding):
    declared = TOY.replace('"1.0"', f'"1.0" encoding="{encoding.split("-sig")[0]}"')
    path = tmp_path / "toy.urdf"
    path.write_bytes(declared.replace('"tip"', '"h\u00fclse"').encode(encoding))
    assert load_urdf(path).link_names[-1] == "h\u00fclse"


@pytest.mark.parametrize("turn", [1e-160, 1.0, 1e160])
def test_quaternion_of_an_origin_is_its_rotation(write, turn):
    quaternion = f'quat_xyzw="0 0 {0.5**0.5 * turn} {0.5**0.5 * turn}"'
    changed = TOY.replace('rpy="0 0 1.5707963267948966"', quaternion)
    pose = load_urdf(write(changed)).links[0].geoms[0].T_link_shape
    expected = load_urdf(write(TOY)).links[0].geoms[0].T_link_shape
    np.testing.assert_allclose(pose, expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_free_base_is_fixed_with_a_warning_once(write, kind, caplog):
    warn_once.cache_clear()
    path = write(TOY.replace('"revolute"', f'"{kind}"'))
    robots = [load_urdf(path) for _ in range(2)]
    assert robots[0].joint_names == ("roll",)
    (record,) = caplog.records
    assert kind in record.message and "'lift'" in record.message
    expected = Kinematics(load_urdf(write(TOY))).poses(np.array([0.0, 0.5]))
    got = Kinematics(robots[1]).poses(np.array([0.5]))
    np.testing.assert_allclose(got, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("address", "stored"),
    [
        ("../box.stl", "box.stl"),
        ("../other/meshes/box.stl", "other/meshes/box.stl"),
        ("../meshes/../other/box.stl", "other/box.stl"),
        ("../mesh/box.stl", "box.stl"),
        ("{tmp}/box.stl", "box.stl"),
        ("file://{tmp}/box.stl", "box.stl"),
        ("package://../box.stl", "box.stl"),
        ("package://toy/../../box.stl", "box.stl"),
        ("package://toy/box.stl", "toy/box.stl"),
        ("link.stl", "box.stl"),
        ("linked/box.stl", "box.stl"),
    ],
)
def test_mesh_outside_folder_and_packages_is_refused(tmp_path, address, stored):
    """By a path that leads out, an absolute one, or a symbolic link."""
    folder = tmp_path / "robot"
    (folder / "toy").mkdir(parents=True)
    write_stl(tmp_path / stored)
    (folder / "link.stl").symlink_to(tmp_path / stored)
    (folder / "linked").symlink_to(tmp_path)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "mesh").symlink_to(tmp_path)
    path = folder / "toy.urdf"
    path.write_text(MESH.format(address.format(tmp=tmp_path), "1 1 1"))
    pytest.importorskip("trimesh")
    remedy = f"an empty package.xml into {tmp_path},"
    check_refusal(path, "'base'", "outside", "packages", remedy)
    (tmp_path / "package.xml").touch()
    assert read_shapes(load_urdf(path))


def test_mesh_in_a_folder_of_meshes_beside_is_read(tmp_path):
    """Whatever the folder of the URDF is named."""
    pytest.importorskip("trimesh")
    write_stl(tmp_path / "meshes" / "left" / "box.stl")
    (tmp_path / "any").mkdir()
    path = tmp_path / "any" / "toy.urdf"
    path.write_text(MESH.format("../meshes/left/box.stl", "1 1 1"))
    assert read_shapes(load_urdf(path))


def test_mesh_of_a_package_beside_is_read(tmp_path):
    """Where a package.xml says that it is one; also through a link to its folder."""
    pytest.importorskip("trimesh")
    write_stl(tmp_path / "other" / "meshes" / "box.stl")
    (tmp_path / "other" / "package.xml").write_text("<package/>")
    (tmp_path / "linked").symlink_to(tmp_path / "other")
    (tmp_path / "robot").mkdir()
    path = tmp_path / "robot" / "toy.urdf"
    for name in ("other", "linked"):
        path.write_text(MESH.format(f"package://{name}/meshes/box.stl", "1 1 1"))
        assert read_shapes(load_urdf(path))


PLY = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(
    f"property float {axis}\n" for axis in "xyz"
)
FACES = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
CORNERS = "0 0 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("name", "content", "part"),
    [
        ("a.ply", f"{PLY}{FACES}{CORNERS}3 0 1 9\n", ""),
        ("a.ply", f"{PLY}{FACES}{CORNERS}3 0 1 -9\n", ""),
        ("a.ply", f"{PLY}{FACES}{CORNERS.replace('1', 'nan')}3 0 1 2\n", ""),
        ("a.ply", PLY.replace("x 3", "x 99999999999") + FACES, ""),
        ("a.3mf", "PK\x03\x04", "convert it"),
        ("a.glb", "glTF", "convert it"),
        ("a.stl", "nonsense", ""),
        ("a.dae", "<!DOCTYPE a [<!ENTITY b 'c'>]><COLLADA/>", "<!DOCTYPE>"),
        ("a.dae", "<instance_node/>" * 40, "repeats"),
        ("a.stl", "\0" * ((32 << 20) + 1), "33,554,432"),
    ],
)
def test_hostile_mesh_is_refused(write, tmp_path, name, content, part):
    pytest.importorskip("trimesh")
    (tmp_path / name).write_text(content)
    check_refusal(write(MESH.format(name, "1 1 1")), "'base'", name, part)


def test_mesh_that_is_repeated_too_often_is_refused(write, tmp_path, monkeypatch):
    pytest.importorskip("trimesh")
    monkeypatch.setattr("eskin.robot.meshes.MAX_TRIANGLES", 100)
    write_stl(tmp_path / "box.stl")
    start, middle, end = MESH.format("box.stl", "1 1 1").partition("<collision>")
    once, *rest = end.partition("</link>")
    end_of_link = "".join(rest)
    assert read_shapes(load_urdf(write(start + (middle + once) * 8 + end_of_link)))
    text = start + (middle + once) * 9 + end_of_link
    check_refusal(write(text), "'base'", "108 triangles")


@pytest.mark.parametrize(
    ("old", "new", "texts"),
    [
        ('joint="roll" multiplier', "multiplier", ["has no 'joint'"]),
        ('joint="roll"', 'joint="rolls"', ["'rolls'", "such as roll"]),
        ('joint="roll"', 'joint="weld"', ["'weld'", "no value of its own"]),
    ],
)
def test_wrong_mimic_rule_names_its_line_and_can_be_ignored(write, old, new, texts):
    """Every command accepts the remedy: a URDF without the rule."""
    path = write(TOY.replace(old, new, 1))
    line = 1 + path.read_text().split("<mimic")[0].count("\n")
    remedy = "take the <mimic> out"
    check_refusal(path, f"toy.urdf line {line}: joint 'slide'", remedy, *texts)
    without = write(re.sub("<mimic.*?/>", "", TOY))
    for robot in (load_urdf(path, mimics=False), load_urdf(without)):
        assert robot.joint_names == ("lift", "roll", "slide")


def build_chain(*followed):
    """Build a URDF of three joints in a row, each of which may follow another."""
    rule = '<mimic joint="{}" multiplier="-2" offset="0.5"/>'
    joints = "".join(
        f'<joint name="j{i}" type="prismatic"><parent link="l{i}"/>'
        f'<child link="l{i + 1}"/><limit lower="-9" upper="9" velocity="1"/>'
        f"{other and rule.format(other)}</joint>"
        for i, other in enumerate(followed)
    )
    links = "".join(f'<link name="l{i}"/>' for i in range(len(followed) + 1))
    return f'<robot name="r">{links}{joints}</robot>'


@pytest.mark.parametrize(
    ("followed", "values"),
    [(("", "j0", "j1"), [1, -1.5, 3.5]), (("j1", "j2", ""), [3.5, -1.5, 1])],
)
def test_joint_that_follows_a_follower_has_the_value_of_both_rules(
    write, followed, values
):
    robot = load_urdf(write(build_chain(*followed)))
    poses = Kinematics(robot).poses(np.ones(1))
    np.testing.assert_allclose(np.diff(poses[:, 0, 3]), values)


@pytest.mark.parametrize(
    "followed", [("j0", ""), ("j1", "j0", ""), ("j1", "j2", "j1"), ("j2", "j0", "j1")]
)
def test_joints_that_follow_each_other_are_refused(write, followed):
    check_refusal(write(build_chain(*followed)), "'j", "no value of its own", "<mimic>")


def test_collada_mesh_is_read_in_metres(write, tmp_path):
    """A file in millimetres whose parts are moved by its scene."""
    pytest.importorskip("collada", reason="pycollada is not installed: extra models")
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((10.0, 20.0, 30.0))
    (tmp_path / "box.dae").write_bytes(trimesh.exchange.dae.export_collada(box))
    mesh = load_urdf(write(MESH.format("box.dae", "0.001 0.001 0.001"))).links[0]
    vertices = mesh.geoms[0].shape.vertices
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.01, 0.02, 0.03], rtol=1e-6)


def find_example_robots():
    """Return the URDFs of example-robot-data, or none where it is not installed."""
    parts = ("cmeel.prefix", "share", "example-robot-data", "robots")
    roots = (Path(place).joinpath(*parts) for place in sys.path if place)
    return sorted(path for root in roots for path in root.glob("**/*.urdf"))


NO_LINKS = "ur3.urdf"
BAD_MIMICS = "alex_psyonic_hands.urdf"


def test_kinematics_of_example_robots_agree_with_another_library():
    """On all robots of example-robot-data; one file of them has no links."""
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is not installed")
    paths = [path for path in find_example_robots() if path.name != NO_LINKS]
    if not paths:
        pytest.skip("example-robot-data is not installed: extra models")
    rng = np.random.default_rng(0)
    for path in paths:
        if path.name == BAD_MIMICS:
            check_refusal(path, "line 1037", "'index_q1'", "Left_index_q1")
            continue
        robot = load_urdf(path, meshes=False)
        other = yourdfpy.URDF.load(
            str(path), load_meshes=False, build_collision_scene_graph=False
        )
        low, high = (np.clip(limit, -3.0, 3.0) for limit in (robot.lower, robot.upper))
        q = rng.uniform(low, high)
        other.update_cfg(dict(zip(robot.joint_names, q, strict=True)))
        poses = Kinematics(robot).poses(q)
        base = np.linalg.inv(poses[robot.link_index(other.base_link)])
        for link, pose in zip(robot.link_names, poses, strict=True):
            expected = other.get_transform(link, other.base_link)
            np.testing.assert_allclose(base @ pose, expected, rtol=0, atol=1e-14)
