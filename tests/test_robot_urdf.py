"""Any normal URDF is read, and one that cannot be used is refused in one line."""

import numpy as np
import pytest

from eskin.errors import RobotError
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

GOOD = """<?xml version="1.0"?>
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


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "toy.urdf"
        path.write_text(text)
        return path

    return write


def changed(old, new):
    assert GOOD.count(old) == 1, f"{old!r} must stand once in the file"
    return GOOD.replace(old, new)


def test_links_joints_and_limits_are_read_and_all_else_passed_over(write):
    robot = load_urdf(write(GOOD))
    assert robot.name == "toy"
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


def test_bodies_keep_their_shape_and_place(write):
    base, arm, *rest = load_urdf(write(GOOD)).links
    box, sphere = base.geoms
    assert box.shape == Box((1.0, 2.0, 3.0))
    expected = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(box.T_link_shape, expected, atol=1e-15)
    assert sphere.shape == Sphere(0.5)
    np.testing.assert_array_equal(sphere.T_link_shape, np.eye(4))
    assert arm.geoms[0].shape == Cylinder(0.1, 2.0)
    assert all(link.geoms == () for link in rest)


def test_a_robot_is_loaded_by_path_as_text_or_path(write):
    path = write(GOOD)
    assert load_robot(path).name == load_robot(str(path)).name == "toy"


def refusal(path, **options):
    with pytest.raises(RobotError) as caught:
        load_robot(path) if not options else load_urdf(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message


LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'


@pytest.mark.parametrize(
    "old, new, message",
    [
        ('name="toy"', "", None),
        ('<link name="tip"/>', "<link/>", "robot: <link> has no 'name'; add it"),
        (
            '<link name="tip"/>',
            "",
            "robot 'toy': joint 'weld' has unknown child link 'tip'; "
            "allowed: arm, base, slider, wheel",
        ),
        (
            '<parent link="slider"/>',
            '<parent link="tip"/>',
            "robot 'toy': links tip hang in a cycle; remove the joint that closes it",
        ),
        (
            '<link name="wheel"/>',
            '<link name="wheel"/><link name="stray"/>',
            "robot 'toy' has several roots (base, stray); "
            "join them with fixed joints to leave one",
        ),
        (
            'name="lift" type="revolute"',
            'name="lift" type="floating"',
            "joint 'lift' is of type 'floating'; "
            "allowed: revolute, continuous, prismatic, fixed",
        ),
        (
            'name="lift" type="revolute"',
            'name="lift"',
            "joint 'lift': <joint> has no 'type'; add it",
        ),
        (
            LIMIT,
            "",
            "joint 'lift' is revolute and has no <limit>; "
            "add one with lower, upper and velocity, or make it continuous",
        ),
        (
            LIMIT,
            LIMIT.replace('velocity="3"', ""),
            "joint 'lift': <limit> has no 'velocity'; add it",
        ),
        (
            LIMIT,
            LIMIT.replace('lower="-1"', 'lower="3"'),
            "joint 'lift': <limit> lower 3 is above upper 2; swap them",
        ),
        (
            LIMIT,
            LIMIT.replace('lower="-1"', 'lower="low"'),
            "joint 'lift': <limit> lower is 'low'; wanted: 1 finite number",
        ),
        (
            LIMIT,
            LIMIT.replace('velocity="3"', 'velocity="-3"'),
            "joint 'lift': <limit> velocity is -3; wanted: 0 or more",
        ),
        (
            '<parent link="base"/>',
            "",
            "joint 'lift' has no <parent>; add one",
        ),
        (
            '<child link="arm"/>',
            "<child/>",
            "joint 'lift': <child> has no 'link'; add it",
        ),
        (
            '<axis xyz="0 2 0"/>',
            '<axis xyz="0 0 0"/>',
            "joint 'lift': <axis> xyz has no length; give a direction",
        ),
        (
            '<origin xyz="0 0 1"/>',
            '<origin xyz="0 0"/>',
            "joint 'lift': <origin> xyz is '0 0'; wanted: 3 finite numbers",
        ),
        (
            '<origin xyz="0 0 1"/>',
            '<origin rpy="0 nan 1"/>',
            "joint 'lift': <origin> rpy is '0 nan 1'; wanted: 3 finite numbers",
        ),
        (
            '<mimic joint="roll" multiplier="2"/>',
            '<mimic multiplier="2"/>',
            "joint 'slide': <mimic> has no 'joint'; add it",
        ),
        (
            '<box size="1 2 3"/>',
            '<box size="1 0 3"/>',
            "link 'base': <box> size is '1 0 3'; wanted: each above 0",
        ),
        (
            '<sphere radius="0.5"/>',
            '<sphere radius="-1"/>',
            "link 'base': <sphere> radius is -1; wanted: more than 0",
        ),
        (
            '<sphere radius="0.5"/>',
            '<capsule radius="1"/>',
            "link 'base': <geometry> holds capsule; "
            "allowed: cylinder, sphere, box, mesh",
        ),
        (
            '<sphere radius="0.5"/>',
            "",
            "link 'base': <geometry> holds nothing; "
            "allowed: cylinder, sphere, box, mesh",
        ),
        (
            '<cylinder radius="0.1" length="2"/>',
            '<cylinder radius="0.1"/>',
            "link 'arm': <cylinder> has no 'length'; add it",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_place(write, old, new, message):
    path = write(changed(old, new))
    if message is None:
        assert load_urdf(path).name == path.stem
    else:
        assert refusal(path) == f"{path}: {message}"


@pytest.mark.parametrize(
    "text, message",
    [
        ("not xml", "{} is not XML (syntax error: line 1, column 0); a URDF is wanted"),
        ("<mujoco/>", "{} holds <mujoco>; a URDF with <robot> is wanted"),
        (
            '<?xml version="1.0" encoding="bogus"?><robot/>',
            "{} is not XML (unknown encoding: bogus); a URDF is wanted",
        ),
        (
            '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro/></robot>',
            "{} still holds xacro macros; run xacro on it first",
        ),
        ("<robot/>", "{}: robot 'toy' has no links; at least one is needed"),
    ],
)
def test_a_file_that_is_no_urdf_is_refused(write, text, message):
    path = write(text)
    assert refusal(path) == message.format(path)


def test_a_missing_file_is_refused(tmp_path):
    path = tmp_path / "gone.urdf"
    assert refusal(path) == f"cannot read URDF {path}: No such file or directory"


def test_a_folder_is_refused(tmp_path):
    path = tmp_path / "folder.urdf"
    path.mkdir()
    assert refusal(path) == f"cannot read URDF {path}: Is a directory"


MESH = """<robot name="toy"><link name="base">
  <collision><geometry><mesh filename="{}" scale="{}"/></geometry></collision>
