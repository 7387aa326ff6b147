"""Measure how soon an arm is held after the last packet of its skin, or of one patch.

    python -m lab.attacks hold              # played, on a simulated clock
    python -m lab.attacks hold --live       # in real time, over UDP on loopback

Four patches scan at phases of their own. In each trial the packets of all of them or of
one stop at a random moment. The time to the hold is measured from the arrival of the
last packet; live from its sending, by another process. An arm is slowed before it is
held where one patch stops. Live, a recogniser with the shipped weights takes every
reading, and the policy checks the skin on its own thread.
"""

import multiprocessing
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import final

import numpy as np
import tyro

from eskin.command import CommandMap, Policy, Rule
from eskin.drivers import DeviceSource, FixedJoints, HostClock, UdpTransport
from eskin.drivers.packet import DATA
from eskin.live import Recognizer, load_model, warm_up
from eskin.robot import load_robot
from eskin.sim.virtual import (
    UdpPort,
    VirtualPort,
    VirtualSkin,
)
from eskin.skin import MountedSkin
from eskin.stream import Recognition, Stream
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S
from lab.attacks.delay import travel
from lab.attacks.played_line import (
    START,
    HeldArm,
    PlayedLine,
    PlayedPatch,
    build_flat_skin,
    merge_arrivals,
)
from lab.tables import format_head, format_row

PATCHES = 4
RATES = (50.0, 200.0)
LEAD = 1.0
"""Time for which all patches send at least, before a played trial [s]."""
SETTLE = 4.0
"""Time before the first live trial, in which the skin is tared [s]."""
SENDING, STALLED = 0.35, 0.25
"""Times for which patches send and stall in a live trial, at least [s]."""
REST = 200
"""Counts of a taxel at rest."""


def hold_played(rate: float, one: bool, seed: int) -> tuple[float, float]:
    """Return the times from the last packet to the limit and to the hold [s].

    The clock is simulated. The first is the time until the arm is slowed or held.
    """
    rng = np.random.default_rng((seed, 32))
    end = LEAD + rng.uniform(0.0, 0.2)
    errors = rng.uniform(-50e-6, 50e-6, PATCHES)
    patches = [
        PlayedPatch(number, rate, errors[number], rng.uniform())
        for number in range(PATCHES)
    ]
    streams = [
        travel(patch.send(end if number == 0 or not one else end + 1.0, None), rng)
        for number, patch in enumerate(patches)
    ]
    stopped = streams[:1] if one else streams
    last = max(stream[-1].arrived for stream in stopped)
    line = PlayedLine(patches, rate)
    line.check_at += int(rng.uniform(0.0, 0.02) * NS_PER_S)
    arrivals = list(merge_arrivals(*streams))
    line.play([a for a in arrivals if a.arrived <= last], (last - START) / NS_PER_S)
    line.arm.release()
    line.play([a for a in arrivals if a.arrived > last], end + 1.0)
    if line.arm.held_at is None:
        raise TimeoutError("the arm was not held within a second")
    limited = line.arm.limited_at or line.arm.held_at
    return (limited - last) / NS_PER_S, (line.arm.held_at - last) / NS_PER_S


