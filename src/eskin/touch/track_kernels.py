"""Compiled kernels that track contacts from one reading to the next."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled
from eskin.touch.contact_kernels import distance_to
from eskin.touch.records import (
    CONTACT,
    ENDED,
    GOING,
    LOAD,
    NEXT_TRACK,
    PAST,
    TRACK,
    Instant,
    Memory,
    Rules,
    TouchRecords,
)
from eskin.units import NS_PER_S

CONTACTS, LOADS = 0, 1
"""What `Room.used` counts."""

NOWHERE = -1


class Room(NamedTuple):
    """Room for contacts and loads, large enough for one reading."""

    contacts: np.ndarray
    """(room) CONTACT."""
    loads: np.ndarray
    """(room) LOAD."""
    places: np.ndarray
    """(contact before) where it is kept, or `NOWHERE`."""
    used: np.ndarray
    """(2) how much is written."""


@compiled
@no_type_check
def make_room(contacts: np.ndarray, loads: np.ndarray, before: TouchRecords) -> Room:
    """Room that begins with the contacts and loads of a reading.

    It may come to hold all that there was before, and once more the loads of every
    touch, of this reading and of the one before.
    """
    older = len(before.contacts)
    room = Room(
        np.empty(len(contacts) + older, CONTACT),
        np.empty(2 * (len(loads) + len(before.loads)), LOAD),
        np.full(older, NOWHERE),
        np.array([len(contacts), len(loads)]),
    )
    room.contacts[: len(contacts)] = contacts
    room.loads[: len(loads)] = loads
    return room


@compiled
@no_type_check
def keep(old: int, before: TouchRecords, room: Room) -> int:
    """Keep a contact of the reading before with its loads; return its new place."""
    place = keep_place(old, before, room)
    span = room.contacts[place].loads
    if span[0] == span[1]:
        had = before.contacts[old].loads
        span[0] = room.used[LOADS]
        span[1] = add_loads(before.loads[had[0] : had[1]], room)
    return place


@compiled
@no_type_check
def keep_place(old: int, before: TouchRecords, room: Room) -> int:
    """Keep where a contact of the reading before was; return its new place."""
    if room.places[old] == NOWHERE:
        place = room.used[CONTACTS]
        room.used[CONTACTS] += 1
        room.places[old] = place
        room.contacts[place] = before.contacts[old]
        room.contacts[place].loads[0] = room.contacts[place].loads[1] = 0
    return room.places[old]


@compiled
@no_type_check
def add_loads(loads: np.ndarray, room: Room) -> int:
    """Write loads behind those that are there; return where they end now."""
    end = room.used[LOADS] + len(loads)
    room.loads[room.used[LOADS] : end] = loads
    room.used[LOADS] = end
    return end


MICROMETRES = 1e6
NOBODY = -1


@compiled
@no_type_check
def follow_tracks(
    contacts: np.ndarray,
    loads: np.ndarray,
    before: TouchRecords,
    reading: Instant,
    rules: Rules,
    sites: np.ndarray,
    memory: Memory,
    room: Room,
) -> tuple[np.ndarray, int]:
    """Follow the tracks into the contacts of the next reading.

    1. A track goes on in the contact that covers most of the area it had; ties go to
       the stronger contact, then the first.
    2. Merging: where several go on in one contact, the oldest keeps its id and the
       others end, `merged_into` it.
    3. Splitting: the contact that covers most of the track keeps its id; each of the
       others becomes a new track with this one as `parent`.
    4. Tracks and contacts then left over, where nothing overlaps, are paired nearest
       first within the gate, measured in the frame of the track's link, so that the
       motion of the arm does not count. So a fast stroke keeps its id over any seam.
    5. A track without contact has ended, at once: lifting off is never bridged. Only
       where most of its taxels were not received it waits for a moment.

    Returns:
        TRACK records: going on, then those that have just ended, both by id, then those
        past; and how many go on.
    """
    going = np.full(count_going(before.tracks), NOBODY)
    parents = np.full(len(contacts), NOBODY)
    if reading.elapsed <= rules.gap:
        overlap(contacts, loads, before, sites, memory.taxels, going, parents)
        gate = rules.gate + rules.speed * (reading.elapsed / NS_PER_S)
        pair_nearest(contacts, before, reading.T_world_link, gate, going, parents)
    keeper = oldest(going, len(contacts), before.tracks)
    tracks = np.empty(len(before.tracks) + len(contacts), TRACK)
    count = go_on(going, keeper, before, reading, rules, tracks, room)
    for n in range(len(contacts)):
        if keeper[n] == NOBODY:
            parent = parents[n]
            parent_id = 0 if parent == NOBODY else before.tracks[parent].id
            begin(n, parent_id, reading.stamp, tracks[count], memory)
            count += 1
    alive = count
    count = end_tracks(going, keeper, before, reading, rules, tracks, count, room)
    return tracks[:count], alive


@compiled
@no_type_check
def count_going(tracks: np.ndarray) -> int:
    """How many tracks go on; they are in front."""
    count = 0
    while count < len(tracks) and tracks[count].phase == GOING:
        count += 1
    return count


@compiled
@no_type_check
def overlap(
    contacts: np.ndarray,
    loads: np.ndarray,
    before: TouchRecords,
    sites: np.ndarray,
    taxels: np.ndarray,
    going: Int[np.ndarray, "track"],
    parents: Int[np.ndarray, "contact"],
) -> None:
    """Write where each track goes on that a contact covers, and whom it splits from.

    Args:
        contacts: CONTACT, of this reading.
        loads: of them.
        before: the reading before.
        sites: SITE, all taxels.
        taxels: TAXEL, whose `place` is -1 before and after.
        going: (track) the contact that covers most of it, where there is one.
        parents: (contact) the track most of which it covers, where there is one.
    """
    mark(before, len(going), taxels, True)
    covered, best = np.zeros(len(going)), np.zeros(len(going))
    found = np.empty(len(loads), np.int64)
    for n in range(len(contacts)):
        count, most = 0, 0.0
        for k in range(contacts[n].loads[0], contacts[n].loads[1]):
            i = loads[k].taxel
            track = taxels[i].place
            if track == NOBODY:
                continue
            if covered[track] == 0.0:
                found[count] = track
                count += 1
            covered[track] += sites[i].area
        for track in found[:count]:
            area, covered[track] = covered[track], 0.0
            if area > most or (area == most and track < parents[n]):
                most, parents[n] = area, track
            other = going[track]
            if area > best[track] or (
                area == best[track] and contacts[n].force > contacts[other].force
            ):
                best[track], going[track] = area, n
    mark(before, len(going), taxels, False)


@compiled
@no_type_check
def mark(before: TouchRecords, count: int, taxels: np.ndarray, on: bool) -> None:
    """Write to the taxels that tracks had which track it was, or take it off again."""
    for track in range(count):
        span = before.contacts[before.tracks[track].contact].loads
        for k in range(span[0], span[1]):
            taxels[before.loads[k].taxel].place = track if on else NOBODY


@compiled
@no_type_check
def pair_nearest(
    contacts: np.ndarray,
    before: TouchRecords,
    T_world_link: Float[np.ndarray, "link 4 4"],
    gate: float,
    going: Int[np.ndarray, "track"],
    parents: Int[np.ndarray, "contact"],
) -> None:
    """Pair tracks and contacts that overlap nothing, nearest first within the gate."""
    free = parents == NOBODY
    lost = np.flatnonzero(going == NOBODY)
    if not lost.size or not free.any():
        return
    nearest, gaps = np.empty(len(lost), np.int64), np.empty(len(lost))
    for k in range(len(lost)):
        was = before.contacts[before.tracks[lost[k]].contact]
        nearest[k], gaps[k] = find_nearest(was, contacts, free, T_world_link)
    while True:
        k = np.argmin(gaps)
        if not gaps[k] <= gate:
            return
        if free[nearest[k]]:
            going[lost[k]], free[nearest[k]] = nearest[k], False
            gaps[k] = np.inf
        else:
            was = before.contacts[before.tracks[lost[k]].contact]
            nearest[k], gaps[k] = find_nearest(was, contacts, free, T_world_link)


@compiled
@no_type_check
def find_nearest(
    was: np.void,
    contacts: np.ndarray,
    free: Bool[np.ndarray, "contact"],
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> tuple[int, float]:
    """The free contact nearest to where a contact is now, and how far it is [m].

    To the micrometre, so that rounding of the pose decides no tie.
    """
    nearest, least = NOBODY, np.inf
    T = T_world_link[was.link]
    for n in range(len(contacts)):
        if free[n]:
            far = distance_to(T, was.p_link, contacts[n].p_world)
            far = np.rint(far * MICROMETRES) / MICROMETRES
            if far < least:
                nearest, least = n, far
    return nearest, least


@compiled
@no_type_check
def oldest(
    going: Int[np.ndarray, "track"], count: int, tracks: np.ndarray
) -> np.ndarray:
    """The oldest of the tracks that go on in each of so many contacts, or -1."""
    keeper = np.full(count, NOBODY)
    for track in range(len(going)):
        n = going[track]
        if n == NOBODY:
            continue
        other = keeper[n]
        # Tracks are in the order of their ids.
        if other == NOBODY or tracks[track].onset < tracks[other].onset:
            keeper[n] = track
    return keeper


@compiled
@no_type_check
def go_on(
    going: Int[np.ndarray, "track"],
    keeper: Int[np.ndarray, "contact"],
    before: TouchRecords,
    reading: Instant,
    rules: Rules,
    tracks: np.ndarray,
    room: Room,
) -> int:
    """Write the tracks that have contact or wait for it; return how many there are."""
    count = 0
    for track in range(len(going)):
        n = going[track]
        if n == NOBODY and waits(before.tracks[track], before, reading, rules):
            tracks[count] = before.tracks[track]
            tracks[count].contact = keep(before.tracks[track].contact, before, room)
            count += 1
        elif n != NOBODY and keeper[n] == track:
            tracks[count] = before.tracks[track]
            tracks[count].last, tracks[count].contact = reading.stamp, n
            count += 1
    return count


@compiled
@no_type_check
def waits(track: np.void, before: TouchRecords, reading: Instant, rules: Rules) -> bool:
    """Whether a track without contact may only not have been received."""
    if (reading.stamp - track.last) / NS_PER_S > rules.coast:
        return False
    span = before.contacts[track.contact].loads
    heard = 0
    for k in range(span[0], span[1]):
        heard += reading.valid[before.loads[k].taxel]
    return 1.0 - heard / (span[1] - span[0]) > 0.5


@compiled
@no_type_check
def begin(
    contact: int, parent: int, stamp: int, track: np.void, memory: Memory
) -> None:
    """Write a new track in a contact."""
    track.id = memory.counts[NEXT_TRACK]
    memory.counts[NEXT_TRACK] += 1
    track.onset = track.last = stamp
    track.parent, track.contact = parent, contact
    track.merged_into = track.touch = 0
    track.phase = GOING


@compiled
@no_type_check
def end_tracks(
    going: Int[np.ndarray, "track"],
    keeper: Int[np.ndarray, "contact"],
    before: TouchRecords,
    reading: Instant,
    rules: Rules,
    tracks: np.ndarray,
    count: int,
    room: Room,
) -> int:
    """Write the tracks that have ended behind the others; return how many there are.

    What ended before is remembered for as long as its touch may be joined.
    """
    for track in range(len(before.tracks)):
        old = before.tracks[track]
        if track >= len(going):
            if reading.stamp - old.last <= rules.pause:
                tracks[count] = old
                tracks[count].phase = PAST
                tracks[count].contact = keep_place(old.contact, before, room)
                count += 1
            continue
        n = going[track]
        merged = n != NOBODY and keeper[n] != track
        if merged or (n == NOBODY and not waits(old, before, reading, rules)):
            tracks[count] = old
            tracks[count].phase = ENDED
            tracks[count].contact = keep(old.contact, before, room)
            if merged:
                tracks[count].merged_into = before.tracks[keeper[n]].id
            count += 1
    return count
