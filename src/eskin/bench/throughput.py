"""Bytes of a device to detections, sustained: a skin in one process, eskin in this."""

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

from eskin.bench.sender import calibration_of
from eskin.drivers import (
    DeviceSource,
    HostClock,
    JointSource,
    SerialTransport,
    UdpTransport,
)
from eskin.live import Recognizer, warm_up
from eskin.model import load_model
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from eskin.stream import DurationHistogram, Recognition, Stream, short_switch_interval

Over = Literal["udp", "serial"]

SKIN = "ur5"
SETTLE = 3.0
"""What is not counted: until every patch is believed and every taxel tared [s]."""
PACKETS = ("late", "superseded", "incomplete", "damaged", "foreign", "held")
"""Fates of packets that no reading was made of."""
SHORT = 3.0
"""Of each run that looks for the limit [s]."""
HALVINGS = 4
"""Of the span in which the limit lies."""
HIGHEST = 10_000.0
"""Scans a second beyond which no limit is sought [1/s]."""


@dataclass(frozen=True)
class ThroughputConfig:
    """What is sent, and for how long."""

    rate: float = 1000.0
    """Scans a second."""

    seconds: float = 60.0
    """How long is counted."""

    over: Literal["udp", "serial", "both"] = "both"
    """What carries the packets: UDP on loopback, or a pseudo-terminal."""

    find_limit: bool = False
    """Also look for the rate at which readings are first dropped."""

    def __post_init__(self) -> None:
        """Refuse what cannot be measured."""
        if not 1 <= self.rate <= HIGHEST:
            raise ValueError(
                f"--rate is {self.rate:g}; allowed are 1 to {HIGHEST:g}; change it"
            )
        if not 0 < self.seconds < float("inf"):
            raise ValueError(
                f"--seconds is {self.seconds:g}; allowed are above 0; change it"
            )

    @property
    def transports(self) -> tuple[Over, ...]:
        """One after the other."""
        return ("udp", "serial") if self.over == "both" else (self.over,)


@dataclass(frozen=True)
class Throughput:
    """What came of one transport at one rate."""

    over: Over
    asked_hz: float
    rate_hz: float
    """Whole readings that were recognised in a second."""
    dropped: int
    """Scans of patches and readings that were lost anywhere."""
    cpu: float
    """Share of a core of the receiving process."""
    age_ms_p50: float
    """From the stamp of a reading until all is said of it."""
    age_ms_p99: float
    age_ms_max: float
    step_ms_p50: float
    detections: int
    lost: dict[str, int]
    """What was dropped, by where."""

    def as_dict(self) -> dict[str, object]:
        """As JSON has it."""
        return {
            key: round(value, 4) if isinstance(value, float) else value
            for key, value in asdict(self).items()
        }


@final
class SwingingJoints(JointSource):
    """An arm whose joints swing, each at its own rate."""

    def __init__(self, count: int) -> None:
        """Prepare that many joints."""
        self.speeds = 0.5 + 0.1 * np.arange(count)

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Joint positions [rad]."""
        return 0.3 * np.sin(stamp * 1e-9 % 1000.0 * self.speeds)


def throughput(over: Over, rate: float, seconds: float) -> Throughput:
    """Read, recognise and count for some time.

    Args:
        over: what carries the packets.
        rate: scans a second.
        seconds: how long is counted, after 3 s that are not.
    """
    mounted = MountedSkin(load_skin(SKIN), load_robot(SKIN))
    calibration = calibration_of(mounted.skin.count)
    recognizer = Recognizer(load_model(SKIN), mounted, calibration)
    warm_up(recognizer)
    recognition, clock = Recognition(recognizer), HostClock()
    joints = SwingingJoints(len(mounted.robot.joint_names))
    with sending(over, rate, clock) as transport:
        source = DeviceSource(transport, mounted, calibration, joints, clock, over)
        gc.collect()
        gc.freeze()
        with short_switch_interval(), Stream(source, [recognition]) as stream:
            stream.wait(SETTLE)
            recognition.age, recognition.step = DurationHistogram(), DurationHistogram()
            said, before = recognition.detections, counted(source, stream)
            busy, start = time.process_time(), time.perf_counter()
            stream.wait(seconds)
            busy, wall = time.process_time() - busy, time.perf_counter() - start
            after = counted(source, stream)
    gc.unfreeze()
    found = {key: after[key] - before[key] for key in after}
    used = found.pop("used") / len(mounted.skin.patches)
    age, lost = recognition.age, {key: n for key, n in found.items() if n}
    return Throughput(
        over=over,
        asked_hz=rate,
        rate_hz=(used - lost.get("queue", 0)) / wall,
        dropped=sum(lost.values()),
        cpu=busy / wall,
        age_ms_p50=1e3 * age.quantile(0.5),
        age_ms_p99=1e3 * age.quantile(0.99),
        age_ms_max=1e3 * age.longest,
        step_ms_p50=1e3 * recognition.step.quantile(0.5),
        detections=recognition.detections - said,
        lost=lost,
    )


def counted(source: DeviceSource, stream: Stream) -> dict[str, int]:
    """Packets used, and everything by which readings get lost."""
    counts = source.counters()
    queues = sum(queue.dropped for queue in stream.queue_counts().values())
    lost = {key: counts[key] for key in ("used", "lost", "skipped", *PACKETS)}
    return {**lost, "queue": queues}


@contextmanager
def sending(
    over: Over, rate: float, clock: HostClock
) -> "Iterator[UdpTransport | SerialTransport]":
    """A process that sends touches at a rate, and the transport to hear it by."""
    command = [sys.executable, "-m", "eskin.bench.sender", f"{rate}", SKIN]
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


def find_limit(over: Over, rate: float) -> float:
    """The lowest rate found at which readings are dropped [1/s]; inf without one.

    The rate is doubled until readings are dropped, then the span is halved; each run is
    short.
    """
    good, bad = 0.0, rate
    while not throughput(over, bad, SHORT).dropped:
        if bad >= HIGHEST:
            return float("inf")
        good, bad = bad, min(2.0 * bad, HIGHEST)
    for _ in range(HALVINGS):
        middle = round((good + bad) / 2.0)
        if throughput(over, middle, SHORT).dropped:
            bad = middle
        else:
            good = middle
    return bad
