"""What may command an arm, and what holds it."""

import threading
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.command import CommandMap, Policy, Rule, SimulatedArm, command_function
from eskin.drivers import HostClock, ManualClock
from eskin.errors import ArmError
from eskin.stream import Context
from helpers.commands import (
    INFO,
    PATCH,
    SECOND,
    SKIN,
    VOCABULARY,
    Scene,
    ToldArm,
)

STARTING_ACTIONS = {"resume", "release"}


def accepted(said):
    return [one.action for one in said if one.accepted]


def test_each_gesture_does_what_the_map_says():
    scene = Scene()
    for gesture, told in [
        ("grab", "close_gripper"),
        ("stroke", "set_speed"),
        ("double_pat", "next_waypoint"),
        ("grab", "open_gripper"),
        ("stroke", "set_speed"),
        ("poke", "pause"),
    ]:
        assert len(accepted(scene.whole(gesture))) == 1
        assert scene.arm.told[-1] == told
    assert scene.policy.accepted == 6
    assert scene.arm.speed == 1.0


def test_a_poke_pauses_and_another_resumes_once_it_has_ended():
    scene = Scene()
    assert accepted(scene.whole()) == ["pause"]
    scene.rest(1.0)
    number = scene.touch()
    scene.rest(0.3)
    assert scene.detect(number) == []
    scene.rest(0.5)
    assert scene.arm.paused
    scene.lift(number)
    scene.rest(0.08)
    assert scene.arm.paused
    scene.rest(0.1)
    assert not scene.arm.paused and accepted(scene.said) == ["pause", "resume"]


@pytest.mark.parametrize("pause", [0.5, 0.9])
def test_a_pause_lasts_a_second_at_least(pause):
    scene = Scene()
    number = scene.touch()
    scene.rest(0.1)
    scene.detect(number)
    scene.lift(number)
    scene.rest(pause)
    other = scene.touch()
    scene.moment()
    (said,) = scene.detect(other)
    assert not said.accepted and "it was paused only" in said.why
    assert scene.arm.paused


def test_nothing_resumes_that_began_before_the_pause():
    scene = Scene()
    early = scene.touch()
    scene.rest(0.1)
    number = scene.touch()
    scene.moment()
    scene.detect(number)
    scene.rest(1.5)
    (said,) = scene.detect(early)
    assert said.why == "the touch began before the pause" and scene.arm.paused


def test_a_touch_that_goes_on_does_not_resume():
    scene = Scene()
    scene.whole()
    scene.rest(1.0)
    number = scene.touch()
    scene.moment()
    scene.detect(number)
    scene.rest(2.5)
    assert scene.said[-1].why == "touching went on"
    scene.lift(number)
    scene.rest(1.0)
    assert scene.arm.paused


def test_resuming_needs_to_be_sure_when_the_touch_has_ended():
    scene = Scene()
    scene.whole()
    scene.rest(1.0)
    said = scene.whole(sure=0.94)
    assert [one.why for one in said] == ["confidence 0.94 is below 0.95"]
    number = scene.touch(sure=0.9)
    scene.moment()
    scene.detect(number)
    scene.touches[number]["sure"] = 0.97
    scene.lift(number)
    scene.rest(0.3)
    assert not scene.arm.paused


def to_resume(sure):
    """A touch that asks a paused arm to go on, recognised and lifted."""
    scene = Scene()
    scene.whole()
    scene.rest(1.0)
    number = scene.touch(sure=sure)
    scene.rest(0.2)
    scene.detect(number)
    scene.lift(number)
    return scene, number


def test_a_touch_to_resume_may_become_sure_until_it_closes():
    scene, number = to_resume(0.9)
    scene.rest(0.3)
    assert accepted(scene.said) == ["pause"] and scene.said[-1].action == "pause"
    scene.touches[number]["sure"] = 0.96
    scene.moment()
    assert accepted(scene.said) == ["pause", "resume"] and not scene.arm.paused


