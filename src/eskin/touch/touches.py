"""This module defines contacts, tracks and touches, and the state that holds them."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.skin import MountedSkin
from eskin.touch.faults import Fault
from eskin.touch.reading import Reading
from eskin.touch.records import (
    ContactConfig,
    ContactRecord,
    TouchRecord,
    TrackingResult,
)
from eskin.units import seconds_between


@dataclass(frozen=True, eq=False)
class Contact:
    """A contact is a connected set of active taxels at one instant."""

    taxels: Int[np.ndarray, "active"]
    """Indices of its taxels, ordered by patch, row and column."""
    force: float
    """Sum of pressure times area [N]."""
    area: float
    """Sum of the taxels' areas [m2]."""
    peak: float
    """Greatest pressure [kPa]."""
    p_world: Float[np.ndarray, "3"]
    """Centre, weighted by force [m]."""
    n_world: Float[np.ndarray, "3"]
    """Mean outward normal, weighted by force; unit, or zero where normals cancel."""
    p_link: Float[np.ndarray, "3"]
    """Centre in the frame of `link` [m]."""
    link: str
    """Link of the most loaded taxel."""
    patch: str
    """Patch of the most loaded taxel."""


@dataclass(frozen=True, eq=False)
class Track:
    """A track is a contact through time; it keeps its id across patches and links."""

    id: int
    """Number that counts up from 1 in the order of appearance."""
    onset: int
    """Stamp of its first reading [ns since the epoch]."""
    last: int
    """Stamp of its last reading with contact [ns since the epoch]."""
    contact: Contact
    """Contact at `last`."""
    parent: int | None = None
    """Id of the track that it split off from."""
    merged_into: int | None = None
    """Id of the track with which it was merged when their contacts became one."""
    ended: bool = False
    """True once its contact has ended."""


@dataclass(frozen=True, eq=False)
class Touch:
    """A touch consists of all tracks of one gesture, such as both of a double pat."""

    id: int
    """Number that counts up from 1 in the order of appearance."""
    onset: int
    """Stamp of its first contact [ns since the epoch]."""
    last: int
    """Stamp of its last contact so far [ns since the epoch]."""
    tracks: tuple[int, ...]
    """Ids of its tracks, ascending."""
    impulse: float
    """Integral of its force over time [N s]."""
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
    """Strongest of its latest contacts."""
    force: float = 0.0
    """Sum of the forces of its contacts now [N]; 0 in a pause between them."""
    closed: bool = False
    """True once no further track can join it."""
    merged_into: int | None = None
    """Id of the touch into which it was merged."""

    @property
    def travel(self) -> Float[np.ndarray, "3"]:
        """Vector from its first to its latest centre in the frame of `link` [m]."""
        return self.latest - self.start


