"""Tests of commands that wait: until a touch has ended, or until it is confident."""

import pytest

from eskin.command import CommandMap, Rule
from eskin.command.actions import MIN_CONFIDENCE
from helpers.commands import (
    OTHER_PATCH,
    PATCH,
    TOGGLE,
    Scene,
    make_map,
    make_paused_scene,
)

LEAST = MIN_CONFIDENCE["resume"]
DOUBTFUL = LEAST - 0.05
WAYPOINT = CommandMap(
    commands=[Rule(gesture="stroke", action="next_waypoint", confidence=0.9)]
)


def ask_to_resume(confidence=0.99, **config):
    """Return a paused scene, and a detected touch of it that asks to resume."""
    scene = make_paused_scene(**{"commands": TOGGLE, **config})
    number = scene.begin_detected(confidence=confidence, seconds=0.4)
    assert scene.arm.paused
    return scene, number


def ask_to_open():
    """Return a scene with a closed gripper, and a doubtful touch that opens it."""
    scene = Scene()
    scene.arm.gripper = "closed"
    return scene, scene.begin_detected("grab", confidence=0.8)


def test_poke_resumes_paused_arm_once_it_has_closed():
    scene, number = ask_to_resume()
    scene.wait(0.5)
    assert scene.arm.paused
    scene.lift(number)
    scene.wait(0.48)
    assert scene.arm.paused
    scene.close(number)
    assert not scene.arm.paused and scene.accepted == ["pause", "resume"]


def test_arm_does_more_only_once_the_hand_has_left():
    scene = Scene()
    number = scene.begin_detected("grab", seconds=0.5)
    scene.wait(0.5)
    scene.lift(number)
    scene.wait(0.08)
    assert scene.accepted == []
    scene.wait(0.04)
    assert scene.accepted == ["close_gripper"]


def test_pause_lasts_one_second_at_least():
    scene = Scene(TOGGLE)
    scene.lift(scene.begin_detected(seconds=0.1))
    scene.wait(0.9)
    number = scene.begin()
    scene.step()
    (event,) = scene.detect(number)
    assert not event.accepted and "only 0.9 s" in event.why and scene.arm.paused


def test_touch_before_pause_does_not_resume():
    scene = Scene(TOGGLE)
    early = scene.begin("grab")
    scene.wait(0.1)
    scene.begin_detected(seconds=0.02)
    scene.wait(1.5)
    (event,) = scene.detect(early, gesture="poke")
    assert "before the pause" in event.why and scene.arm.paused


def test_lasting_touch_does_not_resume():
    scene, number = ask_to_resume()
    scene.wait(2.5)
    assert "went on" in scene.last_reason
    scene.lift(number)
    scene.wait(1.0)
    assert scene.arm.paused


@pytest.mark.parametrize(
    ("last", "resumed"), [(LEAST + 0.01, True), (LEAST - 0.01, False)]
)
def test_lifted_touch_may_become_confident_until_it_closes(last, resumed):
    scene, number = ask_to_resume(DOUBTFUL)
    scene.lift(number)
    scene.wait(0.4)
    assert scene.accepted == ["pause"]
    scene.touches[number].confidence = last
    scene.step()
    scene.close(number)
    assert scene.arm.paused == (not resumed)
    if not resumed:
        assert f"{LEAST - 0.01:.2f} is below {LEAST:.2f}" in scene.last_reason
        scene.touch(confidence=0.5)
        assert scene.arm.paused


@pytest.mark.parametrize(("seconds", "accepted"), [(0.2, ["next_waypoint"]), (2.1, [])])
def test_doubtful_touch_has_two_seconds_to_become_confident(seconds, accepted):
    scene = Scene(WAYPOINT)
    number = scene.begin_detected("stroke", 0.85, seconds=0.4)
    assert scene.events == []
    scene.lift(number)
    scene.wait(seconds)
    scene.touches[number].confidence = 0.92
    scene.wait(0.5)
    assert scene.accepted == accepted and len(scene.events) == 1
    assert accepted or "0.85" in scene.last_reason


@pytest.mark.parametrize("seconds", [0.1, 0.2, 0.3])
def test_touch_as_brief_as_a_bump_never_makes_the_arm_do_more(seconds):
    scene = make_paused_scene(commands=TOGGLE)
    number = scene.begin_detected(seconds=seconds)
    scene.lift(number)
    scene.wait(0.5)
    scene.close(number)
    assert scene.arm.paused and "lasted" in scene.last_reason


@pytest.mark.parametrize(("gesture", "action"), [("stroke", "slow"), ("poke", "pause")])
def test_touch_as_brief_as_a_bump_may_make_the_arm_do_less(gesture, action):
    scene = Scene()
    number = scene.begin_detected(gesture, seconds=0.1)
    scene.lift(number)
    scene.wait(0.3)
    assert scene.accepted == [action]


def test_heir_of_pending_touch_becomes_pending():
    scene, number = ask_to_resume(DOUBTFUL)
    scene.lift(number)
    heir = scene.begin(confidence=0.99)
    scene.lift(heir)
    scene.close(number, heir)
    scene.wait(0.2)
    assert scene.accepted == ["pause"]
    scene.close(heir)
    assert scene.accepted == ["pause", "resume"]


