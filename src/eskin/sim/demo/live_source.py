"""This module reads a simulated skin on a moving arm as a source of scans."""

from collections.abc import Callable
from typing import final

from eskin.drivers import Clock, Event, JointSource, Source, SourceInfo
from eskin.sim.interactive import InteractiveSkin
from eskin.touch import Scan
from eskin.units import NS_PER_S

MAX_LATE = 0.5
"""Delay above which overdue scans are skipped [s]."""


@final
class LiveSource(Source):
    """Scans a simulated skin on its arm, period by period, without end.

    Attributes:
        skin: the skin that is scanned.
        skipped: number of scans skipped because the computer was too slow.
    """

    def __init__(
        self,
        skin: InteractiveSkin,
        joints: JointSource,
        clock: Clock,
        before_scan: Callable[[int], None] = lambda stamp: None,
        after_scan: Callable[[], None] = lambda: None,
    ) -> None:
        """Schedule the first scan one period from now.

        Args:
            skin: the skin to scan.
            joints: joint positions of the arm.
            clock: the clock that times the scans.
            before_scan: called before each scan with its stamp.
            after_scan: called after each scan.
        """
        self.skin = skin
        self.joints = joints
        self.clock = clock
        self.before_scan = before_scan
        self.after_scan = after_scan
        self.period = round(skin.period * NS_PER_S)
        self.due = clock.now() + self.period
        self.given = self.skipped = 0
        self.closed = False
        mounted = skin.mounted
        self.info = SourceInfo(
            uri=f"sim:{mounted.skin.name}",
            robot_name=skin.wearer.name,
            joint_names=mounted.robot.joint_names,
            skin=mounted.skin,
            calibration=skin.calibration,
            rate=1.0 / skin.period,
            urdf=skin.wearer.urdf,
        )

    def read(self, timeout: float | None = None) -> Scan | None:
        """Return the next scan when it is due; None if that takes too long."""
        if self.closed:
            return None
        wait = (self.due - self.clock.now()) / NS_PER_S
        if timeout is not None and wait > timeout:
            self.clock.sleep(timeout)
            return None
        self.clock.sleep(wait)
        late = self.clock.now() - self.due
        if late > MAX_LATE * NS_PER_S:
            missed = late // self.period
            self.skipped += missed
            self.due += missed * self.period
        stamp, self.due = self.due, self.due + self.period
        self.before_scan(stamp)
        self.given += 1
        scan = self.skin.scan(stamp, self.joints.q_at(stamp))
        self.after_scan()
        return scan

    @property
    def ended(self) -> bool:
        """Return whether it was closed."""
        return self.closed

    def take_events(self) -> list[Event]:
        """Return no events: nothing unexpected happens to a simulated skin."""
        return []

    def counters(self) -> dict[str, int]:
        """Return the number of `readings` given and of those `skipped`."""
        return {"readings": self.given, "skipped": self.skipped}

    def close(self) -> None:
        """End the source."""
        self.closed = True
