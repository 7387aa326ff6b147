"""Tests of the skins that come with eskin: sizes, densities and place on robots."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import KDTree

from eskin.robot import compute_surface_distance, load_robot
from eskin.skin import (
    SKIN_PRESETS,
    MountedSkin,
    check_skin,
    load_robot_for_skin,
    load_skin,
)
from eskin.transforms import apply, invert

ARMS = [name for name in SKIN_PRESETS if name.startswith("ur")]
ROBOT_SKINS = [*ARMS, "base", "post"]
UR5 = load_skin("ur5")


def compute_density(skin, taxels=...):
    """Compute the number of taxels per square centimetre."""
    areas = skin.areas[taxels]
    return len(areas) / (1e4 * areas.sum())


def test_ur5_skin_has_the_published_size_and_density():
    assert (UR5.count, len(UR5.patches)) == (2112, 9)
    assert 1.5 <= compute_density(UR5) <= 1.6
    densities = [compute_density(UR5, UR5.find_taxels(p.id)) for p in UR5.patches]
    assert np.all(np.diff(densities) >= -1e-9)
    assert len(np.unique(np.round(densities, 1))) >= 3
    links = [load_robot("ur5").link_index(patch.link) for patch in UR5.patches]
    assert links == sorted(links)


@pytest.mark.parametrize("name", SKIN_PRESETS)
def test_check_finds_no_problem_with_a_preset(name):
    assert load_skin(name).name == name
    assert check_skin(load_skin(name), load_robot_for_skin(name)) == []


def test_skins_of_public_data_are_flat_grids_of_nominal_pitch():
    sleeve = load_skin("sleeve")
    shearsense = load_skin("shearsense")
    assert sleeve.count == 513 and not sleeve.calibrated and not sleeve.has_shear
    assert shearsense.count == 36 and shearsense.has_shear
    np.testing.assert_allclose(np.diff(sleeve.positions[:27], axis=0)[:, 0], 0.01)
    np.testing.assert_allclose(sleeve.positions.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(sleeve.areas, 1e-4)
    assert load_robot_for_skin("sleeve").name == "table"
    assert load_robot_for_skin("other") is None


@pytest.mark.parametrize(
    ("name", "factor", "count"),
    [
        ("ur5-half", 0.5, 1056),
        ("ur5-double", 2.0, 4224),
        ("ur5-sparse", 0.7, 1478),
        ("ur5-dense", 1.4, 2957),
        ("ur5-shapes", 1.0, None),
        ("ur5-missing", 1.0, 2112 - 468),
        ("ur10", 1.0, None),
        ("base", 1.0, None),
        ("post", 1.0, None),
    ],
)
def test_preset_has_its_density(name, factor, count):
    skin = load_skin(name)
    assert compute_density(skin) == pytest.approx(
        factor * compute_density(UR5), rel=0.05
    )
    if count is not None:
        assert skin.count == pytest.approx(count, rel=0.05)
    if factor != 1.0:
        assert skin.areas.sum() == pytest.approx(UR5.areas.sum(), rel=0.02)


def test_missing_patch_leaves_the_others_where_they_are():
    skin = load_skin("ur5-missing")
    assert skin.patches == tuple(p for p in UR5.patches if p.id != "forearm_back")
    for patch in skin.patches:
        here = skin.find_taxels(patch.id)
        there = UR5.find_taxels(patch.id)
        np.testing.assert_array_equal(skin.positions[here], UR5.positions[there])


@pytest.mark.parametrize("name", ROBOT_SKINS)
def test_patches_lie_on_their_links_irregular_and_apart(name):
    skin = load_skin(name)
    robot = load_robot_for_skin(name)
    parts = [skin.find_taxels(patch.id) for patch in skin.patches]
    for patch, taxels in zip(skin.patches, parts, strict=True):
        link = robot.links[robot.link_index(patch.link)]
        distance, outward = compute_surface_distance(link, skin.positions[taxels])
        assert np.max(np.abs(distance)) < 1e-12
        assert np.min(np.sum(outward * skin.normals[taxels], axis=1)) > 1 - 1e-12
        assert len(taxels) < patch.rows * patch.columns or "ring" in patch.id
    for (one, own), (other, others) in combinations(enumerate(parts), 2):
        if skin.patches[one].link == skin.patches[other].link:
            gaps, nearest = KDTree(skin.positions[others]).query(skin.positions[own])
            cells = np.sqrt(skin.areas[own]) + np.sqrt(skin.areas[others[nearest]])
            assert np.min(gaps - cells / 2) > 0.001


@pytest.mark.parametrize("name", ARMS)
def test_no_taxel_is_inside_a_link_next_to_its_own(name):
    skin = load_skin(name)
    robot = load_robot_for_skin(name)
    mounted = MountedSkin(skin, robot)
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    # An arm this wide cannot fold its elbow flat on itself.
    elbow = np.arange(6) == robot.joint_names.index("elbow_joint")
    low, high = np.where(elbow, -2.4, low), np.where(elbow, 2.4, high)
    for q in np.random.default_rng(0).uniform(low, high, (6, 6)):
        p_world, _ = mounted.place_taxels(q)
        T_world_link = mounted.kinematics.poses(q)
        for joint in robot.joints:
            pair = robot.link_index(joint.parent), robot.link_index(joint.child)
            for own, beside in (pair, pair[::-1]):
                taxels = mounted.taxel_link_index == own
                if taxels.any() and robot.links[beside].geoms:
                    local = apply(invert(T_world_link[beside]), p_world[taxels])
                    distance, _ = compute_surface_distance(robot.links[beside], local)
                    assert np.min(distance) > 0.001, (robot.links[own].name, q)


def test_ur5_shapes_skin_covers_seams_of_the_ur5_skin():
    shapes = load_skin("ur5-shapes")
    for link in ("upper_arm_link", "forearm_link"):
        covering, usual = (
            skin.positions[np.array(skin.link_names)[skin.patch_index] == link]
            for skin in (shapes, UR5)
        )
        # Points between the two half shells of the usual skin.
        height = np.array([0.16, 0.25, 0.3])
        radius = np.hypot(*usual[-1, :2])
        seam = np.column_stack([0 * height, 0 * height + radius, height])
        assert (KDTree(usual).query(seam)[0] > 0.004).all()
        assert (KDTree(covering).query(seam)[0] < 0.009).any()
