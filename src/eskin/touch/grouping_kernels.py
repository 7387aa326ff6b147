"""Compiled kernels that group the tracks of a reading into touches.

`update` holds the tracks, and the touches while they are updated.
"""
# The types of compiled code are those that numba infers.
# pyright: reportAttributeAccessIssue=false

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from eskin.compiled import compiled
from eskin.touch.belief_kernels import CLEAR_FACTOR, MAX_STEP_INTERVAL
from eskin.touch.contact_kernels import (
    box_gap,
    compute_box,
    distance,
    distance_to_link_point,
    point_gap,
    transform_to_link,
)
from eskin.touch.records import (
    NEXT_TOUCH,
    NO_INDEX,
    TOUCH,
    KernelReading,
    TrackerContext,
    TrackerState,
    TrackingParameters,
)
from eskin.touch.track_kernels import RecordBuffer, fill_indices
from eskin.units import NS_PER_S

SLOW_NS = round(MAX_STEP_INTERVAL * NS_PER_S)
"""Time between two readings from which a touch may last for one of them [ns]."""
FADE_SECONDS = 2.0
"""Time constant with which the evidence of a track fades [s]: what has given none for
some seconds may be a taxel that does not return to its rest, and joins no other."""
MIN_NOISE = 0.1
"""Smallest pressure that is taken for noise [kPa]."""
MIN_LIFT_NS = 60_000_000
"""Smallest time without contact from which a contact counts as a new one [ns]; it must
contain a reading."""
ALL, CLOSED, PREVIOUS = 0, 1, 2
"""Indices of `TouchUpdate.counts`: number of all touches, of those that have closed,
and of those that were open at the previous reading."""


class TouchUpdate(NamedTuple):
    """An update holds the tracks and touches of a reading while they are grouped."""

    tracks: np.ndarray
    """(track) TRACK, ongoing ones first."""
    ongoing: int
    """Number of ongoing tracks."""
    points: np.ndarray
    """(load, 3) positions of the loads in the world [m]."""
    boxes: np.ndarray
    """(ongoing, 2, 3) bounding boxes of the current contacts of tracks [m]."""
    buffer: RecordBuffer
    """Contacts and loads of this reading, and the records of the previous one."""
    touches: np.ndarray
    """(touch) TOUCH: those open at the previous reading, then new ones."""
    survivors: np.ndarray
    """(touch) touch that it was merged into, or -1."""
    closed: np.ndarray
    """(touch) touches that have closed, in this order."""
    counts: np.ndarray
    """(3) see `ALL`, `CLOSED`, `PREVIOUS`."""
    renewed: np.ndarray
    """(touch) whether its contact is in the buffer already."""
    owners: np.ndarray
    """(track) its touch, which may since have been merged into another, or -1."""
    joined: np.ndarray
    """(track) the touch that it has joined at this reading, or -1."""


@compiled
def begin_update(
    tracks: np.ndarray,
    ongoing: int,
    points: Float[np.ndarray, "load 3"],
    reading: KernelReading,
    parameters: TrackingParameters,
    buffer: RecordBuffer,
) -> TouchUpdate:
    """Begin with the touches that were open, and close those after the pause."""
    boxes, before = np.empty((ongoing, 2, 3)), buffer.before
    for track in range(ongoing):
        span = buffer.contacts[tracks[track].contact].loads
        if tracks[track].last == reading.stamp:
            compute_box(points[span[0] : span[1]], boxes[track])
    count = 0
    while count < len(before.touches) and not before.touches[count].closed:
        count += 1
    most = count + 2 * ongoing
    update = TouchUpdate(
        tracks,
        ongoing,
        points,
        boxes,
        buffer,
        np.empty(most, TOUCH),
        fill_indices(most),
        np.empty(most, np.int64),
        np.zeros(3, np.int64),
        np.zeros(most, np.bool_),
        fill_indices(len(tracks)),
        fill_indices(len(tracks)),
    )
    update.counts[ALL] = update.counts[PREVIOUS] = count
    for touch in range(count):
        update.touches[touch] = before.touches[touch]
        status, goes_on = update.touches[touch], False
        for track in range(len(tracks)):
            if tracks[track].touch == status.id:
                update.owners[track] = touch
                goes_on |= track < ongoing
        pause = parameters.pause_ns if status.confirmed else parameters.timeout_ns
        is_weak = status.evidence < parameters.least_evidence and not status.confirmed
        if is_weak and not goes_on:
            pause = min(pause, MIN_LIFT_NS)
        if reading.stamp - status.last > pause:
            close_touch(touch, 0, update)
            for track in range(len(tracks)):
                if update.owners[track] == touch:
                    update.owners[track] = NO_INDEX
    return update


