"""This module computes touches from scans, live or replayed."""

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import pack
from eskin.errors import ReadingError, SkinMismatchError
from eskin.skin import MountedSkin, Skin
from eskin.touch.adjacency import Adjacency
from eskin.touch.calibration import MAX_CONTACT, Calibration
from eskin.touch.contact_kernels import (
    AGE,
    AREA,
    BEGIN,
    END,
    EVIDENCE,
    FORCE,
    LINK,
    N_WORLD,
    NEAR,
    P_LINK,
    P_WORLD,
    PATCH,
    PEAK,
    find_candidates,
    find_contacts,
)
from eskin.touch.faults import Fault
from eskin.touch.front_end import FrontEnd
from eskin.touch.reading import Reading, Scan, check_count
from eskin.touch.records import (
    NO_TOUCHES,
    RECENT,
    RELEASES,
    ContactConfig,
    ContactRecord,
    KernelReading,
    TouchConfig,
    TrackConfig,
    TrackerContext,
    TrackingResult,
    build_tracking_parameters,
)
from eskin.touch.rest_kernels import CalibrationConfig
from eskin.touch.taxels import Instant, TaxelPlaces
from eskin.touch.touches import Touch, TouchState
from eskin.touch.tracking import TouchGrouper, TrackFollower

MAX_MEDIAN_CONTACT = 0.6
"""Largest share of full scale at which contact begins by the calibration of half of the
taxels of a patch; the most sensitive device measured has 0.59."""


@final
class LinkPoseCache:
    """A cache holds the link poses at the latest q, computed once q changes."""

    def __init__(self, mounted: MountedSkin, use_kinematics: bool = True) -> None:
        """Start without a pose; without kinematics every joint is taken as 0."""
        self.mounted = mounted
        self.use_kinematics = use_kinematics
        self.joints = len(mounted.robot.joint_names)
        self.q: bytes | None = None
        self.T_world_link = np.empty((0, 4, 4))

    def get(self, q: Float[np.ndarray, "joint"]) -> Float[np.ndarray, "link 4 4"]:
        """Return T_world_link of all links in the robot's order."""
        key = q.tobytes()
        if key != self.q:
            self.check_joint_count(q)
            used = q if self.use_kinematics else np.zeros_like(q)
            self.T_world_link = self.mounted.kinematics.poses(used)
            self.q = key
        return self.T_world_link

    def check_joint_count(self, q: Float[np.ndarray, "joint"]) -> None:
        """Refuse the joint positions of another robot."""
        if len(q) != self.joints:
            raise ReadingError(
                f"q has {len(q)} joints, robot '{self.mounted.robot.name}' has "
                f"{self.joints}; allowed is one number a moving joint; "
                "use the robot that the data came from"
            )


