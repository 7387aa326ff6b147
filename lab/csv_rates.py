"""Read matrices that send lines at many rates, and print what becomes of the lines.

    python -m lab.csv_rates

The driver and the source are those of `csv:` addresses; time is simulated.
"""

import math
import sys
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np

from eskin.drivers import (
    FixedJoints,
    ManualClock,
    PatchSample,
    SampleDevice,
    SampledSource,
)
from eskin.drivers.csv_lines import LineForm
from eskin.drivers.csv_matrix import MAX_WAIT, MatrixLine
from eskin.robot import load_robot
from eskin.skin import (
    MountedSkin,
    Patch,
    Plane,
    Skin,
    TaxelGrid,
    build_skin,
)
from eskin.touch import Calibration
from eskin.units import NS_PER_S
from lab.program import run_program
from lab.tables import format_head, format_row

RATES = (2, 5, 8, 10, 12, 15, 20, 25, 33, 50, 100, 200, 500, 1000)
WAYS = ("steady", "jitter", "bursts", "repeats")
JITTER = 0.3
BURST = 0.16
"""Largest relative change of an interval; time between two bursts [s]."""
MIN_SCANS = 50
MIN_SECONDS = 4.0
"""Each run lasts for a number of scans and a time [s], about a third to open."""
SLACK = 0.05
"""Delay that is allowed beyond one period [s]."""


def build_pad() -> Skin:
    """Build one patch of 64 taxels on a table."""
    patch = Patch("pad", "table", 1, 8, 8)
    grid = TaxelGrid(8, 8, 0.01, 0.01)
    return build_skin("pad", [(patch, grid, Plane(np.eye(4)))])


