"""Tests of the attacks on timing: the age of obeyed touches, and the time to a hold."""

import pytest

from lab.attacks.crush import Plan, is_in_time, run_events
from lab.attacks.delay import LIMIT, attack_timing
from lab.attacks.hold import hold_played

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("link", ["one-way", "echo"])
@pytest.mark.parametrize(
    ("name", "minutes"),
    [
        ("growing 1 %", 0.3),
        ("jitter 0 to 0.3 s", 0.05),
        ("replayed, patch cut off", 0.05),
    ],
)
def test_nothing_old_is_obeyed(name, minutes, link):
    assert attack_timing(name, link, minutes).obeyed < LIMIT


@pytest.mark.parametrize("name", ["step 0.3 s", "replayed, patch cut off"])
def test_delay_is_said_within_a_second(name):
    said = attack_timing(name, "one-way", minutes=0.05).said
    assert said is not None and said < 1.0


def test_fresh_burst_is_used_whole():
    assert attack_timing("bursts every 0.1 s", "one-way", minutes=0.05).used == 1


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_arm_is_held_within_150_ms_of_the_last_packet(rate):
    assert hold_played(rate, one=False, seed=0)[1] < 0.15


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_arm_is_slowed_within_150_ms_of_last_packet_of_a_patch_and_then_held(rate):
    # It was held within 150 ms before; one run of lost packets held an arm then, at a
    # loss of 0.2 % every minute. Slowed, its tool goes 0.15 m until it is held.
    slowed, held = hold_played(rate, one=True, seed=0)
    assert slowed < 0.15 and held < 0.55


def test_grab_that_crushes_stops_the_arm_and_one_that_is_kept_does_not():
    (crushed,), (kept,) = (
        run_events(Plan("fresh", "grab", crushes, 1, 58000))
        for crushes in (True, False)
    )
    assert crushed.passed and is_in_time(crushed) and crushed.is_latched
    assert not kept.is_latched
