"""This module continues tracks of contacts, and groups them into touches."""

from collections.abc import Sequence
from itertools import combinations, product
from math import exp, inf, sqrt
from operator import attrgetter
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.touch.contact_kernels import PA_PER_KPA, PRESS_END
from eskin.touch.fault_kernels import LONE_STEP
from eskin.touch.records import (
    FINGERTIP,
    NO_INDEX,
    NO_TAXELS,
    ContactRecord,
    KernelReading,
    TouchRecord,
    TrackerContext,
    TrackingParameters,
    TrackRecord,
    Vector,
    copy_record,
)
from eskin.touch.rest_kernels import LOW_SECONDS
from eskin.units import seconds_between

UM_PER_M = 1e6
FADE_SECONDS = 2.0
"""Time constant with which the evidence of a track fades [s]: what has given none for
some seconds may be a taxel that does not return to its rest, and joins no other."""
HELD_SHARE = 0.15
"""Share of its greatest pressure from which a taxel is still pressed whose contact has
ended; creep leaves less."""
HELD_FORCE = 1.0
"""Force from which taxels are pressed by a hand, however weak beside a press [N]."""
MIN_LIFT_SECONDS = LOW_SECONDS
"""Smallest time without contact from which a contact counts as a new one [s]; it must
contain a reading."""

by_force = attrgetter("force")
by_track_force = attrgetter("contact.force")


@final
class TrackFollower:
    """A follower continues tracks in the contacts of each reading; stateful.

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

    Attributes:
        ongoing: tracks with contact, or whose taxels are not received, by id.
        ended: tracks that ended with the latest reading, by id.
        past: tracks that ended before, while a new one may join their touch.
    """

    def __init__(
        self, areas: Float[np.ndarray, "taxel"], parameters: TrackingParameters
    ) -> None:
        """Start without tracks on a skin whose taxels have these areas [m2]."""
        self.areas = areas
        self.parameters = parameters
        self.covering = np.zeros(len(areas), np.int64)
        self.next_id = 1
        self.clear()

    def clear(self) -> None:
        """Drop all tracks."""
        self.ongoing: list[TrackRecord] = []
        self.ended: list[TrackRecord] = []
        self.past: list[TrackRecord] = []

    @property
    def all(self) -> list[TrackRecord]:
        """Ongoing, ended and past tracks."""
        return self.ongoing + self.ended + self.past

    def follow_contacts(
        self, contacts: Sequence[ContactRecord], reading: KernelReading
    ) -> None:
        """Continue the tracks in the contacts of the next reading."""
        before = self.ongoing
        instant = reading.instant
        pause = self.parameters.pause_seconds
        self.past = [
            copy_record(track)
            for track in self.ended + self.past
            if instant.seconds_since(track.last) <= pause
        ]
        self.ongoing = []
        self.ended = []
        successors = [NO_INDEX] * len(before)
        parents = [NO_INDEX] * len(contacts)
        if instant.elapsed <= pause:
            self.match_overlaps(before, contacts, successors, parents)
            if NO_INDEX in successors:
                self.pair_nearest(before, contacts, successors, parents, reading)
        owners = self.find_owners(before, successors)
        for n, contact in enumerate(successors):
            track = copy_record(before[n])
            if contact == NO_INDEX:
                goes_on = self.is_coasting(track, reading)
            elif goes_on := owners[contact] == n:
                track.last = instant.stamp
                track.contact = contacts[contact]
            else:
                track.merged_into = before[owners[contact]].id
            track.ended = not goes_on
            (self.ongoing if goes_on else self.ended).append(track)
        for n, contact in enumerate(contacts):
            if n not in owners:
                track = TrackRecord(self.next_id, instant.stamp, instant.stamp, contact)
                self.next_id += 1
                if parents[n] != NO_INDEX:
                    parent = before[parents[n]]
                    track.parent = parent.id
                    track.evidence = parent.evidence
                self.ongoing.append(track)

    def match_overlaps(
        self,
        before: Sequence[TrackRecord],
        contacts: Sequence[ContactRecord],
        successors: list[int],
        parents: list[int],
    ) -> None:
        """Match contacts that overlap the previous ones of tracks.

        Write the contact in which each track continues, and the track of which each
        contact covers most.
        """
        for n, track in enumerate(before):
            self.covering[track.contact.taxels] = n + 1
        best = [0.0] * len(before)
        for n, contact in enumerate(contacts):
            taxels = contact.taxels
            most = 0.0
            covered = np.bincount(self.covering[taxels], self.areas[taxels])[1:]
            for track in covered.nonzero()[0].tolist():
                area = float(covered[track])
                if area > most:
                    most = area
                    parents[n] = track
                other = contacts[successors[track]]
                if area > best[track] or (
                    area == best[track] and contact.force > other.force
                ):
                    best[track] = area
                    successors[track] = n
        for track in before:
            self.covering[track.contact.taxels] = 0

    def pair_nearest(
        self,
        before: Sequence[TrackRecord],
        contacts: Sequence[ContactRecord],
        successors: list[int],
        parents: list[int],
        reading: KernelReading,
    ) -> None:
        """Pair tracks and contacts that overlap nothing, nearest first within the gate.

        Distances are rounded to 1 um, so that rounding errors of the pose decide no
        tie.
        """
        parameters = self.parameters
        pairs = []
        taken = set()
        gate = parameters.gate + parameters.speed * reading.instant.elapsed
        lost = [n for n, contact in enumerate(successors) if contact == NO_INDEX]
        free = [k for k, track in enumerate(parents) if track == NO_INDEX]
        for n, k in product(lost, free):
            if before[n].evidence >= parameters.least_evidence:
                gap = measure_gap(before[n].contact, contacts[k], reading)
                pairs.append((round(gap * UM_PER_M) / UM_PER_M, n, k))
        for gap, n, k in sorted(pairs):
            if gap <= gate and successors[n] == NO_INDEX and k not in taken:
                successors[n] = k
                taken.add(k)

    def find_owners(
        self, before: Sequence[TrackRecord], successors: Sequence[int]
    ) -> dict[int, int]:
        """Return the track that keeps its id in each contact where tracks continue.

        It is the oldest of them; those that may be noise come after all others.
        """
        owners: dict[int, int] = {}
        for n, contact in enumerate(successors):
            if contact != NO_INDEX:
                owner = owners.setdefault(contact, n)
                if owner != n and self.rank(before[n]) < self.rank(before[owner]):
                    owners[contact] = n
        return owners

    def rank(self, track: TrackRecord) -> tuple[bool, int]:
        """Return by what tracks are sorted that continue in one contact."""
        return track.evidence < self.parameters.least_evidence, track.onset

    def is_coasting(self, track: TrackRecord, reading: KernelReading) -> bool:
        """Return whether most taxels of a track without contact were not received."""
        lost = reading.instant.seconds_since(track.last)
        if lost > self.parameters.dropout_seconds:
            return False
        received = reading.valid[track.contact.taxels]
        return 2 * int(np.count_nonzero(received)) < len(received)


