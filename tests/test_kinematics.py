"""Forward kinematics agrees with MuJoCo, with finite differences and with itself."""

from importlib import resources

import mujoco
import numpy as np
import pytest

from eskin.robot import (
    Joint,
    Kinematics,
    Link,
    Mimic,
    Robot,
    load_robot,
    load_urdf,
)
from eskin.transforms import exp_so3, make_transform, random_rotation

FUSE_NOTHING = '<mujoco><compiler fusestatic="false"/></mujoco>'
KINDS = ("revolute", "continuous", "prismatic", "fixed")


@pytest.fixture(scope="module")
def ur5():
    return load_robot("ur5")


def ur5_text():
    return (resources.files("eskin.robot") / "presets" / "ur5.urdf").read_text()


def random_tree_text(seed, links=12):
    """A URDF with every kind of joint, skew axes, and links in no order."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(links)
    text = [f'<link name="l{i}">{BODY}</link>' for i in order]
    for child in range(1, links):
        kind = KINDS[(child + seed) % 4]
        xyz, rpy, axis = (" ".join(map(str, rng.uniform(-1, 1, 3))) for _ in range(3))
        text.append(
            f'<joint name="j{child}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/>'
            f'<parent link="l{rng.integers(child)}"/><child link="l{child}"/>'
            f'<axis xyz="{axis}"/>'
            '<limit lower="-9" upper="9" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="tree">{"".join(text)}</robot>'


BODY = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'


def worst_difference_from_mujoco(robot, text, poses, seed=0):
    """Greatest difference of any entry of any link's pose."""
    head, opening, rest = text.partition("<robot name=")
    name, close, rest = rest.partition(">")
    xml = head + opening + name + close + FUSE_NOTHING + rest
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    q = np.random.default_rng(seed).uniform(-6, 6, (poses, len(robot.joint_names)))
    T_world_link = Kinematics(robot).poses(q)
    worst = 0.0
    for row, T in zip(q, T_world_link, strict=True):
        for joint, value in zip(robot.joint_names, row, strict=True):
            data.joint(joint).qpos[:] = value
        mujoco.mj_kinematics(model, data)
        for ours, name in zip(T, robot.link_names, strict=True):
            theirs = data.body(name)
            worst = max(worst, np.abs(ours[:3, 3] - theirs.xpos).max())
            worst = max(worst, np.abs(ours[:3, :3].ravel() - theirs.xmat).max())
    return worst


def test_ur5_poses_equal_mujocos_over_a_thousand_random_poses(ur5):
    assert worst_difference_from_mujoco(ur5, ur5_text(), 1000) < 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_poses_of_trees_with_every_kind_of_joint_equal_mujocos(tmp_path, seed):
    path = tmp_path / "tree.urdf"
    path.write_text(random_tree_text(seed))
    robot = load_urdf(path)
    assert worst_difference_from_mujoco(robot, path.read_text(), 20) < 1e-9


def axis_jacobian(robot, q):
    """Velocity (linear, angular) of every link per joint speed, from the axes."""
    T = Kinematics(robot).poses(q)
    parent_joint = {joint.child: joint for joint in robot.joints}
    jacobian = np.zeros((len(robot.links), 6, len(q)))
    for index, name in enumerate(robot.link_names):
        while name in parent_joint:
            joint = parent_joint[name]
            if joint.kind != "fixed":
                frame = T[robot.link_index(joint.child)]
                axis = frame[:3, :3] @ joint.axis
                column = robot.joint_names.index(joint.name)
                if joint.kind == "prismatic":
                    jacobian[index, :3, column] = axis
                else:
                    arm = T[index, :3, 3] - frame[:3, 3]
                    jacobian[index, :3, column] = np.cross(axis, arm)
                    jacobian[index, 3:, column] = axis
            name = joint.parent
    return jacobian


def difference_jacobian(robot, q, step=1e-6):
    """The same from poses a step apart."""
    steps = step * np.eye(len(q))
    kinematics = Kinematics(robot)
    ahead, behind = kinematics.poses(q + steps), kinematics.poses(q - steps)
    slope = (ahead - behind) / (2 * step)
    linear = slope[..., :3, 3]
    R = kinematics.poses(q)[:, :3, :3]
    spin = slope[..., :3, :3] @ np.swapaxes(R, -1, -2)
    angular = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    return np.moveaxis(np.concatenate([linear, angular], axis=-1), 0, -1)


def test_the_slope_of_the_poses_is_the_geometric_jacobian(ur5, tmp_path):
    path = tmp_path / "tree.urdf"
    path.write_text(random_tree_text(1))
    rng = np.random.default_rng(5)
    for robot in (ur5, load_urdf(path)):
        q = rng.uniform(-3, 3, len(robot.joint_names))
        np.testing.assert_allclose(
            difference_jacobian(robot, q), axis_jacobian(robot, q), atol=1e-8
        )


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3), (0,)])
def test_a_batch_equals_its_single_poses(ur5, shape):
    kinematics = Kinematics(ur5)
    q = np.random.default_rng(2).uniform(-3, 3, (*shape, 6))
    T = kinematics.poses(q)
    assert T.shape == (*shape, 8, 4, 4)
    for i in np.ndindex(shape):
        np.testing.assert_array_equal(T[i], kinematics.poses(q[i]))


