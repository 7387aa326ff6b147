"""Tests of the policy: which touches command an arm, and what holds it."""

from dataclasses import replace
from threading import Event, Thread

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from eskin.command import (
    CommandMap,
    Policy,
    PolicyConfig,
    Problem,
    QuestionConfig,
    Refusal,
    Rule,
    SkinMonitorConfig,
    command_function,
    moves_nothing,
)
from eskin.command.actions import COMMAND_FUNCTIONS
from eskin.drivers import ManualClock
from eskin.errors import ArmError
from eskin.stream import Context
from eskin.stream.listener import BoundedQueue
from helpers.commands import (
    DEFAULT,
    HELD,
    INFO,
    PAPER,
    PATCH,
    PERIOD,
    SECOND,
    SKIN,
    VOCABULARY,
    RecordingArm,
    Scene,
    is_held_for,
    make_paused_scene,
)


@pytest.fixture
def dances():
    """A list of the calls of a function that a stroke calls, and what registers it."""
    calls = []

    def dance(arm, detection):
        calls.append((arm, detection.gesture))

    yield calls, dance
    COMMAND_FUNCTIONS.pop("dance_in_test", None)


DANCE = CommandMap(commands=[Rule(gesture="stroke", function="dance_in_test")])


def test_registered_function_is_called_once_it_is_answered(dances):
    calls, dance = dances
    command_function("dance_in_test")(dance)
    with pytest.raises(ValueError, match="dance_in_test"):
        command_function("dance_in_test")
    scene = Scene(DANCE)
    scene.wait(1.0)
    scene.touch("stroke", 0.99)
    assert calls == [] and scene.arm.shows_question
    scene.wait(0.5)
    scene.touch("poke")
    scene.wait(0.3)
    assert calls == [(scene.arm, "stroke")] and scene.accepted == ["function"]


def test_function_that_moves_nothing_is_called_at_once(dances):
    calls, dance = dances
    command_function("dance_in_test")(moves_nothing(dance))
    scene = Scene(DANCE)
    scene.touch("stroke", 0.79)
    assert calls == []
    scene.touch("stroke")
    assert calls == [(scene.arm, "stroke")] and scene.questions == []


@pytest.fixture
def blocked():
    """A scene in which a stroke calls a function that blocks, and what ends that."""
    over = Event()
    errors = []

    def block(arm, detection):
        over.wait()
        if errors:
            raise errors[0]

    COMMAND_FUNCTIONS["block_in_test"] = moves_nothing(block)
    rules = [*DEFAULT.commands[:3], Rule(gesture="stroke", function="block_in_test")]
    scene = Scene(CommandMap(commands=rules), function_seconds=0.0)
    scene.touch("stroke")
    yield scene, over, errors
    over.set()
    del COMMAND_FUNCTIONS["block_in_test"]


def test_function_that_blocks_holds_arm_until_it_returns(blocked):
    scene, over, _ = blocked
    assert [event.action for event in scene.events] == ["hold", "function"]
    assert is_held_for(scene.arm, Problem.BLOCKED_FUNCTION)
    assert scene.accepted == ["hold"]
    (pause,) = scene.touch("poke")
    assert pause.accepted and scene.arm.paused
    scene.wait(1.0)
    assert scene.touch("grab")[-1].reason.cause is Problem.BLOCKED_FUNCTION
    over.set()
    scene.policy.call.thread.join()
    scene.wait(1.0)
    assert "the cause is over (function" in scene.last_reason
    assert scene.ask()[-1].action == "resume" and not scene.arm.paused


def test_skin_is_watched_while_function_blocks(blocked):
    scene, _, _ = blocked
    scene.arm.hold_reason = None
    scene.clock.sleep(0.2)
    scene.policy.check_skin()
    assert scene.arm.hold_reason


def test_late_error_of_function_stops_stream(blocked):
    scene, over, errors = blocked
    errors.append(RuntimeError("bug"))
    over.set()
    scene.policy.call.thread.join()
    with pytest.raises(RuntimeError, match="bug"):
        scene.step()


def test_watch_holds_arm_whatever_blocks_the_policy():
    scene = Scene()
    taken = Event()
    over = Event()

    def block():
        with scene.policy.lock:
            taken.set()
            over.wait()

    thread = Thread(target=block)
    thread.start()
    taken.wait()
    scene.policy.check_skin()
    over.set()
    thread.join()
    assert is_held_for(scene.arm, Problem.BLOCKED_POLICY)


