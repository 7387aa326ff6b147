"""A simulated skin on an arm that moves, as a source of scans."""

from collections.abc import Callable
from typing import final

from eskin.drivers import Clock, Event, JointSource, Source, SourceInfo
from eskin.sim.interactive.skin import LiveSkin
from eskin.touch import Scan
from eskin.units import NS_PER_S

MAX_LATE = 0.5
"""Later than this, scans are left out and it goes on with the present [s]."""


@final
class LiveSource(Source):
    """Scans a live skin where its arm is, period by period; never ends by itself.

    Attributes:
        skin: that is scanned.
        skipped: scans left out because the computer was too slow.
    """

    def __init__(
        self,
        skin: LiveSkin,
        joints: JointSource,
        clock: Clock,
        before: Callable[[int], None] = lambda stamp: None,
        after: Callable[[], None] = lambda: None,
    ) -> None:
        """Begin now.

        Args:
            skin: to scan.
            joints: where the arm is.
            clock: that scans are timed by.
            before: called ahead of each scan with its stamp.
            after: called after each scan.
        """
        self.skin = skin
        self.joints = joints
        self.clock = clock
        self.before = before
        self.after = after
        self.period = round(skin.period * NS_PER_S)
        self.due = clock.now() + self.period
        self.given = self.skipped = 0
        self.closed = False
        mounted = skin.mounted
        self.info = SourceInfo(
            uri=f"sim:{mounted.skin.name}",
            robot_name=skin.robot_name,
            joint_names=mounted.robot.joint_names,
            skin=mounted.skin,
            calibration=skin.calibration,
            rate=1.0 / skin.period,
        )

    def read(self, timeout: float | None = None) -> Scan | None:
        """The next scan when it is due; None where it is not in time."""
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
        self.before(stamp)
        self.given += 1
        scan = self.skin.scan(stamp, self.joints.q_at(stamp))
        self.after()
        return scan

    @property
    def ended(self) -> bool:
        """Whether it was closed."""
        return self.closed

    def take_events(self) -> list[Event]:
        """Nothing happens to a simulated skin that is not asked for."""
        return []

    def counters(self) -> dict[str, int]:
        """The `readings` given and those `skipped`."""
        return {"readings": self.given, "skipped": self.skipped}

    def close(self) -> None:
        """Give no more."""
        self.closed = True
