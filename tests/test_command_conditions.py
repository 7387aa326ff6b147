"""Tests of the conditions by which a touch commands: what each kind of action needs."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.command import Problem, Refusal, Rule
from eskin.command.actions import ACTIONS, TOGGLES
from eskin.command.commanded_touch import CommandedTouch, CommandRequest
from eskin.command.conditions import (
    FOR_MORE,
    FOR_QUESTION,
    FOR_STOP,
    WHILE_ALONE,
    arm_is_unchanged,
    find_late_refusal,
    find_refusal,
    list_conditions,
)
from eskin.live import Detection
from helpers.commands import HELD, PATCH, SECOND, Scene

STOPS = ("pause", "hold")
PLAIN = [one for one in ACTIONS if one not in (*TOGGLES, "none")]


def observe(action, **changes):
    """Return the situation of a touch that asks for an action, on a scene at rest."""
    scene = Scene()
    scene.wait(2.0)
    now = scene.clock.now()
    detection = Detection(
        stamp=now,
        touch=1,
        gesture="grab",
        confidence=0.9,
        onset=now,
        end=now,
        link=PATCH.link,
        patch=PATCH.id,
        p_world=np.zeros(3),
        n_world=np.zeros(3),
        direction_world=np.ones(3),
        peak_force=5.0,
    )
    request = CommandRequest(
        touch=CommandedTouch(1, quiet_since=0),
        detection=detection,
        rule=Rule(gesture="grab", action=action),
        action=action,
        required=0.5,
        confidence=0.9,
        end=now,
    )
    return replace(scene.policy.observe(request, now), **changes)


@pytest.mark.parametrize("action", PLAIN)
@pytest.mark.parametrize("asks", [True, False])
def test_stop_needs_least_and_a_question_needs_most(action, asks):
    conditions = list_conditions(observe(action, asks=asks))
    if action in STOPS:
        assert conditions == FOR_STOP
    else:
        is_asked = asks or action in ("resume", "jog")
        assert conditions == (FOR_QUESTION if is_asked else FOR_MORE)
    assert FOR_QUESTION[: len(FOR_MORE)] == FOR_MORE
    assert FOR_MORE[: len(FOR_STOP)] == FOR_STOP


def list_broken(situation):
    """Return the situation in which each condition does not hold, by its refusal."""
    request = situation.request
    still = replace(request.detection, direction_world=np.zeros(3))
    ended = replace(request.touch, closed=True)
    other = CommandedTouch(2, onset=request.end + 1)
    return {
        Problem.PROGRAM_ENDED: {"arm": replace(situation.arm, running=False)},
        Refusal.FELT_LONG_AGO: {"age": 1.0},
        Problem.DEAF_SKIN: {"problem": Problem.DEAF_SKIN.reason()},
        Refusal.PATCH_OUT: {"is_out": True},
        Refusal.RESTS: {"since_same": 0.0},
        Refusal.HELD: {"arm": replace(situation.arm, hold_reason=HELD)},
        Refusal.NO_DIRECTION: {"request": replace(request, detection=still)},
        Refusal.NOT_PAUSED: {"arm": replace(situation.arm, paused=False)},
        Refusal.TOUCHED_AFTER_QUESTION: {"failed_at": request.detection.onset},
        Refusal.ARM_CHANGED: {"meant": "open_gripper"},
        Refusal.TOUCHED_AGAIN: {"others": [other]},
        Refusal.STILL_TOUCHED: {
            "request": replace(request, touch=ended),
            "latest": request.end + 2 * SECOND,
            "has_data": False,
        },
    }


NEEDS = (*FOR_QUESTION, arm_is_unchanged, *WHILE_ALONE)
"""Conditions of a jog, which needs most."""


def test_every_condition_refuses_alone_and_says_why():
    situation = observe("jog", meant="jog")
    situation = replace(situation, arm=replace(situation.arm, paused=True))
    assert find_refusal(situation) is None and find_late_refusal(situation) is None
    broken = list_broken(situation)
    assert len(broken) == len(NEEDS)
    for condition, (cause, changes) in zip(NEEDS, broken.items(), strict=True):
        changed = replace(situation, **changes)
        told = [other(changed) for other in NEEDS]
        assert [reason.cause for reason in told if reason is not None] == [cause]
        assert find_late_refusal(changed) == condition(changed)
        assert (find_refusal(changed) is None) == (condition not in FOR_QUESTION)


@pytest.mark.parametrize("action", STOPS)
def test_nothing_but_arm_and_age_keeps_a_stop_from_being_done(action):
    situation = observe(action)
    for cause, changes in list_broken(situation).items():
        refusal = find_late_refusal(replace(situation, **changes))
        if cause in (Problem.PROGRAM_ENDED, Refusal.FELT_LONG_AGO):
            assert refusal is not None and refusal.cause is cause
        else:
            assert refusal is None
