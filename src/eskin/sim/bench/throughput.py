"""This module measures the sustained throughput from packets to detections.

The skin runs in a process of its own.
"""

import gc
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float

from eskin.drivers import (
    DeviceSource,
    HostClock,
    JointSource,
    SerialTransport,
    UdpTransport,
)
from eskin.live import Recognizer, load_model, warm_up
from eskin.robot import load_robot
from eskin.sim.bench.sender import build_sender_calibration
from eskin.skin import MountedSkin, load_skin
from eskin.stream import DurationHistogram, Recognition, Stream, short_switch_interval

TransportKind = Literal["udp", "serial"]

SKIN = "ur5"
SETTLE_S = 3.0
"""Warm-up time, until every patch is accepted and every taxel is tared [s]."""
DROPPED_PACKETS = ("late", "superseded", "incomplete", "damaged", "foreign", "held")
"""Outcomes of packets that do not become part of a reading."""
SEARCH_RUN_S = 3.0
"""Duration of each run that searches for the limit [s]."""
HALVINGS = 4
"""Number of bisection steps of the search."""
MAX_RATE = 10_000.0
"""Greatest rate of the search [1/s]."""


@dataclass(frozen=True)
class ThroughputConfig:
    """Receive a skin's bytes at a rate, recognise every reading, and count the drops.

    Another process simulates the ur5's skin: touches come and go, and the arm swings.
    """

    rate: float = 1000.0
    """Rate of the scans [1/s]."""
    seconds: float = 60.0
    """Duration of the measurement [s]."""
    over: Literal["udp", "serial", "both"] = "both"
    """Transport of the packets: UDP on loopback, or a pseudo-terminal."""
    find_limit: bool = False
    """Also search for the lowest rate at which readings are dropped."""

    def __post_init__(self) -> None:
        """Raise if a number is out of range."""
        if not 1 <= self.rate <= MAX_RATE:
            raise ValueError(f"--rate is {self.rate:g}; allowed are 1 to {MAX_RATE:g}")
        if not 0 < self.seconds < float("inf"):
            raise ValueError(f"--seconds is {self.seconds:g}; allowed are above 0")

    @property
    def transports(self) -> tuple[TransportKind, ...]:
        """Return the transports to measure, in order."""
        return ("udp", "serial") if self.over == "both" else (self.over,)


@dataclass(frozen=True)
class ThroughputResult:
    """Holds the measurement of one transport at one rate."""

    over: TransportKind
    asked_hz: float
    rate_hz: float
    """Rate of whole readings that were recognised [1/s]."""
    dropped: int
    """Number of scans of patches and of readings that were lost, anywhere."""
    cpu: float
    """Share of a core that the receiving process uses."""
    age_ms_p50: float
    """Time from the stamp of a reading until it is recognised [ms]."""
    age_ms_p99: float
    age_ms_max: float
    step_ms_p50: float
    detections: int
    lost: dict[str, int]
    """Numbers of losses, by place."""

    def as_dict(self) -> dict[str, object]:
        """Return the fields as plain rounded values."""
        return {
            key: round(value, 4) if isinstance(value, float) else value
            for key, value in asdict(self).items()
        }


@final
class SwingingJoints(JointSource):
    """Simulates an arm whose joints swing, each at its own rate."""

    def __init__(self, count: int) -> None:
        """Set the number of joints."""
        self.speeds = 0.5 + 0.1 * np.arange(count)

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return the joint positions at a stamp [rad]."""
        return 0.3 * np.sin(stamp * 1e-9 % 1000.0 * self.speeds)


def measure_throughput(
    over: TransportKind, rate: float, seconds: float
) -> ThroughputResult:
    """Receive and recognise for some time, and count dropped scans.

    The first 3 s are not counted; `rate` is in [1/s], `seconds` in [s].
    """
    mounted = MountedSkin(load_skin(SKIN), load_robot(SKIN))
    calibration = build_sender_calibration(mounted.skin.count)
    recognizer = Recognizer(load_model(SKIN), mounted, calibration)
    warm_up(recognizer)
    recognition = Recognition(recognizer)
    clock = HostClock()
    joints = SwingingJoints(len(mounted.robot.joint_names))
    with run_sender(over, rate, clock) as transport:
        source = DeviceSource(transport, mounted, calibration, joints, clock, over)
        gc.collect()
        gc.freeze()
        with short_switch_interval(), Stream(source, [recognition]) as stream:
            stream.wait(SETTLE_S)
            recognition.age = DurationHistogram()
            recognition.step = DurationHistogram()
            first_detections = recognition.detections
            first_counts = count_losses(source, stream)
            busy = time.process_time()
            start = time.perf_counter()
            stream.wait(seconds)
            busy = time.process_time() - busy
            wall = time.perf_counter() - start
            after = count_losses(source, stream)
    gc.unfreeze()
    found = {key: after[key] - first_counts[key] for key in after}
    used = found.pop("used") / len(mounted.skin.patches)
    age = recognition.age
    lost = {key: n for key, n in found.items() if n}
    return ThroughputResult(
        over=over,
        asked_hz=rate,
        rate_hz=(used - lost.get("queue", 0)) / wall,
        dropped=sum(lost.values()),
        cpu=busy / wall,
        age_ms_p50=1e3 * age.quantile(0.5),
        age_ms_p99=1e3 * age.quantile(0.99),
        age_ms_max=1e3 * age.longest,
        step_ms_p50=1e3 * recognition.step.quantile(0.5),
        detections=recognition.detections - first_detections,
        lost=lost,
    )


def count_losses(source: DeviceSource, stream: Stream) -> dict[str, int]:
    """Return the numbers of packets used and of everything that was lost, by place."""
    counts = source.counters()
    queues = sum(queue.dropped for queue in stream.queue_counts().values())
    lost = {key: counts[key] for key in ("used", "lost", "skipped", *DROPPED_PACKETS)}
    return {**lost, "queue": queues}


@contextmanager
def run_sender(
    over: TransportKind, rate: float, clock: HostClock
) -> Iterator[UdpTransport | SerialTransport]:
    """Run a process that sends touches at a rate; yield the transport to receive it."""
    command = [sys.executable, "-m", "eskin.sim.bench.sender", f"{rate}", SKIN]
    with ExitStack() as stack:
        transport = UdpTransport(clock) if over == "udp" else None
        if transport is not None:
            stack.callback(transport.close)
            command.append(str(transport.port))
        child = stack.enter_context(
            subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        )
        stack.callback(child.kill)
        assert child.stdout is not None
        uri = child.stdout.readline().strip()
        if transport is None:
            transport = SerialTransport(clock, [uri.removeprefix("serial:")])
            stack.callback(transport.close)
        yield transport


def find_limit(over: TransportKind, rate: float) -> float:
    """Find the lowest rate at which readings are dropped [1/s]; inf without one.

    The rate is doubled until readings are dropped, then the span is halved. Each run is
    short.
    """
    good = 0.0
    bad = rate
    while not measure_throughput(over, bad, SEARCH_RUN_S).dropped:
        if bad >= MAX_RATE:
            return float("inf")
        good = bad
        bad = min(2.0 * bad, MAX_RATE)
    for _ in range(HALVINGS):
        middle = float(round((good + bad) / 2.0))
        if measure_throughput(over, middle, SEARCH_RUN_S).dropped:
            bad = middle
        else:
            good = middle
    return bad
