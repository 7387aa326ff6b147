"""Tests of the table of the commanded arm, and of storms of faults."""

import numpy as np
import pytest

from eskin.command import Trigger
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
from lab.commanded_arm import ROWS, compute_interval, format_result

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
DONE = Trigger.GESTURE.reason(gesture="grab", patch="p0")
"""Why a command was executed."""


def make_result(correct, missed):
    """Return the result of a build with so many touches."""
    score = CommandScore(
        attempts=[Attempt("grab", "open_gripper", 1, 2, k) for k in range(missed)]
    )
    for number in range(correct):
        attempt = Attempt("grab", "open_gripper", 1, 2, 100 + number)
        attempt.command = CommandEvent(3, "open_gripper", number, "grab", True, DONE)
        score.attempts.append(attempt)
    return DemoResult(score, 60.0, 6.0, 0, 1, (1.0, 2.0))


def test_row_counts_all_builds_and_interval_holds_their_share():
    parts = [make_result(9, 1), make_result(5, 5), make_result(10, 0)]
    share, low, high = compute_interval(
        np.array([[9.0, 10.0], [5.0, 10.0], [10.0, 10.0]])
    )
    assert share == pytest.approx(0.8) and low < 0.8 < high
    row = format_result("fresh", parts)
    assert "80.0%" in row and "90.0%" in row and row.count("|") == 15


def test_rows_are_of_all_conditions():
    kinds = {config.build_kind for config in ROWS.values()}
    assert {"fresh", "shifted", "divider", "capacitive"} <= kinds
    assert {config.arm_speed for config in ROWS.values()} == {0.5, 1.0, 1.5}


def test_storm_loses_scans_unplugs_patches_and_kills_taxels():
    skin = InteractiveSkin(loses=False)
    config = StormConfig(loss=0.2, unplug_period=1.0, unplug_seconds=0.5, dead=0.1)
    storm = FaultStorm(skin, config, seed=0)
    assert (skin.sensor.readout.sensitivity == 0).mean() == pytest.approx(0.1, abs=0.02)
    lost = []
    unplugged = []
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
