"""Compiled kernels that track contacts and touches into the next reading.

They run the stages of a reading, and write the records of its touches. `update` holds
its tracks, and the touches while they are updated.
"""
# The types of compiled code are those that numba infers.
# pyright: reportAttributeAccessIssue=false

import numpy as np
from jaxtyping import Int

from eskin.compiled import Packed, compiled
from eskin.touch.contact_kernels import find_contacts
from eskin.touch.grouping_kernels import (
    ALL,
    CLOSED,
    PREVIOUS,
    TouchUpdate,
    find_survivor,
    group_tracks,
)
from eskin.touch.records import (
    NO_INDEX,
    TOUCH,
    KernelReading,
    TouchRecords,
    TouchStatus,
)
from eskin.touch.track_kernels import (
    CONTACTS,
    LOADS,
    append_loads,
    build_buffer,
    copy_contact_with_loads,
    track_contacts,
)

STATUS_SIZE = len(TouchStatus._fields)


@compiled
def write_spans(stamp: int, update: TouchUpdate) -> Int[np.ndarray, "member"]:
    """Write the spans of all touches, and the touch of each track.

    Returns:
        `TouchRecords.members`.
    """
    tracks = update.tracks
    for track in range(len(tracks)):
        owner = update.owners[track]
        tracks[track].touch = 0
        if owner != NO_INDEX:
            update.owners[track] = find_survivor(owner, update)
            tracks[track].touch = update.touches[update.owners[track]].id
    for n in range(update.counts[ALL]):
        touch = update.touches[n]
        touch.loads[0] = touch.loads[1] = touch.before[0] = touch.before[1] = 0
        if not touch.closed:
            write_loads(n, stamp, update)
            write_previous_loads(n, update)
    return write_members(update)


@compiled
def write_loads(n: int, stamp: int, update: TouchUpdate) -> None:
    """Write the span of a touch's loads; those of several contacts are copied first."""
    tracks, buffer = update.tracks[: update.ongoing], update.buffer
    span, parts = update.touches[n].loads, 0
    for track in range(len(tracks)):
        if update.owners[track] == n and tracks[track].last == stamp:
            own = buffer.contacts[tracks[track].contact].loads
            span[0], span[1] = own[0], own[1]
            parts += 1
    if parts < 2:
        return
    span[0] = buffer.used[LOADS]
    for track in range(len(tracks)):
        if update.owners[track] == n and tracks[track].last == stamp:
            own = buffer.contacts[tracks[track].contact].loads
            span[1] = append_loads(buffer.loads[own[0] : own[1]], buffer)


@compiled
def write_previous_loads(n: int, update: TouchUpdate) -> None:
    """Write the previous loads of a touch and of those merged into it."""
    buffer, before = update.buffer, update.buffer.before
    span = update.touches[n].before
    span[0] = span[1] = buffer.used[LOADS]
    for other in range(update.counts[PREVIOUS]):
        if find_survivor(other, update) == n:
            old_span = before.touches[other].loads
            span[1] = append_loads(before.loads[old_span[0] : old_span[1]], buffer)


@compiled
def write_members(update: TouchUpdate) -> Int[np.ndarray, "member"]:
    """Write the ids of the tracks of each touch, ascending.

    The tracks of a touch count for those into which it is merged too.
    """
    tracks, before = update.tracks, update.buffer.before
    ends = np.zeros(update.counts[ALL] + 1, np.int64)
    for n in range(update.counts[PREVIOUS]):
        span = before.touches[n].tracks
        count_members(n, span[1] - span[0], ends, update)
    for track in range(len(tracks)):
        count_members(update.joined[track], 1, ends, update)
    for n in range(update.counts[ALL]):
        ends[n + 1] += ends[n]
        update.touches[n].tracks[0] = update.touches[n].tracks[1] = ends[n]
    members = np.empty(ends[-1], np.int64)
    for n in range(update.counts[PREVIOUS]):
        span = before.touches[n].tracks
        for k in range(span[0], span[1]):
            add_member(n, before.members[k], members, update)
    for track in range(len(tracks)):
        add_member(update.joined[track], tracks[track].id, members, update)
    for n in range(update.counts[ALL]):
        span = update.touches[n].tracks
        for k in range(span[0] + 1, span[1]):  # by insertion: most are in order
            member, place = members[k], k
            while place > span[0] and members[place - 1] > member:
                members[place] = members[place - 1]
                place -= 1
            members[place] = member
    return members


@compiled
def count_members(
    touch: int, count: int, ends: Int[np.ndarray, "touch_and_one"], update: TouchUpdate
) -> None:
    """Count tracks for a touch and for those into which it is merged."""
    while touch != NO_INDEX:
        ends[touch + 1] += count
        touch = update.survivors[touch]


@compiled
def add_member(
    touch: int, track: int, members: Int[np.ndarray, "member"], update: TouchUpdate
) -> None:
    """Write a track for a touch and for those into which it is merged."""
    while touch != NO_INDEX:
        span = update.touches[touch].tracks
        members[span[1]] = track
        span[1] += 1
        touch = update.survivors[touch]


@compiled
def track_touches(
    candidates: Int[np.ndarray, "candidate"],
    reading: KernelReading,
    packed_context: Packed,
    packed_before: Packed,
) -> tuple[Packed, Int[np.ndarray, "touch column"], int, int]:
    """Track contacts and touches into the next reading.

    `candidates` are all taxels of enough pressure to be active, ascending; the context
    is a `TrackerContext`, and `packed_before` the `TouchRecords` of the previous
    reading.

    Returns:
        `TouchRecords` of this reading; the `TouchStatus` of each touch as a row; the
            number of open touches; and the number of tracks.
    """
    context, before = packed_context.parts, packed_before.parts
    contacts, loads, points = find_contacts(candidates, reading, context)
    buffer = build_buffer(contacts, loads, before)
    tracks, ongoing = track_contacts(contacts, loads, reading, context, buffer)
    update = group_tracks(tracks, ongoing, points, reading, context, buffer)
    members = write_spans(reading.stamp, update)
    touches = collect_touches(update)
    records = TouchRecords(
        buffer.contacts[: buffer.used[CONTACTS]],
        tracks,
        touches,
        buffer.loads[: buffer.used[LOADS]],
        members,
    )
    open_count = len(touches) - update.counts[CLOSED]
    return Packed(records), build_statuses(touches), open_count, len(tracks)


@compiled
def build_statuses(touches: np.ndarray) -> Int[np.ndarray, "touch column"]:
    """Return the `TouchStatus` of each touch as a row."""
    statuses = np.empty((len(touches), STATUS_SIZE), np.int64)
    for n in range(len(touches)):
        touch, status = touches[n], statuses[n]
        status[0], status[1], status[2] = touch.id, touch.onset, touch.last
        status[3], status[4] = touch.merged_into, touch.closed
        status[5] = touch.confirmed
    return statuses


@compiled
def collect_touches(update: TouchUpdate) -> np.ndarray:
    """Return open touches, then closed ones, and copy their contacts to the buffer."""
    touches = np.empty(update.counts[ALL], TOUCH)
    count = 0
    for n in range(update.counts[ALL]):
        touch = update.touches[n]
        if not update.renewed[n]:
            touch.contact = copy_contact_with_loads(touch.contact, update.buffer)
        if not touch.closed:
            touches[count] = touch
            count += 1
    for n in update.closed[: update.counts[CLOSED]]:
        touches[count] = update.touches[n]
        count += 1
    return touches
