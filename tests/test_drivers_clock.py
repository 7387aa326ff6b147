"""Tests of `DeviceClock`: the age of packets on one-way links and with echoes."""

import numpy as np
import pytest

from eskin.drivers.clock_sync import DeviceClock
from helpers.touch import SECOND, START

MS = SECOND // 1000
PERIOD = 20 * MS
TRAVEL = 2 * MS
BELIEVED = 250e-6
"""Growth of a delay that is believed to be drift of a one-way clock."""


class ClockRun:
    """A device whose packets and echoes are delayed, and what the host believes.

    Attributes:
        lags: how much later than it was made a packet is believed to be made [ns],
            for those that are used, by when they were made [s].
        doubts: doubts by when packets arrived [s].
    """

    def __init__(self, error=0.0, **options):
        self.error = error
        self.clock = DeviceClock(**options)
        self.lags = {}
        self.doubts = {}
        self.problems = {}
        self.count = self.boot = self.content = 0

    def read_clock(self, time):
        return round((time - self.boot) * (1 + self.error) * 1e6) % 2**32

    def send(self, begin, end, delay=lambda time: 0.0, echoes=None, rate=50):
        """Send from begin to end [s], with echoes that come after a delay [s]."""
        arrivals = []
        for n in range(round((end - begin) * rate)):
            time = begin + n / rate
            arrivals.append((time + delay(time), 0, time, self.count))
            self.count += 1
            if echoes is not None and n % 50 == 0:
                arrivals.append((time + echoes(time), 1, time, 0))
        for after, is_echo, time, scan in sorted(arrivals):
            made = START + round(time * SECOND)
            arrived = START + round(after * SECOND) + TRAVEL
            device_time = self.read_clock(time)
            if is_echo:
                self.clock.push_echo(device_time, made - TRAVEL, arrived)
            else:
                self.receive(device_time, scan, arrived, made, time)
        return self

    def receive(self, device_time, scan, arrived, made, time):
        found = self.clock.find_scan_time(
            device_time, scan % 2**16, arrived, self.content
        )
        after = (arrived - START) / SECOND
        self.doubts[after] = self.clock.doubt
        self.problems[after] = self.clock.problem
        if found is not None and self.clock.doubt is None:
            assert found.stamp <= arrived
            self.lags[time] = found.stamp - made

    def largest_lag(self, begin=1.0):
        return max(lag for time, lag in self.lags.items() if time >= begin)

    def used(self, begin, end):
        """Return the share of packets made between two times [s] that is used."""
        count = sum(begin <= time < end for time in self.lags)
        return count / round((end - begin) * 50)

    def said(self, begin):
        """Return how long after a time [s] a problem was known first [s]."""
        return next(
            time - begin
            for time, problem in sorted(self.problems.items())
            if time >= begin and problem is not None
        )


@pytest.mark.parametrize("error", [-0.01, -50e-6, 0.01])
def test_echoes_tell_age_within_round_trip(error):
    rng = np.random.default_rng(0)
    run = ClockRun(error)
    run.send(0, 60, lambda time: rng.exponential(0.01), lambda time: 0.001)
    assert run.used(1, 60) == 1
    late = [lag for time, lag in run.lags.items() if time > 5]
    assert -5 * MS < min(late) and max(late) < 5 * MS
    assert run.clock.drift == pytest.approx(-error, abs=3e-4)


@pytest.mark.parametrize("seed", range(3))
def test_delayed_echoes_never_make_old_data_look_new(seed):
    rng = np.random.default_rng(seed)
    run = ClockRun(0.01).send(0, 20, echoes=lambda time: 0.001)

    def delay(time):
        return 0.01 * (time - 20)

    run.send(20, 80, delay, lambda time: rng.uniform(0, 2 * delay(time)))
    assert run.largest_lag() < 50 * MS


def test_some_delayed_echoes_cost_nothing():
    rng = np.random.default_rng(0)
    run = ClockRun(0.01).send(0, 5, echoes=lambda time: 0.001)
    run.send(5, 60, echoes=lambda time: rng.choice([0.001, 0.5]))
    assert run.used(1, 60) == 1 and run.largest_lag() < 5 * MS


def test_data_is_not_used_before_the_first_echo():
    assert ClockRun(expects_echoes=True).send(0, 3).used(0, 3) == 0


def test_data_looks_older_the_longer_no_echo_comes():
    run = ClockRun(0.01).send(0, 20, echoes=lambda time: 0.001)
    run.send(20, 620, lambda time: 0.25e-3 * (time - 20), rate=10)
    assert run.largest_lag() < 50 * MS
    assert run.lags[max(run.lags)] < -200 * MS
    assert run.problems[max(run.problems)] == "untimed"
    run.send(620, 625, echoes=lambda time: 0.001)
    assert run.largest_lag(621) < 5 * MS and run.clock.problem is None


@pytest.mark.parametrize("error", [-1e-4, 1e-4])
def test_one_way_clock_of_a_crystal_is_believed(error):
    rng = np.random.default_rng(0)
    run = ClockRun(error).send(0, 400, lambda time: rng.exponential(0.01))
    assert run.used(1, 400) == 1
    assert abs(run.largest_lag(20)) < 5 * MS


@pytest.mark.parametrize("growth", [5e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("begin", [0, 60])
def test_growing_delay_of_one_way_link_is_no_drift(growth, begin):
    run = ClockRun().send(0, 260, lambda time: growth * max(0, time - begin))
    found = begin + run.said(begin)
    assert growth * (found - begin) < 0.1
    assert run.used(found + 1, 260) == 0
    assert run.largest_lag() < 1.1 * BELIEVED * (found - begin) * SECOND + 3 * MS


@pytest.mark.parametrize("delay", [0.1, 0.3, 3.0])
def test_step_of_one_way_delay_is_said_within_a_second_and_never_believed(delay):
    run = ClockRun().send(0, 30).send(30, 2000, lambda time: delay, rate=2)
    assert run.said(30 + delay) <= 1
    assert run.used(31, 2000) == 0
    assert run.largest_lag() < 3 * MS


def test_patch_is_used_again_once_its_delay_is_over():
    run = ClockRun().send(0, 30).send(30, 300, lambda time: 0.3, rate=10)
    run.send(301, 305)
    assert run.used(301, 305) == 1 and run.clock.problem is None


@pytest.mark.parametrize("first", [0, 500])
def test_replay_is_no_reboot(first):
    run = ClockRun().send(0, 30)
    for n in range(first, first + 500):
        time = n / 50
        made = START + n * PERIOD
        arrived = made - first * PERIOD + 31 * SECOND
        run.receive(run.read_clock(time), n, arrived, made, 100 + time)
    assert run.used(100, 200) == 0 and run.clock.problem == "replayed"
    # After a reboot its counts are not the same, at the same times.
    run.boot = 42.0
    run.count = 0
    run.content = 1
    run.send(42, 45)
    assert run.used(42.2, 45) == 1 and run.clock.problem is None
