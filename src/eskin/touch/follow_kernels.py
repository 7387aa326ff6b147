"""One reading followed, compiled: from active taxels to touches."""

from typing import no_type_check

import numpy as np
from jaxtyping import Int
from numba import njit

from eskin.touch.contact_kernels import find_contacts
from eskin.touch.group_kernels import KNOWN, OVER, Groups
from eskin.touch.memory import Memory
from eskin.touch.records import TOUCH, TouchRecords
from eskin.touch.room_kernels import CONTACTS, LOADS, Room, keep, make_room
from eskin.touch.rules import Instant, Rules
from eskin.touch.span_kernels import write_spans
from eskin.touch.touch_kernels import follow_touches
from eskin.touch.track_kernels import follow_tracks


@njit(cache=True, nogil=True)
@no_type_check
def follow(
    candidates: Int[np.ndarray, "candidate"],
    reading: Instant,
    rules: Rules,
    sites: np.ndarray,
    neighbours: Int[np.ndarray, "pair"],
    memory: Memory,
    before: TouchRecords,
) -> TouchRecords:
    """Follow contacts, tracks and touches into the next reading.

    Args:
        candidates: all taxels of enough pressure to be active, ascending.
        reading: the next one.
        rules: what is active, and what belongs together.
        sites: SITE of every taxel.
        neighbours: the spans of `sites`.
        memory: of the taxels; written to.
        before: the records of the reading before.
    """
    contacts, loads, points = find_contacts(
        candidates, reading, rules, sites, neighbours, memory
    )
    room = make_room(contacts, loads, before)
    tracks, alive = follow_tracks(
        contacts, loads, before, reading, rules, sites, memory, room
    )
    groups = follow_touches(tracks, alive, points, before, reading, rules, memory, room)
    members = write_spans(tracks, alive, before, reading.stamp, room, groups)
    touches = in_order(before, room, groups)
    return TouchRecords(
        room.contacts[: room.used[CONTACTS]],
        tracks,
        touches,
        room.loads[: room.used[LOADS]],
        members,
    )


@njit(cache=True, nogil=True)
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
