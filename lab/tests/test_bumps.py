"""These tests check the laws that bodies obey which strike a skin."""

import numpy as np
import pytest

from eskin.skin import build_grid_skin
from lab.bumps import (
    DT,
    Ball,
    PushingBody,
    press_sphere,
    press_taxels,
    push_ellipse,
    strike,
)

SPEED = 0.4


def make_ball(restitution=0.5, friction=0.5):
    """Return a ball of 1 kg."""
    return Ball(0.05, 1.0, 1e6, restitution, friction)


@pytest.mark.parametrize("restitution", [0.2, 0.45, 0.7])
def test_energy_after_is_that_before_times_restitution_squared(restitution):
    motion = strike(make_ball(restitution), SPEED)
    energy = motion.approach[-1] ** 2 / SPEED**2
    assert energy == pytest.approx(restitution**2, rel=0.05)
    assert motion.approach[-1] < 0


@pytest.mark.parametrize("restitution", [0.2, 0.7])
def test_impulse_of_skin_is_change_of_momentum_and_force_never_pulls(restitution):
    ball = make_ball(restitution)
    follower = PushingBody(2.0, 5000.0, 30.0)
    for motion, mass in ((strike(ball, SPEED), 0.0), (struck(ball, follower), 2.0)):
        after = ball.mass * motion.approach[-1] + mass * motion.follower[-1]
        impulse = motion.force[:-1].sum() * DT
        assert impulse == pytest.approx((ball.mass + mass) * SPEED - after, rel=1e-6)
        assert motion.force.min() >= 0
        assert motion.force[motion.depth < 0].sum() == 0


def struck(ball, follower):
    """Return the motion of a ball that a follower pushes."""
    return strike(ball, SPEED, follower=follower)


def test_two_bodies_lose_energy():
    follower = PushingBody(2.0, 5000.0, 30.0)
    motion = struck(make_ball(), follower)
    before = 3.0 * SPEED**2
    assert motion.approach[-1] ** 2 + 2.0 * motion.follower[-1] ** 2 < before


def test_friction_takes_its_share_of_the_impulse_until_the_ball_rolls():
    slow = strike(make_ball(friction=0.1), SPEED, sliding=2.0)
    impulse = slow.force[:-1].sum() * DT
    assert 2.0 - slow.sliding[-1] == pytest.approx(0.1 * impulse, rel=1e-6)
    rolling = strike(make_ball(friction=0.8), SPEED, sliding=0.2)
    assert rolling.slip[-1] == pytest.approx(0.0, abs=1e-9)
    assert rolling.sliding[-1] == pytest.approx(0.2 * 5 / 7, rel=1e-6)


def test_taxels_carry_the_force_of_sphere_and_ellipse():
    skin = build_grid_skin(31, 31, 0.004, calibrated=True)
    ball = make_ball()
    sphere = press_sphere(strike(ball, SPEED), ball)
    ellipse = push_ellipse(30.0, 0.1, (0.015, 0.03))
    for contact in (sphere, ellipse):
        times = contact.times[:: len(contact.times) // 5][1:-1]
        pressure = press_taxels(contact, skin, skin.count // 2, 0.7, times)
        force = 1000 * (pressure * skin.areas).sum(1)
        expected = np.interp(times, contact.times, contact.force)
        np.testing.assert_allclose(force, expected, rtol=0.05)


def test_second_contact_follows_after_the_gap():
    ball = make_ball()
    first = press_sphere(strike(ball, SPEED, sliding=0.1), ball)
    both = first.follow(first, 0.2)
    assert both.times[-1] == pytest.approx(2 * first.times[-1] + 0.2)
    assert np.interp(first.times[-1] + 0.1, both.times, both.force) < 1.0
    assert both.force.max() == first.force.max()
    assert np.all(np.diff(both.times) > 0)
