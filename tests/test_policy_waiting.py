"""Touches that wait to be obeyed, and what happens meanwhile."""

import pytest

from eskin.command import CommandMap, Rule, SkinMonitorConfig
from eskin.touch import TouchStatus
from helpers.commands import PATCH, SKIN, Scene

ELSEWHERE = SKIN.patches[1]


def asked_to_resume(**config):
    """A paused arm, and a touch that goes on which asks it to resume."""
    scene = Scene(**config)
    scene.whole()
    scene.rest(1.2)
    number = scene.touch()
    scene.rest(0.3)
    scene.detect(number)
    assert scene.arm.paused
    return scene, number


def brief(scene, number, heir):
    touch = scene.touches.pop(number)
    return TouchStatus(number, touch["onset"], touch["last"], heir, 1)


def accepted(scene):
    return [one.action for one in scene.said if one.accepted]


def test_a_hold_that_came_after_a_touch_is_not_undone_by_it():
    rules = (("poke", "toggle_pause"), ("grab", "hold"))
    rules = [Rule(gesture=gesture, action=action) for gesture, action in rules]
    scene, number = asked_to_resume(commands=CommandMap(commands=rules))
    other = scene.touch("grab")
    scene.rest(0.2)
    scene.detect(other, patch=ELSEWHERE)
    scene.lift(number)
    scene.lift(other)
    scene.rest(0.6)
    assert scene.arm.paused and scene.arm.hold_reason


def test_a_stop_of_the_arm_itself_is_not_undone_by_a_touch_before_it():
    scene, number = asked_to_resume()
    scene.arm.hold("emergency stop")
    scene.rest(0.2)
    scene.lift(number)
    scene.rest(0.6)
    assert scene.arm.paused and scene.arm.hold_reason == "emergency stop"


def test_a_pause_by_somebody_else_is_not_undone_by_a_touch_before_it():
    scene, number = asked_to_resume()
    scene.arm.resume()
    scene.arm.pause()
    scene.rest(0.2)
    scene.lift(number)
    scene.rest(1.5)
    assert scene.arm.paused and "resume" not in accepted(scene)


@pytest.mark.parametrize("oldest", [0.1, 0.4])
def test_a_finger_whose_patch_falls_silent_has_not_been_lifted(oldest):
    scene, number = asked_to_resume(monitor=SkinMonitorConfig(max_age=oldest))
    scene.lift(number)
    scene.silent = (PATCH.id,)
    scene.rest(0.5)
    assert scene.arm.paused and "resume" not in accepted(scene)


def test_a_touch_that_commanded_and_turns_out_a_part_of_a_waiting_one_is_enough():
    scene = Scene()
    scene.arm.gripper = "closed"
    older = scene.touch("grab", sure=0.8)
    scene.rest(0.2)
    scene.detect(older)
    younger = scene.touch("double_pat")
    scene.rest(0.2)
    scene.detect(younger, patch=ELSEWHERE)
    scene.rest(0.1)
    scene.close(younger, heir=older)
    scene.touches[older]["sure"] = 0.95
    scene.rest(0.2)
    assert accepted(scene) == ["next_waypoint"]


def test_touches_that_merge_one_into_the_other_in_one_reading_command_once():
    scene = Scene()
    scene.arm.gripper = "closed"
    last, middle = scene.touch("none"), scene.touch("double_pat")
    first = scene.touch("grab", sure=0.8)
    scene.rest(0.2)
    scene.detect(middle, patch=ELSEWHERE)
    scene.detect(first)
    scene.rest(0.1)
    over = brief(scene, first, middle), brief(scene, middle, last)
    scene.touches[last].update(gesture="grab", sure=0.95)
    scene.moment(over)
    scene.rest(0.2)
    assert accepted(scene) == ["next_waypoint"]


def test_what_a_toggle_would_undo_meanwhile_is_not_done():
    scene = Scene()
    scene.arm.gripper = "closed"
    number = scene.touch("grab", sure=0.8)
    scene.rest(0.2)
    scene.detect(number)
    scene.arm.gripper = "open"
    scene.rest(0.3)
    scene.arm.gripper = "closed"
    scene.touches[number]["sure"] = 0.95
    scene.rest(0.3)
    assert accepted(scene) == []


def test_the_last_word_at_the_end_of_a_stream_moves_nothing():
    scene = Scene()
    scene.arm.gripper = "closed"
    number = scene.touch("grab", sure=0.9)
    scene.rest(0.1)
    scene.detect(number)
    scene.policy.close()
    assert scene.arm.gripper == "closed" and accepted(scene) == []


def test_a_tap_beside_it_does_not_make_a_press_understood():
    scene = Scene()
    lean, tap = scene.touch("none", force=15.0), scene.touch("double_pat")
    scene.rest(0.3)
    scene.detect(tap)
    scene.close(tap, heir=lean)
    scene.touches[lean]["force"] = 60.0
    scene.rest(0.1)
    assert scene.arm.hold_reason
