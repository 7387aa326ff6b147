"""These tests check how a moving arm that is touched is simulated and counted."""

from dataclasses import replace

import pytest

from lab.moving_arm import (
    GRIP_FORCE,
    HARD_GRIP,
    LEAST_FORCE,
    Accidents,
    MovingTouch,
    TouchingPeople,
    format_lost,
    format_touches,
)

pytestmark = pytest.mark.slow


def test_touches_are_strong_enough_and_suspend_the_arm_once_it_is_felt():
    poke, grip = TouchingPeople("fresh", 60000).run(["poke", HARD_GRIP])
    assert poke.force > 0.9 * LEAST_FORCE and grip.force > 0.9 * GRIP_FORCE
    for one in (poke, grip):
        assert one.felt is not None and one.is_in_time() and one.against == 0.0
        assert one.reached is not None and one.reached <= one.seconds


def test_row_counts_touches_by_what_the_arm_did():
    one = MovingTouch("fresh", 1, "poke", reached=0.1, felt=0.1, suspended=0.1)
    late = replace(one, suspended=0.3)
    unfelt = replace(one, felt=None, suspended=None)
    against = replace(one, against=2.0)
    row = format_touches("poke", [one, late, unfelt, against])
    cells = [cell.strip() for cell in row.split("|")][1:-1]
    assert cells[:7] == ["poke", "4", "2", "3", "3", "3", "3"]
    assert cells[8:] == ["1", "0"]


def test_work_is_lost_to_accidents_alone_on_a_skin_without_defects():
    untouched = Accidents("flawless", 60000, None).run(10.0)
    assert (untouched.accidents, untouched.lost, untouched.touched) == (0, 0.0, 0.0)
    touched = Accidents("flawless", 60000, 3.0).run(20.0)
    assert touched.accidents >= 3 and 0.0 < touched.lost < touched.seconds
    cells = format_lost("all", "3 s", [untouched, touched]).split("|")
    lost = float(cells[5].strip().removesuffix("%")) / 100
    assert lost == pytest.approx(touched.lost / 30.0, abs=1e-3)


def test_what_accidents_stop_goes_on_once_nothing_touches():
    accidents = Accidents("flawless", 60001, None)
    accidents.touched.arm.pause()
    assert accidents.run(2.0).stopped == pytest.approx(accidents.touched.skin.period)
    assert not accidents.touched.arm.state().paused
