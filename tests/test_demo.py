"""The demonstration: what counts as obeyed, and that it is the same every time."""

import json

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.command import SimulatedArm, load_commands
from eskin.demo import (
    Attempt,
    CommandScore,
    DemoConfig,
    LiveSource,
    SimulatedUser,
    SimulatedUserConfig,
    run_headless,
)
from eskin.demo.browser import PageCommandHandler
from eskin.drivers import ManualClock
from eskin.page import PageOrder, TouchOrder
from eskin.sim.interactive import InteractiveSkin
from eskin.stream import CommandEvent

SECOND = 1_000_000_000
VOCABULARY = ("none", "double_pat", "grab", "poke", "stroke")


def told(seconds, action="pause", accepted=True, touch=1):
    return CommandEvent(round(seconds * SECOND), action, touch, "poke", accepted, "")


def tried(begin, end, wanted="pause"):
    return Attempt("poke", wanted, round(begin * SECOND), round(end * SECOND))


def scored(tries, commands):
    score = CommandScore(attempts=list(tries))
    for command in commands:
        score.add_command(command)
    return score


def test_a_command_within_a_second_of_its_touch_counts_for_it():
    score = scored([tried(1.0, 1.4)], [told(2.3)])
    assert (score.count("correct"), score.false_alarms) == (1, [])
    assert score.delays() == pytest.approx([0.9])


@pytest.mark.parametrize("when", [0.9, 2.5])
def test_a_command_at_another_time_is_one_that_nobody_gave(when):
    score = scored([tried(1.0, 1.4)], [told(when)])
    assert (score.count("missed"), len(score.false_alarms)) == (1, 1)


def test_another_command_than_was_wanted_is_wrong_and_a_second_one_false():
    score = scored([tried(1.0, 1.4)], [told(1.5, "slow"), told(1.6)])
    assert score.count("wrong") == 1
    assert [command.action for command in score.false_alarms] == ["pause"]


def test_what_was_refused_is_no_command_and_a_hold_is_not_one_either():
    commands = [told(1.5, accepted=False), told(1.6, "hold", touch=None)]
    score = scored([tried(1.0, 1.4)], commands)
    assert (score.commands, score.holds, score.count("missed")) == (0, 1, 1)
    assert len(score.attempts[0].refusals) == 1


def refused(why):
    return CommandEvent(round(1.5 * SECOND), "pause", 1, "poke", False, why)


@pytest.mark.parametrize(
    ("said", "commands", "why"),
    [
        (["poke"], [told(1.5)], ""),
        (["poke"], [refused("confidence 0.94 is below 0.95")], "confidence"),
        (["poke"], [refused("the arm is held: bump; pause it")], "the arm is held"),
        (["unknown"], [], "said to be unknown"),
        (["stroke"], [told(1.5, "slow")], "said to be stroke"),
        (["poke"], [told(1.5, "resume")], "the arm had changed meanwhile"),
        ([], [], "nothing was said"),
    ],
)
def test_a_touch_that_is_lost_has_a_reason(said, commands, why):
    score = scored([tried(1.0, 1.4)], commands)
    score.attempts[0].recognised += said
    assert score.attempts[0].failure == why
    assert score.count_failures() == ({why: 1} if why else {})


