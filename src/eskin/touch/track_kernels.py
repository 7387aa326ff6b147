"""Compiled kernels that track contacts from one reading to the next.

`before` is the `TouchRecords` of the previous reading.
"""
# The types of compiled code are those that numba infers.
# pyright: reportAttributeAccessIssue=false

from typing import NamedTuple

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
    TrackingParameters,
)
from eskin.units import NS_PER_S

UM_PER_M = 1e6

CONTACTS, LOADS = 0, 1
"""Indices of `RecordBuffer.used`."""


class RecordBuffer(NamedTuple):
    """A buffer has space for the contacts and loads of a reading, and older ones."""

    before: TouchRecords
    """Records of the previous reading."""
    contacts: np.ndarray
    """(space) CONTACT."""
    loads: np.ndarray
    """(space) LOAD."""
    copied_to: np.ndarray
    """(previous contact) index of its copy in `contacts`, or -1."""
    used: np.ndarray
    """(2) number of contacts and of loads written."""


@compiled
def build_buffer(
    contacts: np.ndarray, loads: np.ndarray, before: TouchRecords
) -> RecordBuffer:
    """Build a buffer that begins with the contacts and loads of a reading.

    All contacts and loads of the previous reading fit too, and once more the loads of
    both readings, for the touches.
    """
    buffer = RecordBuffer(
        before,
        np.empty(len(contacts) + len(before.contacts), CONTACT),
        np.empty(2 * (len(loads) + len(before.loads)), LOAD),
        fill_indices(len(before.contacts)),
        np.zeros(2, np.int64),
    )
    for n in range(len(contacts)):
        buffer.contacts[n] = contacts[n]
    buffer.used[CONTACTS] = len(contacts)
    append_loads(loads, buffer)
    return buffer


@compiled
def fill_indices(count: int) -> Int[np.ndarray, "index"]:
    """Return so many indices of nothing."""
    indices = np.empty(count, np.int64)
    for n in range(count):
        indices[n] = NO_INDEX
    return indices


@compiled
def copy_contact_with_loads(old: int, buffer: RecordBuffer) -> int:
    """Copy a previous contact with its loads, and return its new index."""
    place, before = copy_contact(old, buffer), buffer.before
    span = buffer.contacts[place].loads
    if span[0] == span[1]:
        old_span = before.contacts[old].loads
        span[0] = buffer.used[LOADS]
        span[1] = append_loads(before.loads[old_span[0] : old_span[1]], buffer)
    return place


@compiled
def copy_contact(old: int, buffer: RecordBuffer) -> int:
    """Copy a previous contact without its loads, and return its new index."""
    if buffer.copied_to[old] == NO_INDEX:
        place = buffer.used[CONTACTS]
        buffer.used[CONTACTS] += 1
        buffer.copied_to[old] = place
        buffer.contacts[place] = buffer.before.contacts[old]
        buffer.contacts[place].loads[0] = buffer.contacts[place].loads[1] = 0
    return buffer.copied_to[old]


@compiled
def append_loads(loads: np.ndarray, buffer: RecordBuffer) -> int:
    """Append loads to the buffer, and return their end."""
    end = buffer.used[LOADS]
    for k in range(len(loads)):
        buffer.loads[end + k] = loads[k]
    buffer.used[LOADS] = end + len(loads)
    return buffer.used[LOADS]


class TrackMatches(NamedTuple):
    """Matches relate previous tracks and the contacts of a reading; -1 is none."""

    successor: np.ndarray
    """(track) contact in which it continues."""
    parents: np.ndarray
    """(contact) track of which it covers most."""
    owner: np.ndarray
    """(contact) track that keeps its id in it."""


