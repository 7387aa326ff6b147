"""This module plays scans that already exist as if they came from a device."""

import math
from collections.abc import Generator, Iterable
from dataclasses import replace
from pathlib import Path
from typing import final

from eskin.drivers.clock import Clock, HostClock
from eskin.drivers.events import Event
from eskin.drivers.source import Source, SourceInfo
from eskin.recording import read_recording
from eskin.touch import Scan
from eskin.units import NS_PER_S


@final
class PlayedClock(Clock):
    """Tells the time in a recording that is played, at any pace.

    It stands at the first stamp until playing begins. A scan's age by it is the same
    as if the scan were taken now.
    """

    def __init__(self, host: Clock, pace: float, start: int | None) -> None:
        """Wait for the first scan.

        Args:
            host: the clock that playing is timed by.
            pace: seconds played in a second; infinite goes from stamp to stamp.
            start: time at which playing begins [ns since the epoch]; None: the host's.
        """
        self.host = host
        self.pace = pace
        self.start = start
        self.began: int | None = None
        self.reached = 0

    def begin(self) -> int:
        """Go from now on, unless it goes already; returns the time it began at."""
        if self.start is None:
            self.start = self.host.now()
        if self.began is None:
            self.reached, self.began = self.start, self.host.now()
        return self.start

    def reach(self, stamp: int) -> None:
        """Note the latest stamp given [ns since the epoch]."""
        self.reached = stamp

    def now(self) -> int:
        """The time in what is played [ns since the epoch]."""
        if self.start is None:
            return self.host.now()
        if self.began is None:
            return self.start
        if math.isinf(self.pace):
            return self.reached
        return self.start + round((self.host.now() - self.began) * self.pace)

    def until(self, stamp: int) -> float:
        """How long until that stamp is due, by the host's clock [s]."""
        return (stamp - self.now()) / NS_PER_S / self.pace

    def sleep(self, seconds: float) -> None:
        """Let some time of what is played pass [s]."""
        self.host.sleep(seconds / self.pace)


STEPPED = math.inf
"""The pace at which each scan is given as soon as it is asked for."""


@final
class PlayedSource(Source):
    """Gives scans of a recording or a simulation at a pace; ends after the last."""

    def __init__(
        self,
        info: SourceInfo,
        scans: Iterable[Scan],
        pace: float = 1.0,
        clock: Clock | None = None,
        restamp: bool = False,
    ) -> None:
        """Make ready; playing begins at the first `read`.

        Args:
            info: of the scans.
            scans: in the order of their stamps; the first is fetched at once.
            pace: seconds played in a second: 1 is real time, `STEPPED` (infinite) gives
                each scan as soon as it is asked for.
            clock: that playing is timed by; None takes this computer's.
            restamp: whether stamps are shifted so that the first is the clock's now; else
                the scans keep their own. `Source.clock` tells the same time as the
                stamps either way.

        Raises:
            ValueError: the pace is not positive.
        """
        if not pace > 0:
            raise ValueError(
                f"pace is {pace}; allowed are positive numbers; give 1 for real time, "
                "inf for as fast as it is read"
            )
        self.info = info
        self.host = clock or HostClock()
        self.scans = iter(scans)
        self.next = next(self.scans, None)
        self.first = self.next.stamp if self.next is not None else 0
        self.played = PlayedClock(self.host, pace, None if restamp else self.first)
        self.clock = self.played
        self.given = 0

    def read(self, timeout: float | None = None) -> Scan | None:
        """The next scan when it is due; None where it is not in time, or at the end."""
        if self.next is None:
            return None
        shift = self.played.begin() - self.first
        stamp = self.next.stamp + shift
        wait = self.played.until(stamp)
        if timeout is not None and wait > timeout:
            self.host.sleep(timeout)
            return None
        self.host.sleep(wait)
        scan = replace(self.next, stamp=stamp) if shift else self.next
        self.played.reach(stamp)
        self.given += 1
        self.next = next(self.scans, None)
        return scan

    @property
    def ended(self) -> bool:
        """Whether the last scan has been given, or the source is closed."""
        return self.next is None

    def take_events(self) -> list[Event]:
        """Nothing happens to what is played."""
        return []

    def counters(self) -> dict[str, int]:
        """The `readings` given."""
        return {"readings": self.given}

    def close(self) -> None:
        """Give no more, and close the recording."""
        self.next = None
        if isinstance(self.scans, Generator):
            self.scans.close()


def replay_source(
    path: Path | str,
    pace: float = 1.0,
    clock: Clock | None = None,
    restamp: bool = False,
) -> PlayedSource:
    """A recording as a source; robot, skin and calibration are those in the file.

    Args:
        path: of the recording; one that is cut is played up to its last whole chunk.
        pace: as of `PlayedSource`.
        clock: as of `PlayedSource`.
        restamp: as of `PlayedSource`.

    Raises:
        RecordingError: there is no such file, or nothing in it can be used.
    """
    recording = read_recording(path)
    info = SourceInfo(
        uri=f"replay:{path}",
        robot_name=recording.robot_name,
        joint_names=recording.joint_names,
        skin=recording.skin,
        calibration=recording.calibration,
        rate=NS_PER_S / recording.period if recording.period else 0.0,
    )
    return PlayedSource(info, recording.scans(), pace, clock, restamp)
