"""Compiled grouping of tracks into touches."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float

from eskin.compiled import compiled
from eskin.touch.geometry_kernels import (
    box_gap,
    box_of,
    distance,
    distance_to,
    point_gap,
    to_link,
)
from eskin.touch.group_kernels import (
    KNOWN,
    NOBODY,
    OLDER,
    OVER,
    Groups,
    heir_of,
    make_groups,
    start,
    take_over,
)
from eskin.touch.memory import Memory
from eskin.touch.records import TouchRecords
from eskin.touch.room_kernels import Room
from eskin.touch.rules import Instant, Rules
from eskin.units import NS_PER_S

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
