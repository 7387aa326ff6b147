"""Tests of the choice of thresholds and of the table of the commanded arm."""

import numpy as np
import pytest

from eskin.sim.demo import (
    Attempt,
    CommandScore,
    DemoConfig,
    DemoResult,
    FaultStorm,
    SimulatedUserConfig,
    StormConfig,
    run_headless,
)
from eskin.sim.interactive import InteractiveSkin
from eskin.stream import CommandEvent
from lab.command_thresholds import (
    TouchTrace,
    choose,
    choose_duration,
    compute_wilson,
    read_traces,
    write_traces,
)
from lab.commanded_arm import ROWS, compute_interval, count_obeyed, format_result

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000


def trace(true, confidence, detected="grab", **changes):
    """Return the trace of a touch with one reading, detected at once, or with more."""
    known = {"grab": confidence, "poke": confidence, "none": 1.0 - confidence}
    known["double_pat"] = confidence
    values = {"true": true, "cause": 1, "detected": detected, "seconds": [0.1]}
    values["onset"] = 0.0
    values |= {"detected_at": 0.1} | changes
    count = len(values["seconds"])
    return TouchTrace(probabilities=[known] * count, contact=[True] * count, **values)


def test_threshold_separates_what_was_asked_for_from_what_was_not():
    traces = [*[trace("grab", 0.9)] * 50, *[trace("none", 0.6)] * 50]
    choice = choose("close_gripper", "grab", 1.0, 3.0, traces)
    assert (choice.threshold, choice.missed, choice.wrong) == (0.9, 0, 0)


def test_dear_error_raises_threshold_at_the_price_of_missed_touches():
    touches = [trace("grab", c) for c in np.linspace(0.5, 0.99, 40)]
    traces = [*touches, *[trace("none", 0.8)] * 3]
    cheap = choose("close_gripper", "grab", 1.0, 0.1, traces)
    dear = choose("close_gripper", "grab", 1.0, 50.0, traces)
    assert cheap.threshold < 0.8 < dear.threshold
    assert cheap.wrong == 3 and dear.wrong == 0 and dear.missed > cheap.missed


def test_duration_separates_bumps_from_touches_that_are_recognised_as_surely():
    touches = [trace("double_pat", 0.9, "double_pat", seconds=[0.0, 0.4])] * 50
    bumps = [trace("none", 0.95, "double_pat", seconds=[0.0, 0.2])] * 20
    duration = choose_duration([*touches, *bumps])
    assert 0.2 < duration <= 0.4
    briefer = choose("resume", "double_pat", 1.0, 20.0, [*touches, *bumps], duration)
    assert (briefer.missed, briefer.wrong) == (0, 0)
    stopping = [trace("poke", 0.9, "poke", seconds=[0.0, 0.1])] * 20
    assert choose("pause", "poke", 5.0, 1.0, stopping, duration).missed == 0


def test_stop_is_given_by_unknown_touches_and_counts_only_at_work():
    touches = [trace("poke", 0.4, "unknown")] * 20
    resting = [trace("none", 0.9, "unknown", works=False)] * 99
    choice = choose("pause", "poke", 5.0, 1.0, [*touches, *resting])
    assert choice.missed == 0 and choice.threshold <= 0.4 and choice.others == 0
    assert trace("grab", 0.9, "grab").final_stop("poke") == 0.0


def test_traces_are_read_as_they_were_written(tmp_path):
    traces = [trace("poke", 0.4), trace("none", 0.25, "")]
    write_traces(tmp_path / "traces.jsonl", traces)
    assert read_traces(tmp_path / "traces.jsonl") == traces


def test_interval_holds_share_and_shrinks_with_number():
    few, many = compute_wilson(9, 10), compute_wilson(900, 1000)
    assert few[0] < many[0] < 0.9 < many[1] < few[1]


def make_result(correct, missed):
    """Return the result of a build with so many touches."""
    score = CommandScore(
        attempts=[Attempt("grab", "open_gripper", 1, 2, k) for k in range(missed)]
    )
    for number in range(correct):
        attempt = Attempt("grab", "open_gripper", 1, 2, 100 + number)
        attempt.command = CommandEvent(3, "open_gripper", number, "grab", True, "")
        score.attempts.append(attempt)
    return DemoResult(score, 60.0, 6.0, 0, 1, (1.0, 2.0))


def test_row_counts_all_builds_and_interval_holds_their_share():
    parts = [make_result(9, 1), make_result(5, 5), make_result(10, 0)]
    share, low, high = compute_interval(parts, count_obeyed)
    assert share == pytest.approx(0.8) and low < 0.8 < high
    row = format_result("fresh", parts)
    assert "80.0%" in row and "90.0%" in row and row.count("|") == 13


def test_rows_are_of_all_conditions():
    kinds = {config.build_kind for config in ROWS.values()}
    assert {"fresh", "shifted", "divider", "capacitive"} <= kinds
    assert {config.arm_speed for config in ROWS.values()} == {0.5, 1.0, 1.5}


def test_storm_loses_scans_unplugs_patches_and_kills_taxels():
    skin = InteractiveSkin(loses=False)
    config = StormConfig(loss=0.2, unplug_period=1.0, unplug_seconds=0.5, dead=0.1)
    storm = FaultStorm(skin, config, seed=0)
    assert (skin.sensor.readout.sensitivity == 0).mean() == pytest.approx(0.1, abs=0.02)
    lost, unplugged = [], []
    for number in range(1, 150):
        stamp = number * SECOND // 50
        storm.update(stamp)
        scan = storm.corrupt(skin.scan(stamp, np.zeros(6)))
        assert not scan.counts[~scan.received].any()
        lost.append(1.0 - scan.received.mean())
        unplugged.append(skin.unplugged.any())
    assert np.mean(lost) > 0.1
    assert not any(unplugged[:45]) and any(unplugged) and not unplugged[80]


def test_storm_of_impossible_loss_is_refused():
    with pytest.raises(ValueError, match=r"loss is 1\.5"):
        FaultStorm(InteractiveSkin(), StormConfig(loss=1.5), 0)


def test_storm_commands_nothing_where_nobody_touches():
    user = SimulatedUserConfig(first=1000.0)
    storm = StormConfig(loss=0.05, unplug_period=4.0, unplug_seconds=1.0, dead=0.1)
    result = run_headless(12.0, DemoConfig(seed=5, user=user, storm=storm))
    assert result.score.commands == 0 and result.score.holds > 0
    assert 0.0 < result.availability < 1.0