@pytest.mark.parametrize("gesture", ["none", "poke", "double_pat", "grab"])
def test_after_its_queue_has_overflowed_policy_is_as_before(gesture):
    scene = Scene()
    queue = BoundedQueue(2, Policy.drop)
    on_message = scene.policy.on_message
    scene.policy.on_message = queue.put
    scene.touch(gesture)
    other = scene.begin(gesture)
    heir = scene.begin()
    scene.wait(0.1)
    scene.lift(other)
    scene.close(other, heir)
    scene.lift(heir)
    scene.close(heir)
    scene.wait(1.0)
    scene.policy.on_message = on_message
    queue.end()
    while (item := queue.take()) is not None:
        on_message(item)
    assert queue.count().dropped > 50
    scene.arm.limit_speed(1.0)
    scene.touch("poke")
    scene.wait(5.0)
    assert scene.ask()[-1].accepted and not scene.arm.paused
    assert scene.arm.speed_limit == 1.0


def test_thread_holds_arm_without_readings():
    clock = ManualClock()
    events = []
    arm = RecordingArm(clock)
    policy = Policy(arm, DEFAULT, VOCABULARY)
    policy.start(Context(INFO, clock, events.append))
    clock.sleep(0.121)
    for _ in range(500):
        if arm.hold_reason:
            break
        policy.closing.wait(0.01)
    policy.close()
    assert "121 ms" in str(arm.hold_reason) and not policy.thread.is_alive()


@given(st.sampled_from(VOCABULARY), st.floats(0.0, 1.0), st.floats(0.1, 39.0))
@settings(max_examples=20, deadline=None)
def test_every_touch_that_is_felt_suspends_a_moving_arm(gesture, confidence, force):
    scene = Scene()
    number = scene.begin(gesture, confidence, force)
    for _ in range(50):
        scene.step()
        assert scene.arm.speed_limit == 0.0
    assert scene.waits == [number]


def test_command_names_touch_and_patch_that_gave_it():
    scene = Scene()
    scene.wait(1.0)
    (event,) = scene.ask()
    (question,) = scene.questions
    for told in (event, question):
        assert (told.touch, told.patch) == (1, PATCH.id)
        assert told.onset == scene.onsets[0][1]


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
        scene.wait(0.4)
        scene.close(number)
    scene.wait(after)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["hold", "pause", "both"]), touches)
def test_single_touch_never_starts_arm_stopped_less_than_second_ago(stop, touch):
    scene = Scene()
    if stop != "pause":
        scene.arm.hold(HELD)
    if stop != "hold":
        scene.arm.pause()
    play(scene, touch, longest=0.9)
    assert not {"resume", "release"} & set(scene.arm.orders)


@settings(max_examples=20, deadline=None)
@given(st.lists(touches, max_size=6))
@example([("stroke", 1.0, 1.0, 0.0, False, 1.0), ("none", 0.0, 2.5, 0.0, False, 2.0)])
@example([("grab", 1.0, 0.5, 5.0, True, 0.2), ("poke", 1.0, 0.2, 5.0, True, 1.5)])
def test_arm_does_more_only_after_it_asked_and_was_answered_by_a_poke(sequence):
    scene = make_paused_scene()
    for touch in sequence:
        play(scene, touch)
    executed = [event for event in scene.events if event.accepted and event.gesture]
    # A gesture commands once; a touch that goes on may stop the arm after it.
    told = [event.touch for event in executed]
    assert len(set(told)) == len(told)
    for event in executed:
        if event.action not in ("pause", "hold", "slow"):
            asked = [one.stamp for one in scene.questions if one.touch == event.touch]
            pokes = [
                onset
                for gesture, onset in scene.onsets
                if gesture == "poke" and asked[0] < onset < event.stamp
            ]
            assert len(asked) == 1 and len(pokes) == 1
            assert 0.25 * SECOND <= pokes[0] - asked[0] <= SECOND


hits = st.tuples(
    st.sampled_from(["none", "grab", "grab"]), st.floats(0.02, 0.9), st.floats(0.5, 0.9)
)


