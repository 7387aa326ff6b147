"""Tests of kinematics: poses agree with MuJoCo and with their definition."""

from importlib import resources

import mujoco
import numpy as np
import pytest

from eskin.robot import Joint, Kinematics, Link, Mimic, Robot, load_robot
from eskin.transforms import exp_so3, make_transform, random_rotation

KINDS = ("revolute", "continuous", "prismatic", "fixed")
UR5 = load_robot("ur5")


def random_q(robot, shape=(), seed=0):
    """Return random joint positions."""
    shape = (*shape, len(robot.joint_names))
    return np.random.default_rng(seed).uniform(-3, 3, shape)


def build_tree(seed, links=15):
    """Build a robot of every kind of joint, some that follow, in no order."""
    rng = np.random.default_rng(seed)
    joints = []
    leaders = []
    for child in range(1, links):
        kind = KINDS[rng.integers(4)]
        axis = rng.normal(size=3)
        follows = kind != "fixed" and leaders and rng.random() < 0.4
        mimic = Mimic(rng.choice(leaders), -1.5, 0.3) if follows else None
        rest = make_transform(random_rotation(rng), rng.normal(size=3))
        ends = (f"l{rng.integers(child)}", f"l{child}")
        axis = axis / np.linalg.norm(axis)
        joints.append(Joint(f"j{child}", kind, *ends, rest, axis, mimic=mimic))
        if kind != "fixed" and not follows:
            leaders.append(f"j{child}")
    order = rng.permutation(links)
    shuffled = tuple(joints[i] for i in rng.permutation(links - 1))
    return Robot("tree", tuple(Link(f"l{i}") for i in order), shuffled)


def test_poses_of_the_ur5_equal_those_of_mujoco():
    path = resources.files("eskin.robot") / "presets" / "ur5.urdf"
    compiler = '<mujoco><compiler fusestatic="false"/></mujoco></robot>'
    xml = path.read_text().replace("</robot>", compiler)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    q = random_q(UR5, (200,))
    for values, T_world_link in zip(q, Kinematics(UR5).poses(q), strict=True):
        for joint, value in zip(UR5.joint_names, values, strict=True):
            data.joint(joint).qpos[:] = value
        mujoco.mj_kinematics(model, data)
        bodies = [data.body(link) for link in UR5.link_names]
        expected = [make_transform(b.xmat.reshape(3, 3), b.xpos) for b in bodies]
        np.testing.assert_allclose(T_world_link, expected, atol=1e-9)


def compute_motion(joint, value):
    """Compute the transform of a joint at a value from its definition."""
    if joint.kind == "fixed":
        return np.eye(4)
    if joint.kind == "prismatic":
        return make_transform(np.eye(3), value * joint.axis)
    return make_transform(exp_so3(value * joint.axis), np.zeros(3))


@pytest.mark.parametrize("seed", range(6))
def test_poses_are_products_of_transforms_along_the_tree(seed):
    robot = build_tree(seed)
    q = random_q(robot, seed=seed)
    values = dict(zip(robot.joint_names, q, strict=True))
    for joint in robot.joints:
        if joint.mimic is not None:
            leader = values[joint.mimic.joint]
            values[joint.name] = joint.mimic.multiplier * leader + joint.mimic.offset
    above = {joint.child: joint for joint in robot.joints}

    def compute_pose(link):
        if link not in above:
            return np.eye(4)
        joint = above[link]
        motion = compute_motion(joint, values.get(joint.name, 0.0))
        return compute_pose(joint.parent) @ joint.T_parent_joint @ motion

    expected = [compute_pose(link) for link in robot.link_names]
    np.testing.assert_allclose(Kinematics(robot).poses(q), expected, atol=1e-12)


@pytest.mark.parametrize("robot", [UR5, load_robot("table")], ids=["ur5", "table"])
@pytest.mark.parametrize("shape", [(), (7,), (2, 3), (0,)])
def test_poses_of_a_batch_equal_those_one_by_one(shape, robot):
    """Also of float32 values; later calls do not change them."""
    kinematics = Kinematics(robot)
    q = random_q(robot, shape).astype(np.float32)
    T = kinematics.poses(q)
    assert (T.shape, T.dtype) == ((*shape, len(robot.links), 4, 4), np.float64)
    for i in np.ndindex(shape):
        one = kinematics.poses(q[i].astype(np.float64))
        np.testing.assert_array_equal(T[i], one)
