"""Tests of touch records: those of one instant, which never change again."""

import numpy as np
import pytest

from eskin.errors import ReadingError
from helpers.touch import (
    START,
    build_hinged_skin,
    build_mounted_grid,
    build_pipeline,
    press_pad,
    push_pressures,
    reading_at,
)

WIDE = build_mounted_grid(columns=40)


def describe(state):
    """Return all that a state tells as plain values."""
    return (
        [(c.taxels.tolist(), c.force, c.p_world.tolist()) for c in state.contacts],
        [(t.id, t.last, t.ended, t.contact.force) for t in state.tracks],
        [
            (t.id, t.last, t.tracks, t.impulse, t.latest.tolist(), t.merged_into)
            for t in (*state.touches, *state.closed_touches)
        ],
    )


def press_two_hands(t):
    """Return the pressures of two hands that come together and leave."""
    left, right = 0.05 + 0.07 * t, 0.25 - 0.07 * t
    pads = (
        press_pad(WIDE.skin, (left, 0.02), 10.0 + t, radius=0.015),
        press_pad(WIDE.skin, (right, 0.02), 20.0 + t, radius=0.015),
    )
    return np.maximum(*pads) * (t <= 1.2)


def test_state_is_the_same_whenever_it_is_read():
    early = build_pipeline(WIDE)
    late = build_pipeline(WIDE)
    described = []
    states = []
    for t in np.arange(0.0, 2.0, 0.02):
        reading = reading_at(t, press_two_hands(t))
        described.append(describe(early.push_reading(reading)))
        states.append(late.push_reading(reading))
    assert list(map(describe, states)) == described
    assert {len(touches) for _, _, touches in described} == {0, 1, 2}


def test_changing_a_state_does_not_change_later_states():
    one = build_pipeline(WIDE)
    other = build_pipeline(WIDE)
    for n in range(50):
        # The pad jumps, so that tracks are continued from the places of contacts.
        pressure = press_pad(WIDE.skin, (0.05 + 0.03 * (n % 3), 0.02), 9.0 + n)
        reading = reading_at(n / 50, pressure)
        state = one.push_reading(reading)
        assert describe(state) == describe(other.push_reading(reading))
        for contact in (*state.contacts, *(touch.contact for touch in state.touches)):
            contact.taxels[:] = 0
            contact.p_world[:] = contact.p_link[:] = 7.0
        for touch in state.touches:
            touch.start[:] = touch.latest[:] = 7.0


def test_touch_has_its_taxels_of_this_reading_and_the_one_before():
    pipeline = build_pipeline(WIDE)
    count = WIDE.skin.count
    before = np.zeros(count)
    onset = np.zeros(count, np.int64)
    for n in range(40):
        now = press_two_hands(n / 20)
        reading = reading_at(n / 20, now)
        state = pipeline.push_reading(reading)
        onset[(now > 0) & (before == 0)] = reading.stamp
        for name, expected in (("taxels", now), ("before", before)):
            got = np.zeros(count, bool)
            for touch in state.tracking.open:
                taxels = getattr(touch, name)
                assert not got[taxels].any()
                got[taxels] = True
            np.testing.assert_array_equal(got, expected > 0)
        for contact in state.tracking.contacts:
            assert contact.onset == onset[contact.taxels].min()
        before = now


def test_touch_counts_its_contacts_and_its_greatest_distance():
    places = [0.1, 0.14, None, None, 0.12, None, None, 0.1]
    nothing = np.zeros(WIDE.skin.count)
    scene = [nothing if x is None else press_pad(WIDE.skin, (x, 0.02)) for x in places]
    states = push_pressures(build_pipeline(WIDE), scene, rate=20)
    touches = [touch for state in states for touch in state.rows]
    assert [touch.contacts for touch in touches] == [1, 1, 1, 1, 2, 2, 2, 3]
    farthest = [touch.farthest for touch in touches]
    assert farthest == pytest.approx([0.0, *[0.04] * 7], abs=1e-6)


def test_number_of_contacts_is_not_limited():
    mounted = build_mounted_grid(rows=60, columns=60)
    apart = (mounted.skin.rows % 3 == 0) & (mounted.skin.columns % 3 == 0)
    few = 9.0 * (np.arange(3600) < 3)
    many = 9.0 * apart
    first, *others = push_pressures(build_pipeline(mounted), [few, many, many], 10)
    assert len(first.contacts) == 1
    for state in others:
        taxels = [contact.taxels.tolist() for contact in state.contacts]
        assert taxels == [[taxel] for taxel in np.flatnonzero(apart).tolist()]
        [touch] = state.touches
        assert touch.tracks == tuple(range(1, 401))


def test_refused_reading_changes_nothing():
    mounted = build_hinged_skin()
    one = build_pipeline(mounted)
    other = build_pipeline(mounted)
    pressure = press_pad(mounted.skin, (0.03, 0.02), kpa=9.0)
    refused = {
        "5 taxels.*72": reading_at(9.0, np.full(5, 9.0), q=np.zeros(1)),
        "3 joints.*'hinged' has 1": reading_at(9.0, pressure, q=np.zeros(3)),
        "later": reading_at(0.0, pressure, q=np.zeros(1)),
    }
    for n in range(4):
        reading = reading_at(n / 50, pressure * (1 + n), q=np.zeros(1))
        expected = describe(other.push_reading(reading))
        assert describe(one.push_reading(reading)) == expected
        for text, bad in refused.items():
            with pytest.raises(ReadingError, match=text):
                one.push_reading(bad)
    assert [t.impulse for t in one.finish()] == [t.impulse for t in other.finish()]


def test_untouched_skin_has_empty_records_and_time_goes_on():
    mounted = build_mounted_grid()
    pipeline = build_pipeline(mounted)
    for state in push_pressures(pipeline, np.zeros((3, 36))):
        assert not any(map(len, state.tracking))
    pipeline.push_reading(reading_at(1.0, press_pad(mounted.skin, (0.02, 0.02))))
    [touch] = pipeline.finish()
    assert touch.onset == START + 1_000_000_000
