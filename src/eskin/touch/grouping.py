"""This module groups the tracks of each reading into touches."""

from collections.abc import Sequence
from itertools import combinations
from math import exp, inf
from operator import attrgetter
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.touch.belief_kernels import MAX_STEP_INTERVAL
from eskin.touch.calibration_kernels import LOW_SECONDS
from eskin.touch.records import (
    NO_TAXELS,
    ContactRecord,
    KernelReading,
    TouchRecord,
    TrackingParameters,
    TrackRecord,
    Vector,
    copy_record,
)
from eskin.touch.tracks import TrackFollower, measure_distance, measure_gap
from eskin.units import NS_PER_S

SLOW_NS = round(MAX_STEP_INTERVAL * NS_PER_S)
"""Time between two readings from which a touch may last for one of them [ns]."""
FADE_SECONDS = 2.0
"""Time constant with which the evidence of a track fades [s]: what has given none for
some seconds may be a taxel that does not return to its rest, and joins no other."""
MIN_LIFT_NS = round(LOW_SECONDS * NS_PER_S)
"""Smallest time without contact from which a contact counts as a new one [ns]; it must
contain a reading."""

by_force, by_track_force = attrgetter("force"), attrgetter("contact.force")


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
    """

    def __init__(self, parameters: TrackingParameters) -> None:
        """Start without touches."""
        self.parameters = parameters
        self.next_id = 1
        self.clear()

    def clear(self) -> None:
        """Drop all touches."""
        self.touches: dict[int, TouchRecord] = {}
        self.closed: list[TouchRecord] = []

    def push(
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
        self.reading, self.near = reading, near
        self.ongoing, self.tracks = tracks.ongoing, tracks.all
        self.current = [one for one in self.ongoing if one.last == reading.stamp]
        self.before, self.touches, self.closed = self.touches, {}, []
        for number, touch in self.before.items():
            touch = self.touches[number] = copy_record(touch)
            touch.before, touch.taxels = touch.taxels, NO_TAXELS
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

    def close_paused(self) -> None:
        """Close the touches whose last contact was longer ago than the pause."""
        parameters, ongoing = self.parameters, {one.touch for one in self.ongoing}
        for touch in list(self.touches.values()):
            pause = parameters.pause_ns
            weak = not touch.confirmed and touch.evidence < parameters.least_evidence
            if weak and touch.id not in ongoing:
                pause = min(pause, MIN_LIFT_NS)
            if self.reading.stamp - touch.last > pause:
                self.close(touch, 0)

    def close(self, touch: TouchRecord, merged_into: int) -> None:
        """Close a touch that was merged into the one of an id, 0 for none."""
        touch.closed, touch.merged_into = True, merged_into
        touch.before = NO_TAXELS
        self.closed.append(self.touches.pop(touch.id))

    def weigh_tracks(self) -> set[int]:
        """Add the evidence of this reading to that of the tracks, which fades.

        A track has no more than confirms a touch, so that all fade in the same time.
        What has faded takes no later track into its touch.

        Returns:
            Ids of the tracks that have enough of it only now to be of one touch with
            others.
        """
        parameters, became_sure = self.parameters, set()
        elapsed = min(self.reading.elapsed, parameters.pause_ns)
        kept = exp(-elapsed / (FADE_SECONDS * NS_PER_S))
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
        stamp = self.reading.stamp
        if track.parent == other.id or not self.parameters.calibrated:
            return True
        if min(track.last, other.last) == stamp:
            return bool(self.near[track.contact.place, other.contact.place])
        if stamp - other.last > self.parameters.pause_ns:
            return False
        gap = measure_gap(other.contact, track.contact, self.reading)
        return gap <= self.parameters.max_gap

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
        touch, gone = older, younger
        if younger.peak_force > self.parameters.restart * older.peak_force:
            touch, gone = younger, older
        touch.last = max(touch.last, gone.last)
        touch.impulse += gone.impulse
        touch.force += gone.force
        touch.peak_force = max(touch.peak_force, gone.peak_force)
        touch.peak = max(touch.peak, gone.peak)
        touch.evidence += gone.evidence
        touch.confirmed |= gone.confirmed
        touch.tracks = tuple(sorted(touch.tracks + gone.tracks))
        touch.before = np.concatenate([touch.before, gone.before])
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
        """Start a new touch where the force grows far beyond that of a touch.

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
        new.onset = new.settled_at = self.reading.stamp
        new.confirmed, new.tracks = touch.confirmed, tuple(one.id for one in moved)
        for track in moved:
            track.touch = new.id
        contacts[new.id] = contacts.pop(touch.id)
        self.close(touch, new.id if touch.confirmed else 0)

    def update_touch(
        self, touch: TouchRecord, contacts: Sequence[ContactRecord]
    ) -> None:
        """Update an open touch with its contacts in this reading."""
        parameters, reading = self.parameters, self.reading
        stamp, force = reading.stamp, sum_forces(contacts)
        # The force in a longer gap between readings is unknown.
        if reading.elapsed <= parameters.pause_ns:
            touch.impulse += 0.5 * (force + touch.force) * (reading.elapsed / NS_PER_S)
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
        lasts = touch.onset < stamp or reading.elapsed > SLOW_NS
        if touch.last == stamp and (lasts or touch.evidence == inf):
            touch.confirmed |= touch.evidence >= parameters.confirm_llr
        distance = measure_distance(touch.latest, touch.start)
        touch.farthest = max(touch.farthest, distance)
        if stamp - touch.settled_at >= parameters.settle_ns:
            touch.settled, touch.settled_at = touch.peak_force, stamp
        if touch.id in self.before:
            last = self.before[touch.id].last
            if last < stamp - reading.elapsed and touch.last - last > MIN_LIFT_NS:
                touch.contacts += 1

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