def test_what_is_not_sure_when_its_touch_closes_is_refused_for_good():
    scene, number = to_resume(0.9)
    scene.rest(0.4)
    scene.touches[number]["sure"] = 0.94
    scene.moment()
    scene.close(number)
    assert scene.said[-1].why == "confidence 0.94 is below 0.95"
    scene.whole(sure=0.5)
    assert scene.arm.paused


def test_any_action_is_waited_for_until_it_is_sure_and_done_once():
    rule = Rule(gesture="stroke", action="next_waypoint", confidence=0.9)
    scene = Scene(CommandMap(commands=[rule]))
    number = scene.touch("stroke", 0.85)
    scene.rest(0.2)
    assert scene.detect(number) == []
    scene.touches[number]["sure"] = 0.92
    scene.rest(0.5)
    assert accepted(scene.said) == ["next_waypoint"] and len(scene.said) == 1


def test_nobody_waits_for_a_touch_longer_than_patience():
    rule = Rule(gesture="stroke", action="next_waypoint", confidence=0.9)
    scene = Scene(CommandMap(commands=[rule]))
    number = scene.touch("stroke", 0.85)
    scene.moment()
    scene.detect(number)
    scene.rest(2.1)
    assert [one.why for one in scene.said] == ["confidence 0.85 is below 0.90"]
    scene.touches[number]["sure"] = 0.99
    scene.rest(1.0)
    assert accepted(scene.said) == []


def test_what_takes_over_a_touch_that_is_waited_for_is_waited_for():
    scene, number = to_resume(0.9)
    heir = scene.touch(sure=0.97)
    scene.lift(heir)
    scene.close(number, heir)
    scene.rest(0.2)
    assert accepted(scene.said) == ["pause", "resume"]


def test_what_has_commanded_is_not_waited_for_as_another_touch():
    scene = Scene()
    scene.whole()
    scene.rest(1.0)
    heir, number = scene.touch("double_pat"), scene.touch(sure=0.9)
    scene.rest(0.2)
    scene.detect(heir)
    scene.detect(number)
    scene.touches[heir].update(gesture="poke", sure=0.99)
    scene.close(number, heir)
    assert scene.said[-1].why == "its touch has commanded already"
    scene.lift(heir)
    scene.rest(0.5)
    assert scene.arm.paused


def test_what_is_waited_for_is_refused_once_the_skin_cannot_be_relied_on():
    scene, number = to_resume(0.9)
    scene.clock.sleep(0.12)
    scene.policy.check_skin()
    assert [one.why for one in scene.said if not one.accepted] == [
        "stale skin: no reading for 120 ms"
    ]
    scene.touches[number]["sure"] = 0.99
    scene.rest(0.5)
    assert scene.arm.paused


@pytest.mark.parametrize(
    ("likeliest", "sure", "done"),
    [
        ("poke", 0.6, ["pause"]),
        ("poke", 0.4, []),
        ("stroke", 0.75, []),
        ("grab", 0.75, []),
        ("none", 0.75, []),
        ("", 0.75, []),
    ],
)
def test_an_unknown_touch_halts_the_arm_where_it_most_likely_asks_for_it(
    likeliest, sure, done
):
    scene = Scene()
    number = scene.touch("none")
    scene.rest(0.2)
    scene.lift(number)
    scene.detect(number, sure=sure, gesture="unknown", likeliest=likeliest)
    scene.close(number)
    assert accepted(scene.said) == done


def test_an_unknown_touch_never_resumes():
    scene = Scene()
    scene.whole()
    scene.rest(1.0)
    number = scene.touch(sure=0.99)
    scene.lift(number)
    scene.rest(0.2)
    scene.detect(number, gesture="unknown", likeliest="poke")
    scene.rest(1.0)
    scene.close(number)
    assert scene.arm.paused and accepted(scene.said) == ["pause"]


