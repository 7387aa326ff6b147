"""The skins of robots: as dense as they say, on their surfaces, patches apart."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import KDTree

from eskin.robot import Kinematics, compute_surface_distance, load_robot
from eskin.skin import SKIN_PRESETS, MountedSkin, load_skin
from eskin.skin.layout import build_outline_skin, fit_to_part, scale_density
from eskin.skin.presets import UR5_OUTLINES, UR5_PARTS
from eskin.transforms import apply, invert

ARMS = (
    *("ur5", "ur5-half", "ur5-double", "ur5-sparse", "ur5-dense"),
    *("ur5-shapes", "ur5-missing", "ur10"),
)
DRUMS = ("base", "post")
SKINS = ARMS + DRUMS
USUAL = load_skin("ur5")


def area(skin):
    """Skin in all [cm2]."""
    return 1e4 * skin.areas.sum()


def density(skin):
    """Taxels a square centimetre."""
    return skin.count / area(skin)


@pytest.mark.parametrize(
    ("name", "times", "count"),
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
def test_a_skin_is_as_dense_as_it_says(name, times, count):
    skin = load_skin(name)
    assert skin.name == name
    assert density(skin) == pytest.approx(times * density(USUAL), rel=0.05)
    if count is not None:
        assert skin.count == pytest.approx(count, rel=0.05)


@pytest.mark.parametrize("name", ["ur5-half", "ur5-double", "ur5-sparse", "ur5-dense"])
def test_a_denser_skin_covers_the_same_surface(name):
    assert area(load_skin(name)) == pytest.approx(area(USUAL), rel=0.02)


def test_the_usual_density_and_size_are_the_ur5_skin_to_the_bit():
    outlines = [
        fit_to_part(
            scale_density(outline, 1.0),
            UR5_PARTS[outline.part],
            UR5_PARTS[outline.part],
        )
        for outline in UR5_OUTLINES
    ]
    skin = build_outline_skin("ur5", outlines, UR5_PARTS)
    for name in ("positions", "normals", "tangents", "areas", "rows", "columns"):
        assert getattr(skin, name).tobytes() == getattr(USUAL, name).tobytes()


def test_a_missing_patch_leaves_the_others_where_they_are():
    skin = load_skin("ur5-missing")
    assert skin.patches == tuple(p for p in USUAL.patches if p.id != "forearm_back")
    for patch in skin.patches:
        here, there = skin.find_taxels(patch.id), USUAL.find_taxels(patch.id)
        assert (skin.positions[here] == USUAL.positions[there]).all()


def test_a_patch_that_is_not_there_cannot_be_missing():
    with pytest.raises(ValueError, match=r"no patch \['knee'\] to leave out"):
        build_outline_skin("ur5", UR5_OUTLINES, UR5_PARTS, ("knee",))


@pytest.mark.parametrize("name", SKINS)
def test_every_taxel_lies_on_its_link_and_points_out_of_it(name):
    skin, robot = load_skin(name), load_robot(SKIN_PRESETS[name].robot)
    for number, patch in enumerate(skin.patches):
        taxels = skin.patch_index == number
        link = robot.links[robot.link_index(patch.link)]
        distance, outward = compute_surface_distance(link, skin.positions[taxels])
        assert np.max(np.abs(distance)) < 1e-12
        assert np.min(np.sum(outward * skin.normals[taxels], axis=1)) > 1 - 1e-12


@pytest.mark.parametrize("name", SKINS)
def test_patches_of_a_link_do_not_overlap(name):
    skin = load_skin(name)
    links = [patch.link for patch in skin.patches]
    for one, other in combinations(range(len(links)), 2):
        if links[one] != links[other]:
            continue
        mine, others = (np.flatnonzero(skin.patch_index == n) for n in (one, other))
        tree = KDTree(skin.positions[others])
        gaps, nearest = tree.query(skin.positions[mine])
        cells = np.sqrt(skin.areas[mine]) + np.sqrt(skin.areas[others[nearest]])
        assert np.min(gaps - cells / 2) > 0.001, (skin.patches[one], other)


@pytest.mark.parametrize("name", SKINS)
def test_every_patch_is_irregular_but_rings(name):
    skin = load_skin(name)
    for patch in skin.patches:
        whole = len(skin.find_taxels(patch.id)) == patch.rows * patch.columns
        assert not whole or "ring" in patch.id


@pytest.mark.parametrize("name", ARMS)
def test_no_taxel_is_buried_in_a_link_next_to_its_own(name):
    skin, robot = load_skin(name), load_robot(SKIN_PRESETS[name].robot)
    rng = np.random.default_rng(0)
    mounted, kinematics = MountedSkin(skin, robot), Kinematics(robot)
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    low, high = low.copy(), high.copy()
    # An arm this wide cannot fold its elbow flat on itself.
    elbow = robot.joint_names.index("elbow_joint")
    low[elbow], high[elbow] = -2.4, 2.4
    for _ in range(10):
        q = rng.uniform(low, high)
        p_world, _ = mounted.place_taxels(q)
        T_world_link = kinematics.poses(q)
        for joint in robot.joints:
            pair = robot.link_index(joint.parent), robot.link_index(joint.child)
            for own, beside in (pair, pair[::-1]):
                taxels = mounted.taxel_link_index == own
                if not taxels.any() or not robot.links[beside].geoms:
                    continue
                local = apply(invert(T_world_link[beside]), p_world[taxels])
                distance, _ = compute_surface_distance(robot.links[beside], local)
                assert np.min(distance) > 0.001, (robot.links[own].name, q)


def test_shapes_have_other_seams_than_the_usual_skin():
    """A finger on a seam of one skin is on a patch of the other."""
    shapes = load_skin("ur5-shapes")
    for link in ("upper_arm_link", "forearm_link"):
        one, other = (
            skin.positions[np.array(skin.link_names)[skin.patch_index] == link]
            for skin in (shapes, USUAL)
        )
        # On the strip between the usual half shells.
        height = np.array([0.16, 0.25, 0.3])
        radius = np.hypot(*other[-1, :2])
        strip = np.column_stack([0 * height, 0 * height + radius, height])
        assert (KDTree(other).query(strip)[0] > 0.004).all()
        assert (KDTree(one).query(strip)[0] < 0.009).any()


def test_the_base_has_one_pose():
    assert load_robot("base").joint_names == ()
