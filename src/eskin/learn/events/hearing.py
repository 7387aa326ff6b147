"""Traces of many recordings, beside what really happened in them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed, parallel_config

from eskin.errors import RecordingError
from eskin.learn.events.take import Take
from eskin.learn.events.trace import Trace, trace_of
from eskin.learn.events.true_events import TrueEvent, true_events
from eskin.model import DecisionConfig, Model
from eskin.recording import Recording, read_recording
from eskin.units import NS_PER_S

BREAK = 1.0
"""Time without a reading after which another clip begins [s]."""

STREAM = 10.0
"""Time without a break from which a simulated recording is no clip [s]."""


@dataclass(frozen=True, eq=False)
class HeardStream:
    """A recording's trace, and what really happened in it."""

    path: Path
    """The recording."""

    subject: str
    """Who touched, or the session where that is not known."""

    seconds: float
    """From its first reading to its last [s]."""

    truncated: bool
    """Whether its end is missing."""

    events: tuple[TrueEvent, ...]
    """What really happened."""

    trace: Trace
    """What the decider hears."""

    def take(
        self, config: DecisionConfig | None = None, temperature: float | None = None
    ) -> Take:
        """What is said with a decision of one's choice, to be scored."""
        detections = self.trace.detections(config, temperature)
        return Take(self.events, detections, self.seconds, self.subject)


def hear(
    paths: Sequence[Path], model: Model, workers: int = 1
) -> Iterator[HeardStream]:
    """Trace recordings in their order.

    Args:
        paths: the recordings.
        model: what to recognise with.
        workers: processes that share them; 1 works in this one.

    Raises:
        RecordingError: it is not known what happened in one of them.
    """
    count = max(1, min(workers, len(paths)))
    jobs = (delayed(hear_one)(path, model) for path in paths)
    with parallel_config("loky", inner_max_num_threads=1):
        found: Any = Parallel(count, return_as="generator")(jobs)
    yield from found


def hear_one(path: Path, model: Model) -> HeardStream:
    """Trace one recording."""
    recording = read_recording(path)
    if not recording.labels and not recording.metadata.simulated:
        raise RecordingError(
            f"{path} has no labels; scoring needs them; make some with: "
            f"eskin label {path}"
        )
    return HeardStream(
        path=path,
        subject=recording.metadata.subject or recording.metadata.session,
        seconds=(recording.end - recording.start) / NS_PER_S,
        truncated=recording.truncated,
        events=true_events(recording),
        trace=trace_of(recording, model),
    )


def is_stream(recording: Recording) -> bool:
    """Whether a recording shows all that happened in one go.

    A simulated set of clips does not: seconds are missing between its clips.
    """
    if not recording.metadata.simulated:
        return True
    start = last = recording.start
    for scan in recording.scans():
        start = scan.stamp if scan.stamp - last > BREAK * NS_PER_S else start
        last = scan.stamp
        if last - start >= STREAM * NS_PER_S:
            return True
    return False
