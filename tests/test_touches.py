from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import ReadingError
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchConfig, TouchPipeline
from helpers.touch import (
    calibration_of,
    hinged_skin,
    mounted_grid,
    moved,
    permuted,
    pressed,
    reading_at,
    scan_at,
)

WIDE = {"rows": 6, "columns": 40}


def feel(mounted, pressure_at, seconds, rate=50, q_at=None):
    """Play `pressure_at(t)` and return the state after each reading, and the rest."""
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin))
    states = []
    for t in np.arange(round(seconds * rate)) / rate:
        q = None if q_at is None else q_at(t)
        states.append(pipeline.push_reading(reading_at(t, pressure_at(t), None, q)))
    return states, pipeline.finish()


def closed_of(states, rest):
    return [touch for state in states for touch in state.closed_touches] + list(rest)


def whole(touches):
    return [touch for touch in touches if touch.merged_into is None]


def pats(mounted, times, places, length=0.15):
    def pressure_at(t):
        now = [
            pressed(mounted.skin, (x, 0.02))
            for start, x in zip(times, places, strict=True)
            if start <= t < start + length
        ]
        return np.max([np.zeros(mounted.skin.count), *now], axis=0)

    return pressure_at


@pytest.mark.parametrize("rate", [10, 50, 500])
def test_a_double_pat_is_one_touch_of_two_tracks(rate):
    mounted = mounted_grid(**WIDE)
    scene = pats(mounted, [0.2, 0.6], [0.1, 0.13])
    states, rest = feel(mounted, scene, 2.0, rate)
    (touch,) = closed_of(states, rest)
    assert touch.tracks == (1, 2)
    assert touch.closed


def test_pats_far_apart_in_time_or_place_are_two_touches():
    mounted = mounted_grid(**WIDE)
    late = pats(mounted, [0.2, 1.0], [0.1, 0.1])
    assert len(closed_of(*feel(mounted, late, 2.0))) == 2
    far = pats(mounted, [0.2, 0.6], [0.1, 0.2])
    assert len(closed_of(*feel(mounted, far, 2.0))) == 2


def test_two_hands_are_two_touches_and_two_fingers_are_one():
    mounted = mounted_grid(**WIDE)
    hands = pats(mounted, [0.2, 0.25], [0.05, 0.3], length=0.5)
    assert len(closed_of(*feel(mounted, hands, 2.0))) == 2
    fingers = pats(mounted, [0.2, 0.25], [0.05, 0.1], length=0.5)
    assert len(closed_of(*feel(mounted, fingers, 2.0))) == 1


def test_a_contact_between_two_touches_makes_them_one_and_the_older_stays():
    mounted = mounted_grid(**WIDE)
    scene = pats(mounted, [0.2, 0.25, 0.3], [0.05, 0.25, 0.15], length=0.5)
    states, rest = feel(mounted, scene, 2.0)
    touches = closed_of(states, rest)
    assert [(t.id, t.merged_into) for t in touches] == [(2, 1), (1, None)]
    assert touches[1].tracks == (1, 2, 3)


def test_two_touches_that_come_together_are_one_and_nothing_of_them_is_lost():
    mounted = mounted_grid(**WIDE)

    def pressure_at(t):
        if not 0.2 <= t < 1.4:
            return np.zeros(mounted.skin.count)
        left, right = 0.05 + 0.07 * (t - 0.2), 0.25 - 0.07 * (t - 0.2)
        return np.maximum(
            pressed(mounted.skin, (left, 0.02), radius=0.015),
            pressed(mounted.skin, (right, 0.02), radius=0.015),
        )

    states, rest = feel(mounted, pressure_at, 3.0)
    touches = closed_of(states, rest)
    assert [(t.id, t.merged_into) for t in touches] == [(2, 1), (1, None)]
    forces = [sum(c.force for c in state.contacts) for state in states]
    assert touches[1].impulse == pytest.approx(sum(forces) / 50, rel=1e-9)


def test_what_splits_off_stays_in_the_touch():
    mounted = mounted_grid(columns=21)
    config = PipelineConfig(touches=TouchConfig(beside=0.0, near=0.0))
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin), config)
    for step in range(7):
        presses = [
            pressed(mounted.skin, (0.1 + s * 0.005 * step, 0.02)) for s in (-1, 1)
        ]
        state = pipeline.push_reading(reading_at(step / 50, np.max(presses, axis=0)))
    assert len(state.contacts) == 2
    assert [touch.tracks for touch in state.touches] == [(1, 2)]