@compiled
def find_survivor(touch: int, update: TouchUpdate) -> int:
    """Return the touch into which one was merged, directly or not, else itself."""
    while update.survivors[touch] != NO_INDEX:
        touch = update.survivors[touch]
    return touch


@compiled
def start_touch(track: np.void, state: TrackerState, update: TouchUpdate) -> int:
    """Start a touch with its first track, and return its index."""
    place, buffer = update.counts[ALL], update.buffer
    contact = buffer.contacts[track.contact]
    update.counts[ALL] += 1
    update.renewed[place] = True
    touch = update.touches[place]
    touch.id = state.counts[NEXT_TOUCH]
    state.counts[NEXT_TOUCH] += 1
    touch.onset, touch.last = track.onset, track.last
    for k in range(contact.loads[0], contact.loads[1]):
        touch.onset = min(touch.onset, buffer.loads[k].onset)
    touch.contact, touch.link = track.contact, contact.link
    touch.contacts = 1
    touch.closed = touch.merged_into = 0
    touch.impulse = touch.peak_force = touch.peak = 0.0
    touch.force = touch.farthest = 0.0
    touch.settled, touch.settled_at = 0.0, track.onset
    touch.evidence, touch.confirmed = 0.0, 0
    for r in range(3):
        touch.start[r] = touch.latest[r] = contact.p_link[r]
    return place


@compiled
def merge_touches(older: int, younger: int, restart: float, update: TouchUpdate) -> int:
    """Merge two touches into the older one, or into the one that is far stronger.

    Returns:
        The touch that remains.
    """
    forces = update.touches[older].peak_force, update.touches[younger].peak_force
    if forces[1] > restart * forces[0]:
        older, younger = younger, older
    touch, gone = update.touches[older], update.touches[younger]
    touch.last = max(touch.last, gone.last)
    touch.impulse += gone.impulse
    touch.force += gone.force
    touch.peak_force = max(touch.peak_force, gone.peak_force)
    touch.peak = max(touch.peak, gone.peak)
    touch.evidence += gone.evidence
    touch.confirmed = max(touch.confirmed, gone.confirmed)
    update.survivors[younger] = older
    close_touch(younger, touch.id, update)
    return older


@compiled
def close_touch(touch: int, merged_into: int, update: TouchUpdate) -> None:
    """Close a touch that was merged into the one of an id, 0 for none."""
    update.touches[touch].closed = 1
    update.touches[touch].merged_into = merged_into
    update.closed[update.counts[CLOSED]] = touch
    update.counts[CLOSED] += 1


@compiled
def group_tracks(
    tracks: np.ndarray,
    ongoing: int,
    points: Float[np.ndarray, "load 3"],
    reading: KernelReading,
    context: TrackerContext,
    buffer: RecordBuffer,
) -> TouchUpdate:
    """Group the tracks of the next reading into touches.

    A new track joins the touch of its parent, of any track that ended near it within
    the pause, and of any that has contact beside it. Where these are several touches,
    the younger are merged into the oldest, and close with `merged_into`. A track that
    may be noise is a touch of its own until it has more evidence: where many taxels
    are noisy, their contacts must not keep a touch open for ever. On a skin that
    is not calibrated, distances have no meaning: all contacts within the pause are one
    touch.
    """
    parameters = context.parameters
    update = begin_update(tracks, ongoing, points, reading, parameters, buffer)
    gained, became_sure = weigh_tracks(reading, context, update)
    for track in range(ongoing):
        if update.owners[track] == NO_INDEX or became_sure[track]:
            assign_touch(track, reading, context, update)
    merge_near(reading.stamp, parameters, update)
    restart_touches(reading, context, update)
    update_open_touches(gained, reading, context, update)
    return update


@compiled
def weigh_contact(
    contact: np.void,
    reading: KernelReading,
    context: TrackerContext,
    buffer: RecordBuffer,
) -> float:
    """Return the evidence of a contact in one reading that it is no noise.

    Each taxel adds the logarithm of its pressure in units of its noise, within limits.
    Where only one of them is well above its noise, that counts only while its pressure
    rises above what it was before, since the offset of a taxel may jump, and then stays
    or swings. In readings without noise every contact is evidence enough.
    """
    parameters, state = context.parameters, context.state
    evidence, clear, strongest, changed = 0.0, 0, 0.0, False
    span = contact.loads
    for k in range(span[0], span[1]):
        load = buffer.loads[k]
        if reading.floor[load.taxel] == 0.0:
            return np.inf
        noise = max(reading.floor[load.taxel], MIN_NOISE)
        strength = np.log(max(load.pressure / noise, 1.0))
        strength = min(strength, parameters.max_taxel_llr)
        evidence += strength
        clear += load.pressure >= CLEAR_FACTOR * noise
        if strength > strongest:
            strongest, changed = strength, state.taxels[load.taxel].changed
    return evidence if clear > 1 or changed else 0.0