def test_the_root_link_is_the_world_and_every_pose_is_rigid(ur5):
    q = np.random.default_rng(4).uniform(-3, 3, (50, 6))
    T = Kinematics(ur5).poses(q)
    assert (T[:, ur5.link_index("base_link")] == np.eye(4)).all()
    R = T[..., :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2) - np.eye(3), 0, atol=1e-14)
    assert (T[..., 3, :] == [0, 0, 0, 1]).all()


def test_float32_values_are_computed_in_float64(ur5):
    q = np.random.default_rng(4).uniform(-3, 3, 6).astype(np.float32)
    T = Kinematics(ur5).poses(q)
    assert T.dtype == np.float64
    np.testing.assert_array_equal(T, Kinematics(ur5).poses(q.astype(np.float64)))


def test_poses_do_not_depend_on_the_order_of_links_and_joints(ur5):
    shuffled = Robot("ur5", ur5.links[::-1], ur5.joints[::-1])
    q = np.random.default_rng(6).uniform(-3, 3, 6)
    np.testing.assert_allclose(
        Kinematics(shuffled).poses(q[::-1].copy())[::-1],
        Kinematics(ur5).poses(q),
        atol=1e-15,
    )


def test_a_second_call_leaves_the_first_poses_alone(ur5):
    kinematics = Kinematics(ur5)
    first = kinematics.poses(np.zeros(6))
    kept = first.copy()
    kinematics.poses(np.ones(6))
    np.testing.assert_array_equal(first, kept)


def test_a_robot_without_joints_takes_an_empty_q():
    kinematics = Kinematics(load_robot("table"))
    np.testing.assert_array_equal(kinematics.poses(np.zeros(0)), np.eye(4)[None])
    assert kinematics.poses(np.zeros((3, 0))).shape == (3, 1, 4, 4)


def test_a_joint_that_follows_takes_its_leaders_value():
    z = np.array([0.0, 0.0, 1.0])
    rest = make_transform(random_rotation(np.random.default_rng(0)), np.ones(3))
    follow = Mimic("a", -2.0, 0.5)
    robot = Robot(
        "gripper",
        (Link("palm"), Link("left"), Link("right")),
        (
            # The follower stands before its leader.
            Joint("b", "revolute", "palm", "right", rest, z, mimic=follow),
            Joint("a", "revolute", "palm", "left", rest, z),
        ),
    )
    assert robot.joint_names == ("a",)
    T = Kinematics(robot).poses(np.array([0.3]))
    np.testing.assert_allclose(T[1, :3, :3], rest[:3, :3] @ exp_so3(0.3 * z))
    np.testing.assert_allclose(T[2, :3, :3], rest[:3, :3] @ exp_so3(-0.1 * z))


def test_a_q_of_the_wrong_length_names_the_joints(ur5):
    with pytest.raises(ValueError, match="q has 5 values, robot 'ur5' has 6 moving"):
        Kinematics(ur5).poses(np.zeros(5))


def motion_of(joint, value):
    """What a joint does to its child, straight from its definition."""
    if joint.kind == "fixed":
        return np.eye(4)
    if joint.kind == "prismatic":
        return make_transform(np.eye(3), value * joint.axis)
    return make_transform(exp_so3(value * joint.axis), np.zeros(3))


@pytest.mark.parametrize("seed", range(6))
def test_poses_are_products_of_transforms_along_any_tree(seed):
    """Every kind of joint, some following others, links and joints in no order."""
    rng, links = np.random.default_rng(seed), 15
    joints, leaders = [], []
    for child in range(1, links):
        kind, axis = KINDS[rng.integers(4)], rng.normal(size=3)
        follows = kind != "fixed" and leaders and rng.random() < 0.4
        mimic = Mimic(rng.choice(leaders), -1.5, 0.3) if follows else None
        rest = make_transform(random_rotation(rng), rng.normal(size=3))
        parent, axis = f"l{rng.integers(child)}", axis / np.linalg.norm(axis)
        ends = parent, f"l{child}"
        joints.append(Joint(f"j{child}", kind, *ends, rest, axis, mimic=mimic))
        if kind != "fixed" and not follows:
            leaders.append(f"j{child}")
    order = rng.permutation(links)
    shuffled = tuple(joints[i] for i in rng.permutation(links - 1))
    robot = Robot("tree", tuple(Link(f"l{i}") for i in order), shuffled)
    q = rng.uniform(-3, 3, len(robot.joint_names))
    values, want = dict(zip(robot.joint_names, q, strict=True)), {"l0": np.eye(4)}
    for joint in joints:
        value = values.get(joint.name, 0.0)
        if joint.mimic:
            value = joint.mimic.multiplier * values[joint.mimic.joint]
            value += joint.mimic.offset
        moved = joint.T_parent_joint @ motion_of(joint, value)
        want[joint.child] = want[joint.parent] @ moved
    T_world_link = Kinematics(robot).poses(q)
    wanted = np.array([want[name] for name in robot.link_names])
    np.testing.assert_allclose(T_world_link, wanted, atol=1e-12)
