"""Tests of the policy: which touches command an arm, and what holds it."""

from dataclasses import replace

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
from eskin.drivers import ManualClock
from eskin.errors import ArmError
from eskin.stream import Context
from helpers.commands import (
    DEFAULT,
    INFO,
    PATCH,
    SECOND,
    VOCABULARY,
    RecordingArm,
    Scene,
    make_map,
    make_paused_scene,
)


def test_gestures_execute_actions_of_map():
    scene = Scene()
    for gesture, order in [
        ("grab", "close_gripper"),
        ("stroke", "set_speed"),
        ("double_pat", "next_waypoint"),
        ("grab", "open_gripper"),
        ("stroke", "set_speed"),
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
        ("poke", 0.51, True),
        ("poke", 0.49, False),
        ("double_pat", 0.69, False),
        ("grab", 0.71, True),
    ],
)
def test_action_needs_its_confidence(gesture, confidence, accepted):
    (event,) = Scene().touch(gesture, confidence)
    assert event.accepted == accepted


def test_rule_cannot_lower_confidence_of_releasing():
    rule = Rule(gesture="grab", action="toggle_gripper", confidence=0.1)
    scene = Scene(CommandMap(commands=[rule]))
    for confidence in (0.2, 0.84, 0.86):
        scene.touch("grab", confidence)
    assert scene.accepted == ["close_gripper", "open_gripper"]


@pytest.mark.parametrize(
    ("likeliest", "confidence", "accepted"),
    [
        ("poke", 0.6, ["pause"]),
        ("poke", 0.4, []),
        ("stroke", 0.75, []),
        ("none", 0.75, []),
        ("", 0.75, []),
    ],
)
def test_unknown_touch_only_halts(likeliest, confidence, accepted):
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


@pytest.mark.parametrize("kind", ["faulty_patches", "silent_patches"])
def test_failed_patch_holds_arm(kind):
    scene = Scene()
    scene.wait(0.2)
    setattr(scene, kind, (PATCH.id,))
    scene.wait(0.14)
    assert PATCH.id in scene.arm.hold_reason
    number = scene.begin()
    scene.step()
    (event,) = scene.detect(number)
    assert not event.accepted and PATCH.id in event.why


def test_patch_without_data_holds_arm_though_no_reading_comes():
    scene = Scene(monitor=SkinMonitorConfig(max_age=1.0))
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
    scene.wait(0.2)
    assert (scene.arm.hold_reason is not None) == is_held


def test_patch_that_misses_few_readings_holds_nothing():
    scene = Scene()
    scene.wait(0.2)
    for _ in range(5):
        scene.silent_patches = (PATCH.id,)
        scene.wait(0.08)
        scene.silent_patches = ()
        scene.wait(0.02)
    assert scene.arm.hold_reason is None


@pytest.mark.parametrize(
    ("force", "seconds", "detected", "at_work", "reason"),
    [
        (41.0, 0.1, None, True, "41 N"),
        (5.0, 2.1, None, True, "2.0 s"),
        (5.0, 2.1, "unknown", True, "2.0 s"),
        (39.0, 1.9, None, True, None),
        (60.0, 3.0, "grab", True, None),
        (80.0, 3.0, None, False, None),
    ],
)
def test_strong_or_long_unrecognised_touch_holds_moving_arm(
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


def test_tap_does_not_recognise_strong_press_beside_it():
    scene = Scene()
    press, tap = scene.begin("none", force=15.0), scene.begin_detected("double_pat")
    scene.close(tap, heir=press)
    scene.touches[press].force = 60.0
    scene.wait(0.1)
    assert scene.arm.hold_reason


def test_held_arm_takes_two_touches_to_start():
    scene = Scene()
    scene.arm.hold("not started")
    for gesture in ("double_pat", "grab"):
        (event,) = scene.touch(gesture)
        assert "held: not started" in event.why
    scene.touch()
    assert scene.arm.hold_reason == "not started"
    scene.wait(1.0)
    scene.touch()
    assert scene.accepted == ["pause", "resume"]
    assert scene.arm.hold_reason is None and not scene.arm.paused


def test_arm_that_cannot_be_released_stays_held():
    scene = Scene()
    scene.arm.hold("lost connection")
    scene.touch()
    scene.wait(1.0)
    scene.arm.error = ArmError("speed slider at zero")
    events = scene.touch()
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
def test_arm_starts_only_by_poke_and_second_after_pause(sequence):
    scene = Scene()
    for touch in sequence:
        play(scene, touch)
    executed = [event for event in scene.events if event.accepted and event.touch]
    assert len({event.touch for event in executed}) == len(executed)
    assert scene.policy.accepted == len(executed)
    paused = None
    for event in executed:
        if event.action == "resume":
            assert paused is not None and event.stamp - paused >= SECOND
            assert event.gesture == "poke"
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
