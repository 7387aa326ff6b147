"""Where taxels are on a robot, and how far apart over the surface and in space."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.skin_distance import GeometricDistance, kinematic_distance

from eskin.errors import SkinMismatchError
from eskin.robot import Kinematics, Robot, load_robot
from eskin.skin import (
    Dome,
    MountedSkin,
    Patch,
    Plane,
    TaxelGrid,
    Tube,
    build_grid_skin,
    build_skin,
    load_skin,
)
from eskin.transforms import apply, make_transform, random_rotation

SKIN = load_skin("ur5")
ROBOT = load_robot("ur5")
MOUNTED = MountedSkin(SKIN, ROBOT)
GEOMETRIC = GeometricDistance(SKIN)


def poses(count, seed=0):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))


def some(count, seed=0):
    return np.random.default_rng(seed).choice(SKIN.count, count, replace=False)


def moved_base(robot, T_world_base):
    """The robot with its first joint elsewhere: all links with taxels move along."""
    first, *others = robot.joints
    first = replace(first, T_parent_joint=T_world_base @ first.T_parent_joint)
    return Robot("moved", robot.links, (first, *others))


def test_taxels_move_with_their_links():
    q = poses(1)[0]
    p_world, n_world = MOUNTED.place_taxels(q)
    T_world_link = Kinematics(ROBOT).poses(q)
    for taxel in some(20):
        T = T_world_link[MOUNTED.taxel_link_index[taxel]]
        assert np.allclose(p_world[taxel], apply(T, SKIN.positions[taxel]))
        assert np.allclose(n_world[taxel], T[:3, :3] @ SKIN.normals[taxel])


def test_asked_taxels_and_batches_agree_with_the_whole():
    q, asked = poses(3), some(10)
    p_world, n_world = MOUNTED.place_taxels(q, asked)
    assert p_world.shape == n_world.shape == (3, 10, 3)
    for i in range(3):
        p_all, n_all = MOUNTED.place_taxels(q[i])
        assert np.allclose(p_world[i], p_all[asked])
        assert np.allclose(n_world[i], n_all[asked])
    assert MOUNTED.place_taxels(q[0], asked[:0])[0].shape == (0, 3)


def test_taxel_frames_are_rotations_whose_z_is_the_normal():
    q, asked = poses(1)[0], some(30)
    frames = MOUNTED.compute_frames(q, asked)
    assert np.allclose(frames @ np.swapaxes(frames, -1, -2), np.eye(3))
    assert np.allclose(np.linalg.det(frames), 1)
    assert np.allclose(frames[..., 2], MOUNTED.place_taxels(q, asked)[1])


def test_a_skin_on_a_table_needs_no_joints():
    skin = build_grid_skin(3, 4)
    p_world, n_world = MountedSkin(skin, load_robot("table")).place_taxels(np.zeros(0))
    assert np.allclose(p_world, skin.positions) and np.allclose(n_world, [0, 0, 1])


def test_a_robot_without_the_skins_links_is_refused_by_their_names():
    with pytest.raises(SkinMismatchError) as caught:
        MountedSkin(SKIN, load_robot("table"))
    said = str(caught.value)
    assert "forearm_link, upper_arm_link, wrist_1_link, wrist_2_link, wris" in said
    assert "robot 'table'" in said and "its links: table" in said


def test_over_the_surface_is_never_shorter_than_straight_whatever_the_pose():
    asked = some(200)
    far = GEOMETRIC.between(asked, asked)
    assert np.isfinite(far).any() and np.allclose(np.diag(far), 0, atol=1e-8)
    assert np.allclose(far, far.T)
    for q in poses(3):
        assert np.all(far >= kinematic_distance(MOUNTED, q, asked, asked) - 1e-9)


def test_over_the_surface_does_not_know_the_pose_and_straight_does():
    upper, wrist = (
        SKIN.find_taxels("upper_arm_back")[:5],
        SKIN.find_taxels("wrist_3")[:5],
    )
    straight = [kinematic_distance(MOUNTED, q, upper, wrist) for q in poses(2)]
    assert np.max(np.abs(straight[0] - straight[1])) > 0.01
    beside = [kinematic_distance(MOUNTED, q, upper, upper) for q in poses(2)]
    assert np.allclose(*beside, atol=1e-12), "one link is rigid"
    assert np.all(np.isinf(GEOMETRIC.between(upper, wrist))), "no way between links"


def test_straight_distances_do_not_change_when_the_whole_robot_is_moved():
    rng = np.random.default_rng(1)
    T_world_base = make_transform(random_rotation(rng), rng.standard_normal(3))
    moved = MountedSkin(SKIN, moved_base(ROBOT, T_world_base))
    q, asked = poses(1)[0], some(50)
    assert not np.allclose(
        moved.place_taxels(q, asked)[0], MOUNTED.place_taxels(q, asked)[0]
    )
    assert np.allclose(
        kinematic_distance(moved, q, asked, asked),
        kinematic_distance(MOUNTED, q, asked, asked),
    )


def test_on_a_tube_it_is_the_closed_form_across_both_half_shells():
    radius = 0.0375
    front, back = SKIN.find_taxels("forearm_front"), SKIN.find_taxels("forearm_back")
    pair = np.concatenate([front[::37], back[::41]])
    x, y, z = SKIN.positions[pair].T
    angle = np.arctan2(y, x)
    turn = np.abs(np.angle(np.exp(1j * (angle[:, None] - angle[None]))))
    expected = np.hypot(radius * turn, z[:, None] - z[None])
    assert np.allclose(GEOMETRIC.between(pair, pair), expected, atol=1e-9)


def test_the_ends_of_a_ring_are_neighbours():
    ring = SKIN.find_taxels("wrist_3")
    middle = ring[SKIN.rows[ring] == 2]
    ends = GEOMETRIC.between(middle[:1], middle[-1:])[0, 0]
    assert ends == pytest.approx(2 * np.pi * 0.0375 - 39 * 0.0057)


def test_on_a_plane_it_is_the_straight_line():
    skin = build_grid_skin(4, 5)
    every = np.arange(skin.count)
    straight = np.linalg.norm(skin.positions[:, None] - skin.positions[None], axis=-1)
    assert np.allclose(GeometricDistance(skin).between(every, every), straight)


def bent(fold):
    """Two flat patches of one link that meet at an edge, folded by an angle."""
    grid = TaxelGrid(6, 6, 0.005, 0.005)
    c, s = np.cos(fold), np.sin(fold)
    rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    hinge = np.array([0.015, 0.0, 0.0])
    T = make_transform(rotation, hinge + rotation @ hinge)
    patches = [Patch(name, "arm", i, 6, 6) for i, name in enumerate("ab")]
    laid = [(patches[0], grid, Plane(np.eye(4))), (patches[1], grid, Plane(T))]
    return build_skin("bent", laid)


def test_a_seam_between_patches_of_one_link_is_crossed():
    skin = bent(np.deg2rad(70))
    far = GeometricDistance(skin, seam=0.006).between(
        np.array([12]), np.array([36 + 17])
    )
    assert far[0, 0] == pytest.approx(0.055, rel=0.03)
    straight = np.linalg.norm(skin.positions[12] - skin.positions[36 + 17])
    assert straight < 0.05 < far[0, 0]


def test_patches_beyond_a_seams_width_or_on_other_links_are_infinitely_far():
    skin = bent(0.5)
    pair = np.array([0]), np.array([40])
    assert np.isinf(GeometricDistance(skin, seam=0.001).between(*pair)[0, 0])
    patches = (skin.patches[0], replace(skin.patches[1], link="hand"))
    assert np.isinf(GeometricDistance(replace(skin, patches=patches)).between(*pair))
    flat = replace(bent(0.0), patches=patches)
    assert np.isinf(GeometricDistance(flat).between(*pair)), "one plane, two links"


def test_on_a_free_form_the_way_goes_from_neighbour_to_neighbour():
    patch = Patch("cap", "arm", 1, 9, 9)
    round_skin = build_skin("cap", [(patch, TaxelGrid(9, 9, 0.01, 0.01), dome())])
    squeezed = replace(round_skin, positions=round_skin.positions * [1.0, 1.0, 0.6])
    exact, steps = GeometricDistance(round_skin), GeometricDistance(squeezed)
    assert len(exact.surfaces) == 1 and len(steps.surfaces) == 0
    every = np.arange(81)
    far = steps.between(every, every)
    straight = np.linalg.norm(
        squeezed.positions[:, None] - squeezed.positions[None], axis=-1
    )
    assert np.all(np.isfinite(far)) and np.all(far >= straight - 1e-12)
    middle_row = far[36, 44]
    along = np.linalg.norm(np.diff(squeezed.positions[36:45], axis=0), axis=1).sum()
    assert middle_row <= along + 1e-12


def dome():
    return Dome(0.06, np.eye(4))


def test_a_lone_taxel_has_a_distance_of_zero_to_itself():
    patch = Patch("dot", "arm", 1, 1, 1)
    tube = Tube(0.05, np.eye(4))
    skin = build_skin("dot", [(patch, TaxelGrid(1, 1, 0.01, 0.01), tube)])
    only = np.array([0])
    assert GeometricDistance(skin).between(only, only) == 0
