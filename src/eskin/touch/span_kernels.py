"""Which taxels and which tracks each touch has, written one behind the other."""

from typing import no_type_check

import numpy as np
from jaxtyping import Int

from eskin.compiled import compiled
from eskin.touch.group_kernels import KNOWN, NOBODY, OLDER, Groups, heir_of
from eskin.touch.records import TouchRecords
from eskin.touch.room_kernels import LOADS, Room, add_loads


@compiled
@no_type_check
def write_spans(
    tracks: np.ndarray,
    alive: int,
    before: TouchRecords,
    stamp: int,
    room: Room,
    groups: Groups,
) -> Int[np.ndarray, "member"]:
    """Write the spans of all touches and the touch of each track.

    Args:
        tracks: TRACK, those that go on in front.
        alive: how many go on.
        before: the records of the reading before.
        stamp: of this reading [ns].
        room: where the loads are written.
        groups: the touches, brought up to date.

    Returns:
        The ids of the tracks of each touch.
    """
    for track in range(len(tracks)):
        owner = groups.owners[track]
        tracks[track].touch = 0
        if owner != NOBODY:
            groups.owners[track] = heir_of(owner, groups)
            tracks[track].touch = groups.touches[groups.owners[track]].id
    for n in range(groups.used[KNOWN]):
        touch = groups.touches[n]
        touch.loads[0] = touch.loads[1] = touch.before[0] = touch.before[1] = 0
        if not touch.closed:
            write_loads(n, tracks[:alive], stamp, room, groups)
            write_before(n, before, room, groups)
    return write_members(tracks, before, groups)


@compiled
@no_type_check
def write_loads(
    n: int, tracks: np.ndarray, stamp: int, room: Room, groups: Groups
) -> None:
    """Write the loads that a touch has now; those of one contact are there already."""
    span, parts = groups.touches[n].loads, 0
    for track in range(len(tracks)):
        if groups.owners[track] == n and tracks[track].last == stamp:
            own = room.contacts[tracks[track].contact].loads
            span[0], span[1] = own[0], own[1]
            parts += 1
    if parts < 2:
        return
    span[0] = room.used[LOADS]
    for track in range(len(tracks)):
        if groups.owners[track] == n and tracks[track].last == stamp:
            own = room.contacts[tracks[track].contact].loads
            span[1] = add_loads(room.loads[own[0] : own[1]], room)


@compiled
@no_type_check
def write_before(n: int, before: TouchRecords, room: Room, groups: Groups) -> None:
    """Write the loads that a touch, and those it has taken over, had a reading ago."""
    span = groups.touches[n].before
    span[0] = span[1] = room.used[LOADS]
    for other in range(groups.used[OLDER]):
        if heir_of(other, groups) == n:
            had = before.touches[other].loads
            span[1] = add_loads(before.loads[had[0] : had[1]], room)


@compiled
@no_type_check
def write_members(
    tracks: np.ndarray, before: TouchRecords, groups: Groups
) -> Int[np.ndarray, "member"]:
    """Write the ids of the tracks of each touch, ascending.

    What a touch has and what joins it is also of those that take it over.
    """
    ends = np.zeros(groups.used[KNOWN] + 1, np.int64)
    for n in range(groups.used[OLDER]):
        span = before.touches[n].tracks
        count_members(n, span[1] - span[0], ends, groups)
    for track in range(len(tracks)):
        count_members(groups.joined[track], 1, ends, groups)
    for n in range(groups.used[KNOWN]):
        ends[n + 1] += ends[n]
        groups.touches[n].tracks[0] = groups.touches[n].tracks[1] = ends[n]
    members = np.empty(ends[-1], np.int64)
    for n in range(groups.used[OLDER]):
        span = before.touches[n].tracks
        for k in range(span[0], span[1]):
            add_member(n, before.members[k], members, groups)
    for track in range(len(tracks)):
        add_member(groups.joined[track], tracks[track].id, members, groups)
    for n in range(groups.used[KNOWN]):
        span = groups.touches[n].tracks
        for k in range(span[0] + 1, span[1]):
            if members[k] < members[k - 1]:
                members[span[0] : span[1]].sort()
                break
    return members


@compiled
@no_type_check
def count_members(
    touch: int, count: int, ends: Int[np.ndarray, "touch_and_one"], groups: Groups
) -> None:
    """Count tracks of a touch for it and for its heirs."""
    while touch != NOBODY:
        ends[touch + 1] += count
        touch = groups.heirs[touch]


@compiled
@no_type_check
def add_member(
    touch: int, track: int, members: Int[np.ndarray, "member"], groups: Groups
) -> None:
    """Write a track of a touch for it and for its heirs."""
    while touch != NOBODY:
        span = groups.touches[touch].tracks
        members[span[1]] = track
        span[1] += 1
        touch = groups.heirs[touch]