@compiled
def track_contacts(
    contacts: np.ndarray,
    loads: np.ndarray,
    reading: KernelReading,
    context: TrackerContext,
    buffer: RecordBuffer,
) -> tuple[np.ndarray, int]:
    """Continue the tracks in the contacts of the next reading.

    1. A track continues in the contact that covers most of its previous area; ties go
       to the stronger contact, then to the first.
    2. Merging: where several continue in one contact, the oldest keeps its id, of those
       that have evidence, and the others end, `merged_into` it.
    3. Splitting: the contact that covers most of the track keeps its id; each of the
       others becomes a new track with this one as `parent`.
    4. Remaining tracks and contacts, which overlap nothing, are paired nearest first
       within the gate, so that a fast stroke keeps its id over any seam. Distances are
       measured in the frame of the track's link: the motion of the arm does not count.
       Tracks that may be noise are not paired.
    5. A track without contact ends at once, as a lift is never bridged, unless most of
       its taxels were not received: then it goes on for a short time.

    Returns:
        TRACK records: ongoing ones by id, ended ones by id, then past ones; and the
        number of ongoing ones.
    """
    parameters, before = context.parameters, buffer.before
    matches = TrackMatches(
        fill_indices(count_ongoing(before.tracks)),
        fill_indices(len(contacts)),
        fill_indices(len(contacts)),
    )
    if reading.elapsed <= parameters.gap_seconds * NS_PER_S:
        match_overlaps(contacts, loads, before, context, matches)
        pair_nearest(contacts, before, reading, parameters, matches)
    find_owners(before.tracks, parameters.least_evidence, matches)
    tracks = np.empty(len(before.tracks) + len(contacts), TRACK)
    count = write_ongoing(matches, reading, parameters, buffer, tracks)
    for n in range(len(contacts)):
        if matches.owner[n] == NO_INDEX:
            parent = matches.parents[n]
            start_track(n, parent, before, reading.stamp, tracks[count], context)
            count += 1
    ongoing = count
    count = write_ended(matches, reading, parameters, buffer, tracks, count)
    return tracks[:count], ongoing


@compiled
def count_ongoing(tracks: np.ndarray) -> int:
    """Count the ongoing tracks, which come first."""
    count = 0
    while count < len(tracks) and tracks[count].phase == ONGOING:
        count += 1
    return count


@compiled
def match_overlaps(
    contacts: np.ndarray,
    loads: np.ndarray,
    before: TouchRecords,
    context: TrackerContext,
    matches: TrackMatches,
) -> None:
    """Match contacts that overlap the previous ones of tracks."""
    successor, parents = matches.successor, matches.parents
    geometry, taxels = context.geometry, context.state.taxels
    mark_taxels(before, len(successor), taxels, True)
    covered, best = np.zeros(len(successor)), np.zeros(len(successor))
    found = np.empty(len(loads), np.int64)
    for n in range(len(contacts)):
        count, most = 0, 0.0
        for k in range(contacts[n].loads[0], contacts[n].loads[1]):
            i = loads[k].taxel
            track = taxels[i].scratch_index
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
def mark_taxels(before: TouchRecords, count: int, taxels: np.ndarray, on: bool) -> None:
    """Write each track to the scratch index of its taxels, or reset these."""
    for track in range(count):
        span = before.contacts[before.tracks[track].contact].loads
        for k in range(span[0], span[1]):
            taxels[before.loads[k].taxel].scratch_index = track if on else NO_INDEX


@compiled
def pair_nearest(
    contacts: np.ndarray,
    before: TouchRecords,
    reading: KernelReading,
    parameters: TrackingParameters,
    matches: TrackMatches,
) -> None:
    """Pair tracks and contacts that overlap nothing, nearest first within the gate."""
    gate = parameters.gate + parameters.speed * (reading.elapsed / NS_PER_S)
    T_world_link, successor = reading.T_world_link, matches.successor
    free = np.empty(len(contacts), np.bool_)
    for n in range(len(contacts)):
        free[n] = matches.parents[n] == NO_INDEX
    nearest, gaps = np.empty(len(successor), np.int64), np.empty(len(successor))
    for track in range(len(successor)):
        old, gaps[track] = before.tracks[track], np.inf
        if successor[track] == NO_INDEX and old.evidence >= parameters.least_evidence:
            contact = before.contacts[old.contact]
            found = find_nearest(contact, contacts, free, T_world_link)
            nearest[track], gaps[track] = found
    while True:
        track, least = NO_INDEX, np.inf
        for other in range(len(gaps)):
            if gaps[other] < least:
                track, least = other, gaps[other]
        if track == NO_INDEX or least > gate:
            return
        if free[nearest[track]]:
            successor[track], free[nearest[track]] = nearest[track], False
            gaps[track] = np.inf
        else:
            old = before.contacts[before.tracks[track].contact]
            found = find_nearest(old, contacts, free, T_world_link)
            nearest[track], gaps[track] = found


