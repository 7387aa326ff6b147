"""Sets can be made on every skin that is offered, and mean the same on each."""

from dataclasses import replace
from functools import lru_cache
from typing import get_args

import numpy as np
import pytest

from eskin.cli.generate import SkinName
from eskin.sim.constants import load_constants
from eskin.sim.dataset import GenerationSettings, Simulator
from eskin.sim.dataset.sets import CLASSES
from eskin.sim.dataset.staging import set_up_clip
from eskin.sim.scene.poses import (
    POSE_GROUPS,
    UNGROUPED,
    build_pose_pool,
    can_fold,
    can_touch_itself,
    draw_pose,
)

SKINS = get_args(SkinName)
DRUMS = ("base", "post")
ARMS = [skin for skin in SKINS if skin not in DRUMS]
SMALL = {"robot.pool_tries": 1 / 16, "robot.pool_bent": 1 / 16}


@lru_cache(maxsize=8)
def simulator(skin):
    return Simulator(skin, load_constants().scaled(SMALL))


@lru_cache(maxsize=1)
def plans():
    """Some clips of each class."""
    settings = GenerationSettings("test-p", clips=60)
    found = [p for each in settings.sessions for p in settings.plan_clips(each)[1:]]
    kinds = {"none": "press"}
    return [replace(plan, kind=kinds.get(str(plan.gesture))) for plan in found]


def felt(clip, plan, made):
    """Largest pressure that taxels read above their first readings [kPa]."""
    calibration = made.calibration(plan.build)
    rest = np.median(clip.counts, axis=0)
    pressure = calibration.compute_pressure(np.maximum(clip.counts - rest, 0))
    return float((pressure * clip.received).max())


@pytest.mark.parametrize("skin", SKINS[1:])
def test_every_class_is_felt_on_every_skin(skin):
    made = simulator(skin)
    assert made.mounted.skin.name == skin
    for name in GenerationSettings("val", skin, clips=20).clip_set.classes:
        chosen = [plan for plan in plans() if plan.gesture == name][:2]
        clips = [made.make(plan) for plan in chosen]
        for clip, plan in zip(clips, chosen, strict=True):
            assert clip.counts.shape == (100, made.mounted.skin.count)
            assert clip.q.shape == (100, len(made.mounted.robot.joint_names))
            assert clip.truths[0].gesture == name
            assert clip.truths[0].force.max() > 0.1
            assert plan.person.name == clip.truths[0].subject
        assert max(felt(c, p, made) for c, p in zip(clips, chosen, strict=True)) > 3.0


@pytest.mark.parametrize("skin", ARMS[1:])
def test_poses_of_arms_come_in_the_same_groups(skin):
    pool = build_pose_pool(simulator(skin).env)
    assert set(pool.any) == POSE_GROUPS
    assert all(len(poses) for poses in pool.any.values())
    groups = frozenset(range(9, 13))
    assert can_fold(simulator(skin).env, groups)


def test_people_poses_and_sensors_of_a_set_are_the_same_on_every_skin():
    for skins in (ARMS, DRUMS):
        one, *others = (GenerationSettings("val", skin, clips=20) for skin in skins)
        for other in others:
            for sitting in one.sessions:
                assert one.plan_clips(sitting) == other.plan_clips(sitting)


@pytest.mark.parametrize("skin", SKINS)
def test_nobody_grabs_what_a_hand_cannot_close_round(skin):
    classes = GenerationSettings("val", skin, clips=20).clip_set.classes
    assert set(CLASSES) - set(classes) == ({"grab"} if skin in DRUMS else set())


def test_a_robot_without_joints_has_one_pose_that_stands_for_every_group():
    world = simulator("base").env
    rng = np.random.default_rng(0)
    for groups in (POSE_GROUPS, {9}):
        assert draw_pose(world, groups, rng).shape == (0,)
    assert not can_fold(world, POSE_GROUPS) and not can_touch_itself(world, POSE_GROUPS)
    assert simulator("base").make(plans()[0]).pose_group == UNGROUPED


def test_a_robot_without_joints_stands_still_unfolded_and_never_touches_itself():
    made = simulator("base")
    plan = replace(plans()[0], moving=True, fold_share=1.0)
    stage = set_up_clip(plan, "press", made.env, plan.rng())
    assert not stage.folded
    assert stage.q.shape == (len(stage.q), 0)
    nothing = replace(plan, gesture="none", kind=None, concurrent=0.0, seconds=0.5)
    kinds = {
        made.make(replace(nothing, seed=(7, number))).drawn["touch0.kind"]
        for number in range(40)
    }
    assert "self_contact" not in kinds and len(kinds) >= 7


def test_streams_can_be_made_on_a_robot_without_joints():
    made = simulator("base")
    for kind in (None, "accidents", "quiet"):
        plan = replace(plans()[0], gesture=None, kind=kind, moving=True, seconds=20.0)
        clip = made.make(plan)
        assert len(clip.counts) == 1000
        assert bool(clip.truths) == (kind != "quiet")


def test_pairs_are_refused_on_a_robot_that_cannot_fold():
    with pytest.raises(ValueError, match="set 'pairs' asked on skin 'base'") as caught:
        GenerationSettings("pairs", "base", clips=2)
    assert "\n" not in str(caught.value)


def test_a_grab_of_a_body_too_thick_to_close_round_is_weak():
    """Hands are spread on it and squeeze with a share of their largest grip."""
    made = simulator("base")
    share = made.env.constants.value("grab.weakest")
    for plan in [p for p in plans() if p.gesture == "grab"][:3]:
        clip = made.make(replace(plan, concurrent=0.0))
        largest = float(clip.drawn["touch0.largest"])
        assert largest <= share * 300.0
        assert clip.truths[0].force.max() <= 1.05 * largest
