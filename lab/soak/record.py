"""Measure the cost of recording."""

import tempfile
import time
from pathlib import Path

from eskin.recording import Metadata
from eskin.stream import Recorder, Stream
from lab.soak.scans import idle_source


def record_line(seconds: float, rate: float) -> str:
    """Record the idle ur5 skin in real time and format the result.

    Args:
        seconds: duration [s].
        rate: rate of the scans [1/s].
    """
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder) / "a.mcap", Metadata("soak"))
        source = idle_source(rate, round(seconds * rate))
        busy, start = time.process_time(), time.perf_counter()
        with Stream(source, [recorder]) as stream:
            stream.wait()
        wall, busy = time.perf_counter() - start, time.process_time() - busy
        count = stream.queue_counts()["recorder"]
        size = sum(path.stat().st_size for path in recorder.pieces.files)
    sync = recorder.sync
    return (
        f"{count.taken} scans in {wall:.1f} s, {count.dropped} dropped, at most "
        f"{count.longest} waiting; {60 * size / 1e6 / wall:.1f} MB a minute; share of "
        f"a core {busy / wall:.1%}; chunk to disk p50 {1e3 * sync.quantile(0.5):.1f} "
        f"ms, p99 {1e3 * sync.quantile(0.99):.1f} ms, longest {1e3 * sync.longest:.1f} "
        "ms"
    )
