"""Tests of touches: tracks of one gesture are one touch, from its onset to its end."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import ReadingError
from eskin.skin import MountedSkin
from eskin.touch import PressDetector, TouchConfig
from helpers.touch import (
    RIGID_MOTION,
    SECOND,
    build_hinged_skin,
    build_mounted_grid,
    build_pipeline,
    press_pad,
    push_pressures,
    reading_at,
    reorder_taxels,
    scan_at,
)

GRID = build_mounted_grid()
WIDE = build_mounted_grid(columns=40)
PAD = press_pad(GRID.skin, (0.02, 0.02))


def find_touches(mounted, pressure_at, seconds=2.0, rate=50, q_at=None):
    """Push `pressure_at(t)`; return the states and all touches once they are closed."""
    pipeline = build_pipeline(mounted)
    times = np.arange(round(seconds * rate)) / rate
    q = None if q_at is None else [q_at(t) for t in times]
    states = push_pressures(pipeline, map(pressure_at, times), rate, q)
    closed = [touch for state in states for touch in state.closed_touches]
    return states, [*closed, *pipeline.finish()]


def press(mounted, starts, places, length=0.15):
    """Return the pressures of pads at x [m], each from its start for a length [s]."""

    def pressure_at(t):
        return np.max(
            [np.zeros(mounted.skin.count)]
            + [
                press_pad(mounted.skin, (x, 0.02)) * (start <= t < start + length)
                for start, x in zip(starts, places, strict=True)
            ],
            axis=0,
        )

    return pressure_at


@pytest.mark.parametrize("rate", [10, 50, 200])
def test_double_pat_is_one_touch_of_two_tracks(rate):
    _, (touch,) = find_touches(WIDE, press(WIDE, [0.2, 0.6], [0.1, 0.13]), rate=rate)
    assert touch.tracks == (1, 2) and touch.closed


@pytest.mark.parametrize(
    ("starts", "places", "length", "count"),
    [
        ([0.2, 1.0], [0.1, 0.1], 0.15, 2),
        ([0.2, 0.6], [0.1, 0.2], 0.15, 2),
        ([0.2, 0.25], [0.05, 0.3], 0.5, 2),
        ([0.2, 0.25], [0.05, 0.1], 0.5, 1),
    ],
    ids=["pats far in time", "pats far in place", "two hands", "two fingers"],
)
def test_presses_far_apart_are_two_touches(starts, places, length, count):
    _, touches = find_touches(WIDE, press(WIDE, starts, places, length))
    assert len(touches) == count


@pytest.mark.parametrize(("pitch", "count"), [(0.01, 2), (0.02, 1)])
@pytest.mark.parametrize("later", [0.0, 0.45], ids=["at once", "one after the other"])
def test_one_hand_on_several_large_cells_is_one_touch(pitch, count, later):
    mounted = build_mounted_grid(columns=round(0.4 / pitch), pitch=pitch)
    scene = press(mounted, [0.2, 0.2 + later], [0.04, 0.18], length=0.3)
    _, touches = find_touches(mounted, scene)
    assert len(touches) == count


@pytest.mark.parametrize(
    ("column", "later"), [(11, 0.0), (9, 0.45)], ids=["at once", "one after the other"]
)
def test_cells_of_a_fingertip_are_as_large_as_one_where_many_are_pressed(column, later):
    """The mean area of 25 such cells is rounded to a little less than one of them."""
    mounted = build_mounted_grid(rows=5, columns=16, pitch=0.02)
    columns = mounted.skin.columns
    first = 20.0 * (columns < 5)
    second = 20.0 * ((columns >= column) & (columns < column + 5))

    def pressure_at(t):
        return first * (0.2 <= t < 0.5) + second * (0.2 <= t - later < 0.5)

    _, touches = find_touches(mounted, pressure_at)
    assert len(touches) == 1


def test_contact_between_two_touches_merges_them_into_the_older():
    scene = press(WIDE, [0.2, 0.26, 0.3], [0.05, 0.25, 0.15], length=0.5)
    states, touches = find_touches(WIDE, scene)
    assert [(t.id, t.merged_into) for t in touches] == [(2, 1), (1, None)]
    assert touches[1].tracks == (1, 2, 3)
    forces = [sum(contact.force for contact in state.contacts) for state in states]
    assert touches[1].impulse == pytest.approx(sum(forces) / 50, rel=1e-9)


def test_track_that_splits_off_stays_in_the_touch():
    apart = TouchConfig(max_separation=0.0, max_gap=0.0)
    pipeline = build_pipeline(WIDE, touches=apart)
    scene = [
        np.maximum(*(press_pad(WIDE.skin, (0.1 + x, 0.02)) for x in (-half, half)))
        for half in np.arange(0.0, 0.035, 0.005)
    ]
    state = push_pressures(pipeline, scene)[-1]
    assert len(state.contacts) == 2
    assert [touch.tracks for touch in state.touches] == [(1, 2)]


def test_all_contacts_on_an_uncalibrated_skin_are_one_touch():
    mounted = build_mounted_grid(columns=40, calibrated=False)
    scene = press(mounted, [0.2, 0.25, 0.7], [0.05, 0.35, 0.2], length=0.3)
    _, (touch,) = find_touches(mounted, scene)
    assert touch.tracks == (1, 2, 3)


@pytest.mark.parametrize("rate", [10, 100])
def test_touch_closes_some_time_after_its_last_contact(rate):
    states, (touch,) = find_touches(GRID, press(GRID, [0.2], [0.02], 0.5), rate=rate)
    (state,) = [state for state in states if state.closed_touches]
    seconds = (state.reading.stamp - touch.last) * 1e-9
    pause = TouchConfig().pause_seconds
    assert pause < seconds <= pause + 1.001 / rate


@pytest.mark.parametrize("begin", [0.0, 1 / 3, 86400.0])
@pytest.mark.parametrize("pause", [0.1, 0.3, 0.36, 0.7])
@pytest.mark.parametrize(("late", "count"), [(0, 1), (1, 2)])
def test_touch_goes_on_within_its_pause_to_the_nanosecond(begin, pause, late, count):
    pipeline = build_pipeline(GRID, touches=TouchConfig(pause_seconds=pause))
    pipeline.push_reading(reading_at(0.0, np.zeros(GRID.skin.count)))
    first = reading_at(begin + 1.0, PAD)
    pipeline.push_reading(first)
    pipeline.push_reading(reading_at(begin + 1.05, np.zeros(GRID.skin.count)))
    stamp = first.stamp + round(pause * SECOND) + late
    state = pipeline.push_reading(replace(first, stamp=stamp))
    assert state.touches[-1].id == count


@pytest.mark.parametrize("rate", [10, 100, 300])
def test_impulse_is_force_times_time_at_any_rate(rate):
    scene = press(GRID, [0.2], [0.02], length=0.6)
    _, (touch,) = find_touches(GRID, scene, 1.0, rate)
    force = 5 * 20e3 * 1e-4
    assert touch.impulse == pytest.approx(0.6 * force, rel=1e-6)
    assert touch.peak_force == pytest.approx(force)
    assert touch.peak == pytest.approx(20.0)


def test_impulse_is_the_integral_of_force_at_an_uneven_rate():
    pipeline = build_pipeline(GRID)
    times = np.sort(np.random.default_rng(8).uniform(0.0, 3.0, 240))
    pressures = 20 * np.sin(np.pi * times / 3.0) + 5
    for t, kpa in zip(times, pressures, strict=True):
        pipeline.push_reading(reading_at(t, PAD * (kpa / 20.0)))
    (touch,) = pipeline.finish()
    impulse = np.trapezoid(5 * 1e-4 * 1e3 * pressures, times)
    assert touch.impulse == pytest.approx(impulse, rel=1e-3)


def test_travel_of_a_stroke_does_not_depend_on_the_motion_of_the_arm():
    mounted = build_hinged_skin()
    flap = mounted.skin.patch_index == 1

    def pressure_at(t):
        return 20.0 * (flap & (mounted.skin.columns == 5 - int(t * 5)))

    _, (touch,) = find_touches(mounted, pressure_at, 1.0, q_at=lambda t: np.array([t]))
    assert touch.link == "flap"
    np.testing.assert_allclose(touch.travel, [0.04, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(touch.start, [0.005, 0.025, 0.03], atol=1e-9)


def test_gap_in_the_readings_closes_tracks_and_touches():
    pipeline = build_pipeline(GRID)
    push_pressures(pipeline, [PAD] * 3, rate=10)
    state = pipeline.push_reading(reading_at(10.0, PAD))
    assert [touch.id for touch in state.closed_touches] == [1]
    assert [touch.id for touch in state.touches] == [2]
    assert [(t.id, t.ended) for t in state.tracks] == [(2, False), (1, True)]
    assert state.touches[0].impulse < 1.0


def test_new_touch_begins_after_finishing():
    pipeline = build_pipeline(GRID)
    [before] = pipeline.push_reading(reading_at(0.0, PAD)).touches
    assert [touch.id for touch in pipeline.finish()] == [before.id]
    lost = reading_at(0.02, PAD, valid=np.zeros(36, bool))
    assert not pipeline.push_reading(lost).touches
    held = reading_at(0.04, PAD)
    [after] = pipeline.push_reading(held).touches
    assert (after.id, after.tracks) == (before.id + 1, (2,))
    assert after.onset == held.stamp


def random_pats(skin):
    """Return the pressures of pats at random times and places."""
    rng = np.random.default_rng(9)
    starts = rng.uniform(0, 4, 25)
    places = rng.uniform(-0.06, 0.1, (25, 2))
    pads = np.array([press_pad(skin, place, 5.0 + n) for n, place in enumerate(places)])

    def pressure_at(t):
        now = (starts <= t) & (t < starts + 0.25)
        return np.max(now[:, None] * pads, axis=0)

    return pressure_at


def describe(states, touches, order=...):
    """Return the fields of contacts, tracks and touches that are no places."""
    taxels = np.arange(72)[order]
    return (
        [
            [(sorted(taxels[c.taxels]), c.force, c.area, c.peak, c.patch) for c in now]
            for now in (state.contacts for state in states)
        ],
        [
            [(t.id, t.onset, t.last, t.parent, t.merged_into, t.ended) for t in now]
            for now in (state.tracks for state in states)
        ],
        [(t.id, t.onset, t.last, t.tracks, t.merged_into, t.link) for t in touches],
        [round(touch.impulse, 9) for touch in touches],
    )


def test_touches_do_not_depend_on_taxel_order_and_rigid_motion():
    mounted = build_hinged_skin()
    moved = build_hinged_skin(RIGID_MOTION)
    order = np.random.default_rng(10).permutation(72)
    reordered = MountedSkin(reorder_taxels(mounted.skin, order), mounted.robot)
    scene = random_pats(mounted.skin)
    one, other, third = (
        find_touches(skin, pressure_at, 5.0, q_at=lambda t: np.array([np.sin(t)]))
        for skin, pressure_at in (
            (mounted, scene),
            (reordered, lambda t: scene(t)[order]),
            (moved, scene),
        )
    )
    assert len(one[1]) > 3
    assert max(len(state.contacts) for state in one[0]) > 2
    assert describe(*one) == describe(*other, order)
    assert describe(*one) == describe(*third)
    R = RIGID_MOTION[:3, :3]
    p = RIGID_MOTION[:3, 3]
    for state, moved_state in zip(one[0], third[0], strict=True):
        for a, b in zip(state.contacts, moved_state.contacts, strict=True):
            np.testing.assert_allclose(R @ a.p_world + p, b.p_world)
            np.testing.assert_allclose(R @ a.n_world, b.n_world, atol=1e-12)
            np.testing.assert_allclose(a.p_link, b.p_link, atol=1e-12)


def touch_counts(t):
    """Return the counts of a touch from 3 s to 3.5 s."""
    noise = 2 * np.sin(37.0 * t + np.arange(36))
    return np.round(200 + noise + 10 * PAD * (3.0 <= t < 3.5))


def test_pipeline_finds_a_touch_and_a_stuck_taxel_in_counts():
    pipeline = build_pipeline(GRID)
    closed = []
    for t in np.arange(0.0, 12.0, 0.02):
        counts = touch_counts(t)
        counts[35] = 900 if t > 5.0 else counts[35]
        state = pipeline.push_scan(scan_at(t, counts))
        closed += state.closed_touches
    assert [(f.kind, f.row, f.column) for f in state.faults] == [("stuck", 5, 5)]
    assert not state.reading.valid[35] and not state.contacts
    first = min(closed, key=lambda touch: touch.onset)
    assert first.peak == pytest.approx(20.0, abs=0.6)
    assert (first.last - first.onset) * 1e-9 == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("scan", "text"),
    [
        (scan_at(1.0, np.full(36, 200)), "later"),
        (scan_at(0.5, np.full(36, 200)), "later"),
        (scan_at(2.0, np.zeros(5)), "5 taxels"),
        (replace(scan_at(2.0, np.full(36, 200)), q=np.zeros(6)), "6 joints.*0"),
    ],
)
def test_refused_scan_changes_nothing(scan, text):
    pipeline = build_pipeline(GRID)
    pipeline.push_scan(scan_at(1.0, np.full(36, 200)))
    with pytest.raises(ReadingError, match=text) as error:
        pipeline.push_scan(scan)
    assert "\n" not in str(error.value)
    assert pipeline.push_scan(scan_at(1.5, np.full(36, 200))).reading.valid.all()


@pytest.mark.parametrize(("bad_scan", "count"), [(0, -32768), (2, -1)])
def test_negative_count_is_not_valid_and_not_learned(bad_scan, count):
    pipeline = build_pipeline(GRID)
    for n in range(200):
        counts = touch_counts(0.0)
        counts[7] = count if n == bad_scan else counts[7]
        state = pipeline.push_scan(scan_at(n / 50, counts))
        assert not state.contacts
        if n == bad_scan:
            assert np.flatnonzero(~state.reading.valid).tolist() == [7]
    assert state.reading.valid.all()


@pytest.mark.parametrize(
    ("presses", "count"),
    [
        ([(30.0, 1.0, 1.5)], 1),
        ([(30.0, 0.5, 1.0), (30.0, 1.5, 2.0)], 2),
        ([(0.8, 1.0, 2.0)], 0),
        ([(30.0, 1.0, 1.1)], 0),
    ],
    ids=["one", "two", "light", "short"],
)
def test_firm_long_press_is_found_with_its_hardest_taxel(presses, count):
    shape = press_pad(GRID.skin, GRID.skin.positions[15, :2], 1.0)
    shape[15] *= 1.5

    def pressure_at(t):
        return shape * sum(kpa * (start <= t < end) for kpa, start, end in presses)

    states, _ = find_touches(GRID, pressure_at, 3.0)
    detector = PressDetector()
    found = [taxel for taxel in map(detector.find_press, states) if taxel is not None]
    assert found == [15] * count