@final
class Schedule:
    """When each line is made, and when it arrives, since the device began [s]."""

    def __init__(self, rate: float, way: str, seed: int) -> None:
        """Draw the times of a device of some rate of scans [1/s]."""
        seconds = MIN_SECONDS + MIN_SCANS / rate
        rng = np.random.default_rng(seed)
        change = JITTER * rng.uniform(-1, 1, round(seconds * rate))
        steps = (1 + change * (way == "jitter")) / rate
        self.made = np.cumsum(steps)
        if way == "repeats":
            self.made = self.made.repeat(2)
        self.arrived = self.made + 1e-4
        if way == "bursts":
            self.arrived = np.ceil(self.made / BURST) * BURST
        self.rate = rate * (1 + (way == "repeats"))

    def line(self, number: int) -> bytes:
        """Return a line: its number in the first two counts, then constant counts."""
        counts = [number % 1000, number // 1000, *range(300, 362)]
        return ",".join(map(str, counts)).encode() + b"\n"


@final
class ScheduledMatrix(SampleDevice):
    """Sends the lines of a schedule to the driver, in simulated time."""

    def __init__(self, clock: ManualClock, skin: Skin, schedule: Schedule) -> None:
        """Begin now."""
        self.clock = clock
        self.schedule = schedule
        self.next = 0
        self.line = MatrixLine(LineForm("simulated"), skin, 0)
        self.times = clock.now() + (schedule.arrived * NS_PER_S).astype(np.int64)
        self.line.deframer.push_chunk(b"\n")

    def connect(self) -> None:
        """Begin with an empty port."""
        self.line.begin(self.clock.now())

    def receive(self, timeout: float) -> list[PatchSample]:
        """Wait for the next bytes and return their samples."""
        now = self.clock.now()
        times = self.times
        due = times[self.next] if self.next < len(times) else now + NS_PER_S
        self.clock.sleep(min(timeout, MAX_WAIT, max(0, due - now) / NS_PER_S))
        now = self.clock.now()
        last = int(np.searchsorted(times, now, "right"))
        if last == self.next:
            self.line.empty_at = now
            return []
        numbers = range(self.next, last)
        self.next = last
        chunk = b"".join(map(self.schedule.line, numbers))
        return self.line.push_lines(self.line.deframer.push_chunk(chunk), now)

    def disconnect(self) -> None:
        """Do nothing."""

    def counters(self) -> dict[str, int]:
        """Return the counters of the driver."""
        return {"bytes": self.line.deframer.bytes, **self.line.counts}


@dataclass(frozen=True)
class Outcome:
    """What became of the lines that arrived after the source was opened."""

    sent: int
    """Number of lines."""
    used: int
    """Number of lines that became scans."""
    empty: int
    """Number of scans without data."""
    rate: float
    """Announced rate, relative to that of the lines."""
    delay: float
    """95th percentile of the time from arrival to scan [s]."""
    error: float
    """95th percentile of the difference of stamp and time of making [s]."""
    limit: float
    """Largest delay that is allowed [s]."""

    @property
    def is_right(self) -> bool:
        """Whether all lines are used, in time, and the rate is within a tenth."""
        all_used = self.sent == self.used and not self.empty
        in_time = max(self.delay, self.error) <= self.limit
        return all_used and in_time and abs(self.rate - 1) <= 0.1


def measure_simulated(rate: float, way: str, seed: int) -> Outcome:
    """Read a device from its opening to its last line."""
    skin = build_pad()
    clock = ManualClock()
    schedule = Schedule(rate, way, seed)
    begun = clock.now()
    device = ScheduledMatrix(clock, skin, schedule)
    mounted = MountedSkin(skin, load_robot("table"))
    calibration = Calibration.uniform(skin.count, 4095, 100.0)
    joints = FixedJoints(np.zeros(0))
    arrived = begun / NS_PER_S + schedule.arrived
    numbers = []
    ages = []
    errors = []
    empty = 0
    end = arrived[-1] - 0.5 * SLACK
    with SampledSource(device, mounted, calibration, joints, clock, "csv:pad") as read:
        opened = clock.now() / NS_PER_S
        last = int(np.searchsorted(arrived, end - 1e-3, "right")) - 1
        while not numbers or numbers[-1] < last:
            scan = read.read(1.0)
            if scan is None or not scan.received.any():
                empty += 1
                if clock.now() / NS_PER_S > end + 1:
                    break
                continue
            number = int(scan.counts[0]) + 1000 * int(scan.counts[1])
            numbers.append(number)
            ages.append(clock.now() / NS_PER_S - arrived[number])
            made = begun / NS_PER_S + schedule.made[number]
            errors.append(abs(scan.stamp / NS_PER_S - made))
        rate = read.info.rate
    first = int(np.searchsorted(arrived, opened + 1e-6, "right"))
    used = {number for number in numbers if first <= number <= last}
    return Outcome(
        last - first + 1,
        len(used),
        empty,
        rate / schedule.rate,
        percentile(ages),
        percentile(errors),
        1 / schedule.rate + SLACK,
    )


def percentile(values: list[float]) -> float:
    """Return the 95th percentile; infinite without values."""
    return float(np.percentile(values, 95)) if values else math.inf


@dataclass(frozen=True)
class CsvRatesCommand:
    """Read matrices at many rates."""

    rates: tuple[int, ...] = RATES
    """Rates of scans [1/s]."""
    seeds: int = 5
    """Number of draws of each; the worst is printed."""


def run(command: CsvRatesCommand) -> dict[str, object]:
    """Print the table."""
    names = ("1/s", "way", "used", "sent", "empty", "rate", "delay p95", "stamp p95")
    print(format_head((*names, "limit", "right")))
    wrong = 0
    for rate, way in product(command.rates, WAYS):
        draws = [measure_simulated(rate, way, seed) for seed in range(command.seeds)]
        sent, used, empty = (
            sum(getattr(found, name) for found in draws)
            for name in ("sent", "used", "empty")
        )
        told = max((found.rate for found in draws), key=lambda told: abs(told - 1))
        times = (
            max(getattr(found, name) for found in draws)
            for name in ("delay", "error", "limit")
        )
        delay, error, limit = (f"{1e3 * time:.1f} ms" for time in times)
        right = sum(found.is_right for found in draws)
        wrong += len(draws) - right
        cells = (rate, way, used, sent, empty, f"{told:.3f}", delay, error, limit)
        print(format_row([*map(str, cells), f"{right}/{len(draws)}"]), flush=True)
    return {"wrong": wrong}


if __name__ == "__main__":
    sys.exit(run_program(run))
