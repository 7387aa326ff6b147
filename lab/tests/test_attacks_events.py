"""Tests of `lab.attacks.events`: its counts, its draws, and what it keeps."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.command import PolicyConfig, QuestionConfig
from eskin.live import load_model
from eskin.sim.interactive.skin import draw_demo_person
from lab.attacks.event_draws import EventDraw
from lab.attacks.event_stage import Setup, Stage
from lab.attacks.event_streams import MIXES, STREAMS
from lab.attacks.events import (
    GROUPS,
    WORLDS,
    Command,
    count_told,
    format_share,
    get_build,
    replay_lines,
    select_rows,
    simulate_build,
)

NOTHING = {"paused": [], "slow": [], "working": []}
RESUMED = ["resume", "grab", True, "", 1.0]


@pytest.fixture(scope="module")
def setup():
    return Setup(load_model("ur5"), None, PolicyConfig(check_period=None))


@pytest.fixture(scope="module")
def stage(setup):
    return Stage("fresh", 40000, setup)


def draw_event(stage, row, seed):
    rng = np.random.default_rng(seed)
    person = draw_demo_person(stage.skin.env, seed)
    return WORLDS[row](EventDraw(stage.skin, stage.q, person, rng))


def test_only_accepted_decisions_of_touches_count():
    refused = ["resume", "grab", False, "too soon", 1.0]
    by_itself = ["normal", None, True, "no longer out", 1.0]
    waits = ["wait", None, True, "", 1.0]
    asks = ["ask", "grab", True, "", 1.0]
    quiet = {"paused": [refused, asks], "slow": [by_itself], "working": [waits]}
    lines = [{"decided": quiet}, {"decided": quiet | {"paused": [RESUMED]}}]
    assert count_told(lines) == [1, 1, 0, 0, 1, 2]
    assert count_told([]) == [0, 0, 0, 0, 0, 0]


def test_interval_of_no_start_in_2000_reaches_to_two_in_thousand():
    assert format_share(0, 2000) == "0 (0.00 to 0.18 %)"


def test_rows_and_groups_are_selected_by_name():
    chosen = Command(only=("mixes", "bounce"), events=3)
    rows = [row for row, _, _ in select_rows(chosen)]
    assert rows == ["bounce", "bounce, again", *MIXES]
    assert {events for *_, events in select_rows(chosen)} == {3}


def test_default_catalogue_has_about_3000_events_of_things_and_unmeant_people():
    counted = {
        name: len(Command.kinds) * group.events * len(group.worlds)
        for name, group in GROUPS.items()
    }
    assert counted["single"] >= 2000
    assert 3000 <= counted["single"] + counted["streams"] + counted["mixes"] <= 3300


@pytest.mark.parametrize("row", WORLDS)
def test_every_event_presses_or_disturbs_where_it_takes_place(stage, row):
    event = draw_event(stage, row, 3)
    assert event.sites
    pressed = [press.force.max() > 0 for press in event.presses]
    disturbed = [pulses.level.max() > 0 for pulses in event.pulses]
    assert pressed + disturbed and all(pressed + disturbed)
    for press in event.presses:
        assert press.steps == len(press.centre) == len(press.angle)
        assert np.isfinite(press.force).all() and press.force.min() >= 0
        assert press.first >= 0 and press.force.max() < 1000


@pytest.mark.parametrize("row", [*STREAMS, *MIXES])
def test_streams_and_mixes_last_for_twelve_seconds_and_longer(stage, row):
    assert all(draw_event(stage, row, seed).seconds >= 12.0 for seed in range(8))


def test_event_that_is_drawn_again_is_the_same(stage):
    first, second = (draw_event(stage, "things wrap, hands tap", 7) for _ in range(2))
    assert len(first.presses) == len(second.presses)
    for one, other in zip(first.presses, second.presses, strict=True):
        assert one.first == other.first and np.array_equal(one.force, other.force)


def test_builds_of_two_kinds_have_events_of_their_own(setup, stage):
    other = Stage("shifted", 40000, setup)
    drawn = [one.build_rng("poke").random() for one in (stage, stage, other)]
    assert drawn[0] == drawn[1] != drawn[2]


def test_later_event_is_the_same_event(stage):
    event = draw_event(stage, "strap pulled tight", 1)
    later = event.delay(2.0)
    assert later.steps == event.steps + 200
    assert [one.first for one in later.presses] == [200]


def test_rows_that_were_kept_are_not_simulated_again(setup):
    done = [{"row": row, "kind": "fresh", "build": 7} for row in WORLDS]
    assert simulate_build(Command(), setup, ("fresh", 7), done, None) == done


def test_policies_decide_of_kept_events_what_they_decided(setup, stage):
    told = [
        line | {"row": row, "kind": "fresh", "build": 40000}
        for row in ("grab", "vibration at 0.5 to 5 Hz", "temperature step of a patch")
        for line in stage.run_row(row, WORLDS[row], 3, True)
    ]
    assert replay_lines(told, setup) == told
    assert any(line["decided"]["paused"] for line in told)
    assert {get_build(line) for line in told} == {("fresh", 40000)}


def test_policies_with_other_numbers_decide_otherwise_of_kept_events(setup, stage):
    told = [
        line | {"row": "grab", "kind": "fresh", "build": 40000}
        for line in stage.run_row("grab", WORLDS["grab"], 3, True)
    ]
    assert count_told(told)[0] > 0
    config = replace(setup.config, question=QuestionConfig(quiet=100.0))
    assert count_told(replay_lines(told, replace(setup, config=config)))[0] == 0


@pytest.mark.slow
def test_grabs_ask_and_things_that_bounce_do_not(stage):
    grabs = list(stage.run_row("grab", WORLDS["grab"], 3, False))
    bounces = list(stage.run_row("bounce", WORLDS["bounce"], 6, False))
    assert count_told(grabs)[0] > 0
    assert count_told(grabs)[1:5] == [0, 0, 0, 0]
    assert count_told(bounces)[:5] == [0, 0, 0, 0, 0]
