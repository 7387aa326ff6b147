"""This module continues the tracks of contacts from one reading to the next."""

from collections.abc import Sequence
from itertools import product
from math import sqrt
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.touch.records import (
    NO_INDEX,
    ContactRecord,
    KernelReading,
    TrackingParameters,
    TrackRecord,
    Vector,
    copy_record,
)
from eskin.units import NS_PER_S

UM_PER_M = 1e6


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

    def push(self, contacts: Sequence[ContactRecord], reading: KernelReading) -> None:
        """Continue the tracks in the contacts of the next reading."""
        before, pause = self.ongoing, self.parameters.pause_ns
        self.past = [
            copy_record(track)
            for track in self.ended + self.past
            if reading.stamp - track.last <= pause
        ]
        self.ongoing, self.ended = [], []
        successors, parents = [NO_INDEX] * len(before), [NO_INDEX] * len(contacts)
        if reading.elapsed <= pause:
            self.match_overlaps(before, contacts, successors, parents)
            if NO_INDEX in successors:
                self.pair_nearest(before, contacts, successors, parents, reading)
        owners = self.find_owners(before, successors)
        for n, contact in enumerate(successors):
            track = copy_record(before[n])
            if contact == NO_INDEX:
                goes_on = self.is_coasting(track, reading)
            elif goes_on := owners[contact] == n:
                track.last, track.contact = reading.stamp, contacts[contact]
            else:
                track.merged_into = before[owners[contact]].id
            track.ended = not goes_on
            (self.ongoing if goes_on else self.ended).append(track)
        for n, contact in enumerate(contacts):
            if n not in owners:
                track = TrackRecord(self.next_id, reading.stamp, reading.stamp, contact)
                self.next_id += 1
                if parents[n] != NO_INDEX:
                    parent = before[parents[n]]
                    track.parent, track.evidence = parent.id, parent.evidence
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
            taxels, most = contact.taxels, 0.0
            covered = np.bincount(self.covering[taxels], self.areas[taxels])[1:]
            for track in covered.nonzero()[0].tolist():
                area = float(covered[track])
                if area > most:
                    most, parents[n] = area, track
                other = contacts[successors[track]]
                if area > best[track] or (
                    area == best[track] and contact.force > other.force
                ):
                    best[track], successors[track] = area, n
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
        parameters, pairs, taken = self.parameters, [], set()
        gate = parameters.gate + parameters.speed * (reading.elapsed / NS_PER_S)
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
        if (reading.stamp - track.last) / NS_PER_S > self.parameters.coast_seconds:
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
