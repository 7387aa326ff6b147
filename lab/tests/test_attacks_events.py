"""Tests of `lab.attacks.events`: what counts as a start, and worlds that command."""

import pytest

from lab.attacks.event_worlds import WORLDS
from lab.attacks.events import (
    Command,
    Stage,
    count_told,
    require,
    simulate_build,
)

TOUCH = {"chances": {"grab": 0.96}, "longest": 0.7, "seconds": 0.9} | {
    "detections": [["grab", 0.9, 0.5]],
    "plausible": True,
    "merged": False,
}


def test_rule_needs_gesture_probability_and_features():
    assert require("grab", 0.95, longest=0.6)(TOUCH)
    assert not require("grab", 0.97)(TOUCH)
    assert not require("grab", 0.95, longest=0.8)(TOUCH)
    assert not require("grab", 0.95, said=0.95)(TOUCH)
    assert not require("poke", 0.0)(TOUCH)


def test_only_accepted_decisions_count():
    one = ["resume", "grab", True, ""]
    refused = ["resume", "grab", False, "too soon"]
    none = {"paused": [refused], "slow": [], "working": [["wait", None, True, ""]]}
    lines = [{"decided": none}, {"decided": none | {"paused": [one]}}]
    assert count_told(lines) == [1, 0, 0, 2]


def test_rows_that_were_kept_are_not_simulated_again():
    done = [{"row": row, "build": 7, "kind": "fresh"} for row in WORLDS]
    assert simulate_build(Command(), "fresh", 7, done, None) == done


@pytest.mark.slow
def test_grabs_command_three_arms_and_things_that_bounce_none():
    stage = Stage(Command(), "fresh", 40000)
    grabs = list(stage.run_row("grab", 3))
    assert min(count_told(grabs)[:3]) > 0
    assert count_told(list(stage.run_row("bounce", 6)))[:3] == [0, 0, 0]
