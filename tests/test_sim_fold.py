"""A hand between two patches; the robot's own links pressing on its skin."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.sim.constants import MM
from eskin.sim.people.perform import perform
from eskin.sim.scene.environment import compute_surface_axes, compute_surface_direction
from eskin.sim.scene.folds import (
    compute_facing_gaps,
    compute_fold_share,
    compute_site_gap,
    find_fold_sites,
    press_both_sites,
)
from eskin.sim.scene.poses import build_pose_pool, draw_touching_pose
from eskin.sim.scene.validity import find_self_contact_sites
from helpers.worlds import EVERY, people, poses, world


def pairs(count, seed=0):
    """Poses with the pairs of sites in them."""
    for q, person in zip(poses(count, seed, fold=True), people(count), strict=True):
        yield q, person, find_fold_sites(world(), q, person)


def axes(q, site):
    T = world().poses(q)[world().links[site.chart]]
    chart = world().charts[site.chart]
    return [axis[0] for axis in compute_surface_axes(chart, np.array([site.centre]), T)]


def poked(person, site, seed=0):
    rng = np.random.default_rng(seed)
    return perform("poke", None, person, site, world().constants, rng, 1.0, None)


def test_the_two_sites_are_on_different_links_and_close_and_face_each_other():
    within = world().constants.value("fold.within") * MM
    least = world().constants.value("fold.facing") - 1e-9
    for q, _, found in pairs(60):
        assert found
        for first, second in found:
            assert world().links[first.chart] != world().links[second.chart]
            (a, _, _, m), (b, _, _, n) = axes(q, first), axes(q, second)
            assert np.linalg.norm(a - b) <= within
            way = (b - a) / np.linalg.norm(b - a)
            assert min(m @ way, -n @ way, -m @ n) >= least


def test_a_hand_fits_between_the_sites():
    thinnest = world().constants.value("fold.thinnest") * MM
    folded = np.concatenate(list(build_pose_pool(world()).folded.values()))
    gaps, _ = compute_facing_gaps(world(), world().poses(folded))
    assert gaps.min() >= thinnest - 1e-9
    # Some of these patches come nearer elsewhere.
    thin = world().constants.scaled({"fold.thinnest": 0.0})
    nearer, _ = compute_facing_gaps(
        replace(world(), constants=thin), world().poses(folded)
    )
    assert nearer.min() < thinnest


def test_nearest_pairs_come_first():
    for q, _, found in pairs(40):
        gaps = [compute_site_gap(world(), q, *pair) for pair in found]
        assert gaps == sorted(gaps)


def test_the_hand_points_the_same_way_at_both_sites_as_far_as_they_let_it():
    for q, person, ((first, second), *_) in pairs(20):
        ahead = [
            compute_surface_direction(np.array([site.angle]), s[None], t[None])[0]
            for site in (first, second)
            for _, s, t, _ in [axes(q, site)]
        ]
        middle = (axes(q, first)[0] + axes(q, second)[0]) / 2
        distance, bearing = person.stand
        at = distance * np.array([np.cos(bearing), np.sin(bearing)])
        for way in ahead:
            assert way[:2] @ (middle[:2] - at) > -0.3 * distance


def test_both_presses_together_bear_the_force_of_the_one():
    q, person, ((first, second), *_) = next(pairs(1))
    touch = poked(person, first)
    share = compute_fold_share(world(), q, first, second)
    folded = press_both_sites(touch, first, second, share)
    assert len(folded.presses) == 2 * len(touch.presses)
    total = sum(press.force for press in folded.presses)
    np.testing.assert_allclose(total, touch.presses[0].force)
    assert {press.chart for press in folded.presses} == {first.chart, second.chart}
    assert folded.drawn["fold.share"] == share


def test_the_wider_the_gap_the_less_the_farther_patch_bears():
    found = [
        (compute_site_gap(world(), q, *pair), compute_fold_share(world(), q, *pair))
        for q, _, these in pairs(30)
        for pair in these
    ]
    gaps, shares = np.array(sorted(found)).T
    assert np.all(np.diff(shares) <= 1e-12)
    assert np.all((shares >= 0) & (shares <= world().constants.value("fold.even")))


def test_the_hand_moves_the_same_way_in_space_on_patches_that_lie_face_to_face():
    q, person, ((first, second), *_) = next(pairs(1, seed=3))
    touch = poked(person, first)
    one, other = press_both_sites(touch, first, second, 0.4).presses
    way = one.centre - np.array(first.centre)
    there = other.centre - np.array(second.centre)
    # Along and across the hand, whose x axis is mirrored on the other side.
    for path, angle, side, want in (
        (way, first.angle, 1, None),
        (there, second.angle, -1, way),
    ):
        along = path @ np.array([-np.sin(angle), np.cos(angle)])
        across = side * path @ np.array([np.cos(angle), np.sin(angle)])
        if want is None:
            kept = along, across
        else:
            np.testing.assert_allclose(along, kept[0], atol=1e-12)
            np.testing.assert_allclose(across, kept[1], atol=1e-12)
    np.testing.assert_allclose(
        other.angle - second.angle, -(one.angle - first.angle), atol=1e-12
    )
    np.testing.assert_allclose(other.pads.centres[:, 0], -one.pads.centres[:, 0])


def test_a_share_outside_0_to_1_is_refused():
    _, person, ((first, second), *_) = next(pairs(1))
    for share in (-0.1, 1.1, np.nan):
        with pytest.raises(ValueError, match="give 0 to 1"):
            press_both_sites(poked(person, first), first, second, share)


def test_self_contact_lies_where_another_link_is_within_three_millimetres():
    rng = np.random.default_rng(5)
    least = world().constants.value("fold.contact") * MM
    for _ in range(12):
        q = draw_touching_pose(world(), EVERY, rng)
        T = world().poses(q)
        for site in find_self_contact_sites(world(), q):
            point = axes(q, site)[0]
            gap = world().collision.compute_free_distance(
                T, point[None], world().links[site.chart]
            )
            assert gap[0] < least


def test_links_that_touch_do_not_run_into_each_other():
    rng = np.random.default_rng(6)
    low = world().constants.array("fold.touching")[0] * MM
    q = np.array([draw_touching_pose(world(), EVERY, rng) for _ in range(30)])
    gaps = world().collision.compute_clearance(world().poses(q), 0.1)[:, 0]
    assert np.all(gaps >= low - 5e-5)
