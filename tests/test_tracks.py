import numpy as np
import pytest

from eskin.errors import ReadingError
from eskin.skin import MountedSkin
from helpers.touch import (
    hinged_skin,
    mounted_grid,
    moved,
    permuted,
    pipeline_of,
    pressed,
    reading_at,
)


def follow(mounted, pressures, rate=50, q=None, valid=None):
    """Push pressures, one a reading; return the tracks of each."""
    pipeline, said = pipeline_of(mounted), []
    for step, pressure in enumerate(pressures):
        seen = None if valid is None else valid[step]
        reading = reading_at(
            step / rate, pressure, seen, None if q is None else q[step]
        )
        said.append(pipeline.push_reading(reading).tracks)
    return said


def ids(tracks):
    return [track.id for track in tracks if not track.ended]


@pytest.mark.parametrize("rate", [10, 100])
def test_a_stroke_across_patches_keeps_one_id(rate):
    mounted = mounted_grid(columns=8, patches=3)
    path = np.arange(0.0, 0.25, 0.4 / rate)
    said = follow(mounted, [pressed(mounted.skin, (x, 0.02)) for x in path], rate)
    assert {track.id for tracks in said for track in tracks} == {1}
    patches = [tracks[0].contact.patch for tracks in said]
    assert set(patches) == {"p0", "p1", "p2"}


def test_a_jump_beyond_the_gate_is_another_track():
    mounted = mounted_grid(columns=20)
    places = [0.0, 0.0, 0.15, 0.15]
    said = follow(mounted, [pressed(mounted.skin, (x, 0.02)) for x in places])
    assert [ids(tracks) for tracks in said] == [[1], [1], [2], [2]]
    assert [track.ended for track in said[2]] == [False, True]


def test_lifting_off_ends_the_track_at_once():
    mounted = mounted_grid()
    touch, nothing = pressed(mounted.skin, (0.02, 0.02)), np.zeros(36)
    said = follow(mounted, [touch, touch, nothing, touch, nothing, nothing])
    assert [ids(tracks) for tracks in said] == [[1], [1], [], [2], [], []]
    (ended,) = said[2]
    assert ended.ended
    assert ended.last == ended.onset + 20_000_000


def two(mounted, distance, left=20.0, right=20.0):
    """Presses left and right of the middle, as far apart as said [m]."""
    a, b = 0.1 - distance / 2, 0.1 + distance / 2
    return np.maximum(
        pressed(mounted.skin, (a, 0.02), left),
        pressed(mounted.skin, (b, 0.02), right, radius=0.015),
    )


def test_where_two_become_one_the_older_keeps_its_id():
    mounted = mounted_grid(columns=21)
    single = pressed(mounted.skin, (0.06, 0.02))
    way = [two(mounted, d) for d in np.arange(0.08, 0.0, -0.01)]
    said = follow(mounted, [single, *way])
    assert ids(said[1]) == [1, 2]
    assert ids(said[-1]) == [1]
    merged = [track for tracks in said for track in tracks if track.ended]
    assert [(track.id, track.merged_into) for track in merged] == [(2, 1)]


def test_where_one_becomes_two_the_larger_part_keeps_the_id():
    mounted = mounted_grid(columns=21)
    said = follow(mounted, [two(mounted, d) for d in np.arange(0.0, 0.08, 0.01)])
    assert ids(said[0]) == [1]
    last = {track.id: track for track in said[-1]}
    assert set(last) == {1, 2}
    assert last[1].contact.area > last[2].contact.area
    assert (last[1].parent, last[2].parent) == (None, 1)


def test_two_that_pass_close_by_at_speed_keep_their_ids():
    mounted = mounted_grid(rows=12, columns=12)
    steps = np.arange(0.01, 0.1, 0.02)
    scene = [
        np.maximum(
            pressed(mounted.skin, (x, 0.02), radius=0.008),
            pressed(mounted.skin, (0.11 - x, 0.08), radius=0.008),
        )
        for x in steps
    ]
    said = follow(mounted, scene, rate=10)
    for tracks in said:
        assert [(t.id, round(t.contact.p_world[1], 2)) for t in tracks] == [
            (1, 0.02),
            (2, 0.08),
        ]


def test_a_track_waits_for_a_lost_packet_but_not_for_long():
    mounted = mounted_grid()
    touch = pressed(mounted.skin, (0.02, 0.02))
    for lost, expected in ((5, [1]), (20, [2])):
        seen = np.ones((lost + 3, 36), bool)
        seen[1 : lost + 1] = False
        said = follow(mounted, [touch] * (lost + 3), valid=seen)
        assert ids(said[-1]) == expected


def test_no_track_survives_a_gap_in_the_readings():
    mounted = mounted_grid()
    touch = pressed(mounted.skin, (0.02, 0.02))
    said = follow(mounted, [touch, touch], rate=1)
    assert [(t.id, t.ended) for t in said[1]] == [(2, False), (1, True)]


def test_the_motion_of_the_arm_is_not_the_motion_of_the_touch():
    mounted = hinged_skin()
    skin = mounted.skin
    dot = np.zeros((2, skin.count))
    for step, column in enumerate((0, 2)):
        dot[step, (skin.patch_index == 1) & (skin.columns == column)] = 20.0
    q = np.array([[0.0], [1.5]])
    said = follow(mounted, dot, rate=50, q=q)
    assert ids(said[1]) == [1]


def random_walks(skin, steps=60):
    rng = np.random.default_rng(6)
    at = np.array([[0.02, 0.02], [0.09, 0.06], [0.14, 0.02]])
    scene = []
    for step in range(steps):
        at = at + rng.normal(0, 0.006, at.shape)
        here = [pressed(skin, p, 8.0 + 3 * n) for n, p in enumerate(at)]
        here = here[: 1 + (step // 10) % 3]
        scene.append(np.max(here, axis=0))
    return scene


def described(said):
    return [
        [(t.id, t.onset, t.last, t.parent, t.merged_into, t.ended) for t in tracks]
        for tracks in said
    ]


def test_tracks_do_not_depend_on_the_order_of_the_taxels():
    mounted = mounted_grid(rows=9, columns=9, patches=2)
    order = np.random.default_rng(7).permutation(mounted.skin.count)
    other = MountedSkin(permuted(mounted.skin, order), mounted.robot)
    scene = random_walks(mounted.skin)
    one = described(follow(mounted, scene))
    assert max(track[0] for tracks in one for track in tracks) > 5
    assert one == described(follow(other, [pressure[order] for pressure in scene]))


def test_tracks_do_not_depend_on_a_rigid_motion_of_the_robot():
    one = hinged_skin()
    other = hinged_skin(moved(np.array([0.3, -0.7, 0.9]), np.array([1.0, 2.0, -3.0])))
    scene = random_walks(one.skin)
    q = np.linspace(0.0, 1.0, len(scene))[:, None]
    first, second = follow(one, scene, q=q), follow(other, scene, q=q)
    assert described(first) == described(second)


def test_stamps_that_do_not_advance_are_refused():
    mounted = mounted_grid()
    pipeline = pipeline_of(mounted)
    pipeline.push_reading(reading_at(1.0, np.zeros(36)))
    with pytest.raises(ReadingError, match="allowed is only later"):
        pipeline.push_reading(reading_at(1.0, np.zeros(36)))
