"""Tests of the demonstration: scores, simulated users, and its command."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from eskin.arms import SimulatedArm
from eskin.cli.main import run
from eskin.command import (
    ASK,
    SUSPEND,
    Policy,
    PolicyConfig,
    Question,
    Refusal,
    Trigger,
    load_commands,
)
from eskin.drivers import ManualClock
from eskin.live import Recognizer, load_model
from eskin.page import PageOrder, TouchOrder
from eskin.page.hand import USUAL
from eskin.recording import TruthRecord
from eskin.sim.commands.demo import open_once, tell_link
from eskin.sim.demo import (
    Attempt,
    CommandScore,
    DemoConfig,
    DemoResult,
    LiveSource,
    SimulatedUser,
    SimulatedUserConfig,
    TouchCauses,
    run_headless,
    summarise_score,
)
from eskin.sim.demo.browser import PageOrderHandler, SkinChoice
from eskin.sim.demo.headless import SynchronousStream
from eskin.sim.demo.live_source import AHEAD, WaitingClock
from eskin.sim.demo.simulated_user import FORGOT, MISTOOK
from eskin.sim.interactive import InteractiveSkin
from eskin.stream import CommandEvent, Recognition
from helpers.commands import HELD, PAPER, make_map

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
VOCABULARY = ("none", "double_pat", "grab", "poke", "stroke")


GESTURE = Trigger.GESTURE.reason(gesture="poke", patch="p0")


def command(seconds, action="pause", accepted=True, touch=1, reason=GESTURE):
    gesture = None if touch is None or action == SUSPEND else "poke"
    stamp = round(seconds * SECOND)
    return CommandEvent(stamp, action, touch, gesture, accepted, reason)


def score_commands(*commands):
    """Return the score of commands after a poke from 1.0 to 1.4 s that is to pause.

    Tracked touch 1 is the poke, 2 an accident at the same time, 3 nobody's.
    """
    end = round(1.4 * SECOND)
    attempt = Attempt("poke", "pause", SECOND, end, number=10)
    accident = Attempt("none", "none", SECOND, end, number=20)
    score = CommandScore(attempts=[attempt], accidents=[accident])
    score.causes.readings = {1: Counter({10: 5, 20: 1}), 2: Counter({20: 3})}
    for each in commands:
        score.add_command(each)
    return score


@pytest.mark.parametrize(
    ("commands", "outcome", "alarms", "by_faults"),
    [
        ([command(2.3)], "correct", [], 0),
        ([command(2.5)], "missed", ["pause"], 0),
        ([command(1.5, touch=2)], "missed", ["pause"], 0),
        ([command(1.5, touch=3)], "missed", ["pause"], 1),
        ([command(1.5, "slow"), command(1.6)], "wrong", ["pause"], 0),
        ([command(1.5, accepted=False)], "missed", [], 0),
        ([command(1.6, "hold", touch=None)], "missed", [], 0),
    ],
)
def test_command_counts_for_the_touch_that_caused_it_within_a_second(
    commands, outcome, alarms, by_faults
):
    score = score_commands(*commands)
    assert score.count(outcome) == 1
    assert [alarm.action for alarm in score.false_alarms] == alarms
    assert score.count_unasked()["unasked_stops"] == len(alarms)
    assert len(score.by_faults) == by_faults
    assert score.holds == sum(each.action == "hold" for each in commands)
    refused = sum(not each.accepted for each in commands)
    assert len(score.attempts[0].refusals) == refused
    assert score.delays() == pytest.approx([0.9] if outcome == "correct" else [])


def test_commands_that_go_on_are_counted_apart():
    actions = ["pause", "resume", "slow", "next_waypoint"]
    score = score_commands(*(command(1.5, action, touch=3) for action in actions))
    counts = summarise_score(score)
    assert (counts["commands_of_faults"], counts["going_on_by_faults"]) == (4, 2)
    assert (counts["unasked_stops"], counts["unasked_slow"]) == (1, 1)


def test_stop_is_timed_from_first_contact_to_first_wait():
    score = score_commands(command(1.1, SUSPEND), command(1.5))
    assert score.stop_delays() == pytest.approx([0.1]) and score.commands == 1


def score_answer(*commands, works=True):
    """Return the score of a grab from 1.0 to 1.4 s that asks, answered by a poke.

    Tracked touch 1 is the grab, 2 its answer from 2.2 to 2.5 s.
    """
    end = round(2.5 * SECOND)
    attempt = Attempt("grab", "normal", SECOND, end, 10, works, answer=11)
    score = CommandScore(attempts=[attempt])
    score.causes.readings = {1: Counter({10: 5}), 2: Counter({11: 5})}
    for each in (command(1.8, ASK), *commands):
        score.add_command(each)
    return score


def test_touch_and_the_answer_to_its_question_are_one_attempt():
    score = score_answer(command(2.9, "normal"))
    counts = summarise_score(score)
    assert (counts["correct"], counts["commands"]) == (1, 1)
    assert (counts["questions"], counts["answered"]) == (1, 1)
    assert score.delays() == pytest.approx([0.4])


@pytest.mark.parametrize(
    ("works", "outcome", "commands"), [(True, "wrong", 1), (False, "missed", 0)]
)
def test_failed_answer_counts_if_it_stops_an_arm_at_work(works, outcome, commands):
    unclear = Refusal.UNCLEAR_ANSWER.reason(answer="poke", chance=0.4, again=5.0)
    refusal = command(2.9, "normal", False, reason=unclear)
    score = score_answer(refusal, command(2.9, "pause", touch=2), works=works)
    assert score.count(outcome) == 1 and score.commands == commands
    assert (score.asked, score.answered) == (1, 0) and not score.false_alarms
    assert score.count_failures() == {"unclear answer": 1}


def test_mistakes_of_people_are_reasons_of_their_own():
    refusal = Refusal.NO_ANSWER.reason(answer="poke", again=5.0)
    score = score_answer(command(2.9, "normal", False, reason=refusal))
    score.attempts[0].mistake = FORGOT
    assert score.count_failures() == {FORGOT: 1}


def test_touch_is_caused_by_nearest_simulated_one():
    causes = TouchCauses()
    for stamp, x in ((1, 0.0), (2, 0.0), (3, 0.5)):
        causes.felt = {
            7: TruthRecord(stamp, 7, "poke", "", "", 1.0, 1.0, (0.05, 0.0, 0.0)),
            8: TruthRecord(stamp, 8, "grab", "", "", 1.0, 1.0, (0.5, 0.0, 0.0)),
        }
        causes.add_reading(4, np.array([x, 0.0, 0.0]))
        causes.add_reading(5, np.array([0.25, 0.0, 0.0]))
    assert (causes.find(4), causes.find(5), causes.find(6)) == (7, None, None)


OLD = Refusal.FELT_LONG_AGO.reason(milliseconds=120.0)


@pytest.mark.parametrize(
    ("recognised", "commands", "failure"),
    [
        (["poke"], [command(1.5)], ""),
        (["poke"], [command(1.5, accepted=False, reason=OLD)], "felt long ago"),
        (["unknown"], [], "said to be unknown"),
        (["stroke"], [command(1.5, "slow")], "said to be stroke"),
        (["poke"], [command(1.5, "resume")], "the arm had changed meanwhile"),
        ([], [], "nothing was said"),
    ],
)
def test_failed_attempt_has_reason(recognised, commands, failure):
    score = score_commands(*commands)
    score.attempts[0].recognised += recognised
    assert score.attempts[0].failure == failure
    assert score.count_failures() == ({failure: 1} if failure else {})


def test_user_leaves_paused_arm_alone_for_second():
    arm = SimulatedArm(clock=ManualClock(SECOND))
    skin = InteractiveSkin()
    commands = load_commands(None, VOCABULARY, skin.mounted.skin)
    user = SimulatedUser(skin, arm, commands, 0, SimulatedUserConfig(first=0.1))
    arm.pause()
    stamps = SECOND + np.arange(0, 2 * SECOND, SECOND // 50)
    touching = [user.update(int(s)) or bool(skin.hand.touching) for s in stamps]
    assert stamps[touching.index(True)] == 2 * SECOND


ASKED_AT = 2 * SECOND


def answer_question(seed):
    """Return what a user makes of a question, and when they begin to: both or none.

    The arm asks because of a grab, and its question is over after a second.
    """
    arm = SimulatedArm(clock=ManualClock(SECOND))
    skin = InteractiveSkin()
    commands = load_commands(None, VOCABULARY, skin.mounted.skin)
    question = Mock(Question, answer="poke", asked_at=ASKED_AT)
    asked: list[Question | None] = [question]
    user = SimulatedUser(skin, arm, commands, seed, question=lambda: asked[0])
    user.strongest = TruthRecord(
        0, 0, "grab", "", "forearm_link", 1.0, 1.0, (0.3, 0.0, 0.3)
    )
    user.attempt = Attempt("grab", "resume", SECOND, ASKED_AT, asked=ASKED_AT)
    user.asks = True
    user.active = False
    attempt = user.attempt
    for stamp in range(ASKED_AT, 4 * SECOND, SECOND // 50):
        asked[0] = question if stamp < ASKED_AT + SECOND else None
        user.update(stamp)
        if skin.hand.touching:
            (touch,) = skin.hand.active.values()
            return attempt.mistake, touch.touch.gesture, stamp
    assert user.attempt is None and user.has_failed
    return attempt.mistake, "", None


def test_people_answer_in_time_and_a_few_forget_or_make_another_gesture():
    found = [answer_question(seed) for seed in range(120)]
    delays = [(s - ASKED_AT) / SECOND for _, _, s in found if s is not None]
    assert 0.35 <= min(delays) < 0.4 and 0.75 < max(delays) <= 0.82
    by_mistake = {mistake: set() for mistake, _, _ in found}
    for mistake, gesture, _ in found:
        by_mistake[mistake].add(gesture)
    assert by_mistake[""] == {"poke"} and by_mistake[FORGOT] == {""}
    assert by_mistake[MISTOOK] <= {"double_pat", "grab", "stroke", "none"}
    mistakes = sum(bool(mistake) for mistake, _, _ in found)
    assert 3 <= mistakes <= 24


def test_user_leaves_stopped_arm_alone_for_five_seconds_after_failed_question():
    arm = SimulatedArm(clock=ManualClock(SECOND))
    skin = InteractiveSkin()
    commands = load_commands(None, VOCABULARY, skin.mounted.skin)
    asked = [Mock(Question)]
    config = SimulatedUserConfig(first=0.1)
    user = SimulatedUser(skin, arm, commands, 0, config, lambda: asked[0])
    arm.pause()
    user.update(SECOND)
    asked[0] = None
    stamps = range(SECOND + SECOND // 50, 9 * SECOND, SECOND // 50)
    touching = [user.update(stamp) or bool(skin.hand.touching) for stamp in stamps]
    assert stamps[touching.index(True)] == 6 * SECOND + SECOND // 50


@pytest.mark.parametrize(("failed", "gestures"), [(True, 3), (False, 4)])
def test_nobody_asks_a_working_arm_for_more_after_a_failed_question(failed, gestures):
    arm = SimulatedArm(clock=ManualClock(SECOND))
    commands = load_commands(None, VOCABULARY, InteractiveSkin().mounted.skin)
    user = SimulatedUser(InteractiveSkin(), arm, commands, config=EAGER)
    user.has_failed = failed
    made = {user.choose_gesture(arm.state()) for _ in range(60)}
    assert len(made) == gestures and ("grab" in made) != failed


CONFIG = DemoConfig(seed=3, user=SimulatedUserConfig(first=1.0, accidents=0.1))


def choose_gestures(commands, arm):
    """Return the gestures of 40 touches of an arm in its present state."""
    user = SimulatedUser(InteractiveSkin(), arm, commands, config=EAGER)
    return {user.choose_gesture(arm.state()) for _ in range(40)}


EAGER = SimulatedUserConfig(accidents=0.0)


def test_people_make_gestures_for_which_the_map_has_a_rule():
    arm = SimulatedArm(clock=ManualClock(SECOND))
    assert choose_gestures(PAPER, arm) == {"poke", "double_pat", "grab"}
    arm.pause()
    assert choose_gestures(PAPER, arm) == {"poke", "double_pat", "grab"}
    arm.hold(HELD)
    assert choose_gestures(PAPER, arm) == {"poke"}
    arm.resume()
    assert choose_gestures(PAPER, arm) == {"poke"}


def test_people_press_the_button_where_no_gesture_ends_a_stop():
    clock = ManualClock(SECOND)
    arm = SimulatedArm(clock=clock)
    skin = InteractiveSkin()
    user = SimulatedUser(skin, arm, make_map(poke="pause"), config=EAGER)
    user.next_touch = SECOND
    arm.pause()
    arm.hold(HELD)
    for _ in range(60):
        clock.sleep(0.02)
        user.update(clock.now())
    assert not arm.state().stopped and not skin.hand.touching


def test_arm_is_commanded_by_map_of_paper():
    config = replace(CONFIG, commands=Path("paper"))
    score = run_headless(10.0, config).score
    done = {attempt.gesture for attempt in score.attempts}
    asked = {attempt.expected for attempt in score.attempts}
    assert "stroke" not in done and {"pause", "resume"} <= asked
    assert score.count("correct") > len(score.attempts) // 2


def test_demonstration_adds_up_repeats_and_waits_for_last_touch():
    score = run_headless(6.0, CONFIG).score
    counts = [score.count(outcome) for outcome in ("correct", "wrong", "missed")]
    assert sum(counts) == len(score.attempts) > 1 and counts[0] > 0
    assert score.commands == counts[0] + counts[1] + len(score.false_alarms)
    first = score.attempts[0]
    seconds = first.begin / SECOND - 1.0 + 0.04
    (same,) = run_headless(seconds, CONFIG).score.attempts
    assert same == first and same.begin < same.end


def test_demo_command_prints_result(monkeypatch, capsys):
    result = DemoResult(score_commands(command(2.3)), 8.0, 0.0, 0, 2, (3.0, 4.0))
    monkeypatch.setattr("eskin.sim.demo.run_headless", lambda seconds, config: result)
    assert run(["demo", "--headless", "--json"]) == 0
    out = capsys.readouterr().out
    printed = json.loads(out.splitlines()[-1])
    keys = {"touches", "correct", "wrong", "missed", "false_alarms", "commands"}
    assert keys | {"step_ms_p50", "step_ms_p99"} <= set(printed)
    assert printed["delay_s_p50"] == pytest.approx(0.9) and "p50 0.90 s" in out


@pytest.mark.parametrize(("at_screen", "opened"), [(True, 1), (False, 0)])
def test_demo_opens_its_link_once_where_a_person_sees_it(
    monkeypatch, capsys, at_screen, opened
):
    links = []
    monkeypatch.setattr("webbrowser.open", links.append)
    monkeypatch.setattr("sys.stdout.isatty", lambda: at_screen)
    monkeypatch.setenv("DISPLAY", ":0")
    open_once.cache_clear()
    for _ in range(2):
        tell_link("http://127.0.0.1:8080/token/")
    assert "http://127.0.0.1:8080/token/" in capsys.readouterr().out.splitlines()
    assert links == ["http://127.0.0.1:8080/token/"] * opened


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ("--headless --pause 2 1", "--pause is 2 1"),
        ("--headless --pause -1 1", "--pause is -1 1"),
        ("--headless --pause 1 inf", "--pause is 1 inf"),
        ("--headless --seconds 0", "--seconds is 0"),
    ],
)
def test_invalid_option_is_refused_in_one_line(words, part, capsys):
    assert run(["demo", *words.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert part in line


def test_orders_of_page_touch_skin_and_pause_arm():
    arm = SimulatedArm(clock=ManualClock())
    skin = InteractiveSkin()
    choice = SkinChoice()
    handler = PageOrderHandler(skin, arm, choice=choice)
    taxel = int(skin.mounted.skin.find_taxels("forearm_front")[200])
    place = tuple(skin.mounted.skin.positions[taxel].tolist())
    handler.handle(TouchOrder("poke", "forearm_link", place, 5.0, 0.3, 1))
    assert len(skin.hand.touching) == 1
    handler.handle(TouchOrder("begin", "forearm_link", place, 3.0, 0.0, 2))
    handler.handle(TouchOrder("move", "forearm_link", place, 3.0, 0.0, 2))
    assert len(skin.hand.touching) == 2
    arm.hold(HELD)
    for kind in ("resume_task", "pause_task", "resume_task"):
        handler.handle(PageOrder(kind))
        assert arm.state().stopped == (kind == "pause_task")
    handler.handle(PageOrder("unplug", "wrist_1"))
    scan = skin.scan(SECOND, arm.q_at(SECOND))
    assert not scan.received[skin.mounted.skin.find_taxels("wrist_1")].any()
    handler.handle(PageOrder("skin", "ur5-half"))
    assert choice.skin == "ur5-half"


def test_clicks_of_page_play_task_of_the_paper():
    clock = ManualClock(SECOND)
    arm = SimulatedArm(clock=clock)
    skin = InteractiveSkin("ur5", 1, "flawless", loses=False)
    model = load_model("ur5")
    vocabulary = model.card.vocabulary
    policy = Policy(arm, PAPER, vocabulary, PolicyConfig(check_period=None))
    recognition = Recognition(Recognizer(model, skin.mounted, skin.calibration))
    source = LiveSource(skin, arm, clock)
    stream = SynchronousStream(source, [recognition, policy])
    handler = PageOrderHandler(skin, arm)
    taxel = int(skin.mounted.skin.find_taxels("forearm_front")[200])
    place = tuple(skin.mounted.skin.positions[taxel].tolist())

    def click(kind):
        order = TouchOrder(kind, "forearm_link", place, *USUAL[kind], 1)
        handler.handle(order)
        for _ in range(round(3.0 / skin.period)):
            stream.publish(source.read())
        return arm.state()

    assert click("poke").paused
    grip = arm.state().gripper
    target = arm.state().target
    assert click("grab").gripper != grip
    assert click("grab").gripper == grip
    assert click("double_pat").target != target
    assert arm.state().paused
    assert not click("poke").paused
    assert click("poke").paused


def test_simulated_time_waits_for_readings_that_are_processed_too_slowly():
    host = ManualClock(SECOND)
    processed = [SECOND]
    clock = WaitingClock(host)
    clock.latest = lambda: processed[0]
    host.sleep(0.1)
    assert clock.now() == host.now()
    host.sleep(30.0)
    assert clock.now() == SECOND + round(AHEAD * SECOND) == clock.now()
    processed[0] += SECOND // 10
    host.sleep(0.05)
    assert clock.now() == SECOND + round((AHEAD + 0.05) * SECOND)


def test_flawless_build_is_a_fresh_one_without_defects():
    skins = [InteractiveSkin("ur5", 4, kind) for kind in ("flawless", "fresh")]
    flawless, fresh = (skin.build.defects for skin in skins)
    assert not flawless.dead.any() and np.isnan(flawless.stuck).all()
    assert fresh.dead.any() or np.isfinite(fresh.stuck).any()
    assert np.ptp(skins[0].build.velostat.gain) > 0


def test_arm_is_offered_to_go_on_after_patch_is_back_and_taxels_are_restored():
    clock = ManualClock(SECOND)
    events = []
    arm = SimulatedArm(clock=clock)
    skin = InteractiveSkin("ur5", 1, loses=False)
    model = load_model("ur5")
    vocabulary = model.card.vocabulary
    commands = load_commands(None, vocabulary, skin.mounted.skin)
    policy = Policy(arm, commands, vocabulary, PolicyConfig(check_period=None))
    recognizer = Recognizer(model, skin.mounted, skin.calibration)
    source = LiveSource(skin, arm, clock)
    stream = SynchronousStream(source, [Recognition(recognizer), policy])
    policy.context = replace(policy.context, publish=events.append)

    def wait(seconds):
        for _ in range(round(seconds / skin.period)):
            stream.publish(source.read())

    wait(4.0)
    skin.unplug("forearm_front")
    wait(2.0)
    assert "forearm_front" in str(arm.state().hold_reason)
    skin.plug("forearm_front")
    skin.kill(0.1)
    wait(10.0)
    skin.restore()
    wait(10.0)
    assert [event.action for event in events] == ["slow", "hold", "resume"]
    assert "poke or double pat, 1 s later grab" in events[-1].why
    assert not events[-1].accepted
    touches = policy.touches
    assert touches.latest - touches.last_contact > SECOND
    assert policy.monitor.find_problem(touches.latest) is None
    assert touches.find_lasting() is None
