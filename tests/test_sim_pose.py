"""Poses: drawn evenly, in groups that can be kept for tests."""

import numpy as np
import pytest

from eskin.sim.scene import build_environment, compute_joint_limits
from eskin.sim.scene.folds import find_fold_sites
from eskin.sim.scene.poses import (
    build_pose_pool,
    compute_pose_group,
    compute_pose_groups,
    draw_pose,
    draw_touching_pose,
)
from eskin.sim.scene.validity import are_poses_valid, find_self_contact_sites
from helpers.worlds import EVERY, people, poses, world


def test_every_pose_has_one_group_of_twelve():
    low, high = compute_joint_limits(world())
    q = np.random.default_rng(0).uniform(low, high, (5000, 6))
    groups = compute_pose_groups(world(), q, world().poses(q))
    assert set(groups.tolist()) == set(range(1, 13))
    assert [compute_pose_group(world(), each) for each in q[:20]] == groups[
        :20
    ].tolist()


def test_turning_the_base_or_the_wrist_keeps_the_group():
    rng = np.random.default_rng(1)
    for q in poses(50, seed=1):
        turned = q.copy()
        turned[[0, 3, 4, 5]] = rng.uniform(-np.pi, np.pi, 4)
        assert compute_pose_group(world(), turned) == compute_pose_group(world(), q)


def test_all_groups_are_populated_in_every_part_of_the_pool():
    pool = build_pose_pool(world())
    assert sum(pool.shares.values()) == pytest.approx(1.0)
    for group in EVERY:
        assert pool.shares[group] > 0.01
        assert len(pool.any[group]) > 10


def test_drawn_poses_are_of_the_groups_asked_for_and_acceptable():
    rng = np.random.default_rng(2)
    for groups in ({1}, {9, 10, 11, 12}, {3, 8}):
        q = np.array([draw_pose(world(), groups, rng) for _ in range(40)])
        assert {compute_pose_group(world(), each) for each in q} <= groups
        assert are_poses_valid(world(), q).all()
        low, high = compute_joint_limits(world())
        assert np.all((q >= low) & (q <= high))


def test_groups_come_as_often_as_such_poses_are():
    drawn = [compute_pose_group(world(), q) for q in poses(1500, seed=3)]
    shares = build_pose_pool(world()).shares
    for group in EVERY:
        assert np.mean(np.array(drawn) == group) == pytest.approx(
            shares[group], abs=0.035
        )


def test_the_base_points_anywhere():
    base = poses(1000, seed=4)[:, 0]
    quarters = np.histogram(base, bins=4, range=(-np.pi, np.pi))[0]
    assert quarters.min() > 200


def test_folded_poses_bring_two_patches_together():
    person = people(1)[0]
    for q in poses(30, seed=5, fold=True):
        assert find_fold_sites(world(), q, person)


def test_touching_poses_have_places_of_self_contact_and_others_have_none():
    rng = np.random.default_rng(6)
    for _ in range(10):
        assert find_self_contact_sites(world(), draw_touching_pose(world(), EVERY, rng))
    for q in poses(20, seed=6):
        assert find_self_contact_sites(world(), q) == ()


def test_the_same_seed_draws_the_same_poses_also_in_a_new_world():
    again = build_environment(world().mounted, world().constants)
    rngs = np.random.default_rng(7), np.random.default_rng(7)
    for fold in (False, True):
        one, other = (
            draw_pose(place, EVERY, rng, fold)
            for place, rng in zip((world(), again), rngs, strict=True)
        )
        assert one.tobytes() == other.tobytes()


def test_unknown_groups_are_refused():
    rng = np.random.default_rng(0)
    for groups in (set(), {0}, {13}):
        with pytest.raises(ValueError, match="give some of 1 to 12"):
            draw_pose(world(), groups, rng)