def test_nobody_touches_an_arm_that_has_just_been_paused():
    clock = ManualClock(SECOND)
    arm, skin = SimulatedArm(clock=clock), InteractiveSkin()
    config = SimulatedUserConfig(first=0.1)
    user = SimulatedUser(
        skin, arm, load_commands(None, VOCABULARY, skin.mounted.skin), 0, config
    )
    arm.pause()
    stamps = SECOND + np.arange(0, 2 * SECOND, SECOND // 50)
    begun = [user.update(int(s)) or bool(skin.hand.touching) for s in stamps]
    assert stamps[begun.index(True)] == 2 * SECOND


def test_a_touch_under_way_at_the_end_is_waited_for():
    whole = run_headless(10.0, DemoConfig(seed=3)).score.attempts[0]
    seconds = whole.begin / SECOND - 1.0 + 0.04
    (cut,) = run_headless(seconds, DemoConfig(seed=3)).score.attempts
    assert (cut.begin, cut.end, cut.recognised) == (
        whole.begin,
        whole.end,
        whole.recognised,
    )
    assert cut.outcome == whole.outcome


@pytest.mark.parametrize("pause", [("2", "1"), ("-1", "1"), ("1", "inf")])
def test_pauses_that_make_no_sense_are_refused_in_a_line(pause, capsys):
    assert run(["demo", "--headless", "--pause", *pause]) == 2
    assert "--pause is" in capsys.readouterr().err


def test_touches_and_commands_add_up_and_are_the_same_every_time():
    """The arm works, somebody touches it, on a clock that waits for nobody."""
    first, second = (run_headless(25.0, DemoConfig(seed=3)) for _ in range(2))
    score = first.score
    verdicts = [score.count(verdict) for verdict in ("correct", "wrong", "missed")]
    assert sum(verdicts) == len(score.attempts) > 2
    assert score.commands == verdicts[0] + verdicts[1] + len(score.false_alarms)
    key = [(t.gesture, t.expected, t.begin, t.end, t.outcome) for t in score.attempts]
    again = second.score.attempts
    assert key == [(t.gesture, t.expected, t.begin, t.end, t.outcome) for t in again]


def test_the_command_prints_what_the_contract_says(capsys):
    assert run(["demo", "--headless", "--seconds", "8", "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    wanted = {"touches", "correct", "wrong", "missed", "false_alarms", "commands"}
    assert wanted | {"step_ms_p50", "step_ms_p99"} <= set(told)


def test_where_nothing_was_obeyed_no_delay_is_told(capsys):
    assert run(["demo", "--headless", "--seconds", "1", "--json"]) == 0
    *_, said, told = capsys.readouterr().out.splitlines()
    assert said.startswith("no touch was obeyed in that time")
    assert (json.loads(told)["correct"], json.loads(told)["delay_s_p50"]) == (0, None)


def test_scans_come_period_by_period_where_the_arm_is():
    clock = ManualClock()
    with SimulatedArm(clock=clock) as arm:
        source = LiveSource(InteractiveSkin(), arm, clock)
        scans = [source.read() for _ in range(20)]
    stamps = [scan.stamp for scan in scans]
    assert (np.diff(stamps) == round(source.skin.period * SECOND)).all()
    for scan in scans:
        np.testing.assert_array_equal(scan.q, arm.q_at(scan.stamp))


def test_orders_of_the_page_touch_the_skin_and_pause_the_arm():
    clock = ManualClock()
    arm, skin, others = SimulatedArm(clock=clock), InteractiveSkin(), []
    handler = PageCommandHandler(skin, arm, others.append)
    taxel = int(skin.mounted.skin.find_taxels("forearm_front")[200])
    place = tuple(skin.mounted.skin.positions[taxel].tolist())
    handler.handle(TouchOrder("poke", "forearm_link", place, 5.0, 0.3, 1))
    assert len(skin.hand.touching) == 1
    handler.handle(TouchOrder("begin", "forearm_link", place, 3.0, 0.0, 2))
    handler.handle(TouchOrder("move", "forearm_link", place, 3.0, 0.0, 2))
    assert len(skin.hand.touching) == 2
    handler.handle(PageOrder("pause_task"))
    assert arm.state().paused
    handler.handle(PageOrder("resume_task"))
    assert not arm.state().paused
    handler.handle(PageOrder("unplug", "wrist_1"))
    scan = skin.scan(SECOND, arm.q_at(SECOND))
    assert not scan.received[skin.mounted.skin.find_taxels("wrist_1")].any()
    handler.handle(PageOrder("skin", "ur5-half"))
    assert [order.kind for order in others] == ["skin"]