</link></robot>"""


def write_stl(path, mesh):
    """The text form of STL, in which every triangle brings its own corners."""
    lines = ["solid thing"]
    for triangle in mesh.vertices[mesh.faces]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, "endsolid thing", ""]))


def volume(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return np.sum(a * np.cross(b, c)) / 6


@pytest.mark.parametrize(
    "uri, stored",
    [
        ("box.stl", "robots/toy/urdf/box.stl"),
        ("../meshes/box.stl", "robots/toy/meshes/box.stl"),
        ("package://toy/meshes/box.stl", "robots/toy/meshes/box.stl"),
        ("package://toy/box.stl", "robots/toy/urdf/toy/box.stl"),
        ("package://other_name/meshes/box.stl", "robots/toy/meshes/box.stl"),
    ],
)
def test_meshes_are_found_from_the_urdfs_folder_and_those_above(tmp_path, uri, stored):
    pytest.importorskip("trimesh")
    write_stl(tmp_path / stored, build_shape_mesh(Box((1.0, 2.0, 3.0))))
    path = tmp_path / "robots" / "toy" / "urdf" / "toy.urdf"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(MESH.format(uri, "0.5 1 1"))
    shape = load_urdf(path).links[0].geoms[0].shape
    assert isinstance(shape, TriangleMesh)
    assert shape.vertices.shape == (8, 3)
    np.testing.assert_allclose(volume(shape), 3)


def test_a_mirrored_mesh_still_faces_outward(tmp_path):
    pytest.importorskip("trimesh")
    write_stl(tmp_path / "box.stl", build_shape_mesh(Box((1.0, 2.0, 3.0))))
    (tmp_path / "toy.urdf").write_text(MESH.format("box.stl", "1 -1 1"))
    shape = load_urdf(tmp_path / "toy.urdf").links[0].geoms[0].shape
    assert isinstance(shape, TriangleMesh)
    np.testing.assert_allclose(volume(shape), 6)


def test_a_missing_mesh_says_where_it_was_sought(write):
    path = write(MESH.format("package://toy/gone.stl", "1 1 1"))
    assert refusal(path) == (
        f"{path}: link 'base': mesh package://toy/gone.stl is not in {path.parent} "
        "or any folder above; put it there"
    )


@pytest.mark.parametrize(
    "file, message",
    [
        ("bad.stl", "mesh {} holds no triangles; give one that does"),
        ("bad.glb", "{} is no mesh ("),
    ],
)
def test_a_file_that_is_no_mesh_is_refused(write, tmp_path, file, message):
    pytest.importorskip("trimesh")
    (tmp_path / file).write_text("nonsense")
    path = write(MESH.format(file, "1 1 1"))
    expected = f"{path}: link 'base': {message.format(tmp_path / file)}"
    assert refusal(path).startswith(expected)


def test_a_mesh_without_trimesh_says_what_to_install(write, tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "trimesh", None)
    write_stl(tmp_path / "box.stl", build_shape_mesh(Box((1.0, 1.0, 1.0))))
    path = write(MESH.format("box.stl", "1 1 1"))
    assert refusal(path) == (
        f"{path}: link 'base' has mesh box.stl, which needs trimesh: "
        "pip install 'eskin[models]', or load the URDF with meshes=False"
    )


def test_a_urdf_moves_without_its_meshes(write):
    robot = load_urdf(write(MESH.format("gone.stl", "1 1 1")), meshes=False)
    assert robot.links[0].geoms == ()
    assert Kinematics(robot).poses(np.zeros(0)).shape == (1, 4, 4)
