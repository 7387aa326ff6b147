"""Tracks: contacts through time, keeping their ids across patches and links."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.skin.mount import MountedSkin
from eskin.touch.contacts import NANOSECONDS, Contact
from eskin.touch.poses import LivePoses
from eskin.touch.reading import Reading, check_order


@dataclass(frozen=True, eq=False)
class Track:
    """A contact through time."""

    id: int
    """Counts up from 1 in the order of appearance."""

    onset: int
    """Stamp of its first reading [ns since the epoch]."""

    last: int
    """Stamp of its last reading with contact [ns since the epoch]."""

    contact: Contact
    """Its contact at `last`."""

    parent: int | None = None
    """The track that it split off from."""

    merged_into: int | None = None
    """The track that took its contact over when two contacts became one."""

    ended: bool = False
    """True once there is no contact any more."""


@dataclass(frozen=True)
class TrackConfig:
    """How far a contact may move between two readings."""

    gate: float = 0.03
    """Distance that the centre may jump at once [m]."""

    speed: float = 1.0
    """Speed by which that distance grows with the time between readings [m/s]."""

    coast_seconds: float = 0.2
    """How long a track waits while most of its taxels are not received [s]."""

    gap_seconds: float = 0.5
    """After how long without a reading every track has ended [s]."""


@final
class Tracker:
    """Follows contacts from reading to reading; stateful and deterministic.

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
       where most of its taxels were not received it waits for `coast_seconds`.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        config: TrackConfig | None = None,
        poses: LivePoses | None = None,
    ) -> None:
        """Start without tracks."""
        self.mounted = mounted
        self.config = config or TrackConfig()
        self.poses = poses or LivePoses(mounted)
        self.tracks: list[Track] = []
        self.areas = np.asarray(mounted.skin.areas, np.float64)
        self.owner = np.full(mounted.skin.count, -1)
        self.next_id = 1
        self.last: int | None = None

    def push(self, reading: Reading, contacts: list[Contact]) -> tuple[Track, ...]:
        """Follow the tracks into the contacts of the next reading.

        Returns:
            Tracks with contact or waiting for one, then those that have just ended;
            both in the order of their ids.
        """
        check_order(self.last, reading.stamp)
        elapsed = 0 if self.last is None else reading.stamp - self.last
        self.last = reading.stamp
        if not self.tracks and not contacts:
            return ()
        old = self.tracks
        if elapsed > self.config.gap_seconds * NANOSECONDS:
            going: dict[int, int] = {}
            covered = np.zeros((len(old), len(contacts)))
        else:
            covered = self.covered(contacts)
            going = self.overlapping(contacts, covered)
            self.nearest(reading, contacts, covered, going, elapsed / NANOSECONDS)
        return self.advance(reading, contacts, covered, going)

    def finish(self) -> None:
        """Drop every track, as at the end of a recording."""
        self.tracks = []

    def covered(self, contacts: list[Contact]) -> Float[np.ndarray, "track contact"]:
        """Area of each track's latest contact that each contact covers [m2]."""
        result = np.zeros((len(self.tracks), len(contacts)))
        if not self.tracks:
            return result
        for place, track in enumerate(self.tracks):
            self.owner[track.contact.taxels] = place
        for column, contact in enumerate(contacts):
            owners = self.owner[contact.taxels]
            known = owners >= 0
            result[:, column] = np.bincount(
                owners[known],
                self.areas[contact.taxels[known]],
                minlength=len(self.tracks),
            )
        for track in self.tracks:
            self.owner[track.contact.taxels] = -1
        return result

    def overlapping(
        self, contacts: list[Contact], covered: Float[np.ndarray, "track contact"]
    ) -> dict[int, int]:
        """Where each track goes on that overlaps a contact: places of both."""
        going: dict[int, int] = {}
        for place in range(len(self.tracks)):
            options = [n for n in range(len(contacts)) if covered[place, n] > 0.0]
            if options:
                going[place] = max(
                    options, key=lambda n: (covered[place, n], contacts[n].force, -n)
                )
        return going

    def nearest(
        self,
        reading: Reading,
        contacts: list[Contact],
        covered: Float[np.ndarray, "track contact"],
        going: dict[int, int],
        elapsed: float,
    ) -> None:
        """Pair what overlaps nothing, nearest first within the gate."""
        lost = [n for n in range(len(self.tracks)) if n not in going]
        free = [n for n in range(len(contacts)) if not covered[:, n].any()]
        if not lost or not free:
            return
        gate = self.config.gate + self.config.speed * elapsed
        pairs = []
        for place in lost:
            was = self.tracks[place].contact
            here = self.poses.to_world(reading.q, was.link, was.p_link)
            for n in free:
                distance = float(np.linalg.norm(contacts[n].p_world - here))
                # To the micrometre, so that rounding of the pose decides no tie.
                pairs.append((round(distance, 6), self.tracks[place].id, n, place))
        taken: set[int] = set()
        for distance, _, n, place in sorted(pairs):
            if distance <= gate and place not in going and n not in taken:
                going[place] = n
                taken.add(n)

    def advance(
        self,
        reading: Reading,
        contacts: list[Contact],
        covered: Float[np.ndarray, "track contact"],
        going: dict[int, int],
    ) -> tuple[Track, ...]:
        """Carry on, merge, start and end tracks."""
        stamp, old = reading.stamp, self.tracks
        keeper: dict[int, Track] = {}
        for place, n in going.items():
            track = old[place]
            if n not in keeper or older(track) < older(keeper[n]):
                keeper[n] = track
        alive = [
            replace(track, last=stamp, contact=contacts[n])
            for n, track in keeper.items()
        ]
        ended = []
        for place, track in enumerate(old):
            if place not in going:
                waiting = self.waits(track, reading)
                (alive if waiting else ended).append(replace(track, ended=not waiting))
            elif keeper[going[place]] is not track:
                into = keeper[going[place]].id
                ended.append(replace(track, merged_into=into, ended=True))
        for n, contact in enumerate(contacts):
            if n not in keeper:
                parent = self.parent_of(covered[:, n])
                alive.append(Track(self.next_id, stamp, stamp, contact, parent))
                self.next_id += 1
        self.tracks = sorted(alive, key=lambda track: track.id)
        return (*self.tracks, *sorted(ended, key=lambda track: track.id))

    def parent_of(self, covered: Float[np.ndarray, "track"]) -> int | None:
        """The id of the track most of which a new contact covers, if any."""
        if not covered.any():
            return None
        return self.tracks[int(np.argmax(covered))].id

    def waits(self, track: Track, reading: Reading) -> bool:
        """Whether a track without contact may only not have been received."""
        missing = 1.0 - reading.valid[track.contact.taxels].mean()
        waited = (reading.stamp - track.last) / NANOSECONDS
        return bool(missing > 0.5 and waited <= self.config.coast_seconds)


def older(track: Track) -> tuple[int, int]:
    """What sorts tracks by age."""
    return track.onset, track.id
