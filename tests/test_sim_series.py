import numpy as np
import pytest

from eskin.sim.people.gesture_sample import (
    build_bell,
    build_minimum_jerk,
    build_trapezoid,
    count_steps,
    draw_slow_noise,
    scale_to_peak,
)


@pytest.mark.parametrize("steps", [3, 4, 14, 201])
def test_shapes_are_zero_at_both_ends_and_reach_one(steps):
    for shape in (build_bell(steps, 1.5), build_trapezoid(steps, 0.25, 0.2, 1)):
        assert shape[0] == 0 == shape[-1]
        assert shape.max() == 1 and shape.min() >= 0
        assert len(shape) == steps


def test_a_bell_is_symmetric_and_a_higher_power_narrower():
    np.testing.assert_allclose(
        build_bell(40, 1.5), build_bell(40, 1.5)[::-1], atol=1e-12
    )
    assert build_bell(40, 2.0).sum() < build_bell(40, 1.0).sum()


def test_a_trapezoid_holds_between_rise_and_fall():
    shape = build_trapezoid(101, 0.2, 0.3, 1)
    np.testing.assert_allclose(shape[22:69], 1.0)
    assert np.all(np.diff(shape[:20]) >= 0) and np.all(np.diff(shape[71:]) <= 0)


def test_a_touch_has_at_least_three_steps():
    assert count_steps(0.001, 0.01) == 3
    assert count_steps(0.5, 0.01) == 51


def test_peaked_series_reach_their_force():
    assert scale_to_peak(np.array([0.0, 0.3, 0.7, 0.0]), 5.0).max() == 5.0


def test_minimum_jerk_starts_and_ends_at_rest_with_the_known_top_speed():
    way = build_minimum_jerk(1001)
    speed = np.gradient(way, 1e-3)
    assert way[0] == 0 and way[-1] == 1
    assert abs(speed[0]) < 1e-4 and abs(speed[-1]) < 1e-4
    assert speed.max() == pytest.approx(1.875, rel=1e-3)


def test_wandering_has_mean_square_one_and_stays_in_its_band():
    rng = np.random.default_rng(0)
    waves = np.array(
        [draw_slow_noise(2000, 0.01, (0.5, 3.0), 6, rng) for _ in range(50)]
    )
    assert np.mean(waves**2) == pytest.approx(1.0, abs=0.05)
    power = np.abs(np.fft.rfft(waves, axis=1)) ** 2
    rates = np.fft.rfftfreq(2000, 0.01)
    assert power[:, rates < 4].sum() > 0.99 * power.sum()