@settings(max_examples=20, deadline=None)
@given(st.lists(hits, min_size=1, max_size=4))
@example([("grab", 0.4, 0.6)])
def test_what_touches_again_within_a_second_never_starts_arm(sequence):
    scene = make_paused_scene()
    number = scene.begin("none", force=0.1)
    scene.step()
    for gesture, seconds, gap in sequence:
        scene.lift(number)
        scene.wait(gap)
        scene.close(number)
        number = scene.begin_detected(gesture, seconds=seconds)
    scene.lift(number)
    scene.wait(0.5)
    scene.close(number)
    assert "resume" not in scene.arm.orders


def test_hand_that_eases_and_stays_starts_nothing_until_it_has_left():
    scene = make_paused_scene()
    number = scene.begin_detected("grab", seconds=0.8)
    scene.lift(number)
    scene.wait(0.4)
    scene.close(number, is_held=True)
    scene.wait(10.0)
    scene.touch("poke")
    assert scene.questions == [] and "resume" not in scene.arm.orders


@pytest.mark.parametrize("gap", [0.5, 1.5])
def test_second_without_touch_begins_as_the_hand_has_left(gap):
    scene = Scene()
    number = scene.begin_detected("poke", seconds=0.3)
    scene.lift(number)
    scene.wait(0.4)
    scene.close(number, is_held=True)
    scene.wait(3.0)
    scene.held = ()
    scene.wait(gap)
    assert scene.arm.paused
    scene.ask()
    assert ("resume" in scene.arm.orders) == (gap > 1.0)


def test_touch_that_only_presses_on_is_known_by_its_patch():
    scene = Scene()
    number = scene.begin("none", force=2.0)
    status = scene.status(number, closed=True)
    status.held = status.taxels
    del scene.touches[number]
    scene.held = (status,)
    scene.wait(0.2)
    assert scene.arm.speed_limit == 0.0


def test_arm_that_stands_for_a_touch_stands_until_it_has_left():
    scene = Scene()
    number = scene.begin("none", force=2.0)
    scene.wait(2.2)
    assert scene.arm.speed_limit == 0.0
    scene.lift(number)
    scene.wait(0.4)
    scene.close(number, is_held=True)
    scene.wait(1.0)
    assert scene.arm.speed_limit == 0.0
    scene.held = ()
    scene.wait(1.0)
    assert scene.arm.speed_limit > 0.0


def test_hand_that_presses_on_is_light_only_if_its_force_is():
    scene = Scene()
    number = scene.begin("none", force=13.0)
    taxels = scene.touches[number].taxels
    scene.wait(0.5)
    scene.hidden[taxels] = 1e-3 * 13.0 / SKIN.areas[taxels].sum()
    scene.lift(number)
    scene.close(number, is_held=True)
    scene.wait(12.0)
    scene.arm.resume()
    scene.step()
    assert scene.accepted == ["pause", "pause"]


def test_hand_that_asked_and_presses_again_withdraws_the_question():
    scene = make_paused_scene()
    number = scene.begin_detected("grab", seconds=0.4)
    scene.lift(number)
    scene.wait(0.4)
    status = scene.status(number, closed=True)
    scene.close(number)
    assert scene.arm.shows_question
    status.held = status.taxels
    scene.held = (status,)
    scene.wait(0.1)
    assert not scene.arm.shows_question


LEAST = round(QuestionConfig.least_delay * SECOND)
"""Shortest time from the question to its answer [ns]."""
WINDOW = round(QuestionConfig.window * SECOND)
"""Longest such time [ns]."""