def test_on_a_skin_that_is_not_calibrated_all_at_once_is_one_touch():
    mounted = mounted_grid(**WIDE, calibrated=False)
    scene = pats(mounted, [0.2, 0.25, 0.7], [0.05, 0.35, 0.2], length=0.3)
    (touch,) = closed_of(*feel(mounted, scene, 2.0))
    assert touch.tracks == (1, 2, 3)


@pytest.mark.parametrize("rate", [10, 100])
def test_a_touch_closes_half_a_second_after_its_last_contact(rate):
    mounted = mounted_grid()
    scene = pats(mounted, [0.2], [0.02], length=0.5)
    states, rest = feel(mounted, scene, 2.0, rate)
    assert rest == ()
    (state,) = [state for state in states if state.closed_touches]
    (touch,) = state.closed_touches
    after = (state.reading.stamp - touch.last) * 1e-9
    assert 0.5 < after <= 0.5 + 1.001 / rate


@pytest.mark.parametrize("rate", [10, 100, 1000])
def test_the_impulse_is_force_times_time_at_any_rate(rate):
    mounted = mounted_grid()
    scene = pats(mounted, [0.2], [0.02], length=0.6)
    (touch,) = closed_of(*feel(mounted, scene, 2.0, rate))
    force = 5 * 20e3 * 1e-4
    assert touch.impulse == pytest.approx(0.6 * force, rel=1e-6)
    assert touch.peak_force == pytest.approx(force)
    assert touch.peak == pytest.approx(20.0)


def test_the_impulse_is_force_times_time_at_an_uneven_rate():
    mounted = mounted_grid()
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin))
    times = np.sort(np.random.default_rng(8).uniform(0.0, 1.0, 80))
    for t in times:
        kpa = 20 * np.sin(np.pi * t) + 5
        pressure = pressed(mounted.skin, (0.02, 0.02), kpa=kpa)
        pipeline.push_reading(reading_at(t, pressure))
    (touch,) = pipeline.finish()
    forces = 5 * 1e-4 * 1e3 * (20 * np.sin(np.pi * times) + 5)
    assert touch.impulse == pytest.approx(np.trapezoid(forces, times), rel=1e-3)


def test_a_stroke_says_which_way_it_went_though_the_arm_moves():
    mounted = hinged_skin()

    def pressure_at(t):
        return np.where(
            (mounted.skin.patch_index == 1) & (mounted.skin.columns == 5 - int(t * 5)),
            20.0,
            0.0,
        )

    states, rest = feel(mounted, pressure_at, 1.0, q_at=lambda t: np.array([t]))
    (touch,) = closed_of(states, rest)
    assert touch.link == "flap"
    np.testing.assert_allclose(touch.travel, [0.04, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(touch.start, [0.005, 0.025, 0.03], atol=1e-9)


def test_a_gap_in_the_readings_closes_tracks_and_touches():
    mounted = mounted_grid()
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin))
    touch = pressed(mounted.skin, (0.02, 0.02))
    for t in (0.0, 0.1, 0.2):
        pipeline.push_reading(reading_at(t, touch))
    state = pipeline.push_reading(reading_at(10.0, touch))
    assert [t.id for t in state.closed_touches] == [1]
    assert [t.id for t in state.touches] == [2]
    assert [(t.id, t.ended) for t in state.tracks] == [(2, False), (1, True)]
    assert state.touches[0].impulse < 1.0


def described(states, rest):
    return [
        (t.id, t.onset, t.last, t.tracks, t.link, t.merged_into, round(t.impulse, 9))
        for t in closed_of(states, rest)
    ]


def busy(skin):
    rng = np.random.default_rng(9)
    times, places = rng.uniform(0, 4, 25), rng.uniform(-0.06, 0.1, (25, 2))

    def pressure_at(t):
        now = [
            pressed(skin, place, 5.0 + n)
            for n, (start, place) in enumerate(zip(times, places, strict=True))
            if start <= t < start + 0.2
        ]
        return np.max([np.zeros(skin.count), *now], axis=0)

    return pressure_at


