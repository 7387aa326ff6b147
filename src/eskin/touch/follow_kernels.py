"""One reading followed, compiled: from active taxels to touches."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Int

from eskin.compiled import compiled
from eskin.structref_kernels import Packed
from eskin.touch.contact_kernels import find_contacts
from eskin.touch.group_kernels import KNOWN, OVER, Groups
from eskin.touch.memory import Memory
from eskin.touch.records import TOUCH, TouchBrief, TouchRecords
from eskin.touch.room_kernels import CONTACTS, LOADS, Room, keep, make_room
from eskin.touch.rules import Instant, Rules
from eskin.touch.span_kernels import write_spans
from eskin.touch.touch_kernels import follow_touches
from eskin.touch.track_kernels import follow_tracks

BRIEF = len(TouchBrief._fields)


class FollowParts(NamedTuple):
    """What is the same at every reading."""

    rules: Rules
    """What is active, and what belongs together."""
    sites: np.ndarray
    """(taxel) SITE."""
    neighbours: np.ndarray
    """(pair) the spans of `sites`."""
    memory: Memory
    """Of the taxels; written to."""


@compiled
@no_type_check
def follow(
    candidates: Int[np.ndarray, "candidate"],
    reading: Instant,
    packed_parts: Packed,
    packed_before: Packed,
) -> tuple[Packed, Int[np.ndarray, "touch column"], int, int]:
    """Follow contacts, tracks and touches into the next reading.

    Args:
        candidates: all taxels of enough pressure to be active, ascending.
        reading: the next one.
        packed_parts: `FollowParts`.
        packed_before: `TouchRecords` of the reading before.

    Returns:
        `TouchRecords` of this reading; a `TouchBrief` of each touch; how many of them
        are open; and how many tracks there are.
    """
    parts, before = packed_parts.parts, packed_before.parts
    rules, memory, sites = parts.rules, parts.memory, parts.sites
    contacts, loads, points = find_contacts(
        candidates, reading, rules, sites, parts.neighbours, memory
    )
    room = make_room(contacts, loads, before)
    tracks, alive = follow_tracks(
        contacts, loads, before, reading, rules, sites, memory, room
    )
    groups = follow_touches(tracks, alive, points, before, reading, rules, memory, room)
    members = write_spans(tracks, alive, before, reading.stamp, room, groups)
    touches = in_order(before, room, groups)
    records = TouchRecords(
        room.contacts[: room.used[CONTACTS]],
        tracks,
        touches,
        room.loads[: room.used[LOADS]],
        members,
    )
    going = len(touches) - groups.used[OVER]
    return Packed(records), briefs_of(touches), going, len(tracks)


@compiled
@no_type_check
def briefs_of(touches: np.ndarray) -> Int[np.ndarray, "touch column"]:
    """The fields of a `TouchBrief` of each touch."""
    briefs = np.empty((len(touches), BRIEF), np.int64)
    for n in range(len(touches)):
        touch, brief = touches[n], briefs[n]
        brief[0], brief[1], brief[2] = touch.id, touch.onset, touch.last
        brief[3], brief[4] = touch.merged_into, touch.closed
    return briefs


@compiled
@no_type_check
def in_order(before: TouchRecords, room: Room, groups: Groups) -> np.ndarray:
    """Open touches, then those that have closed; their contacts are kept."""
    touches = np.empty(groups.used[KNOWN], TOUCH)
    count = 0
    for n in range(groups.used[KNOWN]):
        touch = groups.touches[n]
        if not groups.renewed[n]:
            touch.contact = keep(touch.contact, before, room)
        if not touch.closed:
            touches[count] = touch
            count += 1
    for n in groups.over[: groups.used[OVER]]:
        touches[count] = groups.touches[n]
        count += 1
    return touches
