"""Tests of contacts at one instant, and of the tracks that follow them in time."""

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from eskin.touch import Adjacency, ContactConfig
from helpers.touch import (
    build_hinged_skin,
    build_mounted_grid,
    build_pipeline,
    press_pad,
    push_pressures,
    reading_at,
)

GRID = build_mounted_grid()
PAD = press_pad(GRID.skin, (0.02, 0.02))
NOTHING = np.zeros(36)
THRESHOLDS = ContactConfig(on=3.0, off=2.0)


def find_contacts(mounted, pressure, q=None):
    """Return the contacts of a first reading."""
    reading = reading_at(0.0, pressure, q=q)
    return build_pipeline(mounted).push_reading(reading).contacts


def count_contacts(pressures, rate=50, contacts=THRESHOLDS, valid=None):
    """Return the number of contacts at each reading of the small grid."""
    pipeline = build_pipeline(GRID, contacts=contacts)
    states = push_pressures(pipeline, pressures, rate, valid=valid)
    return [len(state.contacts) for state in states]


def find_tracks(mounted, pressures, rate=50, q=None, valid=None):
    """Return the tracks at each reading."""
    states = push_pressures(build_pipeline(mounted), pressures, rate, q, valid)
    return [state.tracks for state in states]


def ongoing_ids(tracks):
    """Return the ids of tracks that have not ended."""
    return [track.id for track in tracks if not track.ended]


def random_pressure(skin):
    """Return pressures of three in ten taxels, chosen at random."""
    rng = np.random.default_rng(5)
    pressure = np.where(rng.random(skin.count) < 0.3, 20 * rng.random(skin.count), 0.0)
    return pressure.astype(np.float32)


def two_pads(skin, distance):
    """Return pressures of two pads at a distance [m]; the right one is larger."""
    left = press_pad(skin, (0.1 - distance / 2, 0.02))
    right = press_pad(skin, (0.1 + distance / 2, 0.02), radius=0.015)
    return np.maximum(left, right)


def test_force_area_peak_and_centre_follow_from_the_taxels():
    pressure = press_pad(GRID.skin, (0.02, 0.02), kpa=10.0, radius=0.001)
    pressure += press_pad(GRID.skin, (0.03, 0.02), kpa=30.0, radius=0.001)
    (contact,) = find_contacts(GRID, pressure)
    assert contact.force == pytest.approx(40e3 * 1e-4)
    assert contact.area == pytest.approx(2e-4)
    assert contact.peak == pytest.approx(30.0)
    np.testing.assert_allclose(contact.p_world, [0.0275, 0.02, 0.0], atol=1e-9)
    np.testing.assert_allclose(contact.n_world, [0.0, 0.0, 1.0])
    assert (contact.link, contact.patch) == ("table", "p0")


def test_forces_of_contacts_add_up_to_that_of_the_active_taxels():
    pressure = random_pressure(GRID.skin)
    active = pressure >= ContactConfig().on
    force = 1e3 * (pressure * GRID.skin.areas)[active].sum()
    contacts = find_contacts(GRID, pressure)
    assert sum(contact.force for contact in contacts) == pytest.approx(force, rel=1e-6)


@pytest.mark.parametrize("q", [0.0, 0.2, 0.4, 1.5])
def test_contacts_are_the_components_of_taxels_within_reach(q):
    mounted = build_hinged_skin()
    angles = np.array([q])
    random = np.random.default_rng(int(10 * q)).random(mounted.skin.count)
    pressure = 9.0 * (random < 0.3)
    contacts = find_contacts(mounted, pressure, angles)
    active = np.flatnonzero(pressure)
    points, _ = mounted.place_taxels(angles, active)
    reach = Adjacency.build(mounted.skin, 1.6, 0.018).reach[active]
    near = cdist(points, points) <= np.maximum(reach[:, None], reach)
    count, label = connected_components(near)
    parts = {frozenset(active[label == n].tolist()) for n in range(count)}
    assert {frozenset(c.taxels.tolist()) for c in contacts} == parts


@pytest.mark.parametrize(
    ("pressures", "counts"),
    [
        ([0.0, 2.5, 3.5, 2.5, 1.5, 2.5], [0, 0, 1, 1, 0, 0]),
        ([5.0, 0.0, 2.5, 2.5, 3.5, 1.5, 2.5], [1, 0, 0, 0, 1, 0, 0]),
    ],
)
@pytest.mark.parametrize("rate", [3, 10, 100])
def test_active_taxel_stays_active_down_to_the_lower_threshold(pressures, counts, rate):
    scene = [press_pad(GRID.skin, (0.02, 0.02), kpa=kpa) for kpa in pressures]
    assert count_contacts(scene, rate) == counts


