"""This module makes a source of any device that sends samples of whole patches.

A driver of a new device is a `SampleDevice`; `SampledSource` does the rest.
"""

from abc import abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Int

from eskin.drivers.clock import Clock
from eskin.drivers.events import Event, EventLog
from eskin.drivers.joints import JointSource, PoseLog
from eskin.drivers.module_registry import MAX_SCAN_RATE
from eskin.drivers.source import Source, SourceInfo, await_first_byte
from eskin.errors import DeviceError
from eskin.progress import Closing
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

DEFAULT_RATE = 50.0
"""Scan rate of a device that sends nothing while it is opened [1/s]."""
MEASURE_SECONDS = 1.2
MEASURE_SAMPLES = 16
MAX_MEASURE_SECONDS = 8.0
"""The rate of a device is measured from its first sample on, for a time [s] and until
so many samples have come, but no longer than a time [s]."""
MAX_RATE_SAMPLES = 400
"""Number of samples by which the rate is estimated."""
RETRY_INTERVAL = NS_PER_S // 4
"""Time between two attempts to connect a device that is gone [ns]."""
MAX_WAIT = 0.05
"""Longest wait for a sample before missing ones are looked for [s]."""
MAX_HELD = NS_PER_S // 2
"""Time for which data may be held back, by a driver or a busy computer [ns]: what is
older is not used, and what has not come for longer is missing."""
SILENT_PERIODS = 3
"""Silence of a patch in periods of the device, and at least `MAX_HELD`, from which
scans go on without it."""
MAX_SPREAD = 0.9
"""Longest time between the samples of a scan, in periods of the device."""


@dataclass(frozen=True, eq=False)
class PatchSample:
    """A sample holds the counts of one patch at one instant."""

    patch: int
    """Index of the patch in `Skin.patches`."""
    stamp: int
    """Time at which it was taken, by the host's clock [ns since the epoch]."""
    counts: Int[np.ndarray, "taxel"]
    """Counts of the patch's taxels, in the order of the skin."""
    shear: Int[np.ndarray, "taxel 2"] | None = None
    """Counts along each taxel's tangents, 0 at rest; None where not measured."""
    received: Bool[np.ndarray, "taxel"] | None = None
    """Which taxels were measured; None where all were."""


class SampleDevice(Closing):
    """A device sends samples of patches; one thread uses it.

    To add a device, derive a class and implement the four methods. The source of the
    device reopens it when it is gone, keeps stamps in order, drops what is too old,
    joins patches to scans, and marks as not received what is missing.
    """

    @abstractmethod
    def connect(self) -> None:
        """Open the line to the device.

        Raises:
            OSError: it is not there. At the start that is an error; later `connect` is
                called again every quarter of a second.
        """

    @abstractmethod
    def receive(self, timeout: float) -> list[PatchSample]:
        """Return the samples that have arrived, each once, in the order of time.

        Args:
            timeout: longest wait for the first [s].

        Raises:
            OSError: the device is gone; `connect` is called next.
        """

    @abstractmethod
    def disconnect(self) -> None:
        """Close the line; it may be closed already, and may be opened again."""

    @abstractmethod
    def counters(self) -> dict[str, int]:
        """Return how much was received, and how much of it was refused and why.

        `bytes` counts all that has arrived, used or not: it tells a device that sends
        nothing from one that is not understood.
        """

    noun: str = "message"
    """What the device sends is called, in messages."""

    def take_refused(self) -> tuple[int, str]:
        """Return how much was refused since the last call, and why the last was.

        The reason shows what was received, the allowed form and the remedy.
        """
        return 0, ""

    def close(self) -> None:
        """Close the line for good."""
        self.disconnect()


