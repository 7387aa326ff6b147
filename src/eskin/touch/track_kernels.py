"""Compiled kernels that track contacts from one reading to the next."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled
from eskin.touch.contact_kernels import distance_to_link_point
from eskin.touch.records import (
    CONTACT,
    ENDED,
    LOAD,
    NEXT_TRACK,
    NO_INDEX,
    ONGOING,
    PAST,
    TRACK,
    KernelReading,
    TouchRecords,
    TrackerContext,
    TrackerState,
    TrackingParameters,
)
from eskin.units import NS_PER_S

UM_PER_M = 1e6

CONTACTS, LOADS = 0, 1
"""Indices of `RecordBuffer.used`."""


class RecordBuffer(NamedTuple):
    """A buffer has space for the contacts and loads of one reading, and older ones."""

    contacts: np.ndarray
    """(space) CONTACT."""
    loads: np.ndarray
    """(space) LOAD."""
    copied_to: np.ndarray
    """(contact before) index of its copy here, or `NO_INDEX`."""
    used: np.ndarray
    """(2) number of contacts and of loads written."""


@compiled
@no_type_check
def build_buffer(
    contacts: np.ndarray, loads: np.ndarray, before: TouchRecords
) -> RecordBuffer:
    """Build a buffer that begins with the contacts and loads of a reading.

    It has space for all contacts and loads of the reading before, and once more for the
    loads of every touch, of this reading and of the one before.
    """
    older = len(before.contacts)
    buffer = RecordBuffer(
        np.empty(len(contacts) + older, CONTACT),
        np.empty(2 * (len(loads) + len(before.loads)), LOAD),
        np.full(older, NO_INDEX),
        np.array([len(contacts), len(loads)]),
    )
    buffer.contacts[: len(contacts)] = contacts
    buffer.loads[: len(loads)] = loads
    return buffer


@compiled
@no_type_check
def copy_contact_with_loads(
    old: int, before: TouchRecords, buffer: RecordBuffer
) -> int:
    """Copy a contact of the reading before with its loads; return its new index."""
    place = copy_contact(old, before, buffer)
    span = buffer.contacts[place].loads
    if span[0] == span[1]:
        had = before.contacts[old].loads
        span[0] = buffer.used[LOADS]
        span[1] = append_loads(before.loads[had[0] : had[1]], buffer)
    return place


@compiled
@no_type_check
def copy_contact(old: int, before: TouchRecords, buffer: RecordBuffer) -> int:
    """Copy a contact of the reading before without its loads; return its new index."""
    if buffer.copied_to[old] == NO_INDEX:
        place = buffer.used[CONTACTS]
        buffer.used[CONTACTS] += 1
        buffer.copied_to[old] = place
        buffer.contacts[place] = before.contacts[old]
        buffer.contacts[place].loads[0] = buffer.contacts[place].loads[1] = 0
    return buffer.copied_to[old]


@compiled
@no_type_check
def append_loads(loads: np.ndarray, buffer: RecordBuffer) -> int:
    """Append loads to those written; return where they end now."""
    end = buffer.used[LOADS] + len(loads)
    buffer.loads[buffer.used[LOADS] : end] = loads
    buffer.used[LOADS] = end
    return end


@compiled
@no_type_check
def track_contacts(
    contacts: np.ndarray,
    loads: np.ndarray,
    before: TouchRecords,
    reading: KernelReading,
    context: TrackerContext,
    buffer: RecordBuffer,
) -> tuple[np.ndarray, int]:
    """Continue the tracks in the contacts of the next reading.

    1. A track continues in the contact that covers most of the area it had; ties go to
       the stronger contact, then the first.
    2. Merging: where several continue in one contact, the oldest keeps its id and the
       others end, `merged_into` it.
    3. Splitting: the contact that covers most of the track keeps its id; each of the
       others becomes a new track with this one as `parent`.
    4. Tracks and contacts then left over, where nothing overlaps, are paired nearest
       first within the gate, measured in the frame of the track's link, so that the
       motion of the arm does not count. So a fast stroke keeps its id over any seam.
    5. A track without contact has ended, at once: lifting off is never bridged. Only
       where most of its taxels were not received it waits for a moment.

    Returns:
        TRACK records: ongoing, then those that have just ended, both by id, then those
        past; and how many are ongoing.
    """
    parameters = context.parameters
    successor = np.full(count_ongoing(before.tracks), NO_INDEX)
    parents = np.full(len(contacts), NO_INDEX)
    if reading.elapsed <= parameters.gap_seconds * NS_PER_S:
        match_overlaps(contacts, loads, before, context, successor, parents)
        gate = parameters.gate + parameters.speed * (reading.elapsed / NS_PER_S)
        pair_nearest(contacts, before, reading.T_world_link, gate, successor, parents)
    owner = find_owners(successor, len(contacts), before.tracks)
    tracks = np.empty(len(before.tracks) + len(contacts), TRACK)
    count = write_ongoing(successor, owner, before, reading, parameters, tracks, buffer)
    for n in range(len(contacts)):
        if owner[n] == NO_INDEX:
            parent = parents[n]
            parent_id = 0 if parent == NO_INDEX else before.tracks[parent].id
            start_track(n, parent_id, reading.stamp, tracks[count], context.state)
            count += 1
    ongoing = count
    count = write_ended(
        successor, owner, before, reading, parameters, tracks, count, buffer
    )
    return tracks[:count], ongoing


@compiled
@no_type_check
def count_ongoing(tracks: np.ndarray) -> int:
    """Count the ongoing tracks; they come first."""
    count = 0
    while count < len(tracks) and tracks[count].phase == ONGOING:
        count += 1
    return count


@compiled
@no_type_check
def match_overlaps(
    contacts: np.ndarray,
    loads: np.ndarray,
    before: TouchRecords,
    context: TrackerContext,
    successor: Int[np.ndarray, "track"],
    parents: Int[np.ndarray, "contact"],
) -> None:
    """Write in which contact each track continues, and which track each splits from.

    Args:
        contacts: CONTACT, of this reading.
        loads: of the contacts.
        before: the records of the reading before.
        context: the taxels, whose `slot` is -1 before and after.
        successor: (track) contact that covers most of it; written where there is one.
        parents: (contact) track most of which it covers; written where there is one.
    """
    geometry, taxels = context.geometry, context.state.taxels
    mark_taxels(before, len(successor), taxels, True)
    covered, best = np.zeros(len(successor)), np.zeros(len(successor))
    found = np.empty(len(loads), np.int64)
    for n in range(len(contacts)):
        count, most = 0, 0.0
        for k in range(contacts[n].loads[0], contacts[n].loads[1]):
            i = loads[k].taxel
            track = taxels[i].slot
            if track == NO_INDEX:
                continue
            if covered[track] == 0.0:
                found[count] = track
                count += 1
            covered[track] += geometry[i].area
        for track in found[:count]:
            area, covered[track] = covered[track], 0.0
            if area > most or (area == most and track < parents[n]):
                most, parents[n] = area, track
            other = successor[track]
            if area > best[track] or (
                area == best[track] and contacts[n].force > contacts[other].force
            ):
                best[track], successor[track] = area, n
    mark_taxels(before, len(successor), taxels, False)


@compiled
@no_type_check
def mark_taxels(before: TouchRecords, count: int, taxels: np.ndarray, on: bool) -> None:
    """Write the index of each track to the taxels it had, or reset them."""
    for track in range(count):
        span = before.contacts[before.tracks[track].contact].loads
        for k in range(span[0], span[1]):
            taxels[before.loads[k].taxel].slot = track if on else NO_INDEX


@compiled
@no_type_check
def pair_nearest(
    contacts: np.ndarray,
    before: TouchRecords,
    T_world_link: Float[np.ndarray, "link 4 4"],
    gate: float,
    successor: Int[np.ndarray, "track"],
    parents: Int[np.ndarray, "contact"],
) -> None:
    """Pair tracks and contacts that overlap nothing, nearest first within the gate."""
    free = parents == NO_INDEX
    lost = np.flatnonzero(successor == NO_INDEX)
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
            successor[lost[k]], free[nearest[k]] = nearest[k], False
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
    """Find the free contact nearest to where a contact is now, and its distance [m].

    Distances are rounded to the micrometre, so that rounding of the pose decides no
    tie.
    """
    nearest, least = NO_INDEX, np.inf
    T = T_world_link[was.link]
    for n in range(len(contacts)):
        if free[n]:
            far = distance_to_link_point(T, was.p_link, contacts[n].p_world)
            far = np.rint(far * UM_PER_M) / UM_PER_M
            if far < least:
                nearest, least = n, far
    return nearest, least


@compiled
@no_type_check
def find_owners(
    successor: Int[np.ndarray, "track"], count: int, tracks: np.ndarray
) -> np.ndarray:
    """Return the oldest of the tracks that continue in each contact, or -1."""
    owner = np.full(count, NO_INDEX)
    for track in range(len(successor)):
        n = successor[track]
        if n == NO_INDEX:
            continue
        other = owner[n]
        # Tracks are in the order of their ids.
        if other == NO_INDEX or tracks[track].onset < tracks[other].onset:
            owner[n] = track
    return owner


@compiled
@no_type_check
def write_ongoing(
    successor: Int[np.ndarray, "track"],
    owner: Int[np.ndarray, "contact"],
    before: TouchRecords,
    reading: KernelReading,
    parameters: TrackingParameters,
    tracks: np.ndarray,
    buffer: RecordBuffer,
) -> int:
    """Write the tracks that have contact or wait for it; return how many there are."""
    count = 0
    for track in range(len(successor)):
        n = successor[track]
        if n == NO_INDEX and is_coasting(
            before.tracks[track], before, reading, parameters
        ):
            tracks[count] = before.tracks[track]
            tracks[count].contact = copy_contact_with_loads(
                before.tracks[track].contact, before, buffer
            )
            count += 1
        elif n != NO_INDEX and owner[n] == track:
            tracks[count] = before.tracks[track]
            tracks[count].last, tracks[count].contact = reading.stamp, n
            count += 1
    return count


@compiled
@no_type_check
def is_coasting(
    track: np.void,
    before: TouchRecords,
    reading: KernelReading,
    parameters: TrackingParameters,
) -> bool:
    """Return whether the taxels of a track without contact were just not received."""
    if (reading.stamp - track.last) / NS_PER_S > parameters.coast_seconds:
        return False
    span = before.contacts[track.contact].loads
    received = 0
    for k in range(span[0], span[1]):
        received += reading.valid[before.loads[k].taxel]
    return 1.0 - received / (span[1] - span[0]) > 0.5


@compiled
@no_type_check
def start_track(
    contact: int, parent: int, stamp: int, track: np.void, state: TrackerState
) -> None:
    """Write a new track in a contact."""
    track.id = state.counts[NEXT_TRACK]
    state.counts[NEXT_TRACK] += 1
    track.onset = track.last = stamp
    track.parent, track.contact = parent, contact
    track.merged_into = track.touch = 0
    track.phase = ONGOING


@compiled
@no_type_check
def write_ended(
    successor: Int[np.ndarray, "track"],
    owner: Int[np.ndarray, "contact"],
    before: TouchRecords,
    reading: KernelReading,
    parameters: TrackingParameters,
    tracks: np.ndarray,
    count: int,
    buffer: RecordBuffer,
) -> int:
    """Write the tracks that have ended behind the others; return how many there are.

    Tracks that ended before stay for as long as their touch may be joined.
    """
    for track in range(len(before.tracks)):
        old = before.tracks[track]
        if track >= len(successor):
            if reading.stamp - old.last <= parameters.pause_ns:
                tracks[count] = old
                tracks[count].phase = PAST
                tracks[count].contact = copy_contact(old.contact, before, buffer)
                count += 1
            continue
        n = successor[track]
        merged = n != NO_INDEX and owner[n] != track
        if merged or (
            n == NO_INDEX and not is_coasting(old, before, reading, parameters)
        ):
            tracks[count] = old
            tracks[count].phase = ENDED
            tracks[count].contact = copy_contact_with_loads(old.contact, before, buffer)
            if merged:
                tracks[count].merged_into = before.tracks[owner[n]].id
            count += 1
    return count
