"""This module computes touches from scans, live or replayed."""

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import pack
from eskin.errors import ReadingError, SkinMismatchError
from eskin.skin import MountedSkin, Skin
from eskin.touch.adjacency import Adjacency
from eskin.touch.belief_kernels import CLEAR_FACTOR
from eskin.touch.calibration import MAX_CONTACT, Calibration
from eskin.touch.calibrator import CalibrationConfig, Calibrator, CrosstalkCompensator
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
from eskin.touch.faults import Fault, FaultConfig, FaultDetector
from eskin.touch.grouping import TouchGrouper
from eskin.touch.outages import OutageDetector
from eskin.touch.polarity import LEAST_PRESSURE, PolarityDetector
from eskin.touch.reading import Reading, Scan, check_count, check_order
from eskin.touch.records import (
    NO_TOUCHES,
    ContactConfig,
    ContactRecord,
    KernelReading,
    TouchConfig,
    TrackConfig,
    TrackerContext,
    TrackingResult,
    build_taxel_geometry,
    build_tracker_state,
    build_tracking_parameters,
)
from eskin.touch.touches import Touch, TouchState
from eskin.touch.tracks import TrackFollower
from eskin.units import NS_PER_S

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
            self.check(q)
            used = q if self.use_kinematics else np.zeros_like(q)
            self.T_world_link = self.mounted.kinematics.poses(used)
            self.q = key
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
        release_seconds: float,
    ) -> None:
        """Start with an untouched skin."""
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
        self.no_floor = np.zeros(skin.count)
        self.state = build_tracker_state(skin.count)
        parameters = build_tracking_parameters(
            contacts, tracks, touches, skin.calibrated, release_seconds
        )
        # By patch, row and column.
        self.order = np.lexsort((skin.columns, skin.rows, skin.patch_index))
        geometry = build_taxel_geometry(mounted, adjacency)
        self.context = pack(
            TrackerContext(parameters, geometry, adjacency.neighbours, self.state)
        )
        self.tracks = TrackFollower(skin.areas, parameters)
        self.touches = TouchGrouper(parameters)
        self.result = NO_TOUCHES
        self.first: int | None = None
        self.last: int | None = None

    def push(
        self, reading: Reading, floor: Float[np.ndarray, "taxel"] | None = None
    ) -> TrackingResult:
        """Process the next reading; up to `floor` [kPa] it may be noise, 0 for None.

        Raises:
            ReadingError: It is of another skin or robot, or not later than the last
                one. The state is then unchanged.
        """
        check_count(reading, self.skin)
        self.poses.check(reading.q)
        check_order(self.last, reading.stamp)
        found = find_candidates(
            reading.pressure, self.least, self.order, self.candidates
        )
        touched = self.result is not NO_TOUCHES
        if found or touched or self.state.held[0]:
            floor = self.no_floor if floor is None else floor
            self.result = self.track(reading, self.candidates[:found], floor)
        self.first = reading.stamp if self.first is None else self.first
        self.last = reading.stamp
        return self.result

    def track(
        self, reading: Reading, candidates: np.ndarray, floor: np.ndarray
    ) -> TrackingResult:
        """Return the touches of the next reading from the taxels that may be active."""
        stamp = reading.stamp
        first = stamp if self.first is None else self.first
        last = stamp if self.last is None else self.last
        kernel_reading = KernelReading(
            stamp=stamp,
            elapsed=stamp - last,
            now=(stamp - first) / NS_PER_S,
            previous=(last - first) / NS_PER_S,
            pressure=reading.pressure,
            floor=floor,
            valid=reading.valid,
            T_world_link=self.poses.get(reading.q),
        )
        rows, taxels = find_contacts(candidates, kernel_reading, self.context)
        contacts = build_contacts(stamp, rows, taxels)
        self.tracks.push(contacts, kernel_reading)
        self.touches.push(self.tracks, rows[:, NEAR:], kernel_reading)
        opened, closed = tuple(self.touches.touches.values()), self.touches.closed
        if not (opened or closed or self.tracks.all):
            return NO_TOUCHES
        tracks = (*self.tracks.ongoing, *self.tracks.ended)
        return TrackingResult(contacts, tracks, opened, tuple(closed))

    @property
    def latched(self) -> Int[np.ndarray, "latched"]:
        """Indices of the taxels that were in contact at the last reading."""
        return self.state.latched[: self.state.held[0]]

    def finish(self) -> TrackingResult:
        """Drop all tracks and touches, and return the touches of the last reading."""
        result, self.result = self.result, NO_TOUCHES
        self.tracks.clear()
        self.touches.clear()
        return result


def build_contacts(
    stamp: int,
    rows: Float[np.ndarray, "contact column"],
    taxels: Int[np.ndarray, "load"],
) -> tuple[ContactRecord, ...]:
    """Build the contacts that `find_contacts` has found at a stamp [ns]."""
    return tuple(
        ContactRecord(
            *(stamp, index, taxels[int(row[BEGIN]) : int(row[END])]),
            *(int(row[LINK]), int(row[PATCH]), stamp - int(row[AGE])),
            *(row[FORCE], row[AREA], row[PEAK], row[EVIDENCE]),
            (row[P_WORLD], row[P_WORLD + 1], row[P_WORLD + 2]),
            (row[N_WORLD], row[N_WORLD + 1], row[N_WORLD + 2]),
            (row[P_LINK], row[P_LINK + 1], row[P_LINK + 2]),
        )
        for index, row in enumerate(rows.tolist())
    )


