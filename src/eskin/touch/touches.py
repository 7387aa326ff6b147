"""Touches: all tracks of one gesture."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import cdist

from eskin.skin.mount import MountedSkin
from eskin.touch.adjacency import MICROMETRE
from eskin.touch.contacts import NANOSECONDS, Contact
from eskin.touch.poses import LivePoses
from eskin.touch.reading import Reading, check_order
from eskin.touch.tracks import Track


@dataclass(frozen=True, eq=False)
class Touch:
    """All tracks of one gesture, such as both of a double pat."""

    id: int
    """Counts up from 1 in the order of appearance."""

    onset: int
    """Stamp of its first contact [ns since the epoch]."""

    last: int
    """Stamp of its last contact so far [ns since the epoch]."""

    tracks: tuple[int, ...]
    """Ids of its tracks, ascending."""

    impulse: float
    """Its force integrated over time [N s]."""

    peak_force: float
    """Greatest force of all its contacts at one instant [N]."""

    peak: float
    """Greatest pressure on one taxel [kPa]."""

    link: str
    """Link of its first contact."""

    start: Float[np.ndarray, "3"]
    """Centre of its first contact in the frame of `link` [m]."""

    latest: Float[np.ndarray, "3"]
    """Force-weighted centre of its latest contacts in the frame of `link` [m]."""

    contact: Contact
    """The strongest of its latest contacts."""

    closed: bool = False
    """True once it is over: no track will join it any more."""

    merged_into: int | None = None
    """The touch that it turned out to be a part of."""

    @property
    def travel(self) -> Float[np.ndarray, "3"]:
        """From its first to its latest centre in the frame of `link` [m]."""
        return self.latest - self.start


@dataclass(frozen=True)
class TouchConfig:
    """What makes tracks one touch."""

    near: float = 0.08
    """How far a track may begin from where one ended [m], in the frame of its link."""

    pause_seconds: float = 0.5
    """How long after it [s]; so long after its last contact a touch closes."""

    beside: float = 0.1
    """How far contacts at the same time may be apart [m], nearest taxels in space."""


@final
class TouchGrouper:
    """Groups tracks into touches; stateful and deterministic.

    A track joins the touch of the track that it split off from; else the touch of any
    track that ended near it a moment ago, or that has contact beside it. Where that
    makes one of two touches, the older takes over the younger, which closes with
    `merged_into`. On a skin that is not calibrated distances mean nothing, and whatever
    is on it at once, or within the pause, is one touch.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        config: TouchConfig | None = None,
        poses: LivePoses | None = None,
    ) -> None:
        """Start without touches."""
        self.mounted = mounted
        self.config = config or TouchConfig()
        self.poses = poses or LivePoses(mounted)
        self.pause = round(self.config.pause_seconds * NANOSECONDS)
        self.touches: dict[int, Touch] = {}
        self.touch_of: dict[int, int] = {}
        self.tracks: dict[int, Track] = {}
        self.force: dict[int, float] = {}
        self.next_id = 1
        self.last: int | None = None

    def push(
        self, reading: Reading, tracks: tuple[Track, ...]
    ) -> tuple[tuple[Touch, ...], tuple[Touch, ...]]:
        """Group the tracks of the next reading.

        Returns:
            The touches that are open, and those that have just closed.
        """
        check_order(self.last, reading.stamp)
        elapsed = 0 if self.last is None else reading.stamp - self.last
        # Nobody knows what force there was in a gap.
        seconds = elapsed / NANOSECONDS if elapsed <= self.pause else 0.0
        self.last = reading.stamp
        closed = self.close(reading.stamp)
        if not tracks and not self.touches:
            return (), closed
        for track in tracks:
            if track.id not in self.touch_of and not track.ended:
                closed += self.assign(track, reading)
            if track.id in self.touch_of:
                self.tracks[track.id] = track
        closed += self.join_beside(reading)
        for touch_id in list(self.touches):
            self.update(touch_id, reading, seconds)
        return tuple(self.touches.values()), closed

    def finish(self) -> tuple[Touch, ...]:
        """Close every touch, as at the end of a recording, and return them."""
        closed = tuple(replace(t, closed=True) for t in self.touches.values())
        for store in (self.touches, self.touch_of, self.tracks, self.force):
            store.clear()
        return closed

    def close(self, stamp: int) -> tuple[Touch, ...]:
        """Close the touches whose last contact is too long ago."""
        over = [t for t in self.touches.values() if stamp - t.last > self.pause]
        for touch in over:
            self.forget(touch)
        return tuple(replace(touch, closed=True) for touch in over)

    def forget(self, touch: Touch) -> None:
        """Drop a touch and its tracks."""
        del self.touches[touch.id]
        self.force.pop(touch.id, None)
        for track in touch.tracks:
            self.touch_of.pop(track, None)
            self.tracks.pop(track, None)

    def assign(self, track: Track, reading: Reading) -> tuple[Touch, ...]:
        """Give a new track a touch; return those that this has shown to be another."""
        fitting = sorted(
            {
                self.touch_of[other.id]
                for other in self.tracks.values()
                if self.belongs(track, other, reading)
            }
        )
        if not fitting:
            self.start(track)
            return ()
        first, *others = fitting
        self.add(first, (track.id,))
        return tuple(self.take_over(first, other) for other in others)

    def belongs(self, track: Track, other: Track, reading: Reading) -> bool:
        """Whether a new track is of the same touch as another."""
        if track.parent == other.id or not self.mounted.skin.calibrated:
            return True
        if other.last == reading.stamp:
            return self.are_beside(track.contact, other.contact, reading)
        link, p_link = other.contact.link, other.contact.p_link
        was = self.poses.to_world(reading.q, link, p_link)
        distance = np.linalg.norm(track.contact.p_world - was)
        near = bool(distance <= self.config.near + MICROMETRE)
        return near and reading.stamp - other.last <= self.pause

    def are_beside(self, one: Contact, other: Contact, reading: Reading) -> bool:
        """Whether the nearest taxels of two contacts are close in space."""
        a, b = (self.poses.points(reading.q, c.taxels) for c in (one, other))
        return bool(cdist(a, b).min() <= self.config.beside + MICROMETRE)

    def start(self, track: Track) -> None:
        """Start a touch with its first track."""
        contact = track.contact
        self.touches[self.next_id] = Touch(
            id=self.next_id,
            onset=track.onset,
            last=track.last,
            tracks=(track.id,),
            impulse=0.0,
            peak_force=0.0,
            peak=0.0,
            link=contact.link,
            start=contact.p_link,
            latest=contact.p_link,
            contact=contact,
        )
        self.touch_of[track.id] = self.next_id
        self.force[self.next_id] = 0.0
        self.next_id += 1

    def add(self, touch_id: int, tracks: tuple[int, ...]) -> None:
        """Add tracks to a touch."""
        touch = self.touches[touch_id]
        together = tuple(sorted({*touch.tracks, *tracks}))
        self.touches[touch_id] = replace(touch, tracks=together)
        for track in tracks:
            self.touch_of[track] = touch_id

    def take_over(self, older: int, younger: int) -> Touch:
        """Make a touch part of an older one; return what is left of it, closed."""
        gone = self.touches.pop(younger)
        touch = self.touches[older]
        self.touches[older] = replace(
            touch,
            last=max(touch.last, gone.last),
            impulse=touch.impulse + gone.impulse,
            peak_force=max(touch.peak_force, gone.peak_force),
            peak=max(touch.peak, gone.peak),
        )
        self.add(older, gone.tracks)
        self.force[older] += self.force.pop(younger)
        return replace(gone, closed=True, merged_into=older)

    def join_beside(self, reading: Reading) -> tuple[Touch, ...]:
        """Make one touch of those whose contacts have come beside each other."""
        gone: tuple[Touch, ...] = ()
        if len(self.touches) < 2:
            return gone
        now = [t for t in self.tracks.values() if t.last == reading.stamp]
        for n, one in enumerate(now):
            for other in now[n + 1 :]:
                a, b = self.touch_of[one.id], self.touch_of[other.id]
                if a != b and self.are_beside(one.contact, other.contact, reading):
                    gone += (self.take_over(min(a, b), max(a, b)),)
        return gone

    def update(self, touch_id: int, reading: Reading, elapsed: float) -> None:
        """Bring a touch up to date with the contacts of this reading."""
        touch = self.touches[touch_id]
        contacts = [
            self.tracks[track].contact
            for track in touch.tracks
            if track in self.tracks and self.tracks[track].last == reading.stamp
        ]
        force = sum(contact.force for contact in contacts)
        impulse = touch.impulse + 0.5 * (force + self.force[touch_id]) * elapsed
        self.force[touch_id] = force
        if not contacts:
            self.touches[touch_id] = replace(touch, impulse=impulse)
            return
        centres = np.array([contact.p_world for contact in contacts])
        weights = np.array([contact.force for contact in contacts])
        p_world = weights @ centres / weights.sum()
        self.touches[touch_id] = replace(
            touch,
            last=reading.stamp,
            impulse=impulse,
            peak_force=max(touch.peak_force, force),
            peak=max(touch.peak, *(contact.peak for contact in contacts)),
            latest=self.poses.to_link(reading.q, touch.link, p_world),
            contact=max(contacts, key=lambda contact: contact.force),
        )