@final
class StallingPort(VirtualPort):
    """Sends nothing during some periods, and notes when it last sent before each.

    Attributes:
        last_sent: time of the last data packet before each stall [ns, monotonic].
    """

    framed = False

    def __init__(self, inner: VirtualPort, stalls: list[tuple[float, float]]) -> None:
        """Stall from and to times since the first packet [s]."""
        super().__init__()
        self.inner = inner
        self.stalls = stalls
        self.began: float | None = None
        self.sent_at = 0
        self.last_sent: list[int] = []

    @property
    def uri(self) -> str:
        """Return the URI of the receiver."""
        return self.inner.uri

    def send(self, chunks: list[bytes]) -> None:
        """Send packets, unless it stalls."""
        now = time.monotonic()
        self.began = now if self.began is None else self.began
        done = len(self.last_sent)
        begin, end = self.stalls[done] if done < len(self.stalls) else (1e9, 1e9)
        if now - self.began >= end:
            self.last_sent.append(self.sent_at)
        elif now - self.began >= begin:
            return
        self.inner.send(chunks)
        if any(chunk[1] == DATA for chunk in chunks):
            self.sent_at = time.monotonic_ns()

    def receive(self) -> list[bytes]:
        """Return the requests of the host."""
        return self.inner.receive()

    def flush(self) -> None:
        """Flush the port."""
        self.inner.flush()

    def unplug(self) -> None:
        """Do nothing."""

    def plug(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Close the port."""
        self.inner.close()


def draw_stalls(trials: int, seed: int) -> list[tuple[float, float]]:
    """Draw when the patches stall, and until when [s]."""
    rng = np.random.default_rng((seed, 33))
    stalls, time_ = [], SETTLE
    for _ in range(trials):
        begin = time_ + SENDING + rng.uniform(0.0, 0.05)
        time_ = begin + STALLED
        stalls.append((begin, time_))
    return stalls


def make_scans(seed: int) -> Iterator[Scan]:
    """Yield scans of an untouched skin without end."""
    rng = np.random.default_rng((seed, 34))
    count = build_flat_skin(PATCHES).count
    while True:
        counts = REST + rng.integers(-2, 3, count).astype(np.int32)
        yield Scan(0, counts, np.ones(count, bool), np.zeros(0))


def send_live(
    pipe: Connection, port: int, rate: float, one: bool, trials: int, seed: int
) -> None:
    """Send a skin that stalls, in a process; then send the times of last packets."""
    stalls = draw_stalls(trials, seed)
    ports = [
        StallingPort(
            UdpPort("127.0.0.1", port), stalls if number == 0 or not one else []
        )
        for number in range(PATCHES)
    ]
    with VirtualSkin(build_flat_skin(PATCHES), ports, rate, seed=seed) as device:
        device.play(make_scans(seed), HostClock(), stalls[-1][1] + 0.5)
    stalled = ports[:1] if one else ports
    pipe.send(
        [max(times) for times in zip(*(p.last_sent for p in stalled), strict=True)]
    )


def hold_live(rate: float, one: bool, trials: int, seed: int) -> list[float]:
    """Return the times from the last packets to the holds in real time [s]."""
    clock = HostClock()
    mounted = MountedSkin(build_flat_skin(PATCHES), load_robot("table"))
    calibration = Calibration.uniform(mounted.skin.count, 4095, 100.0)
    recognizer = Recognizer(load_model("ur5"), mounted, calibration)
    warm_up(recognizer)
    arm = HeldArm(clock)
    rules = CommandMap(commands=[Rule(gesture="poke", action="pause")])
    policy = Policy(arm, rules, recognizer.model.card.vocabulary)
    held: list[int] = []
    with ExitStack() as stack:
        transport = stack.enter_context(UdpTransport(clock))
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        arguments = (theirs, transport.port, rate, one, trials, seed)
        process = context.Process(target=send_live, args=arguments)
        process.start()
        theirs.close()
        source = DeviceSource(
            transport, mounted, calibration, FixedJoints(np.zeros(0)), clock, "live:"
        )
        stack.enter_context(Stream(source, [Recognition(recognizer), policy]))
        well_since = clock.now()
        while process.is_alive() and not ours.poll(0.002):
            now = clock.now()
            with policy.lock:
                problem = policy.monitor.find_problem(now)
                well_since = now if problem else well_since
                if arm.held_at is not None and now - well_since > NS_PER_S // 20:
                    held.append(arm.held_at - clock.offset)
                    arm.release()
        last_sent = ours.recv()
        process.join()
    holds = np.array(held)
    times = []
    for sent in last_sent:
        later = holds[holds > sent]
        if len(later) and later[0] - sent < STALLED * NS_PER_S:
            times.append((later[0] - sent) / NS_PER_S)
    return times


@dataclass(frozen=True)
class Command:
    """Measure how soon an arm is held without packets."""

    trials: int = 200
    """Number of trials of each row."""
    live: bool = False
    """Measure in real time, over UDP on loopback."""
    seed: int = 0
    """Seed of the moments."""


def main(args: list[str] | None = None) -> None:
    """Print a table of the times."""
    command = tyro.cli(Command, args=args)
    print(format_head(["stops", "rate [Hz]", "trials", "p50", "p99", "longest [ms]"]))
    for one in (False, True):
        for rate in RATES:
            if command.live:
                times = hold_live(rate, one, command.trials, command.seed)
            else:
                times = [
                    hold_played(rate, one, 1000 * command.seed + trial)[1]
                    for trial in range(command.trials)
                ]
            figures = [f"{1e3 * np.percentile(times, p):.0f}" for p in (50, 99, 100)]
            name = "one patch" if one else "all patches"
            cells = [name, f"{rate:g}", str(len(times)), *figures]
            print(format_row(cells), flush=True)


if __name__ == "__main__":
    main()