@compiled
def weigh_tracks(
    reading: KernelReading, context: TrackerContext, update: TouchUpdate
) -> tuple[Float[np.ndarray, "track"], Bool[np.ndarray, "track"]]:
    """Add the evidence of this reading to that of the tracks, which fades.

    A track has no more than confirms a touch, so that all fade in the same time. What
    has faded takes no later track into its touch.

    Returns:
        The evidence added to each ongoing track, and which have enough of it only now
        to be of one touch with others.
    """
    parameters, buffer = context.parameters, update.buffer
    tracks = update.tracks[: update.ongoing]
    least = parameters.least_evidence
    elapsed = min(reading.elapsed, parameters.pause_ns)
    kept = np.exp(-elapsed / (FADE_SECONDS * NS_PER_S))
    gained, became_sure = np.zeros(len(tracks)), np.zeros(len(tracks), np.bool_)
    for track in range(len(tracks)):
        if tracks[track].last == reading.stamp:
            contact = buffer.contacts[tracks[track].contact]
            before = kept * tracks[track].evidence
            gained[track] = weigh_contact(contact, reading, context, buffer)
            tracks[track].evidence = min(before + gained[track], parameters.confirm_llr)
            became_sure[track] = before < least <= tracks[track].evidence
    return gained, became_sure


@compiled
def assign_touch(
    track: int, reading: KernelReading, context: TrackerContext, update: TouchUpdate
) -> None:
    """Assign a touch to a track that has none, and merge the touches that it connects.

    Tracks that may be noise connect nothing.
    """
    tracks, owner = update.tracks, update.owners[track]
    least = context.parameters.least_evidence
    fitting = np.zeros(update.counts[ALL], np.bool_)
    if owner != NO_INDEX:
        fitting[find_survivor(owner, update)] = True
    for other in range(len(tracks)):
        if min(tracks[track].evidence, tracks[other].evidence) < least:
            continue
        if other != track and update.owners[other] != NO_INDEX:
            touch = find_survivor(update.owners[other], update)
            if not fitting[touch]:
                fitting[touch] = belongs_together(
                    track, other, reading, context.parameters, update
                )
    first = NO_INDEX
    for touch in range(len(fitting)):
        if fitting[touch] and first != NO_INDEX:
            restart = context.parameters.restart
            first = merge_touches(first, touch, restart, update)
        elif fitting[touch]:
            first = touch
    if owner != NO_INDEX:
        return
    if first == NO_INDEX:
        first = start_touch(tracks[track], context.state, update)
    update.owners[track] = update.joined[track] = first


@compiled
def belongs_together(
    track: int,
    other: int,
    reading: KernelReading,
    parameters: TrackingParameters,
    update: TouchUpdate,
) -> bool:
    """Return whether a track belongs to the same touch as another, by where it is."""
    tracks, buffer = update.tracks, update.buffer
    if tracks[track].parent == tracks[other].id or not parameters.calibrated:
        return True
    if min(tracks[track].last, tracks[other].last) == reading.stamp:
        return are_near(track, other, parameters.max_separation, update)
    if reading.stamp - tracks[other].last > parameters.pause_ns:
        return False
    end = buffer.contacts[tracks[other].contact]
    start = buffer.contacts[tracks[track].contact].p_world
    T_world_link = reading.T_world_link[end.link]
    return distance_to_link_point(T_world_link, end.p_link, start) <= parameters.max_gap


@compiled
def are_near(one: int, other: int, reach: float, update: TouchUpdate) -> bool:
    """Return whether the nearest taxels of two contacts are within reach [m]."""
    points, boxes, buffer = update.points, update.boxes, update.buffer
    if box_gap(boxes[one], boxes[other]) > reach:
        return False
    a = buffer.contacts[update.tracks[one].contact].loads
    b = buffer.contacts[update.tracks[other].contact].loads
    for m in range(a[0], a[1]):
        if point_gap(points[m], boxes[other]) > reach:
            continue
        for n in range(b[0], b[1]):
            if distance(points[m], points[n]) <= reach:
                return True
    return False