@pytest.mark.parametrize(
    ("delay", "cause"),
    [
        (0, Refusal.TOUCHED_BEFORE_QUESTION),
        (LEAST - 1, Refusal.TOUCHED_BEFORE_QUESTION),
        (LEAST, None),
        (WINDOW, None),
        (WINDOW + 1, Refusal.LATE_ANSWER),
    ],
)
def test_answer_begins_in_its_window(delay, cause):
    """`delay` is the time from the question to the first contact [ns]."""
    scene = make_paused_scene()
    scene.touch("grab")
    question = scene.policy.question
    onset = question.asked_at + delay
    scene.wait((onset - scene.clock.now()) // PERIOD * PERIOD / SECOND)
    number = scene.begin("poke")
    scene.touches[number].onset = onset
    scene.wait(0.3)
    scene.lift(number)
    scene.wait(0.4)
    scene.close(number)
    scene.wait(0.4)
    assert ("resume" in scene.arm.orders) == (cause is None)
    assert cause is None or scene.events[-1].reason.cause is cause


@pytest.mark.parametrize(("rival", "answers"), [("none", True), ("stroke", False)])
def test_answer_is_no_gesture_that_is_likelier_than_the_one_asked_for(rival, answers):
    scene = make_paused_scene()
    scene.touch("grab")
    scene.wait(0.5)
    number = scene.begin("poke")
    chances = np.zeros(len(VOCABULARY))
    chances[VOCABULARY.index("poke")] = 0.4
    chances[VOCABULARY.index(rival)] = 0.6
    scene.touches[number].probabilities = lambda: chances
    scene.wait(0.3)
    scene.lift(number)
    scene.wait(0.4)
    scene.close(number)
    scene.wait(0.4)
    assert ("resume" in scene.arm.orders) == answers


def let_skin_be_silent(scene):
    scene.clock.sleep(0.5)
    scene.policy.check_skin()


def unplug_for_a_second(scene):
    scene.silent_patches = tuple(patch.id for patch in SKIN.patches)
    scene.wait(1.0)
    scene.silent_patches = ()


def break_model_for_a_reading(scene):
    number = scene.begin(confidence=np.nan)
    scene.wait(0.1)
    scene.close(number)


def fail_once(scene):
    scene.arm.error = ArmError("lost")
    scene.touch("double_pat")
    scene.arm.error = None


def test_limits_of_before_load_and_are_told_to_say_nothing(caplog):
    config = PolicyConfig(min_duration=0.2, max_delay=1.0)
    assert config == PolicyConfig()
    assert len(caplog.records) == 1
    assert "min_duration, max_delay" in caplog.text
    assert SkinMonitorConfig(max_seconds=1.0) == SkinMonitorConfig()
    assert len(caplog.records) == 2 and "max_seconds" in caplog.text


def test_skin_that_never_becomes_quiet_is_told_once_with_its_patch():
    scene = make_paused_scene()
    scene.begin("none", force=1.0)
    scene.wait(30.0)
    told = [event.why for event in scene.events if "nothing starts" in event.why]
    assert len(told) == 1 and f"'{PATCH.id}'" in told[0]


@pytest.mark.parametrize("paused", [False, True])
@pytest.mark.parametrize(
    "cause",
    [let_skin_be_silent, unplug_for_a_second, break_model_for_a_reading, fail_once],
)
def test_two_pokes_end_every_hold_under_map_of_paper(cause, paused):
    scene = make_paused_scene(PAPER) if paused else Scene(PAPER)
    cause(scene)
    assert scene.arm.state().hold_reason is not None
    scene.wait(3.0)
    for _ in range(1 if paused else 2):
        assert scene.arm.state().stopped
        scene.touch("poke")
        scene.wait(1.0)
    assert not scene.arm.state().stopped


def test_failure_of_action_holds_arm_and_stops_stream():
    scene = Scene()
    scene.arm.error = RuntimeError("bug")
    number = scene.begin()
    scene.step()
    with pytest.raises(RuntimeError, match="bug"):
        scene.detect(number)
    assert "RuntimeError" in str(scene.arm.hold_reason)


def test_failure_of_thread_holds_arm_and_stops_stream():
    scene = Scene()
    policy = scene.policy = Policy(scene.arm, DEFAULT, VOCABULARY)
    scene.arm.state = lambda: 1 / 0
    policy.start(Context(INFO, scene.clock, scene.events.append))
    policy.thread.join(5)
    assert "ZeroDivisionError" in str(scene.arm.hold_reason)
    with pytest.raises(ZeroDivisionError):
        scene.step()
    policy.close()


def test_slow_skin_is_refused():
    scene = Scene()
    info = replace(INFO, rate=10.0)
    with pytest.raises(ArmError, match="10 readings a second.* 20 "):
        scene.policy.start(Context(info, scene.clock, scene.events.append))


def test_probability_that_is_not_finite_holds_the_arm_and_says_why():
    scene = Scene()
    scene.wait(0.2)
    scene.begin(confidence=float("nan"))
    scene.step()
    assert scene.accepted == ["hold"]
    assert "a probability is not finite" in scene.last_reason
    assert is_held_for(scene.arm, Problem.BROKEN_MODEL)