def measure_gap(
    old: ContactRecord, new: ContactRecord, reading: KernelReading
) -> float:
    """Return the distance of a contact from where the link has an older one now [m]."""
    x, y, z = old.p_link
    here = [
        T[0] * x + T[1] * y + T[2] * z + T[3]
        for T in reading.T_world_link[old.link, :3].tolist()
    ]
    return measure_distance(new.p_world, here)


def measure_distance(one: Vector, other: Sequence[float]) -> float:
    """Return the distance between two points [m]."""
    x, y, z = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    return sqrt(x * x + y * y + z * z)


@final
class TouchGrouper:
    """A grouper groups the tracks of each reading into touches; stateful.

    A new track joins the touch of its parent, of any track that ended near it within
    the pause, and of any that has contact beside it. Where these are several touches,
    the younger are merged into the oldest, and close with `merged_into`. A track that
    may be noise is a touch of its own until it has more evidence: where many taxels
    are noisy, their contacts must not keep a touch open for ever. On a skin that
    is not calibrated, distances have no meaning: all contacts within the pause are one
    touch.

    Attributes:
        touches: open touches by their ids, which ascend.
        closed: touches that closed with the latest reading.
        past: confirmed touches that have closed lately, by their ids.
        held: confirmed touches that have closed, of which taxels are still pressed.
    """

    def __init__(self, context: TrackerContext) -> None:
        """Start without touches on the skin of a tracker."""
        self.parameters = context.parameters
        self.smooth = context.taxels["smooth"]
        self.strongest = context.taxels["strongest"]
        self.pressed_at = context.taxels["pressed_at"]
        self.released = context.taxels["released"]
        self.owner = context.taxels["touch"]
        self.links = context.links
        self.areas = context.places.areas
        self.pressed = context.pressed
        self.pressed_count = context.pressed_count
        self.next_id = 1
        self.clear()

    def clear(self) -> None:
        """Drop all touches."""
        self.touches: dict[int, TouchRecord] = {}
        self.closed: list[TouchRecord] = []
        self.held: list[TouchRecord] = []
        self.past: dict[int, TouchRecord] = {}

    def group_tracks(
        self,
        tracks: TrackFollower,
        near: Float[np.ndarray, "contact contact"],
        reading: KernelReading,
    ) -> None:
        """Group the tracks of the next reading.

        Args:
            tracks: tracks; the touch and the evidence of each are updated.
            near: 1 where two contacts are beside each other, else 0.
            reading: the reading.
        """
        self.reading = reading
        self.near = near
        self.ongoing = tracks.ongoing
        self.tracks = tracks.all
        self.current = [
            one for one in self.ongoing if one.last == reading.instant.stamp
        ]
        self.before = self.touches
        self.touches = {}
        self.closed = []
        for number, touch in self.before.items():
            touch = self.touches[number] = copy_record(touch)
            touch.before = touch.taxels
            touch.taxels = NO_TAXELS
        self.close_paused()
        became_sure = self.weigh_tracks()
        for track in self.ongoing:
            if track.touch not in self.touches or track.id in became_sure:
                self.assign_touch(track)
        self.merge_near()
        contacts: dict[int, list[ContactRecord]] = {}
        for track in self.current:
            contacts.setdefault(track.touch, []).append(track.contact)
        for touch in list(self.touches.values()):
            self.restart_touch(touch, contacts)
        for touch in self.touches.values():
            self.update_touch(touch, contacts.get(touch.id, []))
        self.update_held()

    def close_paused(self) -> None:
        """Close the touches whose last contact was longer ago than the pause."""
        parameters = self.parameters
        ongoing = {one.touch for one in self.ongoing}
        for touch in list(self.touches.values()):
            pause = parameters.pause_seconds
            weak = not touch.confirmed and touch.evidence < parameters.least_evidence
            if weak and touch.id not in ongoing:
                pause = min(pause, MIN_LIFT_SECONDS)
            if self.reading.instant.seconds_since(touch.last) > pause:
                self.close(touch, 0)

    def close(self, touch: TouchRecord, merged_into: int) -> None:
        """Close a touch that was merged into the one of an id, 0 for none."""
        touch.closed = True
        touch.merged_into = merged_into
        touch.before = NO_TAXELS
        self.closed.append(self.touches.pop(touch.id))

    def weigh_tracks(self) -> set[int]:
        """Add the evidence of this reading to the tracks, whose evidence fades.

        A track has no more than confirms a touch, so that all fade in the same time.
        What has faded takes no later track into its touch.

        Returns:
            Ids of the tracks that have enough of it only now to be of one touch with
            others.
        """
        parameters = self.parameters
        became_sure = set()
        elapsed = min(self.reading.instant.elapsed, parameters.pause_seconds)
        kept = exp(-elapsed / FADE_SECONDS)
        for track in self.current:
            before = kept * track.evidence
            evidence = before + track.contact.evidence
            track.evidence = min(evidence, parameters.confirm_llr)
            if before < parameters.least_evidence <= track.evidence:
                became_sure.add(track.id)
        return became_sure

    def is_sure(self, track: TrackRecord) -> bool:
        """Return whether a track has enough evidence to be of one touch with others."""
        return track.evidence >= self.parameters.least_evidence

    def assign_touch(self, track: TrackRecord) -> None:
        """Assign a touch to a track, and merge the touches that it connects.

        Tracks that may be noise connect nothing.
        """
        fitting = {track.touch} & self.touches.keys()
        others = self.tracks if self.is_sure(track) else ()
        for other in others:
            if other.touch in self.touches and other.touch not in fitting:
                if self.is_sure(other) and self.belongs_together(track, other):
                    fitting.add(other.touch)
        touch, *younger = [self.touches[i] for i in sorted(fitting)] or [
            self.start_touch(track)
        ]
        for other in younger:
            touch = self.merge(touch, other)
        if track.touch != touch.id:
            track.touch = touch.id
            touch.tracks = tuple(sorted((*touch.tracks, track.id)))

    def belongs_together(self, track: TrackRecord, other: TrackRecord) -> bool:
        """Return whether a track belongs to the same touch as another, by its place."""
        instant = self.reading.instant
        if track.parent == other.id or not self.parameters.calibrated:
            return True
        if min(track.last, other.last) == instant.stamp:
            return bool(self.near[track.contact.place, other.contact.place])
        if instant.seconds_since(other.last) > self.parameters.pause_seconds:
            return False
        gap = measure_gap(other.contact, track.contact, self.reading)
        is_coarse = min(other.contact.cell, track.contact.cell) >= FINGERTIP
        reach = self.parameters.max_gap
        if is_coarse:
            reach = max(reach, self.parameters.hand)
        return gap <= reach

    def start_touch(self, track: TrackRecord) -> TouchRecord:
        """Start a touch with its first track."""
        contact = track.contact
        touch = TouchRecord(
            self.next_id,
            onset=min(track.onset, contact.onset),
            last=track.last,
            confirmed=False,
            contact=contact,
            link=contact.link,
            start=contact.p_link,
            latest=contact.p_link,
            settled_at=track.onset,
        )
        self.next_id += 1
        self.touches[touch.id] = touch
        return touch

    def merge(self, older: TouchRecord, younger: TouchRecord) -> TouchRecord:
        """Merge two touches into the older one, or into the one that is far stronger.

        Returns:
            The touch that remains.
        """
        touch = older
        gone = younger
        if younger.peak_force > self.parameters.restart * older.peak_force:
            touch = younger
            gone = older
        touch.last = max(touch.last, gone.last)
        touch.impulse += gone.impulse
        touch.force += gone.force
        touch.peak_force = max(touch.peak_force, gone.peak_force)
        touch.peak = max(touch.peak, gone.peak)
        touch.evidence += gone.evidence
        touch.confirmed |= gone.confirmed
        touch.tracks = tuple(sorted(touch.tracks + gone.tracks))
        touch.before = np.concatenate([touch.before, gone.before])
        self.owner[self.owner == gone.id] = touch.id
        for track in self.tracks:
            if track.touch == gone.id:
                track.touch = touch.id
        self.close(gone, touch.id)
        return touch

    def merge_near(self) -> None:
        """Merge the touches of tracks whose contacts are beside each other."""
        if len(self.touches) < 2:
            return
        for one, other in combinations(filter(self.is_sure, self.current), 2):
            if one.touch != other.touch:
                if self.near[one.contact.place, other.contact.place]:
                    ids = sorted((one.touch, other.touch))
                    self.merge(*[self.touches[number] for number in ids])

    def restart_touch(
        self, touch: TouchRecord, contacts: dict[int, list[ContactRecord]]
    ) -> None:
        """Start a new touch where the force grows far beyond the force of a touch.

        What came before may be noise, or a hand that hovers; it gives the new one
        neither its age nor its place. A confirmed touch is merged into the new one.

        Args:
            touch: an open touch.
            contacts: current contacts of each touch, by its id.
        """
        if touch.settled == 0.0 or touch.id not in contacts:
            return
        force = sum_forces(contacts[touch.id])
        if force < self.parameters.restart * touch.settled:
            return
        moved = [one for one in self.current if one.touch == touch.id]
        new = self.start_touch(max(moved, key=by_track_force))
        new.onset = new.settled_at = self.reading.instant.stamp
        new.confirmed = touch.confirmed
        new.tracks = tuple(one.id for one in moved)
        for track in moved:
            track.touch = new.id
        self.owner[self.owner == touch.id] = new.id
        contacts[new.id] = contacts.pop(touch.id)
        self.close(touch, new.id if touch.confirmed else 0)

    def update_touch(
        self, touch: TouchRecord, contacts: Sequence[ContactRecord]
    ) -> None:
        """Update an open touch with its contacts in this reading."""
        parameters = self.parameters
        instant = self.reading.instant
        stamp = instant.stamp
        force = sum_forces(contacts)
        # The force in a longer gap between readings is unknown.
        if instant.elapsed <= parameters.pause_seconds:
            touch.impulse += 0.5 * (force + touch.force) * instant.elapsed
        touch.force = force
        if contacts:
            touch.contact = max(contacts, key=by_force)
            touch.last = stamp
            for contact in contacts:
                touch.evidence += contact.evidence
                touch.peak = max(touch.peak, contact.peak)
            touch.peak_force = max(touch.peak_force, force)
            touch.latest = self.find_centre(contacts, force, touch.link)
            touch.taxels = contacts[0].taxels
            if len(contacts) > 1:
                touch.taxels = np.concatenate([one.taxels for one in contacts])
        lasts = touch.onset < stamp or instant.elapsed > LONE_STEP.max_interval
        if touch.last == stamp and (lasts or touch.evidence == inf):
            touch.confirmed |= touch.evidence >= parameters.confirm_llr
        distance = measure_distance(touch.latest, touch.start)
        touch.farthest = max(touch.farthest, distance)
        if instant.seconds_since(touch.settled_at) >= parameters.settle_seconds:
            touch.settled = touch.peak_force
            touch.settled_at = stamp
        if touch.id in self.before:
            last = self.before[touch.id].last
            lifted = seconds_between(last, touch.last)
            if last < instant.previous_stamp and lifted > MIN_LIFT_SECONDS:
                touch.contacts += 1

    def update_held(self) -> None:
        """Find the taxels that are pressed without contact, and whose they are.

        They are of the touch whose contact they were in last. What has never been in
        contact is clearly pressed, and of a touch beside it. What is left of a press is
        less than a share of it; a hand that eases is not.
        """
        for touch in self.closed:
            if touch.confirmed and not touch.merged_into:
                self.past[touch.id] = touch
        for track in self.current:
            self.owner[track.contact.taxels] = track.touch
        pressed = self.pressed[: self.pressed_count[0]]
        is_old = self.pressed_at[pressed] < self.reading.instant.now
        others = pressed[is_old | (self.released[pressed] != 0)]
        taxels = NO_TAXELS
        if len(others):
            smooth = self.smooth[others]
            is_held = smooth >= HELD_SHARE * self.strongest[others]
            clear = smooth >= PRESS_END.clear_press * self.parameters.off
            taxels = others[is_held & ((self.owner[others] > 0) | clear)]
            self.find_owners(taxels)
        for touch in self.touches.values():
            touch.held = NO_TAXELS
            if touch.confirmed:
                touch.held = self.select_held(touch, taxels)
        self.update_past(taxels)

    def select_held(
        self, touch: TouchRecord, taxels: Int[np.ndarray, "pressed"]
    ) -> Int[np.ndarray, "held"]:
        """Select the taxels that are of a touch.

        A few may have offsets of their own. They press as a hand does, or one of them
        is no less than a share of the greatest pressure of the touch.
        """
        if not len(taxels):
            return NO_TAXELS
        own = taxels[self.owner[taxels] == touch.id]
        pressure = self.smooth[own]
        force = PA_PER_KPA * float(pressure @ self.areas[own])
        is_strong = pressure.max(initial=0.0) >= HELD_SHARE * touch.peak
        return own if is_strong or force >= HELD_FORCE else NO_TAXELS

    def find_owners(self, taxels: Int[np.ndarray, "pressed"]) -> None:
        """Find a touch for taxels whose own is not known any more."""
        for i in taxels.tolist():
            owner = int(self.owner[i])
            if owner in self.touches or owner in self.past:
                continue
            link = self.links[i]
            near = [one.touch for one in self.current if one.contact.link == link]
            self.owner[i] = near[0] if near else 0

    def update_past(self, taxels: Int[np.ndarray, "pressed"]) -> None:
        """Update the touches that have closed, by the taxels that are pressed."""
        instant = self.reading.instant
        self.held = []
        for number, touch in list(self.past.items()):
            held = self.select_held(touch, taxels)
            if len(held):
                touch = copy_record(touch)
                touch.held = held
                touch.last = max(touch.last, instant.previous_stamp)
                self.past[number] = touch
                self.held.append(touch)
            elif instant.seconds_since(touch.last) > self.parameters.pause_seconds:
                # It has left: what is pressed later is another hand's.
                del self.past[number]

    def find_centre(
        self, contacts: Sequence[ContactRecord], force: float, link: int
    ) -> Vector:
        """Return the centre of contacts by force, in the frame of a link [m]."""
        x = y = z = 0.0
        for contact in contacts:
            x += contact.force * contact.p_world[0]
            y += contact.force * contact.p_world[1]
            z += contact.force * contact.p_world[2]
        a, b, c, _ = self.reading.T_world_link[link].tolist()
        x, y, z = x / force - a[3], y / force - b[3], z / force - c[3]
        return (
            x * a[0] + y * b[0] + z * c[0],
            x * a[1] + y * b[1] + z * c[1],
            x * a[2] + y * b[2] + z * c[2],
        )


def sum_forces(contacts: Sequence[ContactRecord]) -> float:
    """Return the sum of the forces of contacts [N]."""
    return sum([contact.force for contact in contacts], 0.0)
