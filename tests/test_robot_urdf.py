"""Tests of URDF files: usual ones are read, others refused in one line with a place."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from eskin.errors import RobotError, warn_once
from eskin.robot import (
    Box,
    Cylinder,
    Kinematics,
    Sphere,
    TriangleMesh,
    load_robot,
    load_urdf,
)
from eskin.robot.urdf import parse_urdf
from helpers.robots import (
    MESH,
    POINTER,
    TOY,
    build_chain,
    read_shapes,
    write_stl,
)


@pytest.fixture
def write(tmp_path):
    """Return a function that writes the text of a URDF and returns its path."""

    def write(text):
        path = tmp_path / "toy.urdf"
        path.write_text(text)
        return path

    return write


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
