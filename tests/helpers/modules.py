"""Modules of skin whose counts tell the time at which they were truly taken."""

import numpy as np

from eskin.drivers import (
    Assembler,
    Data,
    EventLog,
    FixedJoints,
    Hello,
    ManualClock,
    ReceivedPacket,
    Transport,
)
from helpers.touch import SECOND, START, build_grid_skin

MS = SECOND // 1000
ROWS, COLUMNS = 2, 3
TAXELS = ROWS * COLUMNS
PATCHES = 3
SKIN = build_grid_skin(ROWS, COLUMNS, PATCHES)
Q = np.zeros(0)


def tagged(true, address, taxels=TAXELS):
    """Counts that say when they were taken [0.1 ms since START], and by whom."""
    tick = (true - START) // (MS // 10)
    rest = (tick * 31 + np.arange(taxels) * 7 + address * 1000) & 0xFFFF
    rest[:2] = tick & 0xFFFF, tick >> 16
    return rest.astype(np.uint16)


class Module:
    """A patch's electronics, with a clock and scan numbers of its own."""

    def __init__(self, address=0, serial=1, rate=50, boot=START, drift=0.0, **more):
        self.address, self.serial, self.rate = address, serial, rate
        self.drift = drift
        self.taxels = more.get("taxels", TAXELS)
        self.shape = more.get("shape", (ROWS, COLUMNS))
        self.start = more.get("start", 0)
        self.scan = more.get("scan", 0)
        self.boot = boot

    def device_time(self, now):
        """Its clock [us], modulo 2**32."""
        elapsed = (now - self.boot) * (1 + self.drift) / 1000
        return (self.start + round(elapsed)) % 2**32

    def hello(self, now):
        return Hello(
            self.address,
            self.scan % 2**16,
            self.device_time(now),
            *self.shape,
            self.taxels,
            self.rate,
            self.serial,
            "test 1",
        )

    def data(self, now, parts=1):
        """The packets of one scan."""
        self.scan += 1
        counts = tagged(now, self.address, self.taxels)
        return [
            Data(
                self.address,
                self.scan % 2**16,
                self.device_time(now),
                int(places[0]),
                counts[places],
            )
            for places in np.array_split(np.arange(self.taxels), parts)
        ]

    def reboot(self, now):
        self.boot, self.start, self.scan = now, 0, 0

    def stream(self, begin, end, port="a", delay=0.001, phase=0.0, parts=1):
        """What arrives while it runs from begin to end [s]: a hello a second, scans."""
        arrivals = []
        lag = round(delay * SECOND)
        first = START + round(begin * SECOND)
        for n in range(round((end - begin) * self.rate)):
            true = first + round((n + phase) * SECOND / self.rate)
            if n % self.rate == 0:
                arrivals.append((true + lag, port, self.hello(true)))
            arrivals += [
                (true + lag, port, packet) for packet in self.data(true, parts)
            ]
        return arrivals


class World:
    """An assembler on a clock of its own, and everything that it gave."""

    def __init__(self, skin=SKIN, rate=50.0, grace=None):
        self.log = EventLog()
        self.assembler = Assembler(skin, FixedJoints(Q), self.log)
        self.assembler.start(START, float(rate), grace)
        self.period = self.assembler.timeline.grid.period
        self.scans, self.events, self.pushed = [], [], 0
        self.now = START

    def play(self, arrivals, until):
        """Let packets arrive and time pass until then [s]."""
        for arrived, port, packet in sorted(arrivals, key=lambda item: item[0]):
            self.wait(arrived)
            self.assembler.push(packet, arrived, port)
            self.pushed += 1
            self.poll(arrived)
        self.wait(START + round(until * SECOND))
        return self

    def wait(self, time):
        while self.assembler.next_deadline() <= time:
            self.poll(self.assembler.next_deadline())
        self.poll(time)

    def poll(self, now):
        assert now >= self.now
        self.now = now
        self.scans += self.assembler.poll(now)
        self.events += self.log.take()

    @property
    def counts(self):
        return self.assembler.outcomes.counts

    def kinds(self, *unwanted):
        return [event.kind for event in self.events if event.kind not in unwanted]

    def said(self, kind):
        return [event for event in self.events if event.kind == kind]

    def received(self, address, begin=0.0, end=1e9):
        """Which scans between two times [s] have a patch."""
        return [
            bool(scan.received[address * TAXELS])
            for scan in self.scans
            if begin * SECOND <= scan.stamp - START < end * SECOND
        ]


def true_times(scans, period, slack=0.003):
    """True times of all that was received; each within its period, each only once."""
    times = {address: [] for address in range(PATCHES)}
    for scan in scans:
        for address, known in times.items():
            part = slice(address * TAXELS, (address + 1) * TAXELS)
            got = scan.received[part]
            assert got.all() or not got.any()
            if got.any():
                counts = scan.counts[part]
                true = START + int(counts[0] + (counts[1] << 16)) * MS // 10
                np.testing.assert_array_equal(counts, tagged(true, address))
                assert -0.25 * period - MS <= true - scan.stamp
                assert true - scan.stamp <= 1.25 * period + slack * SECOND
                assert not known or true > known[-1]
                known.append(true)
    assert (np.diff([scan.stamp for scan in scans]) > 0).all()
    return times


def check(world, slack=0.003):
    """The laws that hold whatever comes; true times of what was received."""
    assert sum(world.counts.values()) == world.pushed
    assert min(world.counts.values()) >= 0
    return true_times(world.scans, world.period, slack)


class Script(Transport):
    """Brings what arrives at given times, on a clock that waits for nobody."""

    def __init__(self, clock: ManualClock, arrivals):
        self.clock = clock
        self.coming = sorted(arrivals, key=lambda item: item[0])
        self.closed = 0

    def read(self, timeout: float) -> list[ReceivedPacket]:
        end = self.clock.now() + round(timeout * SECOND)
        if self.coming and self.coming[0][0] <= end:
            end = max(self.coming[0][0], self.clock.now())
        self.clock.sleep((end - self.clock.now()) / SECOND)
        now = self.clock.now()
        there = [item for item in self.coming if item[0] <= now]
        self.coming = self.coming[len(there) :]
        return [ReceivedPacket(port, now, data) for _, port, data in there]

    def take_events(self, now: int) -> list:
        return []

    def counters(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        self.closed += 1