def test_touches_do_not_depend_on_the_order_of_the_taxels():
    mounted = hinged_skin()
    order = np.random.default_rng(10).permutation(mounted.skin.count)
    other = MountedSkin(permuted(mounted.skin, order), mounted.robot)
    scene = busy(mounted.skin)
    still = np.array([0.3])
    one = described(*feel(mounted, scene, 5.0, q_at=lambda t: still))
    two = described(*feel(other, lambda t: scene(t)[order], 5.0, q_at=lambda t: still))
    assert len(one) > 3
    assert one == two


def test_touches_do_not_depend_on_a_rigid_motion_of_the_robot():
    one = hinged_skin()
    other = hinged_skin(moved(np.array([0.3, -0.7, 0.9]), np.array([1.0, 2.0, -3.0])))
    scene = busy(one.skin)

    def q_at(t):
        return np.array([np.sin(t)])

    assert described(*feel(one, scene, 5.0, q_at=q_at)) == described(
        *feel(other, scene, 5.0, q_at=q_at)
    )


def counts_of(mounted, t):
    press = pressed(mounted.skin, (0.02, 0.02)) * 10 if 3.0 <= t < 3.5 else 0.0
    return np.round(200 + np.sin(37.0 * t + np.arange(36)) * 2 + press)


def test_the_pipeline_leads_from_counts_to_a_touch_and_a_stuck_taxel():
    mounted = mounted_grid()
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin))
    closed, faults = [], ()
    for t in np.arange(0.0, 12.0, 0.02):
        counts = counts_of(mounted, t)
        counts[35] = 900 if t > 5.0 else counts[35]
        state = pipeline.push(scan_at(t, counts))
        closed += state.closed_touches
        faults = state.faults
    assert [(f.kind, f.row, f.column) for f in faults] == [("stuck", 5, 5)]
    assert not state.reading.valid[35]
    assert not state.contacts
    first = min(closed, key=lambda touch: touch.onset)
    assert first.peak == pytest.approx(20.0, abs=0.6)
    assert (first.last - first.onset) * 1e-9 == pytest.approx(0.5, abs=0.05)


def test_a_scan_that_is_refused_changes_nothing():
    mounted = mounted_grid()
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin))
    pipeline.push(scan_at(1.0, np.full(36, 200)))
    for scan in (scan_at(1.0, np.full(36, 200)), scan_at(0.5, np.full(36, 200))):
        with pytest.raises(ReadingError, match="allowed is only later") as error:
            pipeline.push(scan)
        assert "\n" not in str(error.value)
    with pytest.raises(ReadingError, match="scan has 5 taxels"):
        pipeline.push(scan_at(2.0, np.zeros(5)))
    other_robot = replace(scan_at(2.0, np.full(36, 200)), q=np.zeros(6))
    with pytest.raises(ReadingError, match="q has 6 joints, robot 'bench' has 0"):
        pipeline.push(other_robot)
    assert pipeline.push(scan_at(1.5, np.full(36, 200))).reading.valid.all()


def test_a_count_that_cannot_be_is_not_valid_in_its_own_reading():
    mounted = mounted_grid()
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin))
    for t in (0.0, 0.02, 0.04):
        counts = np.full(36, 200)
        counts[7] = -1 if t == 0.04 else 200
        valid = pipeline.push(scan_at(t, counts)).reading.valid
    assert np.flatnonzero(~valid).tolist() == [7]


def test_a_count_that_cannot_be_is_never_learned_not_even_from_the_first_scan():
    mounted = mounted_grid()
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin))
    for t in np.arange(0.0, 6.0, 0.02):
        counts = counts_of(mounted, 0.0)
        counts[7] = -32768 if t == 0.0 else counts[7]
        state = pipeline.push(scan_at(t, counts))
        assert not state.contacts
    assert state.reading.valid.all()


def test_after_finishing_a_new_touch_begins_at_once():
    mounted = mounted_grid()
    pipeline = TouchPipeline(mounted, calibration_of(mounted.skin))
    held = pressed(mounted.skin, (0.02, 0.02))
    [before] = pipeline.push_reading(reading_at(0.0, held)).touches
    assert [touch.id for touch in pipeline.finish()] == [before.id]
    lost = reading_at(0.02, held, valid=np.zeros(36, bool))
    assert not pipeline.push_reading(lost).touches
    [after] = pipeline.push_reading(reading_at(0.04, held)).touches
    assert (after.id, after.tracks) == (before.id + 1, (2,))
    assert after.onset == reading_at(0.04, held).stamp
