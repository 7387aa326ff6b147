"""These tests check distances between links: clearances, folds and self-contact."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import trimesh

from eskin.robot import Cylinder, compute_surface_distance
from eskin.sim.constants import MM
from eskin.sim.people.perform import perform
from eskin.sim.scene import compute_joint_limits
from eskin.sim.scene.environment import compute_surface_axes
from eskin.sim.scene.folds import (
    compute_facing_gaps,
    compute_fold_share,
    compute_site_gap,
    find_fold_sites,
    press_both_sites,
)
from eskin.sim.scene.poses import build_pose_pool, draw_touching_pose
from eskin.sim.scene.validity import are_poses_valid, find_self_contact_sites
from eskin.transforms import apply, invert
from helpers.worlds import EVERY, people, poses, world

ROBOT = world().mounted.robot
JOINED = {frozenset((joint.parent, joint.child)) for joint in ROBOT.joints}
value = world().constants.value


@lru_cache(maxsize=1)
def sample_surfaces():
    """Return points on the cylinders of each link that has any, by its index."""
    points = {}
    for index, link in enumerate(ROBOT.links):
        for geom in link.geoms:
            assert isinstance(geom.shape, Cylinder)
            sizes = geom.shape.radius, geom.shape.length
            body = trimesh.creation.cylinder(*sizes, transform=geom.T_link_shape)
            sample = trimesh.sample.sample_surface(body, 1000, seed=0)[0]
            points[index] = np.append(points.get(index, sample[:0]), sample, axis=0)
    return points


def measure_distance(T_world_link, link, points):
    """Return the exact distance of world points from a link."""
    there = apply(invert(T_world_link[link]), points)
    return compute_surface_distance(ROBOT.links[link], there)[0]


def measure_clearance(T_world_link):
    """Return distance between links and height over the table, both by points."""
    distance = height = np.inf
    for a, points in sample_surfaces().items():
        there = apply(T_world_link[a], points)
        name = ROBOT.links[a].name
        if name not in ("base_link", "shoulder_link"):
            height = min(height, there[:, 2].min())
        for b in sample_surfaces():
            if a != b and frozenset((name, ROBOT.links[b].name)) not in JOINED:
                gap = measure_distance(T_world_link, b, there).min()
                distance = min(distance, max(gap, 0.0))
    return distance, height


def draw_any_poses(count, seed):
    low, high = compute_joint_limits(world())
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


def test_accepted_poses_keep_their_distances():
    T = world().poses(poses(60, seed=1))
    distances, heights = world().collision.compute_clearance(T, 10.0).T
    assert distances.min() >= value("robot.clearance") * MM
    assert heights.min() >= value("robot.table_clearance") * MM
    assert T[:, ROBOT.link_index("tool0"), 2, 3].min() >= value("robot.tool_height")


@pytest.mark.slow
def test_clearance_is_never_too_large_and_seldom_much_too_small():
    T = world().poses(draw_any_poses(12, seed=2))
    computed = world().collision.compute_clearance(T, 10.0)
    measured = np.array([measure_clearance(each) for each in T])
    # Points on a surface miss the nearest ones by some tenths of their spacing.
    assert np.all(computed <= measured + [1e-4, 1e-9])
    assert np.all(np.median(measured - computed, axis=0) < [1.5e-3, 2e-3])


def test_turning_the_base_changes_no_clearance():
    q = draw_any_poses(100, seed=5)
    turned = q + np.random.default_rng(0).uniform(-3, 3, (100, 1)) * np.eye(6)[0]
    one, other = (
        world().collision.compute_clearance(world().poses(each), 0.05)
        for each in (q, turned)
    )
    np.testing.assert_allclose(one, other, atol=5e-5)
    valid, also = (are_poses_valid(world(), each) for each in (q, turned))
    np.testing.assert_array_equal(valid, also)


@lru_cache(maxsize=1)
def find_folds():
    """Return folded poses with a person and the pairs of sites found in each."""
    return [
        (q, person, find_fold_sites(world(), q, person))
        for q, person in zip(poses(30, fold=True), people(30), strict=True)
    ]


def compute_axes(q, site):
    """Return the point of a site with its s, t and normal directions in the world."""
    T = world().poses(q)[world().links[site.chart]]
    chart = world().charts[site.chart]
    return [axis[0] for axis in compute_surface_axes(chart, np.array([site.centre]), T)]


def poke(person, site):
    rng = np.random.default_rng(0)
    return perform("poke", None, person, site, world().constants, rng, 1.0, None)


def test_fold_sites_face_each_other_on_two_links_nearest_first():
    for q, _, found in find_folds():
        assert found
        gaps = [compute_site_gap(world(), q, *pair) for pair in found]
        assert gaps == sorted(gaps)
        assert gaps[-1] <= value("fold.within") * MM
        for first, second in found:
            assert world().links[first.chart] != world().links[second.chart]
            (a, _, _, m), (b, _, _, n) = (compute_axes(q, s) for s in (first, second))
            way = (b - a) / np.linalg.norm(b - a)
            assert min(m @ way, -n @ way, -m @ n) >= value("fold.facing") - 1e-9


def test_hand_fits_between_fold_sites():
    thinnest = value("fold.thinnest") * MM
    folded = np.concatenate(list(build_pose_pool(world()).folded.values()))
    T = world().poses(folded)
    assert compute_facing_gaps(world(), T)[0].min() >= thinnest - 1e-9
    # Some of these patches come nearer elsewhere.
    thin = world().constants.scaled({"fold.thinnest": 0.0})
    nearer, _ = compute_facing_gaps(replace(world(), constants=thin), T)
    assert nearer.min() < thinnest


def test_second_site_bears_less_force_at_a_wider_gap():
    found = [
        (compute_site_gap(world(), q, *pair), compute_fold_share(world(), q, *pair))
        for q, _, pairs in find_folds()
        for pair in pairs
    ]
    shares = np.array(sorted(found))[:, 1]
    assert np.all(np.diff(shares) <= 1e-12)
    assert np.all((shares >= 0) & (shares <= value("fold.even")))


def test_presses_at_both_sites_share_the_force_and_mirror_the_motion():
    q, person, ((first, second), *_) = find_folds()[0]
    touch = poke(person, first)
    share = compute_fold_share(world(), q, first, second)
    folded = press_both_sites(touch, first, second, share)
    one, other = folded.presses
    assert [press.chart for press in folded.presses] == [first.chart, second.chart]
    np.testing.assert_allclose(one.force + other.force, touch.presses[0].force)
    assert folded.drawn["fold.share"] == share
    # Along and across the hand, whose x axis is mirrored on the other side.
    paths = []
    for press, site, side in ((one, first, 1), (other, second, -1)):
        cos = np.cos(site.angle)
        sin = np.sin(site.angle)
        path = press.centre - np.array(site.centre)
        along = path @ np.array([-sin, cos])
        across = side * path @ np.array([cos, sin])
        paths.append([along, across, side * (press.angle - site.angle)])
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-12)
    np.testing.assert_allclose(other.pads.centres[:, 0], -one.pads.centres[:, 0])


def test_self_contact_lies_where_links_nearly_touch():
    rng = np.random.default_rng(5)
    low = world().constants.array("fold.touching")[0] * MM
    for _ in range(12):
        q = draw_touching_pose(world(), EVERY, rng)
        T = world().poses(q)
        assert world().collision.compute_clearance(T[None], 0.1)[0, 0] >= low - 5e-5
        for site in find_self_contact_sites(world(), q):
            point = compute_axes(q, site)[0]
            link = world().links[site.chart]
            gap = world().collision.compute_free_distance(T, point[None], link)
            assert gap[0] < value("fold.contact") * MM