@dataclass(frozen=True, eq=False)
class TouchState:
    """A state holds contacts, tracks, touches and faults at one instant.

    Its objects are built from the records when they are first used.
    """

    reading: Reading
    """Calibrated reading; faulty taxels are not valid in it."""
    faults: tuple[Fault, ...]
    doubtful: Bool[np.ndarray, "taxel"]
    """Which taxels are faulty, or show signs of a fault."""
    tracking: TrackingResult
    """Records of contacts, tracks and touches."""
    mounted: MountedSkin
    use_kinematics: bool = True
    """Whether contacts were found in the robot's pose. Else they were found with every
    joint at 0; the objects built here, but not the records, are moved to its pose."""
    contact: float = ContactConfig.on
    """Pressure from which a taxel becomes active [kPa]."""

    @cached_property
    def open(self) -> tuple[TouchRecord, ...]:
        """Records of the open touches that are confirmed."""
        return tuple(touch for touch in self.tracking.open if touch.confirmed)

    @cached_property
    def closed(self) -> tuple[TouchRecord, ...]:
        """Records of the confirmed touches that closed with this reading."""
        return tuple(touch for touch in self.tracking.closed if touch.confirmed)

    @property
    def rows(self) -> tuple[TouchRecord, ...]:
        """Records of open touches, then of closed ones."""
        return self.tracking.open + self.tracking.closed

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """Contacts of this reading."""
        return tuple(map(self.build_contact, self.tracking.contacts))

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Ongoing tracks, and those that ended with this reading."""
        return tuple(
            Track(
                id=track.id,
                onset=track.onset,
                last=track.last,
                contact=self.build_contact(track.contact),
                parent=track.parent or None,
                merged_into=track.merged_into or None,
                ended=track.ended,
            )
            for track in self.tracking.tracks
        )

    @cached_property
    def touches(self) -> tuple[Touch, ...]:
        """Open touches that are confirmed."""
        return tuple(map(self.build_touch, self.open))

    @cached_property
    def closed_touches(self) -> tuple[Touch, ...]:
        """Confirmed touches that closed with this reading."""
        return tuple(map(self.build_touch, self.closed))

    def build_contact(self, record: ContactRecord) -> Contact:
        """Build the contact of a record."""
        patch = self.mounted.skin.patches[record.patch]
        contact = Contact(
            taxels=record.taxels.copy(),
            force=record.force,
            area=record.area,
            peak=record.peak,
            p_world=np.array(record.p_world),
            n_world=np.array(record.n_world),
            p_link=np.array(record.p_link),
            link=patch.link,
            patch=patch.id,
        )
        return contact if self.use_kinematics else self.move_to_pose(contact)

    def move_to_pose(self, contact: Contact) -> Contact:
        """Move a contact found with every joint at 0 to the robot's pose."""
        link = self.mounted.robot.link_index(contact.link)
        q = self.reading.q
        poses = self.mounted.kinematics.poses(np.stack([q, np.zeros_like(q)]))
        T, T_at_zero = poses[:, link]
        return replace(
            contact,
            p_world=T[:3, :3] @ contact.p_link + T[:3, 3],
            n_world=T[:3, :3] @ T_at_zero[:3, :3].T @ contact.n_world,
        )

    def build_touch(self, record: TouchRecord) -> Touch:
        """Build the touch of a record."""
        return Touch(
            id=record.id,
            onset=record.onset,
            last=record.last,
            tracks=record.tracks,
            impulse=record.impulse,
            peak_force=record.peak_force,
            peak=record.peak,
            link=self.mounted.robot.link_names[record.link],
            start=np.array(record.start),
            latest=np.array(record.latest),
            contact=self.build_contact(record.contact),
            force=record.force,
            closed=record.closed,
            merged_into=record.merged_into or None,
        )


MIN_PRESS_FORCE = 0.5
"""Smallest force of an intended press [N]."""
MIN_PRESS_SECONDS = 0.15
"""Smallest duration of an intended press [s]."""


@final
class PressDetector:
    """A detector finds intended presses of one finger, one at a time; stateful."""

    def __init__(self) -> None:
        """Start without a press."""
        self.since: int | None = None
        self.force = 0.0
        self.taxel = -1
        self.dropped = False

    def drop(self) -> None:
        """Ignore the press that goes on, if any, until it has ended."""
        self.dropped = self.since is not None

    def find_press(self, state: TouchState) -> int | None:
        """Process the state at the next reading.

        Returns:
            Where a press has just ended, the taxel of greatest pressure at its greatest
            force; else None.
        """
        contact = max(state.contacts, key=lambda one: one.force, default=None)
        stamp = state.reading.stamp
        if contact is not None and contact.force >= MIN_PRESS_FORCE:
            self.since = stamp if self.since is None else self.since
            if contact.force > self.force:
                pressure = state.reading.pressure[contact.taxels]
                self.force = contact.force
                self.taxel = int(contact.taxels[np.argmax(pressure)])
            return None
        since = self.since
        taxel = self.taxel
        dropped = self.dropped
        self.since = None
        self.force = 0.0
        self.taxel = -1
        self.dropped = False
        if since is None or dropped:
            return None
        is_brief = seconds_between(since, stamp) < MIN_PRESS_SECONDS
        return None if is_brief else taxel
