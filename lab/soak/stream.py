"""Stream over serial ports for an hour; report memory, threads and losses."""

import os
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from eskin.drivers import (
    Clock,
    DeviceSource,
    HostClock,
    ManualClock,
    SerialTransport,
    Transport,
)
from eskin.live import Recognizer, load_model, warm_up
from eskin.robot import load_robot
from eskin.sim.bench.sender import (
    build_sender_calibration,
    build_touch_counts,
    repeat_scans,
)
from eskin.sim.bench.throughput import (
    SwingingJoints,
    count_losses,
    run_sender,
)
from eskin.sim.virtual import PtyPort, VirtualSkin
from eskin.skin import MountedSkin, load_skin
from eskin.stream import Recognition, Stream
from lab.soak.cable import Cable

RATE = 50.0
PORTS = 3
SETTLED = 0.1
"""Share of the time after which memory is first measured: all buffers are full."""
LOOK = 0.02
"""Interval between checks of the progress [s]."""


@dataclass(frozen=True)
class Soaked:
    """Holds the results of a stream."""

    readings: int
    detections: int
    lost: dict[str, int]
    """Scans, packets and readings lost since the first measurement, by place."""
    memory: tuple[float, float]
    """Resident memory at the first measurement and at the end [MB]."""
    threads: tuple[int, int]
    """Number of threads at the first measurement and at the end."""


def stream_line(seconds: float, real: bool) -> str:
    """Stream for some time and format the result."""
    start = time.monotonic()
    soaked = stream_live(seconds) if real else stream_simulated(seconds)
    wall = time.monotonic() - start
    return (
        f"{seconds:.0f} s of 2112 taxels at {RATE:g} Hz in {wall:.0f} s: "
        f"{soaked.readings} readings, {soaked.detections} detections, lost "
        f"{soaked.lost or 'none'}; memory {soaked.memory[0]:.1f} MB, then "
        f"{soaked.memory[1]:.1f} MB; threads {soaked.threads[0]}, then "
        f"{soaked.threads[1]}"
    )


def stream_simulated(seconds: float) -> Soaked:
    """Stream over pseudo-terminals on a simulated clock, as fast as possible."""
    clock = ManualClock(10**18)
    mounted = mounted_skin()
    with ExitStack() as stack:
        lines = [stack.enter_context(PtyPort()) for _ in range(PORTS)]
        paths = [line.uri.removeprefix("serial:") for line in lines]
        inner = SerialTransport(clock, paths)
        stack.callback(inner.close)
        device = VirtualSkin(mounted.skin, lines, RATE)
        scans = islice(
            repeat_scans(build_touch_counts(mounted), RATE), round(seconds * RATE)
        )
        cable = Cable(inner, device, scans, clock)
        first = SETTLED * seconds * RATE
        return measure_stream(
            cable, clock, lambda: cable.sent >= first, cable.over.is_set
        )


def stream_live(seconds: float) -> Soaked:
    """Stream from a process with a pseudo-terminal, in real time."""
    clock = HostClock()
    with run_sender("serial", RATE, clock) as transport:
        start = time.monotonic()
        return measure_stream(
            transport,
            clock,
            lambda: time.monotonic() >= start + SETTLED * seconds,
            lambda: time.monotonic() >= start + seconds,
        )


def mounted_skin() -> MountedSkin:
    """Return the ur5's skin on its robot."""
    return MountedSkin(load_skin("ur5"), load_robot("ur5"))


def measure_stream(
    transport: Transport,
    clock: Clock,
    is_settled: Callable[[], bool],
    is_over: Callable[[], bool],
) -> Soaked:
    """Recognise the data of a transport, and measure memory and threads twice."""
    mounted = mounted_skin()
    calibration = build_sender_calibration(mounted.skin.count)
    recognizer = Recognizer(load_model("ur5"), mounted, calibration)
    warm_up(recognizer)
    joints = SwingingJoints(len(mounted.robot.joint_names))
    source = DeviceSource(transport, mounted, calibration, joints, clock, "soak:")
    recognition = Recognition(recognizer, drop="never")
    with Stream(source, [recognition]) as stream:
        while not is_settled():
            stream.wait(LOOK)
        memory = measure_memory()
        threads = threading.active_count()
        before = count_losses(source, stream)
        while not is_over():
            stream.wait(LOOK)
        lost = {key: n - before[key] for key, n in count_losses(source, stream).items()}
        after = measure_memory()
        threads_after = threading.active_count()
    # Detections are counted after the stream has closed: only then is its queue empty.
    return Soaked(
        readings=source.counters()["readings"],
        detections=recognition.detections,
        lost={key: n for key, n in lost.items() if n and key != "used"},
        memory=(memory, after),
        threads=(threads, threads_after),
    )


def measure_memory() -> float:
    """Return the resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