@pytest.mark.parametrize(
    ("gesture", "sure", "done"),
    [
        ("poke", 0.51, True),
        ("poke", 0.49, False),
        ("double_pat", 0.69, False),
        ("grab", 0.71, True),
    ],
)
def test_each_action_needs_its_confidence(gesture, sure, done):
    scene = Scene()
    (said,) = scene.whole(gesture, sure)
    assert said.accepted == done


def test_releasing_needs_more_than_pausing_whatever_the_map_says():
    rule = Rule(gesture="grab", action="toggle_gripper", confidence=0.1)
    scene = Scene(CommandMap(commands=[rule]))
    assert accepted(scene.whole("grab", 0.2)) == ["close_gripper"]
    (said,) = scene.whole("grab", 0.84)
    assert said.why == "confidence 0.84 is below 0.85"
    assert accepted(scene.whole("grab", 0.86)) == ["open_gripper"]


def test_one_touch_commands_once():
    scene = Scene()
    number = scene.touch("double_pat")
    for _ in range(5):
        scene.rest(0.7)
        scene.detect(number)
    assert accepted(scene.said) == ["next_waypoint"]
    assert scene.said[-1].why == "its touch has commanded already"


def test_what_takes_over_a_touch_that_has_commanded_commands_nothing():
    scene = Scene()
    number, heir = scene.touch("double_pat"), scene.touch("grab")
    scene.moment()
    scene.detect(number)
    scene.close(number, heir)
    scene.rest(1.0)
    (said,) = scene.detect(heir)
    assert said.why == "its touch has commanded already"


def test_a_rule_rests_after_it_was_obeyed():
    rule = Rule(gesture="stroke", action="next_waypoint", cool_down=3.0)
    scene = Scene(CommandMap(commands=[rule]))
    assert accepted(scene.whole("stroke")) == ["next_waypoint"]
    (said,) = scene.whole("stroke")
    assert "it rests 3 s" in said.why
    scene.rest(2.0)
    assert accepted(scene.whole("stroke")) == ["next_waypoint"]


def test_a_pause_needs_no_rest():
    rule = Rule(gesture="poke", action="toggle_pause", cool_down=60.0)
    scene = Scene(CommandMap(commands=[rule, Rule(gesture="grab", action="resume")]))
    assert accepted(scene.whole()) == ["pause"]
    scene.rest(1.0)
    assert accepted(scene.whole("grab")) == ["resume"]
    assert accepted(scene.whole()) == ["pause"]


def test_nothing_is_done_on_old_data():
    scene = Scene()
    number = scene.touch()
    scene.moment()
    (said,) = scene.detect(number, age=0.12)
    assert said.why == "it was felt 120 ms ago" and scene.arm.told == []


def test_a_stale_skin_holds_the_arm_though_nothing_comes():
    scene = Scene()
    scene.moment()
    scene.clock.sleep(0.1)
    scene.policy.check_skin()
    assert scene.arm.hold_reason is None
    scene.clock.sleep(0.02)
    scene.policy.check_skin()
    assert scene.arm.hold_reason == "stale skin: no reading for 120 ms"
    assert accepted(scene.said) == ["hold"] and scene.policy.accepted == 0


def test_the_watch_looks_by_itself_within_150_ms():
    clock = ManualClock()
    arm, said = ToldArm(clock), []
    policy = Policy(arm, Scene().policy.commands, VOCABULARY)
    policy.start(Context(INFO, clock, said.append))
    clock.sleep(0.121)
    for _ in range(500):
        if arm.hold_reason:
            break
        time.sleep(0.01)
    policy.close()
    assert arm.hold_reason == "stale skin: no reading for 121 ms"
    assert not policy.thread.is_alive()


@pytest.mark.parametrize("kind", ["out", "silent"])
def test_a_patch_that_is_out_holds_the_arm_and_commands_nothing(kind):
    scene = Scene()
    scene.rest(0.2)
    setattr(scene, kind, (PATCH.id,))
    scene.rest(0.14)
    assert scene.arm.hold_reason == f"broken skin: patch '{PATCH.id}' is out"
    number = scene.touch()
    scene.moment()
    (said,) = scene.detect(number)
    assert not said.accepted and said.why.startswith("broken skin")


