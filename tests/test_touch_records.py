"""What is known of touch at one instant, as arrays: it stays what it was."""

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from eskin.errors import ReadingError
from eskin.touch import TOUCH, Adjacency, TouchRecord
from eskin.touch.contact_kernels import find_candidates
from helpers.touch import (
    START,
    hinged_skin,
    mounted_grid,
    pipeline_of,
    pressed,
    reading_at,
)

WIDE = {"rows": 6, "columns": 40}
NS = 1_000_000_000


def described(state):
    """All that a state tells, as plain values."""
    contacts = [
        (c.taxels.tolist(), c.force, c.p_world.tolist()) for c in state.contacts
    ]
    tracks = [(t.id, t.last, t.ended, t.contact.force) for t in state.tracks]
    touches = [
        (t.id, t.last, t.tracks, t.impulse, t.latest.tolist(), t.closed, t.merged_into)
        for t in (*state.touches, *state.closed_touches)
    ]
    return contacts, tracks, touches


def two_hands(mounted, t):
    """Two hands that come together and leave."""
    if t > 1.2:
        return np.zeros(mounted.skin.count)
    left, right = 0.05 + 0.07 * t, 0.25 - 0.07 * t
    return np.maximum(
        pressed(mounted.skin, (left, 0.02), 10.0 + t, radius=0.015),
        pressed(mounted.skin, (right, 0.02), 20.0 + t, radius=0.015),
    )


def test_a_state_is_the_same_whenever_it_is_asked():
    mounted = mounted_grid(**WIDE)
    early, late = pipeline_of(mounted), pipeline_of(mounted)
    told, states = [], []
    for t in np.arange(0.0, 2.0, 0.02):
        reading = reading_at(t, two_hands(mounted, t))
        told.append(described(early.push_reading(reading)))
        states.append(late.push_reading(reading))
    assert [described(state) for state in states] == told
    assert {len(touches) for _, _, touches in told} == {0, 1, 2}


def test_what_is_done_to_a_state_does_not_change_what_follows():
    mounted = mounted_grid(**WIDE)
    one, other = pipeline_of(mounted), pipeline_of(mounted)
    for n in range(50):
        # It jumps, so that the way on leads over the places of contacts.
        jump = pressed(mounted.skin, (0.05 + 0.03 * (n % 3), 0.02), 9.0 + n)
        reading = reading_at(n / 50, jump)
        state = one.push_reading(reading)
        assert described(state) == described(other.push_reading(reading))
        for contact in (*state.contacts, *(touch.contact for touch in state.touches)):
            contact.taxels[:] = 0
            contact.p_world[:] = contact.p_link[:] = 7.0
        for touch in state.touches:
            touch.start[:] = touch.latest[:] = 7.0


def test_a_touch_has_its_loads_of_now_and_of_one_reading_ago():
    mounted = mounted_grid(**WIDE)
    pipeline = pipeline_of(mounted)
    count = mounted.skin.count
    before, onset = np.zeros(count), np.zeros(count, np.int64)
    for n in range(40):
        pressure = two_hands(mounted, n / 20)
        reading = reading_at(n / 20, pressure)
        records = pipeline.push_reading(reading).records
        now = np.where(pressure > 0, pressure, 0.0)
        onset[(now > 0) & (before == 0)] = reading.stamp
        for span, want in (("loads", now), ("before", before)):
            got = np.zeros(count)
            for touch in records.touches[records.touches["closed"] == 0]:
                loads = records.loads[slice(*touch[span])]
                assert not got[loads["taxel"]].any()
                got[loads["taxel"]] = loads["pressure"]
                if span == "loads":
                    assert loads["onset"].tolist() == onset[loads["taxel"]].tolist()
            np.testing.assert_allclose(got, want, rtol=1e-6)
        before = now


