"""This module plays scans that already exist as if they came from a device."""

import math
from collections.abc import Generator, Iterable
from dataclasses import replace
from pathlib import Path
from typing import final

from eskin.drivers.clock import Clock, HostClock
from eskin.drivers.events import Event, EventLog
from eskin.drivers.source import Source, SourceInfo
from eskin.recording import NO_OVERRIDES, Overrides, read_recording
from eskin.recording.records import compute_skipped
from eskin.skin import MountedSkin
from eskin.touch import Scan
from eskin.units import NS_PER_S, format_duration

STEPPED = math.inf
"""Pace at which each scan is returned as soon as it is read."""


@final
class PlayedClock(Clock):
    """Tells the time in a recording that is played, at any pace.

    It stays at the first stamp until playing begins. By this clock the age of a scan is
    the same as on a device.
    """

    def __init__(self, host: Clock, pace: float, start: int | None) -> None:
        """Start at a time [ns since the epoch], or the host's where `start` is None."""
        self.host = host
        self.pace = pace
        self.start = start
        self.began: int | None = None
        self.reached = 0
        self.skipped = 0

    def begin(self) -> int:
        """Start the clock unless it runs already; return the time it started at."""
        if self.start is None:
            self.start = self.host.now()
        if self.began is None:
            self.reached = self.start
            self.began = self.host.now()
        return self.start

    def now(self) -> int:
        """Return the time in the recording [ns since the epoch]."""
        if self.start is None:
            return self.host.now()
        if self.began is None:
            return self.start
        if math.isinf(self.pace):
            return self.reached
        played = round((self.host.now() - self.began) * self.pace)
        return self.start + self.skipped + played

    def skip(self, duration: int) -> None:
        """Go on as if a duration had passed [ns]."""
        self.skipped += duration

    def time_until(self, stamp: int) -> float:
        """Return the time until a stamp is due, by the host's clock [s]."""
        return (stamp - self.now()) / NS_PER_S / self.pace

    def sleep(self, seconds: float) -> None:
        """Wait until some time of the recording has passed [s]."""
        self.host.sleep(seconds / self.pace)


@final
class PlayedSource(Source):
    """Returns scans of a recording or simulation at a pace and ends after the last.

    A gap, a time without scans, lasts 10 s at most. What is left out of a longer one is
    told by an event; the scan after it keeps its stamp unless stamps are shifted.
    """

    def __init__(
        self,
        info: SourceInfo,
        scans: Iterable[Scan],
        pace: float = 1.0,
        clock: Clock | None = None,
        restamp: bool = False,
    ) -> None:
        """Prepare playing, which begins at the first `read`.

        Args:
            info: source info of the scans.
            scans: scans in the order of their stamps; the first is fetched at once.
            pace: seconds played per second: 1 is real time, `STEPPED` (infinite)
                returns each scan as soon as it is read.
            clock: clock that times the playback; None takes this computer's.
            restamp: whether stamps are shifted so that the first is the clock's now;
                else the scans keep their own. `Source.clock` follows the stamps either
                way.

        Raises:
            ValueError: the pace is not positive.
        """
        if not pace > 0:
            raise ValueError(
                f"pace is {pace}; allowed are positive numbers; give 1 for real time, "
                "inf for as fast as it is read"
            )
        self.info = info
        self.restamp = restamp
        self.host = clock or HostClock()
        self.scans = iter(scans)
        self.next_scan = next(self.scans, None)
        self.first = 0 if self.next_scan is None else self.next_scan.stamp
        self.played = PlayedClock(self.host, pace, None if restamp else self.first)
        self.clock = self.played
        self.log = EventLog()
        self.period = round(NS_PER_S / info.rate) if info.rate else 0
        self.shift = 0
        self.skipping = 0
        self.given = 0

    def read(self, timeout: float | None = None) -> Scan | None:
        """Return the next scan when it is due; None if not in time, or at the end."""
        if self.next_scan is None:
            return None
        if not self.given:
            self.shift = self.played.begin() - self.first
        scan = self.next_scan
        wait = self.played.time_until(scan.stamp + self.shift - self.skipping)
        if timeout is not None and wait > timeout:
            self.host.sleep(timeout)
            return None
        self.host.sleep(wait)
        self.skip_gap(scan.stamp + self.shift)
        stamp = scan.stamp + self.shift
        self.played.reached = stamp
        self.given += 1
        self.next_scan = next(self.scans, None)
        if self.next_scan is not None:
            silence = self.next_scan.stamp - scan.stamp
            self.skipping = compute_skipped(silence, self.period)
        return replace(scan, stamp=stamp) if self.shift else scan

    def skip_gap(self, stamp: int) -> None:
        """Skip the gap before the scan of a stamp, if there is one, and tell it."""
        if not self.skipping:
            return
        if self.restamp:
            self.shift -= self.skipping
            stamp -= self.skipping
        else:
            self.played.skip(self.skipping)
        duration = format_duration(self.skipping / NS_PER_S)
        text = f"skipped {duration} without readings"
        self.log.log_event(stamp, "lost", text)
        self.skipping = 0

    @property
    def ended(self) -> bool:
        """Return whether the last scan has been returned, or the source is closed."""
        return self.next_scan is None

    def take_events(self) -> list[Event]:
        """Return the gaps that were skipped since the last call."""
        return self.log.take()

    def counters(self) -> dict[str, int]:
        """Return the number of `readings` returned."""
        return {"readings": self.given}

    def close(self) -> None:
        """Return no more scans and close the recording."""
        self.next_scan = None
        if isinstance(self.scans, Generator):
            self.scans.close()


def replay_source(
    path: Path | str,
    pace: float = 1.0,
    clock: Clock | None = None,
    restamp: bool = False,
    overrides: Overrides = NO_OVERRIDES,
) -> PlayedSource:
    """Open a recording as a source; robot, skin and calibration are from the file.

    Args:
        path: path of the recording; a truncated one is played to its last whole chunk.
        pace: seconds played per second, see `PlayedSource`.
        clock: clock that times the playback, see `PlayedSource`.
        restamp: whether stamps are shifted to now, see `PlayedSource`.
        overrides: what to use in place of what the file holds.

    Raises:
        RecordingError: there is no such file, or nothing in it can be used.
        RobotError: its robot is not known, or cannot be used.
        SkinMismatchError: the calibration is not of its skin, or the robot lacks its
            links or has joints that were not recorded.
    """
    recording = read_recording(path, overrides)
    robot = recording.load_robot()
    recording = recording.with_robot(robot)
    mounted = MountedSkin(recording.skin, robot)
    rate = NS_PER_S / recording.period if recording.period else 0.0
    info = SourceInfo(f"replay:{path}", mounted, recording.calibration, rate)
    return PlayedSource(info, recording.scans(), pace, clock, restamp)