def test_a_patch_that_misses_a_few_readings_holds_nothing():
    scene = Scene()
    scene.rest(0.2)
    for _ in range(5):
        scene.silent = (PATCH.id,)
        scene.rest(0.08)
        scene.silent = ()
        scene.rest(0.02)
    assert scene.arm.hold_reason is None


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("protective_stop", True, "the arm is in protective stop"),
        ("connected", False, "the arm is not connected"),
    ],
)
@pytest.mark.parametrize("gesture", VOCABULARY[1:])
def test_an_arm_that_is_out_of_order_is_commanded_nothing(name, value, why, gesture):
    scene = Scene()
    setattr(scene.arm, name, value)
    (said,) = scene.whole(gesture)
    assert said.why == why and scene.arm.told == []


@pytest.mark.parametrize(
    ("force", "seconds", "why"),
    [
        (41.0, 0.1, "unrecognised touch of 41 N"),
        (5.0, 2.1, "unrecognised touch for 2.0 s"),
    ],
)
def test_when_in_doubt_it_is_held(force, seconds, why):
    scene = Scene()
    scene.touch("none", force=force)
    scene.rest(seconds)
    assert scene.arm.hold_reason == why


def test_what_is_said_to_be_nothing_is_not_recognised():
    scene = Scene()
    number = scene.touch("none")
    scene.moment()
    scene.detect(number, gesture="unknown")
    scene.rest(2.1)
    assert scene.arm.hold_reason == "unrecognised touch for 2.0 s"


def test_a_recognised_touch_may_be_firm_and_long_and_a_short_gentle_one_not():
    scene = Scene()
    number = scene.touch("grab")
    scene.moment()
    scene.detect(number)
    scene.touches[number]["force"] = 60.0
    scene.rest(4.0)
    scene.close(number)
    scene.touch("none", force=39.0)
    scene.rest(1.9)
    assert scene.arm.hold_reason is None


def test_an_arm_that_stands_is_not_held_by_touching_it():
    scene = Scene()
    scene.arm.working = False
    scene.touch("none", force=80.0)
    scene.rest(3.0)
    assert scene.arm.hold_reason is None


def test_a_held_arm_takes_two_deliberate_touches_to_start():
    scene = Scene()
    scene.arm.hold("not started")
    for gesture in ("double_pat", "grab"):
        (said,) = scene.whole(gesture)
        assert said.why == "the arm is held: not started; pause it, then resume"
    assert accepted(scene.whole()) == ["pause"]
    assert scene.arm.hold_reason == "not started"
    scene.rest(1.0)
    assert accepted(scene.whole()) == ["resume"]
    assert scene.arm.hold_reason is None and not scene.arm.paused


def test_an_arm_that_cannot_be_released_stays_held_and_says_why():
    scene = Scene()
    scene.arm.hold("lost connection")
    scene.whole()
    scene.rest(1.0)
    scene.arm.broken = ArmError("the arm stays held: speed slider at zero")
    said = scene.whole()
    assert [one.accepted for one in said if one.action == "resume"] == [False]
    assert scene.arm.hold_reason and scene.arm.paused


touches = st.tuples(
    st.sampled_from(VOCABULARY),
    st.floats(0.0, 1.0),
    st.floats(0.02, 2.5),
    st.floats(0.0, 80.0),
    st.booleans(),
    st.floats(0.0, 2.0),
)


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(["hold", "pause", "both"]), touches)
def test_no_single_touch_starts_an_arm_that_was_not_paused_a_second_ago(stop, touch):
    scene = Scene()
    if stop != "pause":
        scene.arm.hold("test")
    if stop != "hold":
        scene.arm.pause()
    gesture, sure, seconds, force, ends, rest = touch
    number = scene.touch(gesture, sure, force)
    scene.rest(min(seconds, 0.9))
    scene.detect(number)
    if ends:
        scene.lift(number)
    scene.rest(rest)
    assert not STARTING_ACTIONS & set(scene.arm.told)