def test_a_touch_counts_its_contacts_and_keeps_its_farthest():
    mounted = mounted_grid(**WIDE)
    pipeline = pipeline_of(mounted)
    found = []
    for n, x in enumerate([0.1, 0.14, None, None, 0.12, None, None, 0.1]):
        load = np.zeros(mounted.skin.count)
        load = load if x is None else pressed(mounted.skin, (x, 0.02))
        [touch] = pipeline.push_reading(reading_at(n / 20, load)).rows
        found.append((touch.contacts, round(touch.farthest, 6)))
    assert [count for count, _ in found] == [1, 1, 1, 1, 2, 2, 2, 3]
    assert [far for _, far in found] == [0.0, *[0.04] * 7]


def test_there_may_be_any_number_of_contacts_at_once():
    mounted = mounted_grid(rows=60, columns=60)
    apart = (mounted.skin.rows % 3 == 0) & (mounted.skin.columns % 3 == 0)
    pipeline = pipeline_of(mounted)
    few = pipeline.push_reading(reading_at(0.0, np.where(np.arange(3600) < 3, 9, 0)))
    many = pipeline.push_reading(reading_at(0.1, np.where(apart, 9.0, 0.0)))
    again = pipeline.push_reading(reading_at(0.2, np.where(apart, 9.0, 0.0)))
    assert len(few.contacts) == 1
    for state in (many, again):
        assert [c.taxels.tolist() for c in state.contacts] == [
            [taxel] for taxel in np.flatnonzero(apart).tolist()
        ]
        [touch] = state.touches
        assert touch.tracks == tuple(range(1, 401))


def test_a_reading_that_is_refused_changes_nothing():
    mounted = hinged_skin()
    one, other = pipeline_of(mounted), pipeline_of(mounted)
    load = pressed(mounted.skin, (0.03, 0.02), kpa=9.0)
    refused = [
        reading_at(9.0, np.full(5, 9.0), q=np.zeros(1)),
        reading_at(9.0, load, q=np.zeros(3)),
        reading_at(0.0, load, q=np.zeros(1)),
    ]
    for n in range(4):
        reading = reading_at(n / 50, load * (1 + n), q=np.zeros(1))
        assert described(one.push_reading(reading)) == described(
            other.push_reading(reading)
        )
        for bad in refused:
            with pytest.raises(ReadingError):
                one.push_reading(bad)
    assert [t.impulse for t in one.finish()] == [t.impulse for t in other.finish()]


@pytest.mark.parametrize("q", [0.0, 0.2, 0.4, 1.5])
def test_contacts_are_all_that_is_within_reach_in_the_pose(q):
    mounted = hinged_skin()
    rng = np.random.default_rng(int(10 * q))
    pressure = np.where(rng.random(mounted.skin.count) < 0.3, 9.0, 0.0)
    state = pipeline_of(mounted).push_reading(
        reading_at(0.0, pressure, q=np.array([q]))
    )
    active = np.flatnonzero(pressure)
    points, _ = mounted.place_taxels(np.array([q]), active)
    reach = Adjacency.build(mounted.skin, 1.6, 0.018).reach[active]
    near = cdist(points, points) <= np.maximum(reach[:, None], reach)
    count, label = connected_components(near)
    parts = {frozenset(active[label == n].tolist()) for n in range(count)}
    assert {frozenset(c.taxels.tolist()) for c in state.contacts} == parts


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 1000])
def test_candidates_are_all_taxels_of_enough_pressure(count):
    pressure = np.random.default_rng(count).random(count).astype(np.float32)
    pressure[::7] = np.nan
    for least in (0.5, 0.99, 2.0):
        out = np.empty(count, np.int64)
        found = out[: find_candidates(pressure, np.float32(least), out)]
        want = np.flatnonzero(pressure >= np.float32(least))
        assert found.tolist() == want.tolist()


def test_an_untouched_skin_tells_nothing_and_time_goes_on():
    mounted = mounted_grid()
    pipeline = pipeline_of(mounted)
    for n in range(3):
        state = pipeline.push_reading(reading_at(n / 50, np.zeros(36)))
        assert not any(len(part) for part in state.records)
    pipeline.push_reading(reading_at(1.0, pressed(mounted.skin, (0.02, 0.02))))
    [touch] = pipeline.finish()
    assert touch.onset == START + NS


def test_a_row_is_a_record_by_the_same_names():
    assert TouchRecord._fields == TOUCH.names
