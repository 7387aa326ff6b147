"""Compiled kernels that group tracks into touches."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled
from eskin.structref_kernels import Packed
from eskin.touch.contact_kernels import (
    box_gap,
    box_of,
    distance,
    distance_to,
    find_contacts,
    point_gap,
    to_link,
)
from eskin.touch.records import (
    NEXT_TOUCH,
    TOUCH,
    Instant,
    Memory,
    Rules,
    TouchRecords,
    TouchStatus,
)
from eskin.touch.track_kernels import (
    CONTACTS,
    LOADS,
    Room,
    add_loads,
    follow_tracks,
    keep,
    make_room,
)
from eskin.units import NS_PER_S

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


LIFTED = 60_000_000
"""Shortest time without contact after which contact is made anew [ns]; there must be
a reading that tells of it."""


class Surface(NamedTuple):
    """Where contacts are."""

    points: np.ndarray
    """(load, 3) in the world [m]."""
    boxes: np.ndarray
    """(track, 2, 3) round those of its contact now [m]."""
    reach: float
    """How far contacts of one touch may be apart [m]."""


@compiled
@no_type_check
def follow_touches(
    tracks: np.ndarray,
    alive: int,
    points: Float[np.ndarray, "load 3"],
    before: TouchRecords,
    reading: Instant,
    rules: Rules,
    memory: Memory,
    room: Room,
) -> Groups:
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
    surface = Surface(points, boxes, rules.beside)
    for track in range(alive):
        if groups.owners[track] == NOBODY:
            assign(track, tracks, surface, reading, rules, memory, room, groups)
    join_beside(tracks, alive, surface, reading.stamp, room, groups)
    update(tracks, alive, before, reading, rules, room, groups)
    return groups


@compiled
@no_type_check
def assign(
    track: int,
    tracks: np.ndarray,
    surface: Surface,
    reading: Instant,
    rules: Rules,
    memory: Memory,
    room: Room,
    groups: Groups,
) -> None:
    """Give a new track a touch, which takes over those shown to be a part of it."""
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


@compiled
@no_type_check
def belongs(
    track: int,
    other: int,
    tracks: np.ndarray,
    surface: Surface,
    reading: Instant,
    rules: Rules,
    room: Room,
) -> bool:
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


@compiled
@no_type_check
def are_beside(
    one: int, other: int, tracks: np.ndarray, surface: Surface, room: Room
) -> bool:
    """Whether the nearest taxels of two contacts are close in space."""
    points, boxes, reach = surface.points, surface.boxes, surface.reach
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


@compiled
@no_type_check
def join_beside(
    tracks: np.ndarray,
    alive: int,
    surface: Surface,
    stamp: int,
    room: Room,
    groups: Groups,
) -> None:
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


@compiled
@no_type_check
def update(
    tracks: np.ndarray,
    alive: int,
    before: TouchRecords,
    reading: Instant,
    rules: Rules,
    room: Room,
    groups: Groups,
) -> None:
    """Bring every open touch up to date with the contacts of this reading."""
    count = groups.used[KNOWN]
    force, centre = np.zeros(count), np.zeros((count, 3))
    # Nobody knows what force there was in a gap.
    seconds = 0.0
    if reading.elapsed <= rules.pause:
        seconds = reading.elapsed / NS_PER_S
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


@compiled
@no_type_check
def is_anew(before: int, last: int, reading: Instant) -> bool:
    """Whether a last contact is another one than the last at the reading before."""
    return last - before > LIFTED and before < reading.stamp - reading.elapsed


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


BRIEF = len(TouchStatus._fields)


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
        `TouchRecords` of this reading; a `TouchStatus` of each touch; how many of them
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
    """The fields of a `TouchStatus` of each touch."""
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
