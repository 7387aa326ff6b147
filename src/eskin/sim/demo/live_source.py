"""This module reads a simulated skin on a moving arm as a source, and makes it fail."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import Lock
from typing import final

import numpy as np

from eskin.drivers import Clock, Event, JointSource, Source, SourceInfo
from eskin.sim.interactive import InteractiveSkin
from eskin.touch import Scan
from eskin.units import NS_PER_S

MAX_LATE = 0.5
"""Delay above which overdue scans are skipped [s]."""


AHEAD = 0.2
"""Greatest lead of simulated time over the latest reading that was processed [s]."""


@final
class WaitingClock(Clock):
    """Follows another clock, but waits for readings that are processed too slowly.

    A simulated skin is as late as its computer is busy. Nobody is touched meanwhile, so
    time itself waits: what goes by this clock never sees an old reading.
    """

    def __init__(self, clock: Clock) -> None:
        """Follow a clock without waiting, until `latest` is set."""
        self.clock = clock
        self.waited = 0
        self.latest: Callable[[], int] | None = None
        self.lock = Lock()

    def now(self) -> int:
        """Return the time that has not been waited for [ns since the epoch]."""
        with self.lock:
            time = self.clock.now() - self.waited
            if self.latest is not None:
                late = time - self.latest() - round(AHEAD * NS_PER_S)
                self.waited += max(0, late)
                time -= max(0, late)
            return time

    def sleep(self, seconds: float) -> None:
        """Wait [s]."""
        self.clock.sleep(seconds)


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

        `before_scan` is called with the stamp of each scan.
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
        uri = f"sim:{mounted.skin.name}"
        self.info = SourceInfo(uri, mounted, skin.calibration, 1.0 / skin.period)

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
        stamp = self.due
        self.due = self.due + self.period
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


@dataclass(frozen=True)
class StormConfig:
    """Sets which faults of the skin come beside the faults of its build."""

    loss: float = 0.0
    """Probability that a scan of a patch is lost, beside the losses of the build."""
    unplug_period: float | None = None
    """Time from one unplugged patch to the next [s]; None unplugs none."""
    unplug_seconds: float = 5.0
    """Time after which an unplugged patch is plugged in again [s]."""
    dead: float = 0.0
    """Share of all taxels that are dead from the start."""


@final
class FaultStorm:
    """Loses scans of patches, unplugs patches and kills taxels of a simulated skin."""

    def __init__(self, skin: InteractiveSkin, config: StormConfig, seed: int) -> None:
        """Kill the taxels that are dead from the start.

        Raises:
            ValueError: a share is not between 0 and 1.
        """
        if not 0.0 <= config.loss <= 1.0:
            raise ValueError(
                f"loss is {config.loss}; allowed is 0 to 1, the share of lost scans"
            )
        self.skin = skin
        self.config = config
        self.rng = np.random.default_rng([seed, 2811])
        self.patches = [patch.id for patch in skin.mounted.skin.patches]
        self.patch_index = skin.mounted.skin.patch_index
        self.unplugged: str | None = None
        self.next_change: int | None = None
        if config.dead:
            skin.kill(config.dead)

    def update(self, stamp: int) -> None:
        """Unplug a patch or plug it in again, where that is due at a time [ns]."""
        period = self.config.unplug_period
        if period is None:
            return
        if self.next_change is None:
            self.next_change = stamp + round(period * NS_PER_S)
        if stamp < self.next_change:
            return
        seconds = self.config.unplug_seconds
        if self.unplugged is None:
            self.unplugged = str(self.rng.choice(self.patches))
            self.skin.unplug(self.unplugged)
        else:
            self.skin.plug(self.unplugged)
            self.unplugged = None
            seconds = period - seconds
        self.next_change = stamp + round(seconds * NS_PER_S)

    def corrupt(self, scan: Scan) -> Scan:
        """Return a scan without the patches that are lost."""
        if not self.config.loss:
            return scan
        lost = self.rng.random(len(self.patches)) < self.config.loss
        received = scan.received & ~lost[self.patch_index]
        counts = np.where(received, scan.counts, 0).astype(scan.counts.dtype)
        return replace(scan, counts=counts, received=received)
