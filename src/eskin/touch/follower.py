"""From each reading to the contacts, tracks and touches on the skin."""

from typing import final

import numpy as np

from eskin.errors import ReadingError
from eskin.skin.mount import MountedSkin
from eskin.structref_kernels import pack
from eskin.touch.active_kernels import find_candidates
from eskin.touch.adjacency import MICROMETRE, Adjacency
from eskin.touch.contacts import ContactConfig
from eskin.touch.follow_kernels import FollowParts, follow
from eskin.touch.memory import HELD, fresh_memory, sites_of
from eskin.touch.poses import LivePoses
from eskin.touch.reading import Reading, check_order
from eskin.touch.records import NOTHING, Followed, TouchBrief
from eskin.touch.rules import Instant, Rules
from eskin.touch.touches import TouchConfig
from eskin.touch.tracks import TrackConfig
from eskin.units import NS_PER_S


@final
class TouchFollower:
    """Follows contacts, tracks and touches from reading to reading; stateful.

    Taxels connect by distance in space: on one link that never changes, between links
    it follows the pose. Contacts come in the order of their first taxel by patch, row
    and column, so that numbering the taxels otherwise changes nothing.

    An untouched skin costs a look at its pressures; the rest follows the touch.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        contacts: ContactConfig,
        tracks: TrackConfig,
        touches: TouchConfig,
        poses: LivePoses,
    ) -> None:
        """Start untouched."""
        skin = mounted.skin
        self.skin = skin
        self.poses = poses
        adjacency = Adjacency.of(
            skin, contacts.reach, contacts.least_reach if skin.calibrated else 0.0
        )
        # Below every pressure that the kernel may let pass, whatever their precision.
        least = np.float32(min(contacts.on, contacts.off))
        self.least = np.nextafter(least, np.float32(-np.inf))
        self.candidates = np.empty(skin.count, np.int64)
        self.memory = fresh_memory(skin.count)
        parts = FollowParts(
            rules=rules_of(contacts, tracks, touches, skin.calibrated),
            sites=sites_of(mounted, adjacency),
            neighbours=adjacency.neighbours,
            memory=self.memory,
        )
        self.parts = pack(parts)
        self.nothing = Followed(pack(NOTHING), (), ())
        self.followed = self.nothing
        self.first: int | None = None
        self.last: int | None = None

    def push(self, reading: Reading) -> Followed:
        """Follow into the next reading.

        Raises:
            ReadingError: it is of another skin or robot, or not later than the last
                one; nothing has changed then, and the next one may follow.
        """
        self.check(reading)
        found = find_candidates(reading.pressure, self.least, self.candidates)
        touched = self.followed is not self.nothing
        if found or touched or self.memory.counts[HELD]:
            self.followed = self.follow(reading, self.candidates[:found])
        self.first = reading.stamp if self.first is None else self.first
        self.last = reading.stamp
        return self.followed

    def check(self, reading: Reading) -> None:
        """Refuse a reading that is not the next one of this skin."""
        if len(reading.pressure) != self.skin.count:
            raise ReadingError(
                f"reading has {len(reading.pressure)} taxels, skin "
                f"'{self.skin.name}' has {self.skin.count}; allowed is "
                "one pressure a taxel; load the skin that the data came from"
            )
        self.poses.check(reading.q)
        check_order(self.last, reading.stamp)

    def follow(self, reading: Reading, candidates: np.ndarray) -> Followed:
        """The touches of the next reading, whose active taxels are among some."""
        stamp = reading.stamp
        first = stamp if self.first is None else self.first
        last = stamp if self.last is None else self.last
        instant = Instant(
            stamp,
            stamp - last,
            (stamp - first) / NS_PER_S,
            (last - first) / NS_PER_S,
            reading.pressure,
            reading.valid,
            self.poses.at(reading.q),
        )
        packed, rows, going, tracks = follow(
            candidates, instant, self.parts, self.followed.packed
        )
        if not len(rows) and not tracks:
            return self.nothing
        briefs = tuple(map(TouchBrief._make, rows.tolist()))
        return Followed(packed, briefs[:going], briefs[going:])

    def finish(self) -> Followed:
        """Let go of every track and touch, as at the end of a recording.

        Returns:
            The touches of the last reading.
        """
        followed, self.followed = self.followed, self.nothing
        return followed


def rules_of(
    contacts: ContactConfig, tracks: TrackConfig, touches: TouchConfig, calibrated: bool
) -> Rules:
    """The configuration as the kernels want it."""
    return Rules(
        on=contacts.on,
        off=contacts.off,
        on_share=contacts.on_share,
        off_share=contacts.off_share,
        fade=contacts.fade_seconds,
        hold=contacts.hold_seconds,
        gate=tracks.gate,
        speed=tracks.speed,
        coast=tracks.coast_seconds,
        gap=tracks.gap_seconds * NS_PER_S,
        near=touches.near + MICROMETRE,
        pause=round(touches.pause_seconds * NS_PER_S),
        beside=touches.beside + MICROMETRE,
        calibrated=calibrated,
    )
