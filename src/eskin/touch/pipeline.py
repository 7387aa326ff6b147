"""From counts to touches in one step, live or replayed."""

from dataclasses import dataclass, field, replace
from typing import final

from eskin.skin.mount import MountedSkin
from eskin.touch.calibration import (
    Calibration,
    CalibrationConfig,
    Calibrator,
    check_count,
)
from eskin.touch.contacts import ContactConfig
from eskin.touch.crosstalk import Crosstalk
from eskin.touch.fault import Fault
from eskin.touch.faults import FaultConfig, FaultFinder
from eskin.touch.follower import TouchFollower
from eskin.touch.poses import LivePoses
from eskin.touch.reading import Reading, Scan
from eskin.touch.records import Followed
from eskin.touch.state import TouchState
from eskin.touch.touches import Touch, TouchConfig
from eskin.touch.tracks import TrackConfig


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
        poses: LivePoses | None = None,
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
        self.faults = FaultFinder(mounted.skin, calibration, self.config.faults)
        self.crosstalk = Crosstalk(mounted.skin, calibration)
        self.follower = TouchFollower(
            mounted,
            self.config.contacts.raised_to(calibration.floor),
            self.config.tracks,
            self.config.touches,
            poses or LivePoses(mounted),
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
        return self.crosstalk.taken_off(reading), faults

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
        self, reading: Reading, faults: tuple[Fault, ...], followed: Followed
    ) -> TouchState:
        """All that is known at a reading."""
        posed = self.follower.poses.posed
        return TouchState(reading, faults, followed, self.mounted, posed)
