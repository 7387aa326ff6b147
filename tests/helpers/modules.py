"""Skin modules whose counts tell when they were taken, and what assembles them."""

from collections import deque
from dataclasses import dataclass

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
    encode_packet,
)
from helpers.touch import SECOND, START, build_grid_skin

MS = SECOND // 1000
ROWS = 2
COLUMNS = 3
PATCHES = 3
TAXELS = ROWS * COLUMNS
SKIN = build_grid_skin(ROWS, COLUMNS, PATCHES)


def make_counts(taken, address, taxels=TAXELS):
    """Return counts that tell when they were taken [0.1 ms since START], and where."""
    tick = (taken - START) // (MS // 10)
    counts = (tick * 31 + np.arange(taxels) * 7 + address * 1000) & 0xFFFF
    counts[:2] = tick & 0xFFFF, tick >> 16
    return counts.astype(np.uint16)


@dataclass
class Module:
    """A patch's electronics, with a clock and scan numbers of its own."""

    address: int = 0
    serial: int = 1
    rate: int = 50
    boot: int = START
    drift: float = 0.0
    taxels: int = TAXELS
    shape: tuple[int, int] = (ROWS, COLUMNS)
    clock_start: int = 0
    scan: int = 0

    def device_time(self, now):
        """Return its clock [us], modulo 2**32."""
        elapsed = (now - self.boot) * (1 + self.drift) / 1000
        return (self.clock_start + round(elapsed)) % 2**32

    def hello(self, now):
        numbers = self.address, self.scan % 2**16, self.device_time(now)
        return Hello(
            *numbers, *self.shape, self.taxels, self.rate, self.serial, "test 1"
        )

    def data(self, now, parts=1):
        """Return the packets of one scan."""
        self.scan += 1
        counts = make_counts(now, self.address, self.taxels)
        numbers = self.address, self.scan % 2**16, self.device_time(now)
        return [
            Data(*numbers, int(places[0]), counts[places])
            for places in np.array_split(np.arange(self.taxels), parts)
        ]

    def reboot(self, now):
        self.boot = now
        self.clock_start = 0
        self.scan = 0

    def stream(self, begin, end, port="a", delay=0.001, phase=0.0, parts=1):
        """Return what arrives from begin to end [s]: a hello a second, and scans."""
        arrivals = []
        lag = round(delay * SECOND)
        first = START + round(begin * SECOND)
        for n in range(round((end - begin) * self.rate)):
            taken = first + round((n + phase) * SECOND / self.rate)
            packets = [self.hello(taken)] if n % self.rate == 0 else []
            packets += self.data(taken, parts)
            arrivals += [(taken + lag, port, packet) for packet in packets]
        return arrivals


def stream_all(begin, end, parts=1, **options):
    """Return what arrives of all patches, each with a phase and a clock of its own."""
    return [
        arrival
        for n in range(PATCHES)
        for arrival in Module(
            n, serial=10 + n, boot=START - 7 * SECOND * n, **options
        ).stream(begin, end, phase=0.3 * n, parts=parts)
    ]


def encode_arrivals(arrivals):
    return [(when, port, encode_packet(packet)) for when, port, packet in arrivals]


class AssemblerRun:
    """An assembler on a clock of its own, and everything that it gave."""

    def __init__(self, skin=SKIN, rate=50.0):
        self.log = EventLog()
        self.assembler = Assembler(skin, FixedJoints(np.zeros(0)), self.log)
        self.assembler.start(START, float(rate))
        self.period = round(SECOND / rate)
        self.scans = []
        self.events = []
        self.pushed = 0
        self.now = START

    def play(self, arrivals, until):
        """Let packets arrive and time pass until then [s]."""
        for arrived, port, packet in sorted(arrivals, key=lambda item: item[0]):
            self.wait(arrived)
            self.push_packet(packet, arrived, port)
            self.poll(arrived)
        self.wait(START + round(until * SECOND))
        return self

    def push_packet(self, packet, arrived, port):
        self.assembler.push_packet(packet, arrived, port)
        self.pushed += 1

    def wait(self, time):
        while (deadline := self.assembler.next_deadline()) <= time:
            self.poll(deadline)
        self.poll(time)

    def poll(self, now):
        assert now >= self.now
        self.now = now
        self.scans += self.assembler.poll(now)
        self.events += self.log.take()

    @property
    def counts(self):
        """How many packets had which outcome."""
        return self.assembler.outcomes.counts

    def kinds(self, *unwanted):
        return [event.kind for event in self.events if event.kind not in unwanted]

    def find_events(self, kind):
        return [event for event in self.events if event.kind == kind]

    def received(self, address, begin=0.0, end=1e9):
        """Return in which share of the scans between two times [s] a patch is."""
        return np.mean(
            [
                scan.received[address * TAXELS]
                for scan in self.scans
                if begin * SECOND <= scan.stamp - START < end * SECOND
            ]
        )

    def check(self, slack=0.003):
        """Check the laws that always hold; return when received scans were taken."""
        assert sum(self.counts.values()) == self.pushed
        assert min(self.counts.values()) >= 0
        return check_scans(self.scans, self.period, slack)


def check_scans(scans, period, slack=0.003):
    """Check that no scan is old or given twice; return when they were taken.

    A scan may have been taken by `slack` [s] later than its period [ns].
    """
    times = {address: [] for address in range(PATCHES)}
    for scan in scans:
        for address, known in times.items():
            part = slice(address * TAXELS, (address + 1) * TAXELS)
            received = scan.received[part]
            assert received.all() == received.any()
            if received[0]:
                counts = scan.counts[part]
                taken = START + int(counts[0] + (counts[1] << 16)) * MS // 10
                assert counts.tolist() == make_counts(taken, address).tolist()
                assert -0.25 * period - MS <= taken - scan.stamp
                assert taken - scan.stamp <= 1.25 * period + slack * SECOND
                assert not known or taken > known[-1]
                known.append(taken)
    assert (np.diff([scan.stamp for scan in scans]) > 0).all()
    return times


class ScriptedTransport(Transport):
    """Brings what arrives at given times, on a clock that it advances itself."""

    def __init__(self, clock: ManualClock, arrivals):
        self.clock = clock
        self.coming = deque(sorted(arrivals, key=lambda item: item[0]))
        self.closed = 0
        self.sent = []

    def read(self, timeout: float) -> list[ReceivedPacket]:
        end = self.clock.now() + round(timeout * SECOND)
        if self.coming and self.coming[0][0] <= end:
            end = max(self.coming[0][0], self.clock.now())
        self.clock.sleep((end - self.clock.now()) / SECOND)
        now = self.clock.now()
        packets = []
        while self.coming and self.coming[0][0] <= now:
            _, port, data = self.coming.popleft()
            packets.append(ReceivedPacket(port, now, data))
        return packets

    def send(self, port: str, packet: bytes) -> None:
        self.sent.append((port, packet))

    def take_events(self, now: int) -> list:
        return []

    def counters(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        self.closed += 1
