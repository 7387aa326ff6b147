"""These tests check that sets can be made on every skin and mean the same on each."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from eskin.sim import load_constants
from eskin.sim.commands.generate import SKINS
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

pytestmark = pytest.mark.slow

DRUMS = ("base", "post")
ARMS = [skin for skin in SKINS if skin not in DRUMS]
SMALL_POOL = {"robot.pool_tries": 1 / 16, "robot.pool_bent": 1 / 16}
SETTINGS = {skin: GenerationSettings("val", skin, clips=20) for skin in SKINS}


@lru_cache(maxsize=8)
def get_simulator(skin):
    return Simulator(skin, load_constants().scaled(SMALL_POOL))


@lru_cache(maxsize=1)
def plan_clips():
    """Plan some clips of each class."""
    settings = GenerationSettings("test-p", clips=60)
    found = [p for each in settings.sessions for p in settings.plan_clips(each)[1:]]
    return [replace(p, kind="press" if p.gesture == "none" else None) for p in found]


def is_felt(simulator, plan):
    """Tell whether a taxel reads more than 3 kPa above its rest, and check the clip."""
    clip = simulator.make(plan)
    mounted = simulator.mounted
    assert clip.counts.shape == (100, mounted.skin.count)
    assert clip.q.shape == (100, len(mounted.robot.joint_names))
    truth = clip.truths[0]
    assert (truth.gesture, truth.subject) == (plan.gesture, plan.person.name)
    assert truth.force.max() > 0.1
    above = np.maximum(clip.counts - np.median(clip.counts, axis=0), 0)
    pressure = simulator.calibration(plan.build).compute_pressure(above)
    return (pressure * clip.received).max() > 3.0


# Of the density of taxels the sparsest are the hardest to feel.
@pytest.mark.parametrize("skin", sorted({*SKINS[1:]} - {"ur5-half", "ur5-double"}))
def test_every_class_is_felt_on_every_skin(skin):
    simulator = get_simulator(skin)
    assert simulator.mounted.skin.name == skin
    groups = build_pose_pool(simulator.env).any
    assert skin in DRUMS or set(groups) == POSE_GROUPS
    assert can_fold(simulator.env, POSE_GROUPS) == (skin in ARMS)
    for name in SETTINGS[skin].clip_set.classes:
        plans = [plan for plan in plan_clips() if plan.gesture == name]
        assert any(is_felt(simulator, plan) for plan in plans[:2])


@pytest.mark.parametrize("skins", [ARMS, DRUMS], ids=["arms", "drums"])
def test_set_plans_the_same_clips_on_every_skin(skins):
    one, *others = (SETTINGS[skin] for skin in skins)
    for session in one.sessions:
        plans = one.plan_clips(session)
        assert all(plans == other.plan_clips(session) for other in others)


@pytest.mark.parametrize("skin", SKINS)
def test_only_drums_are_too_thick_for_a_grab(skin):
    missing = set(CLASSES) - set(SETTINGS[skin].clip_set.classes)
    assert missing == ({"grab"} if skin in DRUMS else set())


def test_robot_without_joints_has_one_pose_and_never_touches_itself():
    simulator = get_simulator("base")
    rng = np.random.default_rng(0)
    for groups in (POSE_GROUPS, {9}):
        assert draw_pose(simulator.env, groups, rng).shape == (0,)
    assert not can_touch_itself(simulator.env, POSE_GROUPS)
    plan = replace(plan_clips()[0], moving=True, fold_share=1.0, concurrent=0.0)
    assert not set_up_clip(plan, "press", simulator.env, plan.rng()).folded
    kinds = set()
    for number in range(30):
        changes = {"gesture": "none", "kind": None, "seconds": 0.5}
        clip = simulator.make(replace(plan, seed=(7, number), **changes))
        assert clip.pose_group == UNGROUPED and clip.q.shape[1] == 0
        kinds.add(clip.drawn["touch0.kind"])
    assert "self_contact" not in kinds and len(kinds) >= 7


@pytest.mark.parametrize("kind", [None, "accidents", "quiet"])
def test_streams_can_be_made_on_a_robot_without_joints(kind):
    changes = {"gesture": None, "kind": kind, "moving": True, "seconds": 20.0}
    clip = get_simulator("base").make(replace(plan_clips()[0], **changes))
    assert len(clip.counts) == 1000
    assert bool(clip.truths) == (kind != "quiet")
