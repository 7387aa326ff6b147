"""These tests check where the taxels of a skin are on a robot."""

import numpy as np

from eskin.robot import Kinematics, load_robot
from eskin.skin import MountedSkin, build_grid_skin, load_skin
from eskin.transforms import apply

SKIN = load_skin("ur5")
ROBOT = load_robot("ur5")
MOUNTED = MountedSkin(SKIN, ROBOT)
POSES = np.random.default_rng(0).uniform(-np.pi, np.pi, (3, 6))
TAXELS = np.random.default_rng(0).choice(SKIN.count, 60, replace=False)


def test_taxels_move_with_their_links_in_batches_too():
    p_world, n_world = MOUNTED.place_taxels(POSES, TAXELS)
    assert p_world.shape == n_world.shape == (3, len(TAXELS), 3)
    assert MOUNTED.place_taxels(POSES[0], TAXELS[:0])[0].shape == (0, 3)
    for q, positions, normals in zip(POSES, p_world, n_world, strict=True):
        p_all, n_all = MOUNTED.place_taxels(q)
        np.testing.assert_allclose(positions, p_all[TAXELS])
        np.testing.assert_allclose(normals, n_all[TAXELS])
        T_world_link = Kinematics(ROBOT).poses(q)
        for taxel in TAXELS[:20]:
            T = T_world_link[MOUNTED.taxel_link_index[taxel]]
            assert np.allclose(p_all[taxel], apply(T, SKIN.positions[taxel]))
            assert np.allclose(n_all[taxel], T[:3, :3] @ SKIN.normals[taxel])


def test_taxel_frames_are_rotations_whose_z_is_the_normal():
    frames = MOUNTED.compute_frames(POSES[0], TAXELS)
    assert np.allclose(frames @ np.swapaxes(frames, -1, -2), np.eye(3))
    assert np.allclose(np.linalg.det(frames), 1)
    assert np.allclose(frames[..., 2], MOUNTED.place_taxels(POSES[0], TAXELS)[1])


def test_skin_on_a_table_needs_no_joints():
    skin = build_grid_skin(3, 4)
    p_world, n_world = MountedSkin(skin, load_robot("table")).place_taxels(np.zeros(0))
    assert np.allclose(p_world, skin.positions) and np.allclose(n_world, [0, 0, 1])
