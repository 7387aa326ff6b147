"""A person plays without end, and nobody notices where stretches meet."""

import itertools

import numpy as np
import pytest

from eskin.sim.dataset import Simulator
from eskin.sim.interactive import TouchPlayer
from eskin.sim.interactive.player import LEAD_SECONDS, STRETCH_SECONDS
from eskin.touch import Calibrator, ContactConfig
from helpers.simulation import StandIn

RATE = 50
READINGS = round(RATE * STRETCH_SECONDS)
LED = round(RATE * LEAD_SECONDS)


@pytest.fixture(scope="module")
def simulator():
    return Simulator("ur5")


def played(maker, count, seed=0):
    return list(
        itertools.islice(TouchPlayer(maker, seed, start=5).sampled_scans(), count)
    )


def test_stamps_are_those_of_one_stream():
    moments = played(StandIn("small"), LED + 3 * READINGS)
    stamps = np.array([moment.scan.stamp for moment in moments])
    assert stamps[0] == 5
    assert (np.diff(stamps) == 1_000_000_000 // RATE).all()


def test_a_seed_plays_the_same_every_time_and_another_something_else():
    once, again, other = (
        np.array([moment.scan.counts for moment in played(StandIn("small"), 900, seed)])
        for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(once, again)
    assert (once != other).any()


def test_touches_are_numbered_through_and_pressed_where_they_are_said():
    moments = played(StandIn("small"), LED + 2 * READINGS)
    numbers = [truth.touch for moment in moments for truth in moment.truths]
    assert numbers == sorted(numbers)
    assert set(numbers) == set(range(numbers[-1] + 1))
    for moment in moments:
        pressed = (moment.scan.counts[moment.scan.received] > 500).any()
        assert not pressed or moment.truths
        assert all(truth.stamp == moment.scan.stamp for truth in moment.truths)


def test_person_and_build_are_of_no_set():
    player = TouchPlayer(StandIn("small"), 7)
    plan = player.plan_stretch(1)
    names = {plan.person.name, plan.build.name, plan.session.name, plan.set_name}
    assert all(name.startswith("device") for name in names)
    assert plan.build.kind == "fresh"
    assert plan.seed != player.plan_stretch(2).seed
    assert (plan.person, plan.build, plan.session, plan.pose) == (
        *(player.plan_stretch(2).person, player.plan_stretch(2).build),
        *(player.plan_stretch(2).session, player.plan_stretch(2).pose),
    )


def test_no_contact_is_made_where_stretches_meet(simulator):
    player = TouchPlayer(simulator)
    calibrator = Calibrator(simulator.mounted.skin, simulator.calibration(player.build))
    moments = played(simulator, LED + 3 * READINGS)
    nearby = RATE // 2
    peaks, poses = [], set()
    for number, moment in enumerate(moments):
        reading = calibrator.push(moment.scan)
        poses.add(tuple(moment.scan.q))
        place = (number - LED + nearby) % READINGS
        if number > LED + nearby and place < 2 * nearby:
            assert not moment.truths
            peaks.append(reading.pressure[reading.valid].max())
    assert len(peaks) > 2 * nearby
    assert max(peaks) < ContactConfig().on
    assert len(poses) == 1
    assert any(moment.truths for moment in moments)


def test_a_seed_below_zero_is_refused():
    with pytest.raises(ValueError, match="seed is -1"):
        TouchPlayer(StandIn("small"), -1)