@compiled
def find_nearest(
    old: np.void,
    contacts: np.ndarray,
    free: Bool[np.ndarray, "contact"],
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> tuple[int, float]:
    """Find the free contact nearest to a previous one, and the distance [m].

    Distances are rounded to 1 um, so that rounding errors of the pose decide no tie.
    """
    nearest, least = NO_INDEX, np.inf
    T = T_world_link[old.link]
    for n in range(len(contacts)):
        if free[n]:
            gap = distance_to_link_point(T, old.p_link, contacts[n].p_world)
            gap = np.rint(gap * UM_PER_M) / UM_PER_M
            if gap < least:
                nearest, least = n, gap
    return nearest, least


@compiled
def find_owners(
    tracks: np.ndarray, least_evidence: float, matches: TrackMatches
) -> None:
    """Let the oldest of the tracks that continue in each contact keep its id.

    Tracks that may be noise come after all others.
    """
    successor, owner = matches.successor, matches.owner
    for track in range(len(successor)):
        n = successor[track]
        if n == NO_INDEX:
            continue
        other = owner[n]
        if other == NO_INDEX:
            owner[n] = track
            continue
        # Tracks are in the order of their ids.
        is_sure = tracks[track].evidence >= least_evidence
        if is_sure != (tracks[other].evidence >= least_evidence):
            owner[n] = track if is_sure else other
        elif tracks[track].onset < tracks[other].onset:
            owner[n] = track


@compiled
def write_ongoing(
    matches: TrackMatches,
    reading: KernelReading,
    parameters: TrackingParameters,
    buffer: RecordBuffer,
    tracks: np.ndarray,
) -> int:
    """Write the tracks that continue, and return their number."""
    count, before = 0, buffer.before
    for track in range(len(matches.successor)):
        n, old = matches.successor[track], before.tracks[track]
        if n == NO_INDEX and is_coasting(old, before, reading, parameters):
            tracks[count] = old
            tracks[count].contact = copy_contact_with_loads(old.contact, buffer)
            count += 1
        elif n != NO_INDEX and matches.owner[n] == track:
            tracks[count] = old
            tracks[count].last, tracks[count].contact = reading.stamp, n
            count += 1
    return count


@compiled
def is_coasting(
    track: np.void,
    before: TouchRecords,
    reading: KernelReading,
    parameters: TrackingParameters,
) -> bool:
    """Return whether most taxels of a track without contact were not received."""
    if (reading.stamp - track.last) / NS_PER_S > parameters.coast_seconds:
        return False
    span = before.contacts[track.contact].loads
    received = 0
    for k in range(span[0], span[1]):
        received += reading.valid[before.loads[k].taxel]
    return 1.0 - received / (span[1] - span[0]) > 0.5


@compiled
def start_track(
    contact: int,
    parent: int,
    before: TouchRecords,
    stamp: int,
    track: np.void,
    context: TrackerContext,
) -> None:
    """Write a new track that begins in a contact; it has the evidence of its parent."""
    counts = context.state.counts
    track.id = counts[NEXT_TRACK]
    counts[NEXT_TRACK] += 1
    track.onset = track.last = stamp
    track.contact, track.parent, track.evidence = contact, 0, 0.0
    if parent != NO_INDEX:
        track.parent = before.tracks[parent].id
        track.evidence = before.tracks[parent].evidence
    track.merged_into = track.touch = 0
    track.phase = ONGOING


@compiled
def write_ended(
    matches: TrackMatches,
    reading: KernelReading,
    parameters: TrackingParameters,
    buffer: RecordBuffer,
    tracks: np.ndarray,
    count: int,
) -> int:
    """Append the tracks that have ended, and return the number of all tracks.

    Tracks that ended before are kept while a new one may join their touch.
    """
    before = buffer.before
    for track in range(len(before.tracks)):
        old = before.tracks[track]
        if track >= len(matches.successor):
            if reading.stamp - old.last <= parameters.pause_ns:
                tracks[count] = old
                tracks[count].phase = PAST
                tracks[count].contact = copy_contact(old.contact, buffer)
                count += 1
            continue
        n = matches.successor[track]
        merged = n != NO_INDEX and matches.owner[n] != track
        if merged or (
            n == NO_INDEX and not is_coasting(old, before, reading, parameters)
        ):
            tracks[count] = old
            tracks[count].phase = ENDED
            tracks[count].contact = copy_contact_with_loads(old.contact, buffer)
            if merged:
                tracks[count].merged_into = before.tracks[matches.owner[n]].id
            count += 1
    return count
