"""The touches of a reading while they are brought up to date."""

from typing import NamedTuple, no_type_check

import numpy as np

from eskin.compiled import compiled
from eskin.touch.memory import NEXT_TOUCH, Memory
from eskin.touch.records import TOUCH, TouchRecords
from eskin.touch.room_kernels import Room

NOBODY = -1
KNOWN, OVER, OLDER = 0, 1, 2
"""What `Groups.used` counts: all touches, those of them that have closed, and those
that were open at the reading before."""


class Groups(NamedTuple):
    """The touches of a reading while they are brought up to date."""

    touches: np.ndarray
    """(touch) TOUCH: those open at the reading before, then new ones."""
    heirs: np.ndarray
    """(touch) who has taken it over, or -1."""
    over: np.ndarray
    """(touch) those that have closed, in this order."""
    used: np.ndarray
    """(3) see `KNOWN`, `OVER`, `OLDER`."""
    renewed: np.ndarray
    """(touch) whether its contact is of this reading's room."""
    owners: np.ndarray
    """(track) its touch, which may have been taken over since, or -1."""
    joined: np.ndarray
    """(track) the touch that it has just joined, or -1."""


@compiled
@no_type_check
def make_groups(
    tracks: np.ndarray, alive: int, before: TouchRecords, stamp: int, pause: int
) -> Groups:
    """The touches that were open, of which those over for too long close."""
    count = 0
    while count < len(before.touches) and not before.touches[count].closed:
        count += 1
    most = count + alive
    groups = Groups(
        np.empty(most, TOUCH),
        np.full(most, NOBODY),
        np.empty(most, np.int64),
        np.array([count, 0, count]),
        np.zeros(most, np.bool_),
        np.full(len(tracks), NOBODY),
        np.full(len(tracks), NOBODY),
    )
    groups.touches[:count] = before.touches[:count]
    for touch in range(count):
        if stamp - groups.touches[touch].last > pause:
            close(touch, 0, groups)
            continue
        for track in range(len(tracks)):
            if tracks[track].touch == groups.touches[touch].id:
                groups.owners[track] = touch
    return groups


@compiled
@no_type_check
def heir_of(touch: int, groups: Groups) -> int:
    """The touch that one has become a part of, or itself."""
    while groups.heirs[touch] != NOBODY:
        touch = groups.heirs[touch]
    return touch


@compiled
@no_type_check
def start(track: np.void, memory: Memory, room: Room, groups: Groups) -> int:
    """Start a touch with its first track; return its place."""
    place, contact = groups.used[KNOWN], room.contacts[track.contact]
    groups.used[KNOWN] += 1
    groups.renewed[place] = True
    touch = groups.touches[place]
    touch.id = memory.counts[NEXT_TOUCH]
    memory.counts[NEXT_TOUCH] += 1
    touch.onset, touch.last = track.onset, track.last
    touch.contact, touch.link = track.contact, contact.link
    touch.contacts = 1
    touch.closed = touch.merged_into = 0
    touch.impulse = touch.peak_force = touch.peak = 0.0
    touch.force = touch.farthest = 0.0
    for r in range(3):
        touch.start[r] = touch.latest[r] = contact.p_link[r]
    return place


@compiled
@no_type_check
def take_over(older: int, younger: int, groups: Groups) -> None:
    """Make a touch part of an older one."""
    touch, gone = groups.touches[older], groups.touches[younger]
    touch.last = max(touch.last, gone.last)
    touch.impulse += gone.impulse
    touch.force += gone.force
    touch.peak_force = max(touch.peak_force, gone.peak_force)
    touch.peak = max(touch.peak, gone.peak)
    groups.heirs[younger] = older
    close(younger, touch.id, groups)


@compiled
@no_type_check
def close(touch: int, heir: int, groups: Groups) -> None:
    """Close a touch, for the one of that id or for nobody."""
    groups.touches[touch].closed = 1
    groups.touches[touch].merged_into = heir
    groups.over[groups.used[OVER]] = touch
    groups.used[OVER] += 1