def test_residual_after_a_firm_touch_is_no_contact():
    scene = [PAD * (kpa / 20.0) for kpa in (60.0, 5.0, 5.0, 40.0)]
    assert count_contacts(scene, 10, ContactConfig()) == [1, 0, 0, 1]


def test_taxel_stays_active_over_one_lost_packet():
    valid = np.ones((3, 36), bool)
    valid[1] = False
    assert count_contacts([PAD / 5, PAD / 8, PAD / 8], valid=valid) == [1, 0, 1]


def test_invalid_taxels_and_nan_belong_to_no_contact():
    pressure = np.full(36, 50.0, np.float32)
    pressure[:6] = np.nan
    valid = np.array([np.zeros(36, bool), np.isfinite(pressure)])
    states = push_pressures(build_pipeline(GRID), [pressure] * 2, valid=valid)
    assert states[0].contacts == ()
    (contact,) = states[1].contacts
    assert contact.taxels.tolist() == list(range(6, 36))
    assert np.isfinite(contact.force)


@pytest.mark.parametrize("rate", [10, 100])
def test_stroke_across_patches_is_one_track(rate):
    mounted = build_mounted_grid(columns=8, patches=3)
    path = np.arange(0.0, 0.25, 0.4 / rate)
    scene = [press_pad(mounted.skin, (x, 0.02)) for x in path]
    found = find_tracks(mounted, scene, rate)
    assert {track.id for tracks in found for track in tracks} == {1}
    assert {tracks[0].contact.patch for tracks in found} == {"p0", "p1", "p2"}


def test_jump_beyond_the_gate_begins_another_track():
    mounted = build_mounted_grid(columns=20)
    scene = [press_pad(mounted.skin, (x, 0.02)) for x in (0.0, 0.0, 0.15, 0.15)]
    found = find_tracks(mounted, scene)
    assert list(map(ongoing_ids, found)) == [[1], [1], [2], [2]]
    assert [track.ended for track in found[2]] == [False, True]


def test_track_ends_with_its_contact():
    found = find_tracks(GRID, [PAD, PAD, NOTHING, PAD, NOTHING, NOTHING])
    assert list(map(ongoing_ids, found)) == [[1], [1], [], [2], [], []]
    (ended,) = found[2]
    assert ended.ended and ended.last == ended.onset + 20_000_000


def test_older_of_two_tracks_that_merge_keeps_its_id():
    mounted = build_mounted_grid(columns=21)
    first = press_pad(mounted.skin, (0.06, 0.02))
    merging = [two_pads(mounted.skin, d) for d in np.arange(0.08, 0.0, -0.01)]
    found = find_tracks(mounted, [first, *merging])
    assert (ongoing_ids(found[1]), ongoing_ids(found[-1])) == ([1, 2], [1])
    ended = [track for tracks in found for track in tracks if track.ended]
    assert [(track.id, track.merged_into) for track in ended] == [(2, 1)]


def test_larger_part_of_a_split_track_keeps_the_id():
    mounted = build_mounted_grid(columns=21)
    splitting = [two_pads(mounted.skin, d) for d in np.arange(0.0, 0.08, 0.01)]
    found = find_tracks(mounted, splitting)
    assert ongoing_ids(found[0]) == [1]
    one, two = found[-1]
    assert [(one.id, one.parent), (two.id, two.parent)] == [(1, None), (2, 1)]
    assert one.contact.area > two.contact.area


def test_two_tracks_that_pass_each_other_keep_their_ids():
    mounted = build_mounted_grid(rows=12, columns=12)
    scene = [
        np.maximum(
            press_pad(mounted.skin, (x, 0.02), radius=0.008),
            press_pad(mounted.skin, (0.11 - x, 0.08), radius=0.008),
        )
        for x in np.arange(0.01, 0.1, 0.02)
    ]
    for tracks in find_tracks(mounted, scene, rate=10):
        places = [(t.id, round(t.contact.p_world[1], 2)) for t in tracks]
        assert places == [(1, 0.02), (2, 0.08)]


@pytest.mark.parametrize(("lost", "last_id"), [(5, 1), (20, 2)])
def test_track_waits_a_short_time_for_lost_packets(lost, last_id):
    valid = np.ones((lost + 3, 36), bool)
    valid[1 : lost + 1] = False
    found = find_tracks(GRID, [PAD] * (lost + 3), valid=valid)
    assert ongoing_ids(found[-1]) == [last_id]


def test_motion_of_the_arm_is_not_motion_of_the_contact():
    mounted = build_hinged_skin()
    flap = mounted.skin.patch_index == 1
    scene = [20.0 * (flap & (mounted.skin.columns == column)) for column in (0, 2)]
    found = find_tracks(mounted, scene, q=np.array([[0.0], [1.5]]))
    assert ongoing_ids(found[1]) == [1]
