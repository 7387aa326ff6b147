"""Tests of the policy: which touches command an arm, and what holds it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.command import (
    CommandMap,
    Policy,
    Rule,
    SkinMonitorConfig,
    command_function,
)
from eskin.command.actions import MIN_CONFIDENCE, STAND_CONFIDENCE
from eskin.drivers import ManualClock
from eskin.errors import ArmError
from eskin.stream import Context
from helpers.commands import (
    DEFAULT,
    INFO,
    PATCH,
    SECOND,
    SKIN,
    VOCABULARY,
    RecordingArm,
    Scene,
    make_map,
    make_paused_scene,
)

LEAST = MIN_CONFIDENCE
MAYBE = MIN_CONFIDENCE["pause"] + 0.05
"""Confidence of a poke that may be a stop."""
SLOW = 0.3
"""Share of full speed of an arm whose skin is out in part."""


def test_gestures_execute_actions_of_map():
    scene = Scene()
    for gesture, order in [
        ("double_pat", "next_waypoint"),
        ("grab", "close_gripper"),
        ("stroke", "set_speed"),
        ("double_pat", "set_speed"),
        ("grab", "open_gripper"),
        ("poke", "pause"),
    ]:
        (event,) = scene.touch(gesture)
        assert event.accepted and scene.arm.orders[-1] == order
    assert scene.policy.accepted == 6 and scene.arm.speed == 1.0


@pytest.mark.parametrize(
    ("action", "order"),
    [
        ("hold", "hold"),
        ("previous_waypoint", "previous_waypoint"),
        ("open_gripper", "open_gripper"),
        ("slow", "set_speed"),
        ("normal", "set_speed"),
    ],
)
def test_action_reaches_arm(action, order):
    scene = Scene(make_map(poke=action))
    scene.touch()
    assert scene.accepted == [action] and scene.arm.orders == [order]


def test_touch_without_action_commands_nothing():
    scene = Scene(make_map(poke="none"))
    for gesture, reason in (("poke", "none"), ("grab", "no rule")):
        (event,) = scene.touch(gesture)
        assert not event.accepted and reason in event.why
    assert scene.touch("none") == [] and scene.arm.orders == []


def test_registered_function_is_called_like_any_action():
    calls = []

    @command_function("dance_in_test")
    def dance(arm, detection):
        calls.append((arm, detection.gesture))

    with pytest.raises(ValueError, match="dance_in_test"):
        command_function("dance_in_test")
    scene = Scene(
        CommandMap(commands=[Rule(gesture="stroke", function="dance_in_test")])
    )
    scene.touch("stroke", 0.79)
    assert calls == []
    scene.touch("stroke")
    assert calls == [(scene.arm, "stroke")] and scene.accepted == ["function"]


@pytest.mark.parametrize(
    ("gesture", "confidence", "accepted"),
    [
        ("poke", LEAST["pause"] + 0.01, True),
        ("poke", LEAST["pause"] - 0.01, False),
        ("double_pat", LEAST["next_waypoint"] - 0.01, False),
        ("grab", LEAST["close_gripper"] + 0.01, True),
    ],
)
def test_action_needs_its_confidence(gesture, confidence, accepted):
    (event,) = Scene().touch(gesture, confidence)
    assert event.accepted == accepted


def test_rule_cannot_lower_confidence_of_releasing():
    rule = Rule(gesture="grab", action="toggle_gripper", confidence=0.1)
    scene = Scene(CommandMap(commands=[rule]))
    for confidence in (0.2, LEAST["open_gripper"] - 0.01, 0.999):
        scene.touch("grab", confidence)
    assert scene.accepted == ["close_gripper", "open_gripper"]


@pytest.mark.parametrize(
    ("likeliest", "confidence", "accepted"),
    [
        ("poke", LEAST["pause"] + 0.01, ["pause"]),
        ("poke", LEAST["pause"] - 0.01, []),
        ("stroke", LEAST["slow"] + 0.01, ["slow"]),
        ("stroke", LEAST["slow"] - 0.01, []),
        ("double_pat", 0.99, []),
        ("grab", 0.99, []),
        ("none", 0.75, []),
        ("", 0.75, []),
    ],
)
def test_unknown_touch_only_halts_or_slows(likeliest, confidence, accepted):
    scene = Scene()
    unknown = {"gesture": "unknown", "likeliest": likeliest}
    number = scene.begin("none")
    scene.wait(0.2)
    scene.lift(number)
    scene.detect(number, confidence=confidence, **unknown)
    scene.close(number)
    assert scene.accepted == accepted


def test_unknown_touch_never_resumes():
    scene = make_paused_scene()
    number = scene.begin()
    scene.lift(number)
    scene.wait(0.2)
    scene.detect(number, gesture="unknown", likeliest="poke")
    scene.wait(1.0)
    scene.close(number)
    assert scene.accepted == ["pause"]


def test_touch_commands_once():
    scene = Scene()
    number = scene.begin("double_pat")
    scene.wait(0.4)
    scene.lift(number)
    for _ in range(5):
        scene.wait(0.7)
        scene.detect(number)
    assert scene.accepted == ["next_waypoint"]
    assert "commanded already" in scene.last_reason


def test_heir_of_commanding_touch_commands_nothing():
    scene = Scene()
    number = scene.begin("double_pat")
    heir = scene.begin("grab")
    scene.step()
    scene.detect(number)
    scene.close(number, heir)
    scene.wait(1.0)
    (event,) = scene.detect(heir)
    assert "commanded already" in event.why


def test_rule_cools_down_after_execution():
    rule = Rule(gesture="stroke", action="next_waypoint", cool_down=3.0)
    scene = Scene(CommandMap(commands=[rule]))
    (first,), (second,) = scene.touch("stroke"), scene.touch("stroke")
    assert first.accepted and "3 s" in second.why
    scene.wait(2.0)
    (third,) = scene.touch("stroke")
    assert third.accepted


def test_pause_needs_no_cool_down():
    rules = [
        Rule(gesture="poke", action="toggle_pause", cool_down=60.0),
        Rule(gesture="grab", action="resume"),
    ]
    scene = make_paused_scene(CommandMap(commands=rules))
    scene.touch("grab")
    scene.touch()
    assert scene.accepted == ["pause", "resume", "pause"]


def test_stale_detection_commands_nothing():
    scene = Scene()
    number = scene.begin()
    scene.step()
    (event,) = scene.detect(number, age=0.12)
    assert "120 ms" in event.why and scene.arm.orders == []


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [("protective_stop", True, "protective stop"), ("connected", False, "connected")],
)
def test_stopped_or_lost_arm_is_commanded_nothing(field, value, reason):
    scene = Scene()
    setattr(scene.arm, field, value)
    for gesture in VOCABULARY[1:]:
        (event,) = scene.touch(gesture)
        assert not event.accepted and reason in event.why
    assert scene.arm.orders == []


def test_stale_reading_holds_arm():
    scene = Scene()
    scene.step()
    scene.clock.sleep(0.1)
    scene.policy.check_skin()
    assert scene.arm.hold_reason is None
    scene.clock.sleep(0.02)
    scene.policy.check_skin()
    assert "120 ms" in scene.arm.hold_reason
    assert scene.accepted == ["hold"] and scene.policy.accepted == 0


def test_thread_holds_arm_without_readings():
    clock, events = ManualClock(), []
    arm = RecordingArm(clock)
    policy = Policy(arm, DEFAULT, VOCABULARY)
    policy.start(Context(INFO, clock, events.append))
    clock.sleep(0.121)
    for _ in range(500):
        if arm.hold_reason:
            break
        policy.closing.wait(0.01)
    policy.close()
    assert "121 ms" in arm.hold_reason and not policy.thread.is_alive()


FAR = SkinMonitorConfig(hand=1.0)
"""A monitor of a skin on which a hand is felt from far away."""


@pytest.mark.parametrize("kind", ["faulty_patches", "silent_patches"])
def test_patch_that_is_out_slows_then_holds_arm_where_a_hand_could_be_missed(kind):
    scene = Scene()
    scene.wait(0.2)
    setattr(scene, kind, (PATCH.id,))
    scene.wait(0.14)
    assert scene.arm.hold_reason is None and scene.arm.speed_limit == SLOW
    assert scene.accepted == ["slow"] and PATCH.id in scene.last_reason
    scene.wait(0.4)
    assert PATCH.id in scene.arm.hold_reason


def test_patch_that_is_out_only_slows_arm_where_its_neighbours_feel_a_hand():
    scene = Scene(monitor=FAR)
    scene.wait(0.2)
    scene.silent_patches = (PATCH.id,)
    scene.wait(5.0)
    assert scene.arm.hold_reason is None and scene.arm.speed_limit == SLOW


def test_large_part_of_skin_that_is_out_holds_arm_at_once():
    scene = Scene(monitor=FAR)
    scene.wait(0.2)
    sizes = np.bincount(SKIN.patch_index)
    largest = np.argsort(-sizes)[:2]
    scene.silent_patches = tuple(SKIN.patches[k].id for k in largest)
    scene.wait(0.14)
    assert "% of the taxels" in scene.arm.hold_reason


def test_patch_that_goes_out_under_hand_stops_arm_at_once_and_then_holds_it():
    scene = Scene(monitor=FAR)
    number = scene.begin("grab")
    scene.wait(0.1)
    scene.detect(number)
    scene.lift(number)
    scene.silent_patches = (PATCH.id,)
    scene.wait(0.14)
    assert scene.arm.speed_limit == 0.0
    scene.wait(0.5)
    assert PATCH.id in scene.arm.hold_reason


@pytest.mark.parametrize(("gesture", "accepted"), [("poke", True), ("grab", False)])
def test_patch_that_is_out_can_stop_and_nothing_else(gesture, accepted):
    scene = Scene(monitor=FAR)
    scene.wait(0.2)
    scene.faulty_patches = (PATCH.id,)
    scene.wait(0.2)
    number = scene.begin(gesture)
    scene.step()
    (event,) = scene.detect(number)
    assert event.accepted == accepted
    assert accepted or PATCH.id in event.why


def test_arm_goes_at_commanded_speed_once_patch_is_back_for_a_time():
    scene = Scene(monitor=FAR)
    scene.arm.speed = 0.5
    scene.silent_patches = (PATCH.id,)
    scene.wait(0.2)
    scene.silent_patches = ()
    scene.wait(1.9)
    assert scene.arm.speed_limit == SLOW
    scene.wait(0.3)
    assert scene.arm.speed_limit == 1.0 and scene.arm.speed == 0.5
    assert scene.accepted == ["slow", "normal"]


def test_arm_held_for_patch_offers_to_go_on_once_patch_is_back():
    scene = Scene()
    scene.silent_patches = (PATCH.id,)
    scene.wait(1.0)
    (refusal,) = [event for event in scene.touch("grab") if not event.accepted]
    assert PATCH.id in refusal.why and "cable" in refusal.why
    scene.silent_patches = ()
    scene.step()
    offer = scene.events[-1]
    assert (offer.action, offer.accepted) == ("resume", False)
    assert "no longer" in offer.why and "poke, then double pat" in offer.why
    (refusal,) = scene.touch("grab")
    assert "poke, then double pat" in refusal.why
    scene.touch("poke")
    scene.wait(1.0)
    scene.touch("double_pat")
    assert scene.arm.hold_reason is None and not scene.arm.paused


def test_fault_that_ends_starts_no_arm():
    scene = make_paused_scene()
    for patches in ((PATCH.id,), ()):
        scene.silent_patches = patches
        scene.wait(5.0)
    assert scene.arm.paused and not {"resume", "release"} & set(scene.arm.orders)


def test_patch_without_data_holds_arm_though_no_reading_comes():
    scene = Scene(monitor=SkinMonitorConfig(max_age=1.0, max_out_seconds=0.11))
    scene.wait(0.2)
    scene.silent_patches = (PATCH.id,)
    scene.wait(0.1)
    assert scene.arm.hold_reason is None
    scene.clock.sleep(0.02)
    scene.policy.check_skin()
    assert PATCH.id in scene.arm.hold_reason


@pytest.mark.parametrize(("share", "is_held"), [(0.2, True), (0.3, False)])
def test_patch_with_few_valid_taxels_is_out(share, is_held):
    scene = Scene()
    scene.valid_share = share
    scene.wait(0.6)
    assert (scene.arm.hold_reason is not None) == is_held


def test_patch_that_misses_few_readings_holds_nothing():
    scene = Scene()
    scene.wait(0.2)
    for _ in range(5):
        scene.silent_patches = (PATCH.id,)
        scene.wait(0.08)
        scene.silent_patches = ()
        scene.wait(0.02)
    assert scene.arm.hold_reason is None and scene.arm.speed_limit == 1.0


@pytest.mark.parametrize(
    ("force", "seconds", "detected", "at_work", "reason"),
    [
        (41.0, 0.1, None, True, "41 N"),
        (39.0, 1.9, None, True, None),
        (60.0, 3.0, "grab", True, None),
        (80.0, 3.0, None, False, None),
    ],
)
def test_strong_unrecognised_touch_holds_moving_arm(
    force, seconds, detected, at_work, reason
):
    scene = Scene()
    scene.arm.at_work = at_work
    number = scene.begin("grab")
    scene.step()
    if detected:
        scene.detect(number, gesture=detected)
    scene.touches[number].force = force
    scene.wait(seconds - 0.02)
    assert (reason or "") in (scene.arm.hold_reason or "")
    assert (scene.arm.hold_reason is None) == (reason is None)


@pytest.mark.parametrize("detected", [None, "unknown"])
def test_arm_stands_under_long_unrecognised_touch_and_is_paused_by_longer_one(detected):
    scene = Scene()
    number = scene.begin("grab")
    scene.step()
    if detected:
        scene.detect(number, gesture=detected)
    scene.wait(1.9)
    assert scene.arm.speed_limit == 1.0
    scene.wait(0.2)
    assert scene.waits == [number] and scene.arm.speed_limit == 0.0
    scene.wait(3.0)
    assert scene.accepted == ["pause"] and "5.0 s" in scene.last_reason
    assert scene.events[-1].touch == number and scene.arm.hold_reason is None


def test_strong_touch_holds_arm_that_stands_under_a_long_one():
    scene = Scene()
    scene.begin("none")
    scene.wait(2.2)
    assert scene.arm.speed_limit == 0.0
    scene.begin("none", force=60.0)
    scene.wait(0.1)
    assert "60 N" in scene.arm.hold_reason


def test_policy_leaves_arm_held_and_without_limit():
    scene = Scene()
    scene.begin("poke", confidence=MAYBE)
    scene.step()
    scene.policy.close()
    assert scene.arm.hold_reason and scene.arm.speed_limit == 1.0


def test_arm_goes_on_after_long_touch_that_was_surely_no_gesture():
    scene = Scene()
    number = scene.begin("none")
    scene.wait(3.0)
    scene.lift(number)
    scene.wait(0.5)
    assert scene.arm.speed_limit == 0.0
    scene.detect(number)
    scene.close(number)
    assert scene.arm.speed_limit == 1.0 and scene.accepted == []


def test_light_touch_that_never_ends_slows_arm_and_lets_it_be_resumed():
    scene = Scene()
    scene.begin("none", force=1.1)
    scene.wait(6.0)
    assert scene.accepted == ["pause"]
    scene.touch("double_pat")
    scene.wait(1.5)
    assert scene.arm.paused and "went on" in scene.last_reason
    scene.wait(2.0)
    scene.touch("double_pat")
    assert not scene.arm.paused
    scene.wait(3.0)
    assert not scene.arm.paused and scene.arm.speed_limit == SLOW
    assert "light touch" in next(e.why for e in scene.events if e.action == "slow")


def test_light_touch_that_becomes_strong_counts_again():
    scene = Scene()
    number = scene.begin("none", force=1.1)
    scene.wait(11.0)
    scene.touch("double_pat")
    assert not scene.arm.paused
    scene.touches[number].force = 5.0
    scene.wait(0.1)
    assert scene.arm.paused


@pytest.mark.parametrize(("more", "waits"), [(-0.01, False), (0.01, True)])
def test_arm_stands_while_touch_may_be_a_stop(more, waits):
    scene = Scene()
    number = scene.begin("poke", confidence=STAND_CONFIDENCE + more)
    scene.step()
    assert (scene.arm.speed_limit == 0.0) == waits
    assert scene.waits == [number] * waits and scene.accepted == []


def test_arm_goes_on_once_possible_stop_is_recognised_as_something_else():
    scene = Scene()
    number = scene.begin("poke", confidence=MAYBE)
    scene.step()
    scene.touches[number].gesture, scene.touches[number].confidence = "grab", 0.99
    scene.detect(number)
    scene.wait(0.3)
    scene.lift(number)
    scene.wait(0.2)
    assert scene.accepted == ["close_gripper"] and scene.arm.speed_limit == 1.0


def test_possible_stop_that_ends_unrecognised_pauses():
    scene = Scene()
    number = scene.begin("poke", confidence=MAYBE)
    scene.step()
    scene.lift(number)
    scene.close(number)
    (event,) = scene.events
    assert (event.action, event.touch, event.patch) == ("pause", number, PATCH.id)
    assert "may have been a stop" in event.why and scene.arm.speed_limit == 1.0


def test_arm_that_stood_for_too_little_of_a_chance_goes_on():
    scene = Scene()
    number = scene.begin("poke", confidence=LEAST["pause"] - 0.01)
    scene.step()
    assert scene.arm.speed_limit == 0.0
    scene.lift(number)
    scene.close(number)
    assert scene.arm.speed_limit == 1.0 and not scene.arm.state().paused


def test_heir_of_possible_stop_is_waited_for():
    scene = Scene()
    number, heir = scene.begin("poke", confidence=MAYBE), scene.begin("none")
    scene.step()
    scene.close(number, heir)
    assert scene.arm.speed_limit == 0.0
    scene.detect(heir)
    scene.step()
    assert scene.arm.speed_limit == 1.0


def test_uncertain_touch_does_nothing_and_is_shown_as_not_understood():
    scene = Scene()
    number = scene.begin("none")
    scene.wait(0.2)
    scene.lift(number)
    (event,) = scene.detect(number, gesture="unknown", likeliest="grab", confidence=0.6)
    assert not event.accepted and event.touch == number
    assert "not understood, most likely grab (0.60)" in event.why
    scene.close(number)
    assert scene.arm.orders == []


def test_command_names_touch_and_patch_that_gave_it():
    scene = Scene()
    number = scene.begin_detected("double_pat", seconds=0.4)
    scene.lift(number)
    scene.wait(0.2)
    (event,) = scene.events
    assert (event.touch, event.patch) == (number, PATCH.id)
    assert event.onset == scene.touches[number].onset


def test_tap_does_not_recognise_strong_press_beside_it():
    scene = Scene()
    press, tap = scene.begin("none", force=15.0), scene.begin_detected("double_pat")
    scene.close(tap, heir=press)
    scene.touches[press].force = 60.0
    scene.wait(0.1)
    assert scene.arm.hold_reason


def test_strong_press_holds_an_arm_that_stands_for_another_touch():
    scene = Scene()
    possible_stop = scene.begin("poke", confidence=MAYBE)
    scene.step()
    assert scene.arm.speed_limit == 0.0
    scene.arm.moving = False
    scene.begin("none", force=80.0)
    scene.detect(possible_stop, gesture="none")
    scene.step()
    assert scene.arm.hold_reason


def test_held_arm_takes_two_touches_to_start():
    scene = Scene()
    scene.arm.hold("not started")
    for gesture in ("double_pat", "grab"):
        (event,) = scene.touch(gesture)
        assert "held: not started" in event.why or "nobody has" in event.why
    scene.touch()
    assert scene.arm.hold_reason == "not started"
    scene.wait(1.0)
    scene.touch("double_pat")
    assert scene.accepted == ["pause", "resume"]
    assert scene.arm.hold_reason is None and not scene.arm.paused


def test_arm_that_cannot_be_released_stays_held():
    scene = Scene()
    scene.arm.hold("lost connection")
    scene.touch()
    scene.wait(1.0)
    scene.arm.error = ArmError("speed slider at zero")
    events = scene.touch("double_pat")
    assert [event.accepted for event in events if event.action == "resume"] == [False]
    assert scene.arm.hold_reason and scene.arm.paused


touches = st.tuples(
    st.sampled_from(VOCABULARY),
    st.floats(0.0, 1.0),
    st.floats(0.02, 2.5),
    st.floats(0.0, 80.0),
    st.booleans(),
    st.floats(0.0, 2.0),
)


def play(scene, touch, longest=2.5):
    gesture, confidence, seconds, force, lifted, after = touch
    seconds = min(seconds, longest)
    number = scene.begin_detected(gesture, confidence, seconds, force)
    if lifted:
        scene.lift(number)
    scene.wait(after)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["hold", "pause", "both"]), touches)
def test_single_touch_never_starts_arm_stopped_less_than_second_ago(stop, touch):
    scene = Scene()
    if stop != "pause":
        scene.arm.hold("test")
    if stop != "hold":
        scene.arm.pause()
    play(scene, touch, longest=0.9)
    assert not {"resume", "release"} & set(scene.arm.orders)


@settings(max_examples=8, deadline=None)
@given(st.lists(touches, max_size=4))
def test_arm_starts_only_by_double_pat_and_second_after_pause(sequence):
    scene = Scene()
    for touch in sequence:
        play(scene, touch)
    executed = [
        event
        for event in scene.events
        if event.accepted and event.touch and event.action != "hold"
    ]
    assert len({event.touch for event in executed}) == len(executed)
    assert scene.policy.accepted == len(executed)
    paused = None
    for event in executed:
        if event.action == "resume":
            assert paused is not None and event.stamp - paused >= SECOND
            assert event.gesture == "double_pat"
        paused = {"pause": event.stamp, "resume": None}.get(event.action, paused)


def test_failure_of_action_holds_arm_and_stops_stream():
    scene = Scene()
    scene.arm.error = RuntimeError("bug")
    number = scene.begin()
    scene.step()
    with pytest.raises(RuntimeError, match="bug"):
        scene.detect(number)
    assert "RuntimeError" in scene.arm.hold_reason


def test_failure_of_thread_holds_arm_and_stops_stream():
    scene = Scene()
    policy = scene.policy = Policy(scene.arm, DEFAULT, VOCABULARY)
    scene.arm.state = lambda: 1 / 0
    policy.start(Context(INFO, scene.clock, scene.events.append))
    policy.thread.join(5)
    assert "ZeroDivisionError" in scene.arm.hold_reason
    with pytest.raises(ZeroDivisionError):
        scene.step()
    policy.close()


def test_slow_skin_is_refused():
    scene = Scene()
    info = replace(INFO, rate=10.0)
    with pytest.raises(ArmError, match="10 readings a second.* 20 "):
        scene.policy.start(Context(info, scene.clock, scene.events.append))
