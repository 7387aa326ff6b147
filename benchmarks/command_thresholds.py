"""Choose the confidence that each action of the command map needs, from data.

    python -m benchmarks.command_thresholds --minutes 10 --traces traces.jsonl
    python -m benchmarks.command_thresholds --read traces.jsonl

Simulated people touch an arm at work, as in `eskin demo --headless`, on builds and with
people of no set. Of every tracked touch the probabilities at each reading are kept, the
detection, and the simulated touch that caused it. For each action of the default map
the command prints what every threshold would have cost: `MISS` for a touch that asks
for the action and does not get it, `WRONG` for another touch or accident that gets it.
The threshold with the least cost is chosen; of equal ones the lowest for a stop and the
highest for all else. A last table compares the gestures that could let the arm go on.
The chosen figures belong into `MIN_CONFIDENCE` of `eskin.command.actions`.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import final

import numpy as np
import tyro

from benchmarks.tables import format_head, format_row
from eskin.demo import CommandScore, DemoConfig, SimulatedUserConfig
from eskin.demo.headless import run_build
from eskin.live import Detection
from eskin.model import load_model
from eskin.sim.sensor.build import BuildKind
from eskin.stream import Context, Listener, Message, RecognitionState
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class Command:
    """Choose the confidence that each action needs."""

    minutes: float = 10.0
    """Simulated time [min]."""
    builds: tuple[BuildKind, ...] = ("fresh", "shifted")
    """Kinds of builds, in turn."""
    build_seconds: float = 120.0
    """Simulated time of one build [s]."""
    pause: tuple[float, float] = (0.6, 0.8)
    """Shortest and longest time from one touch to the next [s]."""
    seed: int = 7000
    """Seed of the first build and its people; the demo's own seeds are below 1000."""
    workers: int = 1
    """Number of processes."""
    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""
    traces: Path | None = None
    """Path of a file to store the traces in."""
    read: Path | None = None
    """Path of stored traces to choose from, without simulating."""


@dataclass
class TouchTrace:
    """Holds what the recogniser said of one tracked touch, and what it was."""

    true: str = "none"
    """Gesture that was made; `none` for an accident or a touch that nobody made."""
    cause: int | None = None
    """Number of the simulated touch; None where nobody touched."""
    build: int = 0
    """Seed of the build."""
    seconds: list[float] = field(default_factory=list)
    """Time of each reading since the onset of the simulated touch [s]."""
    probabilities: list[dict[str, float]] = field(default_factory=list)
    """Probability of each class at each reading."""
    contact: list[bool] = field(default_factory=list)
    """Whether the touch is in contact at each reading."""
    detected: str = ""
    """Gesture that was detected; empty where none was."""
    detected_at: float = 0.0
    """Time of the detection since the onset of the simulated touch [s]."""
    length: float = 0.0
    """Duration of the simulated touch [s]."""

    def highest(self, gesture: str, since: float = -np.inf) -> float:
        """Return the highest probability of a gesture from a time [s] on."""
        return max(
            (
                each.get(gesture, 0.0)
                for seconds, each in zip(self.seconds, self.probabilities, strict=True)
                if seconds >= since
            ),
            default=0.0,
        )

    def confidence(self, gesture: str) -> float:
        """Return the confidence that the policy would see: 0 without a detection."""
        if self.detected != gesture:
            return 0.0
        return self.highest(gesture, self.detected_at - 1e-6)


@final
class TraceListener(Listener):
    """Keeps the probabilities of each tracked touch."""

    name = "traces"
    message_types = (RecognitionState, Detection)
    size = 1
    drop = "never"

    def __init__(
        self, score: CommandScore, vocabulary: tuple[str, ...], build: int
    ) -> None:
        """Start without touches."""
        self.score, self.vocabulary, self.build = score, vocabulary, build
        self.onsets: dict[int, int] = {}
        self.stamps: dict[int, list[int]] = {}
        self.traces: dict[int, TouchTrace] = {}
        self.detections: dict[int, Detection] = {}

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Keep the probabilities of a reading, or a detection."""
        if isinstance(item, Detection):
            self.detections.setdefault(item.touch, item)
        elif isinstance(item, RecognitionState):
            for touch in item.state.open:
                trace = self.traces.setdefault(touch.id, TouchTrace(build=self.build))
                self.onsets.setdefault(touch.id, touch.onset)
                stamp = item.state.reading.stamp
                self.stamps.setdefault(touch.id, []).append(stamp)
                values = item.probabilities[touch.id].round(3).tolist()
                trace.probabilities.append(
                    dict(zip(self.vocabulary, values, strict=True))
                )
                trace.contact.append(touch.last == stamp)

    def close(self) -> None:
        """Do nothing."""

    def finish(self) -> list[TouchTrace]:
        """Return the traces, each with the simulated touch that caused it."""
        attempts = {
            attempt.number: attempt
            for attempt in (*self.score.attempts, *self.score.accidents)
        }
        for number, trace in self.traces.items():
            cause = self.score.causes.find(number)
            attempt = None if cause is None else attempts.get(cause)
            onset = self.onsets[number]
            if attempt is not None:
                trace.true, trace.cause = attempt.gesture, attempt.number
                onset = attempt.begin
                trace.length = ((attempt.end or onset) - onset) / NS_PER_S
            trace.seconds = [(at - onset) / NS_PER_S for at in self.stamps[number]]
            detection = self.detections.get(number)
            if detection is not None:
                trace.detected = detection.gesture
                trace.detected_at = (detection.stamp - onset) / NS_PER_S
        return list(self.traces.values())


def collect(plan: tuple[float, DemoConfig, int]) -> list[TouchTrace]:
    """Return the traces of one build."""
    seconds, config, seed = plan
    listeners: list[TraceListener] = []
    vocabulary = load_model(config.model).card.vocabulary

    def watch(score: CommandScore) -> list[Listener]:
        listeners.append(TraceListener(score, vocabulary, seed))
        return list(listeners)

    run_build(seconds, config, seed, watch)
    return listeners[0].finish()


def collect_all(command: Command) -> list[TouchTrace]:
    """Return the traces of all builds."""
    count = round(60.0 * command.minutes / command.build_seconds) or 1
    plans = []
    for number in range(count):
        config = DemoConfig(
            model=command.model,
            build_kind=command.builds[number % len(command.builds)],
            user=SimulatedUserConfig(pause=command.pause),
        )
        seconds = min(command.build_seconds, 60.0 * command.minutes)
        plans.append((seconds, config, command.seed + number))
    with get_context("spawn").Pool(command.workers) as pool:
        parts = pool.imap_unordered(collect, plans)
        return [trace for part in parts for trace in part]


def write_traces(path: Path, traces: Iterable[TouchTrace]) -> None:
    """Write traces as one JSON object a line."""
    path.write_text("".join(json.dumps(asdict(trace)) + "\n" for trace in traces))


def read_traces(path: Path) -> list[TouchTrace]:
    """Read traces that `write_traces` has written."""
    return [TouchTrace(**json.loads(line)) for line in path.read_text().splitlines()]


def main() -> None:
    """Print the tables."""
    command = tyro.cli(Command)
    traces = read_traces(command.read) if command.read else collect_all(command)
    if command.traces is not None:
        write_traces(command.traces, traces)
    print(format_head(["true", "tracked touches"]))
    for true in sorted({trace.true for trace in traces}):
        count = sum(trace.true == true for trace in traces)
        print(format_row([true, str(count)]))


if __name__ == "__main__":
    main()