@compiled
def merge_near(stamp: int, parameters: TrackingParameters, update: TouchUpdate) -> None:
    """Merge the touches of ongoing tracks whose contacts are beside each other."""
    tracks, reach = update.tracks[: update.ongoing], parameters.max_separation
    if update.counts[ALL] - update.counts[CLOSED] < 2:
        return
    for one in range(len(tracks)):
        if tracks[one].evidence < parameters.least_evidence:
            continue
        for other in range(one + 1, len(tracks)):
            if tracks[other].evidence < parameters.least_evidence:
                continue
            a = find_survivor(update.owners[one], update)
            b = find_survivor(update.owners[other], update)
            if a == b or min(tracks[one].last, tracks[other].last) < stamp:
                continue
            if are_near(one, other, reach, update):
                merge_touches(min(a, b), max(a, b), parameters.restart, update)


@compiled
def restart_touches(
    reading: KernelReading, context: TrackerContext, update: TouchUpdate
) -> None:
    """Start a new touch where the force grows far beyond that of a touch.

    What came before may be noise, or a hand that hovers; it gives the new one neither
    its age nor its place. A confirmed touch is merged into the new one.
    """
    parameters, buffer = context.parameters, update.buffer
    tracks = update.tracks[: update.ongoing]
    for n in range(update.counts[PREVIOUS]):
        touch = update.touches[n]
        if touch.closed or touch.settled == 0.0:
            continue
        force, largest, strongest = 0.0, 0.0, NO_INDEX
        for track in range(len(tracks)):
            is_current = tracks[track].last == reading.stamp
            if is_current and find_survivor(update.owners[track], update) == n:
                contact = buffer.contacts[tracks[track].contact]
                force += contact.force
                if contact.force > largest:
                    largest, strongest = contact.force, track
        if strongest == NO_INDEX or force < parameters.restart * touch.settled:
            continue
        new = start_touch(tracks[strongest], context.state, update)
        update.touches[new].onset = update.touches[new].settled_at = reading.stamp
        update.touches[new].confirmed = touch.confirmed
        for track in range(len(tracks)):
            is_current = tracks[track].last == reading.stamp
            if is_current and find_survivor(update.owners[track], update) == n:
                update.owners[track] = update.joined[track] = new
        close_touch(n, update.touches[new].id if touch.confirmed else 0, update)


@compiled
def update_open_touches(
    gained: Float[np.ndarray, "track"],
    reading: KernelReading,
    context: TrackerContext,
    update: TouchUpdate,
) -> None:
    """Update every open touch with the contacts of ongoing tracks."""
    parameters, buffer = context.parameters, update.buffer
    tracks, count = update.tracks[: update.ongoing], update.counts[ALL]
    force, centre = np.zeros(count), np.zeros((count, 3))
    # The force in a longer gap between readings is unknown.
    seconds = 0.0
    if reading.elapsed <= parameters.pause_ns:
        seconds = reading.elapsed / NS_PER_S
    strongest = fill_indices(count)
    for track in range(len(tracks)):
        if tracks[track].last == reading.stamp:
            n = find_survivor(update.owners[track], update)
            touch, contact = update.touches[n], buffer.contacts[tracks[track].contact]
            force[n] += contact.force
            for r in range(3):
                centre[n, r] += contact.force * contact.p_world[r]
            touch.peak = max(touch.peak, contact.peak)
            touch.evidence += gained[track]
            best = strongest[n]
            if best == NO_INDEX or contact.force > buffer.contacts[best].force:
                strongest[n] = tracks[track].contact
    for n in range(count):
        touch = update.touches[n]
        if touch.closed:
            continue
        touch.impulse += 0.5 * (force[n] + touch.force) * seconds
        touch.force = force[n]
        if strongest[n] != NO_INDEX:
            touch.contact, update.renewed[n] = strongest[n], True
            touch.last = reading.stamp
            touch.peak_force = max(touch.peak_force, force[n])
            for r in range(3):
                centre[n, r] /= force[n]
            transform_to_link(reading.T_world_link[touch.link], centre[n], touch.latest)
        lasts = touch.onset < reading.stamp or reading.elapsed > SLOW_NS
        if touch.last == reading.stamp and (lasts or touch.evidence == np.inf):
            if touch.evidence >= parameters.confirm_llr:
                touch.confirmed = 1
        touch.farthest = max(touch.farthest, distance(touch.latest, touch.start))
        if reading.stamp - touch.settled_at >= parameters.settle_ns:
            touch.settled, touch.settled_at = touch.peak_force, reading.stamp
        if n < update.counts[PREVIOUS]:
            last = buffer.before.touches[n].last
            lifted = last < reading.stamp - reading.elapsed
            touch.contacts += lifted and touch.last - last > MIN_LIFT_NS