@dataclass(frozen=True)
class PipelineConfig:
    """A configuration combines those of the stages that a model depends on.

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

    Its stages are the detection of outages, calibration, fault detection, crosstalk and
    tracking. Counts that fall under pressure are turned before the first of them.
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
        self.given, calibration = calibration, calibration.rising
        self.calibrator = Calibrator(mounted.skin, calibration, self.config.calibration)
        contacts = self.config.contacts.with_floor(calibration.floor)
        usual = ContactConfig().with_floor(calibration.floor)
        self.faults = FaultDetector(mounted.skin, calibration, FaultConfig(), usual.on)
        self.contact = contacts.on
        self.insensitive = find_insensitive(mounted.skin, calibration, contacts.on)
        if calibration.noise is not None:
            self.calibrator.set_noise(self.faults.noise.limits.counts)
        self.outages = OutageDetector(self.faults, self.calibrator.config.tare_samples)
        self.polarity = PolarityDetector(
            mounted.skin,
            "rising" if self.given.falling else "falling",
            calibration.full_scale,
            calibration.compute_counts(LEAST_PRESSURE + calibration.floor),
        )
        self.crosstalk = CrosstalkCompensator(mounted.skin, calibration)
        self.tracker = TouchTracker(
            mounted,
            contacts,
            self.config.tracks,
            self.config.touches,
            poses or LinkPoseCache(mounted),
            calibration.release_seconds,
        )
        self.reading: Reading | None = None

    def push(self, scan: Scan) -> TouchState:
        """Process the next scan.

        Raises:
            ReadingError: The scan is of another skin or robot, or not later than the
                last one. The state is then unchanged.
        """
        return self.push_reading(*self.calibrate(scan), self.faults.noise.limits.floor)

    def calibrate(self, scan: Scan) -> tuple[Reading, tuple[Fault, ...]]:
        """Calibrate the next scan, and mark data that cannot be trusted as not valid.

        Raises:
            ReadingError: As for `push`.
        """
        self.tracker.poses.check(scan.q)
        check_count(scan, self.calibrator.skin)
        scan = self.turn(scan)
        # The fault detector needs the pressure of this scan, so faults are masked by
        # those of the last one; negative counts are invalid at once.
        invalid = self.faults.mask | (scan.counts < 0)
        rest = self.calibrator.rest
        refused, restarted = self.outages.push(
            scan, self.calibrator.state, self.faults.noise.limits.counts
        )
        if len(restarted):
            self.calibrator.restart(restarted)
            self.faults.restart(restarted)
        used = scan
        if refused is not None:
            used = replace(scan, received=scan.received & ~refused)
        reading = self.calibrator.push(used, invalid, self.find_latched())
        peak, share = self.calibrator.state["peak"], self.config.calibration.dip_share
        mask, faults = self.faults.push(
            scan, reading.pressure, rest, refused, peak, share
        )
        self.calibrator.set_noise(self.faults.noise.limits.counts)
        reading.valid[mask] = False
        faults += self.polarity.push(scan, self.calibrator.margin, mask)
        reading = self.crosstalk.compensate(reading)
        if len(self.insensitive):
            reading = self.raise_insensitive(reading, scan.counts)
        return reading, faults

    def raise_insensitive(
        self, reading: Reading, counts: Int[np.ndarray, "taxel"]
    ) -> Reading:
        """Return a reading with contact where counts above rest are high enough.

        Taxels that need more by their calibration have it from a share of full scale.
        """
        taxels = self.insensitive
        above = counts[taxels] - self.calibrator.rest[taxels]
        high = above >= MAX_CONTACT * self.faults.full_scale
        raised = taxels[high & reading.valid[taxels]]
        if not len(raised):
            return reading
        pressure = reading.pressure.copy()
        # Rounded up, so that float32 does not end below the threshold.
        least = np.nextafter(np.float32(self.contact), np.float32(np.inf))
        pressure[raised] = np.maximum(pressure[raised], least)
        return replace(reading, pressure=pressure)

    def turn(self, scan: Scan) -> Scan:
        """Return a scan whose counts rise under pressure."""
        if not self.given.falling:
            return scan
        return replace(scan, counts=self.given.turn_counts(scan.counts))

    def find_latched(self) -> Int[np.ndarray, "latched"]:
        """Find the taxels that are in contact, and clearly above their noise."""
        latched, floor = self.tracker.latched, self.faults.noise.limits.floor
        if self.reading is None or not len(latched):
            return latched
        pressure = self.reading.pressure[latched]
        return latched[pressure >= CLEAR_FACTOR * floor[latched]]

    def push_reading(
        self,
        reading: Reading,
        faults: tuple[Fault, ...] = (),
        floor: Float[np.ndarray, "taxel"] | None = None,
    ) -> TouchState:
        """Process the next reading, which is calibrated already.

        Pressures up to `floor` [kPa] may be noise; for None every contact is a touch.

        Raises:
            ReadingError: As for `push`.
        """
        result = self.tracker.push(reading, floor)
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
            self.faults.doubtful,
            result,
            self.mounted,
            self.tracker.poses.use_kinematics,
            self.contact,
        )
