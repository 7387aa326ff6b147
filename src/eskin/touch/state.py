"""All that is known of touch at one instant, made into objects when asked for."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eskin.skin.mount import MountedSkin
from eskin.structref_kernels import unpack
from eskin.touch.contacts import Contact
from eskin.touch.fault import Fault
from eskin.touch.reading import Reading
from eskin.touch.records import (
    ENDED,
    PAST,
    Followed,
    TouchBrief,
    TouchRecords,
    TouchRow,
)
from eskin.touch.touches import Touch
from eskin.touch.tracks import Track


@dataclass(frozen=True, eq=False)
class TouchState:
    """All that is known of touch at one instant."""

    reading: Reading
    """The calibrated reading; faulty taxels are not valid in it."""

    faults: tuple[Fault, ...]
    """Faults known now."""

    followed: Followed
    """All that follows, as it was found."""

    mounted: MountedSkin
    """The skin that it is on."""

    posed: bool = True
    """Whether contacts were found in the robot's pose; else they were found with every
    joint at 0, and only what is made of them here is put where it is in this pose."""

    @property
    def going(self) -> tuple[TouchBrief, ...]:
        """The touches that are open, in brief."""
        return self.followed.going

    @property
    def over(self) -> tuple[TouchBrief, ...]:
        """The touches that closed with this reading, in brief."""
        return self.followed.over

    @cached_property
    def records(self) -> TouchRecords:
        """All that follows, as arrays."""
        return unpack(self.followed.packed)

    @cached_property
    def rows(self) -> tuple[TouchRow, ...]:
        """Open touches, then closed ones, as they are recorded."""
        return tuple(map(TouchRow._make, self.records.touches.tolist()))

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """Contacts now."""
        stamps = self.records.contacts["stamp"]
        return self.all_contacts[: np.count_nonzero(stamps == self.reading.stamp)]

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Tracks going on, and those that ended with this reading."""
        return tuple(
            Track(
                id=int(row["id"]),
                onset=int(row["onset"]),
                last=int(row["last"]),
                contact=self.all_contacts[row["contact"]],
                parent=int(row["parent"]) or None,
                merged_into=int(row["merged_into"]) or None,
                ended=bool(row["phase"] == ENDED),
            )
            for row in self.records.tracks
            if row["phase"] != PAST
        )

    @cached_property
    def touches(self) -> tuple[Touch, ...]:
        """Touches that are open."""
        return tuple(self.touch(row) for row in self.rows if not row.closed)

    @cached_property
    def closed(self) -> tuple[Touch, ...]:
        """Touches that closed with this reading."""
        return tuple(self.touch(row) for row in self.rows if row.closed)

    @cached_property
    def all_contacts(self) -> tuple[Contact, ...]:
        """Contacts now, then older ones that tracks and touches had last."""
        if not len(self.records.contacts):
            return ()
        patches, taxels = self.mounted.skin.patches, self.records.loads["taxel"].copy()
        contacts = tuple(
            Contact(
                taxels=taxels[slice(*row["loads"])],
                force=float(row["force"]),
                area=float(row["area"]),
                peak=float(row["peak"]),
                p_world=row["p_world"].copy(),
                n_world=row["n_world"].copy(),
                p_link=row["p_link"].copy(),
                link=patches[row["patch"]].link,
                patch=patches[row["patch"]].id,
            )
            for row in self.records.contacts
        )
        return contacts if self.posed else tuple(map(self.placed, contacts))

    def placed(self, contact: Contact) -> Contact:
        """A contact that was found with every joint at 0, in the pose of now."""
        link, q = self.mounted.robot.link_index(contact.link), self.reading.q
        both = self.mounted.kinematics.poses(np.stack([q, np.zeros_like(q)]))
        now, rest = both[:, link]
        return replace(
            contact,
            p_world=now[:3, :3] @ contact.p_link + now[:3, 3],
            n_world=now[:3, :3] @ rest[:3, :3].T @ contact.n_world,
        )

    def touch(self, row: TouchRow) -> Touch:
        """The touch that a row of this state records."""
        return Touch(
            id=row.id,
            onset=row.onset,
            last=row.last,
            tracks=tuple(self.records.members[slice(*row.tracks)].tolist()),
            impulse=row.impulse,
            peak_force=row.peak_force,
            peak=row.peak,
            link=self.mounted.robot.link_names[row.link],
            start=row.start,
            latest=row.latest,
            contact=self.all_contacts[row.contact],
            closed=bool(row.closed),
            merged_into=row.merged_into or None,
        )
