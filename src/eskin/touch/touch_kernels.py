"""Compiled grouping of tracks into touches."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float
from numba import njit

from eskin.touch.geometry_kernels import (
    box_gap,
    box_of,
    distance,
    distance_to,
    point_gap,
    to_link,
)
from eskin.touch.memory import NEXT_TOUCH
from eskin.touch.records import TOUCH

NANOSECONDS = 1_000_000_000
NOBODY = -1
KNOWN, OVER, OLDER = 0, 1, 2
"""What `Groups.used` counts: all touches, those of them that have closed, and those
that were open at the reading before."""

LIFTED = 60_000_000
"""Shortest time without contact after which contact is made anew [ns]; there must be
a reading that tells of it."""


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


@njit(cache=True, nogil=True)
@no_type_check
def follow_touches(tracks, alive, points, before, reading, rules, memory, room):
    """Group the tracks of the next reading.

    A track joins the touch of the track that it split off from; else the touch of any
    track that ended near it a moment ago, or that has contact beside it. Where that
    makes one of two touches, the older takes over the younger, which closes with
    `merged_into`. On a skin that is not calibrated distances mean nothing, and whatever
    is on it at once, or within the pause, is one touch.

    Args:
        tracks: TRACK, those that go on in front, by id.
        alive: how many go on.
        points: of the loads of this reading, in the world [m].
        before: the records of the reading before.
        reading: an `Instant`.
        rules: `Rules`.
        memory: `Memory`.
        room: that of this reading.
    """
    groups = make_groups(tracks, alive, before, reading.stamp, rules.pause)
    boxes = np.empty((alive, 2, 3))
    for track in range(alive):
        span = room.contacts[tracks[track].contact].loads
        if tracks[track].last == reading.stamp:
            box_of(points[span[0] : span[1]], boxes[track])
    surface = (points, boxes, rules.beside)
    for track in range(alive):
        if groups.owners[track] == NOBODY:
            assign(track, tracks, surface, reading, rules, memory, room, groups)
    join_beside(tracks, alive, surface, reading.stamp, room, groups)
    update(tracks, alive, before, reading, rules, room, groups)
    return groups


@njit(cache=True, nogil=True)
@no_type_check
def make_groups(tracks, alive, before, stamp, pause):
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


@njit(cache=True, nogil=True)
@no_type_check
def close(touch, heir, groups) -> None:
    """Close a touch, for the one of that id or for nobody."""
    groups.touches[touch].closed = 1
    groups.touches[touch].merged_into = heir
    groups.over[groups.used[OVER]] = touch
    groups.used[OVER] += 1


@njit(cache=True, nogil=True)
@no_type_check
def heir_of(touch, groups) -> int:
    """The touch that one has become a part of, or itself."""
    while groups.heirs[touch] != NOBODY:
        touch = groups.heirs[touch]
    return touch


@njit(cache=True, nogil=True)
@no_type_check
def assign(track, tracks, surface, reading, rules, memory, room, groups) -> None:
    """Give a new track a touch, and that the touches it has shown to be a part of it."""
    fitting = np.zeros(groups.used[KNOWN], np.bool_)
    for other in range(len(tracks)):
        if groups.owners[other] != NOBODY:
            touch = heir_of(groups.owners[other], groups)
            if not fitting[touch]:
                fitting[touch] = belongs(
                    track, other, tracks, surface, reading, rules, room
                )
    first = NOBODY
    for touch in range(len(fitting)):
        if fitting[touch] and first != NOBODY:
            take_over(first, touch, groups)
        elif fitting[touch]:
            first = touch
    if first == NOBODY:
        first = start(tracks[track], memory, room, groups)
    groups.owners[track] = groups.joined[track] = first


@njit(cache=True, nogil=True)
@no_type_check
def belongs(track, other, tracks, surface, reading, rules, room) -> bool:
    """Whether a new track is of the same touch as another."""
    if tracks[track].parent == tracks[other].id or not rules.calibrated:
        return True
    if min(tracks[track].last, tracks[other].last) == reading.stamp:
        return are_beside(track, other, tracks, surface, room)
    if reading.stamp - tracks[other].last > rules.pause:
        return False
    was = room.contacts[tracks[other].contact]
    here = room.contacts[tracks[track].contact].p_world
    T_world_link = reading.T_world_link[was.link]
    return distance_to(T_world_link, was.p_link, here) <= rules.near


@njit(cache=True, nogil=True)
@no_type_check
def are_beside(one, other, tracks, surface, room) -> bool:
    """Whether the nearest taxels of two contacts are close in space."""
    points, boxes, reach = surface
    if box_gap(boxes[one], boxes[other]) > reach:
        return False
    a = room.contacts[tracks[one].contact].loads
    b = room.contacts[tracks[other].contact].loads
    for m in range(a[0], a[1]):
        if point_gap(points[m], boxes[other]) > reach:
            continue
        for n in range(b[0], b[1]):
            if distance(points[m], points[n]) <= reach:
                return True
    return False


@njit(cache=True, nogil=True)
@no_type_check
def start(track, memory, room, groups) -> int:
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


@njit(cache=True, nogil=True)
@no_type_check
def take_over(older, younger, groups) -> None:
    """Make a touch part of an older one."""
    touch, gone = groups.touches[older], groups.touches[younger]
    touch.last = max(touch.last, gone.last)
    touch.impulse += gone.impulse
    touch.force += gone.force
    touch.peak_force = max(touch.peak_force, gone.peak_force)
    touch.peak = max(touch.peak, gone.peak)
    groups.heirs[younger] = older
    close(younger, touch.id, groups)


@njit(cache=True, nogil=True)
@no_type_check
def join_beside(tracks, alive, surface, stamp, room, groups) -> None:
    """Make one touch of those whose contacts have come beside each other."""
    if groups.used[KNOWN] - groups.used[OVER] < 2:
        return
    for one in range(alive):
        for other in range(one + 1, alive):
            a = heir_of(groups.owners[one], groups)
            b = heir_of(groups.owners[other], groups)
            if a == b or min(tracks[one].last, tracks[other].last) < stamp:
                continue
            if are_beside(one, other, tracks, surface, room):
                take_over(min(a, b), max(a, b), groups)


@njit(cache=True, nogil=True)
@no_type_check
def update(tracks, alive, before, reading, rules, room, groups) -> None:
    """Bring every open touch up to date with the contacts of this reading."""
    count = groups.used[KNOWN]
    force, centre = np.zeros(count), np.zeros((count, 3))
    # Nobody knows what force there was in a gap.
    seconds = 0.0
    if reading.elapsed <= rules.pause:
        seconds = reading.elapsed / NANOSECONDS
    strongest = np.full(count, NOBODY)
    for track in range(alive):
        if tracks[track].last == reading.stamp:
            n = heir_of(groups.owners[track], groups)
            touch, contact = groups.touches[n], room.contacts[tracks[track].contact]
            force[n] += contact.force
            for r in range(3):
                centre[n, r] += contact.force * contact.p_world[r]
            touch.peak = max(touch.peak, contact.peak)
            best = strongest[n]
            if best == NOBODY or contact.force > room.contacts[best].force:
                strongest[n] = tracks[track].contact
    for n in range(count):
        touch = groups.touches[n]
        if touch.closed:
            continue
        touch.impulse += 0.5 * (force[n] + touch.force) * seconds
        touch.force = force[n]
        if strongest[n] != NOBODY:
            touch.contact, groups.renewed[n] = strongest[n], True
            touch.last = reading.stamp
            touch.peak_force = max(touch.peak_force, force[n])
            centre[n] /= force[n]
            to_link(reading.T_world_link[touch.link], centre[n], touch.latest)
        touch.farthest = max(touch.farthest, distance(touch.latest, touch.start))
        if n < groups.used[OLDER]:
            touch.contacts += is_anew(before.touches[n].last, touch.last, reading)


@njit(cache=True, nogil=True)
@no_type_check
def is_anew(before: int, last: int, reading) -> bool:
    """Whether a last contact is another one than the last at the reading before."""
    return last - before > LIFTED and before < reading.stamp - reading.elapsed