@final
class TouchTracker:
    """A tracker finds contacts, tracks and touches reading by reading; stateful.

    Taxels connect by distance in space, which is fixed on one link and depends on the
    pose between links. Contacts are sorted by patch, row and column of their first
    taxel, so the result does not depend on the order of the taxels.

    An untouched skin costs one pass over its pressures; all else grows with the touch.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        contacts: ContactConfig,
        tracks: TrackConfig,
        touches: TouchConfig,
        poses: LinkPoseCache,
        places: TaxelPlaces,
        taxels: np.ndarray,
        release_seconds: float,
    ) -> None:
        """Start with an untouched skin.

        Args:
            mounted: the skin on its robot.
            contacts: thresholds of contacts.
            tracks: limits of the motion of contacts.
            touches: limits of what belongs to one touch.
            poses: poses of the robot's links.
            places: places of the taxels.
            taxels: (taxel) `TAXEL`, whose contact is updated.
            release_seconds: `Calibration.release_seconds`.
        """
        skin = mounted.skin
        self.skin = skin
        self.poses = poses
        adjacency = Adjacency.build(
            skin, contacts.reach, contacts.least_reach if skin.calibrated else 0.0
        )
        # Rounded down, so that float32 loses no candidate of the float64 thresholds.
        least = np.float32(min(contacts.on, contacts.off))
        self.least = np.nextafter(least, np.float32(-np.inf))
        self.candidates = np.empty(skin.count, np.int64)
        parameters = build_tracking_parameters(
            contacts, tracks, touches, skin.calibrated
        )
        # By patch, row and column.
        self.order = np.lexsort((skin.columns, skin.rows, skin.patch_index))
        self.pressed_count = np.zeros(1, np.int64)
        self.release_rate = np.full(1, 1.0 / release_seconds)
        context = TrackerContext(
            parameters=parameters,
            places=places._replace(adjacency=adjacency),
            links=np.array(mounted.taxel_link_index, np.int64),
            taxels=taxels,
            pressed=np.empty(skin.count, np.int64),
            pressed_count=self.pressed_count,
            recent=np.zeros((RECENT, skin.count)),
            recent_times=np.full(RECENT, -np.inf),
            slot=np.zeros(1, np.int64),
            measured_at=np.zeros(1),
            release_rates=np.full(RELEASES, 1.0 / release_seconds),
            release_rate=self.release_rate,
            releases=np.zeros(1, np.int64),
        )
        self.context = pack(context)
        self.tracks = TrackFollower(places.areas, parameters)
        self.grouper = TouchGrouper(context)
        self.result = NO_TOUCHES

    def track_touches(self, reading: Reading, instant: Instant) -> TrackingResult:
        """Return the touches of the next reading, at its instant."""
        found = find_candidates(
            reading.pressure, self.least, self.order, self.candidates
        )
        touched = self.result is not NO_TOUCHES
        if found or touched or self.pressed_count[0]:
            self.result = self.track_candidates(
                reading, instant, self.candidates[:found]
            )
        return self.result

    def track_candidates(
        self, reading: Reading, instant: Instant, candidates: np.ndarray
    ) -> TrackingResult:
        """Return the touches of the next reading from the taxels that may be active."""
        kernel_reading = KernelReading(
            instant=instant,
            pressure=reading.pressure,
            valid=reading.valid,
            T_world_link=self.poses.get(reading.q),
        )
        rows, taxels = find_contacts(candidates, kernel_reading, self.context)
        contacts = build_contacts(instant.stamp, rows, taxels)
        self.tracks.follow_contacts(contacts, kernel_reading)
        self.grouper.group_tracks(self.tracks, rows[:, NEAR:], kernel_reading)
        opened = tuple(self.grouper.touches.values())
        closed = tuple(self.grouper.closed)
        held = tuple(self.grouper.held)
        if not (opened or closed or held or self.tracks.all):
            return NO_TOUCHES
        tracks = (*self.tracks.ongoing, *self.tracks.ended)
        return TrackingResult(contacts, tracks, opened, closed, held)

    @property
    def release_seconds(self) -> float:
        """Time constant with which pressure falls as the skin is let go [s].

        The calibration gives it until enough releases have been seen.
        """
        return float(1.0 / self.release_rate[0])

    def finish(self) -> TrackingResult:
        """Drop all tracks and touches, and return the touches of the last reading."""
        result = self.result
        self.result = NO_TOUCHES
        self.tracks.clear()
        self.grouper.clear()
        return result


def build_contacts(
    stamp: int,
    rows: Float[np.ndarray, "contact column"],
    taxels: Int[np.ndarray, "load"],
) -> tuple[ContactRecord, ...]:
    """Build the contacts that `find_contacts` has found at a stamp [ns]."""
    return tuple(
        ContactRecord(
            stamp=stamp,
            place=index,
            taxels=taxels[int(row[BEGIN]) : int(row[END])],
            link=int(row[LINK]),
            patch=int(row[PATCH]),
            onset=stamp - int(row[AGE]),
            force=row[FORCE],
            area=row[AREA],
            peak=row[PEAK],
            evidence=row[EVIDENCE],
            p_world=(row[P_WORLD], row[P_WORLD + 1], row[P_WORLD + 2]),
            n_world=(row[N_WORLD], row[N_WORLD + 1], row[N_WORLD + 2]),
            p_link=(row[P_LINK], row[P_LINK + 1], row[P_LINK + 2]),
        )
        for index, row in enumerate(rows.tolist())
    )


@dataclass(frozen=True)
class PipelineConfig:
    """A configuration combines the settings of the stages that a model depends on.

    It is stored with the weights. What counts as a fault does not depend on a model:
    no file may make the skin believe more.
    """

    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    """Settings of baselines."""
    contacts: ContactConfig = field(default_factory=ContactConfig)
    """Thresholds of contacts."""
    tracks: TrackConfig = field(default_factory=TrackConfig)
    """Limits of the motion of contacts."""
    touches: TouchConfig = field(default_factory=TouchConfig)
    """Limits of what belongs to one touch."""


def find_insensitive(
    skin: Skin, calibration: Calibration, contact: float
) -> Int[np.ndarray, "some"]:
    """Find taxels in which contact begins above `MAX_CONTACT` by their calibration.

    Raises:
        SkinMismatchError: half of the taxels of a patch would hardly feel a contact
            from that pressure [kPa] on.
    """
    share = calibration.compute_counts(contact) / calibration.full_scale
    for n, patch in enumerate(skin.patches):
        middle = np.median(share[skin.patch_index == n])
        if not middle <= MAX_MEDIAN_CONTACT:
            raise SkinMismatchError(
                f"contact on patch '{patch.id}' would begin at {middle:.3g} of full "
                f"scale by calibration and model, at {contact:g} kPa; allowed is at "
                f"most {MAX_MEDIAN_CONTACT:g}; calibrate the skin again, or train the "
                "model again"
            )
    return np.flatnonzero(share > MAX_CONTACT)


@final
class TouchPipeline:
    """A pipeline finds the touches on one skin from its scans; stateful.

    A front end turns scans into readings; a tracker finds touches in them.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        calibration: Calibration,
        config: PipelineConfig | None = None,
        poses: LinkPoseCache | None = None,
    ) -> None:
        """Start with every stage in its initial state; `poses` may be shared."""
        self.config = config or PipelineConfig()
        self.mounted = mounted
        self.front_end = FrontEnd(mounted.skin, calibration, self.config.calibration)
        contacts = self.config.contacts.with_floor(calibration.floor)
        self.contact = contacts.on
        self.insensitive = find_insensitive(
            mounted.skin, self.front_end.calibration, contacts.on
        )
        self.tracker = TouchTracker(
            mounted,
            contacts,
            self.config.tracks,
            self.config.touches,
            poses or LinkPoseCache(mounted),
            self.front_end.places,
            self.front_end.taxels,
            calibration.release_seconds,
        )
        self.reading: Reading | None = None
        self.calibrated: Instant | None = None

    def push_scan(self, scan: Scan) -> TouchState:
        """Process the next scan.

        Raises:
            ReadingError: The scan is of another skin or robot, or not later than the
                last one. The state is then unchanged.
        """
        return self.push_reading(*self.calibrate(scan))

    def calibrate(self, scan: Scan) -> tuple[Reading, tuple[Fault, ...]]:
        """Calibrate the next scan, and mark data that cannot be trusted as not valid.

        Raises:
            ReadingError: As for `push_scan`.
        """
        self.tracker.poses.check_joint_count(scan.q)
        reading = self.front_end.make_reading(scan)
        self.calibrated = self.front_end.clock.latest
        if len(self.insensitive):
            self.raise_insensitive(reading, self.front_end.turn(scan).counts)
        return reading, self.front_end.faults

    def raise_insensitive(
        self, reading: Reading, counts: Int[np.ndarray, "taxel"]
    ) -> None:
        """Raise pressures to contact where counts above rest are high enough.

        Taxels that need more by their calibration have it from a share of full scale.
        """
        taxels = self.insensitive
        above = counts[taxels] - self.front_end.rest[taxels]
        high = above >= MAX_CONTACT * self.front_end.calibration.full_scale
        raised = taxels[high & reading.valid[taxels]]
        # Rounded up, so that float32 does not end below the threshold.
        least = np.nextafter(np.float32(self.contact), np.float32(np.inf))
        reading.pressure[raised] = np.maximum(reading.pressure[raised], least)

    def push_reading(
        self, reading: Reading, faults: tuple[Fault, ...] = ()
    ) -> TouchState:
        """Process the next reading, which is calibrated already.

        Without a scan before, no pressure is noise: every contact is a touch.

        Raises:
            ReadingError: As for `push_scan`.
        """
        check_count(reading, self.mounted.skin)
        self.tracker.poses.check_joint_count(reading.q)
        instant = self.calibrated
        if instant is None or instant.stamp != reading.stamp:
            instant = self.front_end.clock.advance_to(reading.stamp)
        self.calibrated = None
        result = self.tracker.track_touches(reading, instant)
        self.reading = reading
        return self.build_state(reading, faults, result)

    def finish(self) -> tuple[Touch, ...]:
        """Close the open touches, as at the end of a recording, and return them.

        Later readings begin new tracks and touches.
        """
        if self.reading is None:
            return ()
        state = self.build_state(self.reading, (), self.tracker.finish())
        return tuple(replace(touch, closed=True) for touch in state.touches)

    def build_state(
        self, reading: Reading, faults: tuple[Fault, ...], result: TrackingResult
    ) -> TouchState:
        """Build the state at a reading."""
        return TouchState(
            reading,
            faults,
            self.front_end.doubtful,
            result,
            self.mounted,
            self.tracker.poses.use_kinematics,
            self.contact,
        )