@settings(max_examples=12, deadline=None)
@given(st.lists(touches, max_size=6))
def test_whatever_is_felt_the_laws_of_starting_hold(sequence):
    scene = Scene()
    for gesture, sure, seconds, force, ends, rest in sequence:
        number = scene.touch(gesture, sure, force)
        scene.rest(seconds)
        scene.detect(number)
        if ends:
            scene.lift(number)
        scene.rest(rest)
    done = [one for one in scene.said if one.accepted and one.touch is not None]
    assert len({one.touch for one in done}) == len(done)
    paused = None
    for one in done:
        if one.action == "resume":
            assert paused is not None and one.stamp - paused >= SECOND
            assert one.gesture == "poke"
        paused = {"pause": one.stamp, "resume": None}.get(one.action, paused)
    assert scene.policy.accepted == len(done)


def test_every_decision_is_told_with_its_reason():
    scene = Scene(CommandMap(commands=[Rule(gesture="poke", action="none")]))
    assert [one.why for one in scene.whole()] == ["the map says none"]
    assert [one.why for one in scene.whole("grab")] == ["the map has no rule for it"]
    assert scene.whole("none") == []


def test_a_registered_function_is_called_like_any_action():
    called = []

    @command_function("dance_in_test")
    def dance(arm, detection):
        called.append((arm, detection.gesture))

    with pytest.raises(ValueError, match="allowed is a word that is not taken"):
        command_function("dance_in_test")
    rule = Rule(gesture="stroke", function="dance_in_test")
    scene = Scene(CommandMap(commands=[rule]))
    assert accepted(scene.whole("stroke", 0.79)) == []
    assert accepted(scene.whole("stroke")) == ["function"]
    assert called == [(scene.arm, "stroke")]


def test_whatever_goes_wrong_holds_the_arm_and_stops_the_stream():
    scene = Scene()
    scene.arm.broken = RuntimeError("bug")
    number = scene.touch()
    scene.moment()
    with pytest.raises(RuntimeError, match="bug"):
        scene.detect(number)
    assert scene.arm.hold_reason == "the policy failed: RuntimeError"


def test_a_watch_that_fails_holds_the_arm_and_stops_the_stream():
    clock = HostClock()
    arm = ToldArm(clock)
    policy = Policy(arm, Scene().policy.commands, VOCABULARY)
    arm.state = lambda: 1 / 0
    policy.start(Context(INFO, clock, lambda item: None))
    policy.thread.join(5)
    assert arm.hold_reason == "the policy failed: ZeroDivisionError"
    with pytest.raises(ZeroDivisionError):
        Scene.moment.__get__(stand_for(policy, clock))()
    policy.close()


def stand_for(policy, clock):
    scene = Scene()
    scene.policy, scene.clock = policy, ManualClock(clock.now())
    return scene


def test_when_the_stream_ends_the_arm_is_held():
    scene = Scene()
    scene.policy.close()
    assert scene.arm.hold_reason == "the stream has ended"


def test_a_skin_too_slow_to_be_watched_is_refused():
    from dataclasses import replace

    scene = Scene()
    info = replace(INFO, rate=10.0)
    with pytest.raises(ArmError, match="10 readings a second; allowed are 20 or more"):
        scene.policy.start(Context(info, scene.clock, scene.said.append))


def test_a_simulated_arm_obeys_and_stands_in_time():
    scene = Scene()
    arm = scene.policy.arm = SimulatedArm(clock=scene.clock)
    while arm.state().target != "over the frame":
        scene.rest(0.02)
    scene.rest(1.0)
    scene.clock.sleep(0.11)
    scene.policy.check_skin()
    began = scene.clock.now()
    while arm.state().moving:
        scene.clock.sleep(0.001)
    assert scene.clock.now() - began <= 0.13 * SECOND
    assert threading.active_count() < 10 and np.isfinite(arm.state().q).all()
    assert SKIN.count == 2112