def test_heir_that_has_commanded_does_not_become_pending():
    scene = make_paused_scene()
    heir, number = scene.begin("double_pat"), scene.begin(confidence=DOUBTFUL)
    scene.wait(0.2)
    scene.detect(heir)
    scene.detect(number)
    scene.touches[heir].gesture = "poke"
    scene.close(number, heir)
    assert "commanded already" in scene.last_reason
    scene.lift(heir)
    scene.wait(0.5)
    assert scene.arm.paused


def test_pending_touch_that_inherits_commanding_touch_is_refused():
    scene, older = ask_to_open()
    younger = scene.begin_detected("double_pat", patch=OTHER_PATCH, seconds=0.4)
    scene.lift(younger)
    scene.wait(0.2)
    scene.close(younger, heir=older)
    scene.touches[older].confidence = 0.99
    scene.lift(older)
    scene.wait(0.2)
    assert scene.accepted == ["next_waypoint"]


def test_chain_of_merged_touches_commands_once():
    scene = Scene()
    scene.arm.gripper = "closed"
    last, middle = scene.begin("none"), scene.begin("double_pat")
    first = scene.begin("grab", confidence=0.8)
    scene.wait(0.4)
    scene.detect(middle, patch=OTHER_PATCH)
    scene.detect(first)
    scene.lift(middle)
    scene.wait(0.2)
    closed = scene.status(first, middle), scene.status(middle, last)
    del scene.touches[first], scene.touches[middle]
    scene.touches[last].gesture, scene.touches[last].confidence = "grab", 0.99
    scene.step(closed)
    scene.lift(last)
    scene.wait(0.2)
    assert scene.accepted == ["next_waypoint"]


def test_stale_skin_refuses_pending_command():
    scene, number = ask_to_resume(DOUBTFUL)
    scene.clock.sleep(0.12)
    scene.policy.check_skin()
    (refusal,) = [event.why for event in scene.events if not event.accepted]
    assert refusal.startswith(scene.arm.hold_reason)
    scene.touches[number].confidence = 0.99
    scene.lift(number)
    scene.wait(0.5)
    scene.close(number)
    assert scene.arm.paused


@pytest.mark.parametrize("stop", ["grab", "hold", "pause"])
def test_touch_before_second_stop_does_not_resume(stop):
    commands = make_map(poke="toggle_pause", grab="hold")
    scene, number = ask_to_resume(commands=commands)
    if stop == "grab":
        other = scene.begin_detected("grab", patch=OTHER_PATCH)
        scene.close(other)
    elif stop == "hold":
        scene.arm.hold("emergency stop")
    else:
        scene.arm.resume()
        scene.arm.pause()
    scene.wait(0.2)
    scene.lift(number)
    scene.wait(1.2)
    scene.close(number)
    assert scene.arm.paused and "resume" not in scene.accepted
    assert "the touch began before the" in scene.last_reason
    assert (scene.arm.hold_reason is None) == (stop == "pause")


def test_touch_on_silent_patch_has_not_ended():
    scene, number = ask_to_resume()
    scene.lift(number)
    scene.wait(0.46)
    scene.silent_patches = (PATCH.id,)
    scene.step()
    scene.close(number)
    assert scene.arm.paused
    scene.silent_patches = ()
    scene.step()
    assert not scene.arm.paused


def test_arm_is_not_set_in_motion_after_the_skin_was_touched_again():
    scene, number = ask_to_resume()
    scene.lift(number)
    scene.wait(0.2)
    other = scene.begin("poke", confidence=0.5)
    scene.wait(0.2)
    scene.lift(other)
    scene.wait(0.1)
    assert scene.arm.paused and "touched again" in scene.last_reason
    scene.close(number)
    assert scene.arm.paused


def test_arm_is_not_set_in_motion_while_an_earlier_touch_is_undecided():
    scene = make_paused_scene(commands=TOGGLE)
    other = scene.begin("poke", confidence=0.5)
    scene.wait(0.1)
    number = scene.begin_detected(seconds=0.4)
    scene.lift(other)
    scene.lift(number)
    scene.wait(0.48)
    scene.close(number)
    assert scene.arm.paused
    scene.close(other)
    assert not scene.arm.paused


@pytest.mark.parametrize(("readings", "accepted"), [(15, []), (16, ["next_waypoint"])])
def test_least_duration_is_met_to_the_reading(readings, accepted):
    scene = Scene()
    number = scene.begin_detected("double_pat", seconds=readings / 50)
    scene.lift(number)
    scene.wait(0.3)
    scene.close(number)
    assert scene.accepted == accepted


@pytest.mark.parametrize(("seconds", "resumed"), [(1.9, True), (2.1, False)])
def test_touch_that_starts_the_arm_may_go_on_for_two_seconds(seconds, resumed):
    scene, number = ask_to_resume()
    scene.wait(seconds)
    scene.lift(number)
    scene.wait(0.48)
    scene.close(number)
    assert scene.arm.paused == (not resumed)
    assert resumed or "went on" in scene.last_reason


def test_toggle_that_would_do_opposite_meanwhile_is_refused():
    scene, number = ask_to_open()
    scene.arm.gripper = "open"
    scene.wait(0.3)
    scene.arm.gripper = "closed"
    scene.touches[number].confidence = 0.99
    scene.lift(number)
    scene.wait(0.3)
    assert scene.accepted == [] and "the arm has changed" in scene.last_reason


def test_end_of_stream_holds_arm_and_drops_pending_commands():
    scene, _ = ask_to_open()
    scene.policy.close()
    assert scene.arm.hold_reason == "the stream has ended"
    assert scene.arm.gripper == "closed" and scene.accepted == []
