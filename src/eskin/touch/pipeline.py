"""This module processes scans into touches, live or replayed."""

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.errors import ReadingError
from eskin.skin import MountedSkin
from eskin.structref_kernels import pack
from eskin.touch.adjacency import MICROMETRE, Adjacency
from eskin.touch.calibration import Calibration
from eskin.touch.calibrator import CalibrationConfig, Calibrator, CrosstalkCompensator
from eskin.touch.contact_kernels import find_candidates
from eskin.touch.faults import Fault, FaultConfig, FaultDetector
from eskin.touch.reading import Reading, Scan, check_count, check_order
from eskin.touch.records import (
    HELD,
    NO_TOUCHES,
    Instant,
    Rules,
    TouchStatus,
    TrackingResult,
    fresh_memory,
    sites_of,
)
from eskin.touch.touch_kernels import FollowParts, follow
from eskin.touch.touches import (
    ContactConfig,
    Touch,
    TouchConfig,
    TouchState,
    TrackConfig,
)
from eskin.units import NS_PER_S


@final
class LinkPoseCache:
    """Poses of the links at the latest q asked for; an arm at rest costs nothing."""

    def __init__(self, mounted: MountedSkin, posed: bool = True) -> None:
        """Start without a pose.

        Args:
            mounted: the skin on its robot.
            posed: whether q counts; else every joint is at 0, whatever is asked.
        """
        self.mounted = mounted
        self.posed = posed
        self.joints = len(mounted.robot.joint_names)
        self.q: bytes | None = None
        self.T_world_link = np.empty((0, 4, 4))

    def get(self, q: Float[np.ndarray, "joint"]) -> Float[np.ndarray, "link 4 4"]:
        """T_world_link of all links in the robot's order."""
        asked = q.tobytes()
        if asked != self.q:
            self.check(q)
            seen = q if self.posed else np.zeros_like(q)
            self.T_world_link = self.mounted.kinematics.poses(seen)
            self.q = asked
        return self.T_world_link

    def check(self, q: Float[np.ndarray, "joint"]) -> None:
        """Refuse the joint positions of another robot."""
        if len(q) != self.joints:
            raise ReadingError(
                f"q has {len(q)} joints, robot '{self.mounted.robot.name}' has "
                f"{self.joints}; allowed is one number a moving joint; "
                "use the robot that the data came from"
            )


@final
class TouchTracker:
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
        poses: LinkPoseCache,
    ) -> None:
        """Start untouched."""
        skin = mounted.skin
        self.skin = skin
        self.poses = poses
        adjacency = Adjacency.build(
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
        self.nothing = TrackingResult(pack(NO_TOUCHES), (), ())
        self.followed = self.nothing
        self.first: int | None = None
        self.last: int | None = None

    def push(self, reading: Reading) -> TrackingResult:
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

    def follow(self, reading: Reading, candidates: np.ndarray) -> TrackingResult:
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
            self.poses.get(reading.q),
        )
        packed, rows, going, tracks = follow(
            candidates, instant, self.parts, self.followed.packed
        )
        if not len(rows) and not tracks:
            return self.nothing
        briefs = tuple(map(TouchStatus._make, rows.tolist()))
        return TrackingResult(packed, briefs[:going], briefs[going:])

    def finish(self) -> TrackingResult:
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


@dataclass(frozen=True)
class PipelineConfig:
    """The configuration of every stage from counts to touches."""

    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    """How counts become kPa."""

    faults: FaultConfig = field(default_factory=FaultConfig)
    """What is not to be believed."""

    contacts: ContactConfig = field(default_factory=ContactConfig)
    """What is touched."""

    tracks: TrackConfig = field(default_factory=TrackConfig)
    """What is the same contact as before."""

    touches: TouchConfig = field(default_factory=TouchConfig)
    """What belongs to one gesture."""


@final
class TouchPipeline:
    """Calibration, faults, contacts, tracks and touches of one skin; stateful."""

    def __init__(
        self,
        mounted: MountedSkin,
        calibration: Calibration,
        config: PipelineConfig | None = None,
        poses: LinkPoseCache | None = None,
    ) -> None:
        """Start with every stage fresh.

        Args:
            mounted: the skin on its robot.
            calibration: of the skin.
            config: of every stage.
            poses: of the robot's links, shared with who else asks for them.
        """
        self.config = config or PipelineConfig()
        self.mounted = mounted
        self.calibrator = Calibrator(mounted.skin, calibration, self.config.calibration)
        self.faults = FaultDetector(mounted.skin, calibration, self.config.faults)
        self.crosstalk = CrosstalkCompensator(mounted.skin, calibration)
        self.follower = TouchTracker(
            mounted,
            self.config.contacts.with_floor(calibration.floor),
            self.config.tracks,
            self.config.touches,
            poses or LinkPoseCache(mounted),
        )
        self.reading: Reading | None = None

    def push(self, scan: Scan) -> TouchState:
        """Take the next scan.

        Raises:
            ReadingError: the scan is of another skin, or not later than the last one;
                nothing has changed then, and the next scan may follow.
        """
        return self.push_reading(*self.calibrated(scan))

    def calibrated(self, scan: Scan) -> tuple[Reading, tuple[Fault, ...]]:
        """What the next scan says in kPa, and what of it is not to be believed.

        Raises:
            ReadingError: as for `push`.
        """
        self.follower.poses.check(scan.q)
        check_count(scan, self.calibrator.skin)
        # The fault finder needs a reading first; no converter counts below zero.
        reading = self.calibrator.push(scan, self.faults.mask | (scan.counts < 0))
        mask, faults = self.faults.push(scan, reading.pressure)
        if mask.any():
            reading = replace(reading, valid=reading.valid & ~mask)
        return self.crosstalk.compensate(reading), faults

    def push_reading(
        self, reading: Reading, faults: tuple[Fault, ...] = ()
    ) -> TouchState:
        """Take the next reading that is calibrated already.

        Raises:
            ReadingError: as for a scan.
        """
        followed = self.follower.push(reading)
        self.reading = reading
        return self.state_of(reading, faults, followed)

    def finish(self) -> tuple[Touch, ...]:
        """Close the touches still open, as at the end of a recording.

        What comes later begins new tracks and touches.
        """
        if self.reading is None:
            return ()
        state = self.state_of(self.reading, (), self.follower.finish())
        return tuple(replace(touch, closed=True) for touch in state.touches)

    def state_of(
        self, reading: Reading, faults: tuple[Fault, ...], followed: TrackingResult
    ) -> TouchState:
        """All that is known at a reading."""
        posed = self.follower.poses.posed
        return TouchState(reading, faults, followed, self.mounted, posed)