@final
class SampledSource(Source):
    """Returns the scans of a device that sends samples; it never ends by itself.

    A scan is returned once every patch that sends has a new sample, or when one of them
    has a second or would be a period older than another. Without samples, scans in
    which nothing is received are returned at the rate of the device, so that a skin
    that is silent is noticed.

    Attributes:
        late: number of samples that were too old to be used.
        lag: time for which the device was last not read, as the computer was busy [ns].
        lag_end: end of that time [ns]; 0 before the first.
    """

    def __init__(
        self,
        device: SampleDevice,
        mounted: MountedSkin,
        calibration: Calibration,
        joints: JointSource,
        clock: Clock,
        uri: str,
        rate: float | None = None,
        patience: float = 0.0,
    ) -> None:
        """Connect a device, which is closed with the source.

        Args:
            device: the device.
            mounted: the skin on its robot.
            calibration: calibration of the skin's electronics.
            joints: source of the robot's joint positions.
            clock: clock that stamps everything.
            uri: URI that the source was opened with.
            rate: scan rate of the device [1/s]; None measures it, for 1.2 s, or until
                16 samples or 8 s have passed.
            patience: longest wait for the first byte [s]; 0 waits for none.

        Raises:
            SkinMismatchError: the calibration is not of this skin.
            DeviceError: the device is not there, no byte came in time, what comes is
                not understood, or the rate is out of range.
        """
        skin = mounted.skin
        calibration.check_skin(skin)
        if rate is not None and not 0.1 <= rate <= MAX_SCAN_RATE:
            raise DeviceError(
                f"rate is {rate}; allowed is 0.1 to {MAX_SCAN_RATE} scans a second; "
                "correct it, or leave it out to measure it"
            )
        self.device = device
        self.clock = clock
        self.uri = uri
        self.skin = skin
        self.taxels = [skin.find_taxels(patch.id) for patch in skin.patches]
        self.log = EventLog()
        self.pose = PoseLog(joints, self.log)
        self.ready: deque[Scan] = deque()
        self.pending: dict[int, PatchSample] = {}
        self.last_received: dict[int, int] = {}
        self.sending: set[int] = set()
        self.is_open = True
        self.closed = False
        self.received_at: int | None = None
        self.lag = 0
        self.lag_end = 0
        self.tried = 0
        self.asked_at = clock.now()
        self.last = 0
        self.readings = 0
        self.late = 0
        try:
            device.connect()
        except DeviceError:
            raise
        except OSError as error:
            raise DeviceError(
                f"cannot open {uri} ({error}); allowed is a device that is there and "
                "that no other program uses; plug it in, or correct the name"
            ) from error
        await_first_byte(
            uri, clock, patience, lambda: device.counters()["bytes"], self.receive
        )
        rate = self.measure_rate() if rate is None else rate
        self.period = round(NS_PER_S / rate)
        self.silence = max(SILENT_PERIODS * self.period, MAX_HELD)
        self.due = clock.now() + self.silence
        self.info = SourceInfo(uri, mounted, calibration, rate)

    def measure_rate(self) -> float:
        """Return the highest rate of a patch, by its samples [1/s].

        Raises:
            DeviceError: more is refused than understood.
        """
        stamps: dict[int, list[int]] = {}
        begin = now = self.clock.now()
        first = None
        while True:
            most = max(map(len, stamps.values()), default=0)
            first = now if most and first is None else first
            sends = self.device.counters()["bytes"] > 0
            is_enough = most >= MEASURE_SAMPLES or not sends
            since = begin if first is None else first
            limit = MEASURE_SECONDS if is_enough else MAX_MEASURE_SECONDS
            left = limit - (now - since) / NS_PER_S
            if left <= 0:
                break
            samples = self.receive(min(left, MAX_WAIT))
            now = self.clock.now()
            for sample in samples:
                if now - sample.stamp <= MAX_HELD:
                    stamps.setdefault(sample.patch, []).append(sample.stamp)
        refused, why = self.device.take_refused()
        self.count_refused(refused, why)
        if refused > sum(map(len, stamps.values())) or (sends and not stamps):
            why = why or "it is not data of this skin; allowed is such a device"
            raise DeviceError(f"what {self.uri} sends is not understood: {why}")
        rates = [estimate_rate(found) for found in stamps.values() if len(found) > 1]
        return max(rates, default=DEFAULT_RATE)

    def read(self, timeout: float | None = None) -> Scan | None:
        """Return the next scan of the whole skin; None where none was due in time."""
        end = None if timeout is None else self.clock.now() + round(timeout * NS_PER_S)
        while not self.ready and not self.closed:
            now = self.clock.now()
            wait = MAX_WAIT if end is None else min(MAX_WAIT, (end - now) / NS_PER_S)
            wait = min(wait, max(self.due - now, 0) / NS_PER_S)
            for sample in self.receive(max(wait, 0.0)):
                self.push_sample(sample)
            self.poll(self.clock.now())
            if end is not None and now >= end:
                break
        return self.ready.popleft() if self.ready else None

    def receive(self, timeout: float) -> list[PatchSample]:
        """Return what the device sends; reconnect it where it is gone."""
        now = self.clock.now()
        if not self.is_open:
            if now - self.tried < RETRY_INTERVAL:
                self.clock.sleep(min(timeout, RETRY_INTERVAL / NS_PER_S))
                return []
            self.tried = now
            try:
                self.device.connect()
            except OSError:
                return []
            self.is_open = True
            self.log.log_event(now, "returned", f"{self.uri} is back")
        try:
            samples = self.device.receive(timeout)
            now = self.clock.now()
            last = self.received_at
            self.received_at = now
            if last is not None and now - last > MAX_HELD:
                self.lag = now - last
                self.lag_end = now
            return samples
        except OSError as error:
            self.device.disconnect()
            self.is_open = False
            self.received_at = None
            self.due = self.clock.now()
            text = f"{self.uri} is gone ({error}); plug it in again"
            self.log.log_event(self.clock.now(), "silent", text)
            return []

    def push_sample(self, sample: PatchSample) -> None:
        """Take a sample, unless it is too old."""
        now = self.clock.now()
        patch = sample.patch
        if now - sample.stamp > MAX_HELD:
            self.late += 1
            name = self.skin.patches[patch].id
            text = f"of patch '{name}' arrived too late to be used"
            detail = ""
            if sample.stamp <= self.lag_end:
                text = f"of patch '{name}' lay unread, as this computer was busy"
                detail = f" for {self.lag / NS_PER_S:.1f} s; stop other programs"
                # It sends, though what it sends cannot be used.
                self.note_patch(patch, now)
            self.log.count("late", "sample", text, patch=name, detail=detail)
            return
        oldest = min((one.stamp for one in self.pending.values()), default=sample.stamp)
        if patch in self.pending or sample.stamp - oldest > MAX_SPREAD * self.period:
            self.emit(now)
        self.pending[patch] = sample
        self.note_patch(patch, now)
        if self.sending <= self.pending.keys():
            self.emit(now)

    def note_patch(self, patch: int, now: int) -> None:
        """Note that a patch sends."""
        if patch not in self.sending:
            name = self.skin.patches[patch].id
            known = patch in self.last_received
            kind, text = ("returned", "again") if known else ("appeared", "data")
            self.log.log_event(now, kind, f"patch '{name}' sends {text}", name)
            self.sending.add(patch)
        self.last_received[patch] = now

    def poll(self, now: int) -> None:
        """Note which patches have become silent; emit the scans that are due."""
        for patch in [
            p for p in self.sending if now - self.last_received[p] > self.silence
        ]:
            self.sending.discard(patch)
            name = self.skin.patches[patch].id
            text = f"patch '{name}' no longer sends; check its cable"
            self.log.log_event(now, "silent", text, name)
        if self.pending and self.sending <= self.pending.keys():
            self.emit(now)
        elif now >= self.due:
            self.emit(now)
        if now - self.asked_at >= NS_PER_S:
            self.asked_at = now
            self.count_refused(*self.device.take_refused())
        self.log.flush_counts(now)

    def count_refused(self, refused: int, why: str) -> None:
        """Count what was refused, and note why the last was."""
        if refused:
            text = "could not be read"
            detail = f"; the last: {why}"
            self.log.count("damaged", self.device.noun, text, refused, detail=detail)

    def emit(self, now: int) -> None:
        """Make a scan of the samples that wait; what has none is not received."""
        counts = np.zeros(self.skin.count, np.int32)
        received = np.zeros(self.skin.count, bool)
        shear = (
            np.zeros((self.skin.count, 2), np.int32) if self.skin.has_shear else None
        )
        for patch, sample in self.pending.items():
            taxels = self.taxels[patch]
            counts[taxels] = sample.counts
            received[taxels] = True if sample.received is None else sample.received
            if shear is not None and sample.shear is not None:
                shear[taxels] = sample.shear
        newest = max((one.stamp for one in self.pending.values()), default=now)
        self.last = stamp = max(newest, self.last + 1)
        # While nothing comes, the next scan without data is due one period later.
        self.due = now + (self.silence if self.pending else self.period)
        self.pending.clear()
        self.readings += 1
        q, received = self.pose.read(stamp, received)
        self.ready.append(Scan(stamp, counts, received, q, shear))

    @property
    def ended(self) -> bool:
        """Return whether it was closed and all scans were read."""
        return self.closed and not self.ready

    def take_events(self) -> list[Event]:
        """Return the events since the last call."""
        return self.log.take()

    def take_last_events(self) -> list[Event]:
        """Return the events since the last call, and of what was only counted yet."""
        self.count_refused(*self.device.take_refused())
        self.log.flush_counts(self.clock.now(), at_end=True)
        return self.log.take()

    def counters(self) -> dict[str, int]:
        """Return readings, samples that were too late, and the device's counters."""
        own = {"readings": self.readings - len(self.ready), "late": self.late}
        return {**own, **self.device.counters()}

    def close(self) -> None:
        """Close the device; may be called twice."""
        if not self.closed:
            self.closed = True
            self.readings -= len(self.ready)
            self.ready.clear()
            self.device.close()


def estimate_rate(stamps: Sequence[int]) -> float:
    """Estimate the rate of samples [1/s] by their stamps, to three digits.

    It is the median over all pairs of samples (Theil, 1950; Sen, 1968), on which
    jitter, bursts and a pause have little effect.
    """
    stride = len(stamps) // MAX_RATE_SAMPLES + 1
    times = np.array(stamps[::stride], np.float64)
    if len(times) < 2:
        return DEFAULT_RATE
    i, j = np.triu_indices(len(times), 1)
    period = np.median((times[j] - times[i]) / (j - i)) / stride / NS_PER_S
    return float(f"{1 / min(max(period, 1 / MAX_SCAN_RATE), 10.0):.3g}")
