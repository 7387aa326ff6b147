"""Choose the confidence that each action of the command map needs, from data.

    python -m lab.command_thresholds --traces traces.jsonl
    python -m lab.command_thresholds --read traces.jsonl

Simulated people touch an arm at work, as in `eskin demo --headless`, on builds and with
people of no set. Of every tracked touch the probabilities at each reading are kept, the
detection, the simulated touch that caused it, and whether it is evidence enough; one
that is not is obeyed by a stop alone. For each action of the default map the command
adds up, for every threshold, what it would have cost: `COSTS` states the cost of a
touch that asks for the action and does not get it, and of another touch or an accident
that gets it. Of unasked commands few are seen, so their upper limit counts (95 %, of a
Poisson law). The threshold of least cost is chosen; of equal ones the
lowest for a stop, and the highest for all else. So are the probability from which a
moving arm stands for a possible stop, and how long a touch lasts at least that makes
the arm do more; of equal ones the lowest. The chosen figures belong into
`MIN_CONFIDENCE` and `SUSPEND_CONFIDENCE` of `eskin.command.actions`, and into
`PolicyConfig.min_duration`. A last table compares the gestures that could let an arm go
on.
"""

import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import final

import numpy as np
import tyro
from scipy.stats import chi2

from eskin.command import (
    HALTING_ACTIONS,
    REDUCING_ACTIONS,
    STARTING_ACTIONS,
    PolicyConfig,
)
from eskin.command.evidence import EvidenceConfig, EvidenceMonitor
from eskin.errors import ArmError
from eskin.live import UNKNOWN, Detection, load_model
from eskin.recording import NONE
from eskin.sim.demo import (
    CommandScore,
    DemoConfig,
    SimulatedUserConfig,
)
from eskin.sim.demo.headless import run_build
from eskin.sim.sensor import FAMILIES
from eskin.sim.sensor.build import BuildKind
from eskin.stream import Context, Listener, Message, RecognitionState
from eskin.units import NS_PER_S
from lab.tables import format_head, format_row

COSTS = {
    "pause": ("poke", 5.0, 1.0),
    "slow": ("stroke", 1.0, 0.5),
    "close_gripper": ("grab", 1.0, 3.0),
    "next_waypoint": ("double_pat", 1.0, 5.0),
    "normal": ("double_pat", 1.0, 10.0),
    "open_gripper": ("grab", 1.0, 10.0),
    "resume": ("double_pat", 1.0, 20.0),
}
"""Gesture of each action of the default map, cost of a touch that asks for it and does
not get it, and cost of one that gets it and did not ask. A missed command is repeated:
1. A stop that does not come may hurt: 5. A slow arm harms nobody, and one touch makes
it fast again: 0.5. A part that falls costs 10 commands, an arm that starts though
nobody asked costs 20."""

LATEST_STOP = 0.25
"""Time after the onset of a poke from which it costs a missed stop that the arm does
not stand yet [s]."""

WAIT_COST = 0.1
"""Cost of a touch that is no stop and for which the arm stands until it is decided."""

GRID = tuple(np.round(np.arange(0.05, 1.0, 0.01), 2).tolist())
"""Thresholds that are compared."""

DURATIONS = tuple(np.round(np.arange(0.0, 0.41, 0.02), 2).tolist())
"""Least durations that are compared [s]."""


@dataclass(frozen=True)
class Choice:
    """Holds the threshold of an action and what it gives on the traces."""

    action: str
    """Plain action of a rule."""
    gesture: str
    """Gesture that asks for it."""
    threshold: float
    """Threshold of least cost."""
    cost: float
    """That cost."""
    asked: int
    """Number of touches that ask for it."""
    missed: int
    """Number of them that do not get it."""
    others: int
    """Number of other touches and accidents."""
    wrong: int
    """Number of them that get it."""


@dataclass(frozen=True)
class Command:
    """Choose the confidence that each action needs."""

    minutes: float = 72.0
    """Simulated time [min]."""
    builds: tuple[BuildKind, ...] = ("fresh", "shifted", *FAMILIES)
    """Kinds of builds, in turn."""
    build_seconds: float = 120.0
    """Simulated time of one build [s], also of stored traces."""
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
    read: tuple[Path, ...] = ()
    """Paths of stored traces to choose from, without simulating."""


@dataclass
class TouchTrace:
    """Holds what the recogniser said of one tracked touch, and what it was."""

    onset: float
    """Onset of the tracked touch since that of the simulated one [s]."""
    true: str = "none"
    """Gesture that was made; `none` for an accident or a touch that nobody made."""
    cause: int | None = None
    """Number of the simulated touch; None where nobody touched."""
    build: int = 0
    """Seed of the build."""
    works: bool = True
    """Whether the arm was neither paused nor held when it began."""
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
    sound: bool = True
    """Whether it was no fault of the skin, as far as the policy can tell, when it was
    last open."""

    @property
    def duration(self) -> float:
        """Return the time from its onset to its latest contact [s]."""
        return self.end - self.onset

    @property
    def end(self) -> float:
        """Return its latest contact since the onset of the simulated touch [s]."""
        pairs = zip(self.seconds, self.contact, strict=True)
        return max((at for at, contact in pairs if contact), default=self.onset)

    def confidence(self, gesture: str) -> float:
        """Return the highest confidence that the policy would see after detection.

        It is 0 where another gesture or none was detected, and the probability of the
        last reading where the touch was detected as it closed.
        """
        if self.detected != gesture:
            return 0.0
        pairs = zip(self.seconds, self.probabilities, strict=True)
        since = self.detected_at - 1e-6
        last = self.probabilities[-1][gesture]
        return max((p[gesture] for at, p in pairs if at >= since), default=last)

    def settled(self, gesture: str, config: PolicyConfig) -> float:
        """Return the highest such confidence once the touch has ended.

        So does the policy wait where a touch makes the arm do more. It is 0 where the
        touch goes on for too long.
        """
        if self.closing(gesture, config) == 0.0:
            return 0.0
        since, latest, values = self.detected_at - 1e-6, -math.inf, []
        for at, known, contact in zip(
            self.seconds, self.probabilities, self.contact, strict=True
        ):
            latest = at if contact else latest
            if at >= since and at - latest >= config.min_release - 1e-6:
                values.append(known[gesture])
        return max(values, default=self.probabilities[-1][gesture])

    def closing(self, gesture: str, config: PolicyConfig) -> float:
        """Return the confidence as the touch closes; 0 if it goes on for too long."""
        goes_on = self.end - self.detected_at > config.max_delay
        if self.detected != gesture or goes_on:
            return 0.0
        return self.probabilities[-1][gesture]

    def slowing(self, gesture: str) -> float:
        """Return the confidence by which it would slow the arm.

        That needs no detection: the likeliest gesture of an unknown touch suffices.
        """
        last = self.probabilities[-1]
        is_likely = (
            self.detected == UNKNOWN and max(last, key=last.__getitem__) == gesture
        )
        return last[gesture] if is_likely else self.confidence(gesture)

    def final_stop(self, gesture: str) -> float:
        """Return the probability of a stop by which an arm would be paused at the end.

        It is 1 where that gesture was detected, and 0 where another or `none` was.
        """
        if self.detected == gesture:
            return 1.0
        undecided = self.detected in ("", UNKNOWN)
        return self.probabilities[-1][gesture] if undecided else 0.0

    def value(self, action: str, gesture: str) -> float:
        """Return the confidence by which it would command an action."""
        if action in HALTING_ACTIONS:
            return self.final_stop(gesture)
        if not self.sound:
            return 0.0
        if action == "slow":
            return self.slowing(gesture)
        judge = self.closing if action in STARTING_ACTIONS else self.settled
        return judge(gesture, PolicyConfig())

    def first_stop(self, gesture: str, threshold: float) -> float | None:
        """Return when the arm would stand for it [s]; None where it would not.

        The time is from the onset of the simulated touch.
        """
        for at, known, contact in zip(
            self.seconds, self.probabilities, self.contact, strict=True
        ):
            if self.detected and at > self.detected_at:
                return None
            if contact and known[gesture] >= threshold:
                return at
        return None


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
        """Start without evidence."""
        self.evidence = EvidenceMonitor(context.info.skin, EvidenceConfig())

    def on_message(self, item: Message) -> None:
        """Keep the probabilities of a reading, or a detection."""
        if isinstance(item, Detection):
            self.detections.setdefault(item.touch, item)
        elif isinstance(item, RecognitionState):
            self.evidence.update(item)
            for touch in item.state.open:
                trace = self.traces.setdefault(
                    touch.id, TouchTrace(0.0, build=self.build)
                )
                self.onsets.setdefault(touch.id, touch.onset)
                stamp = item.state.reading.stamp
                self.stamps.setdefault(touch.id, []).append(stamp)
                values = item.probabilities[touch.id].round(3).tolist()
                trace.probabilities.append(
                    dict(zip(self.vocabulary, values, strict=True))
                )
                trace.contact.append(touch.last == stamp)
                trace.sound = self.evidence.is_plausible(touch.id)

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
                trace.works = attempt.works
                onset = attempt.begin
                trace.length = ((attempt.end or onset) - onset) / NS_PER_S
            trace.onset = (self.onsets[number] - onset) / NS_PER_S
            trace.seconds = [(at - onset) / NS_PER_S for at in self.stamps[number]]
            detection = self.detections.get(number)
            if detection is not None:
                trace.detected = detection.gesture
                trace.detected_at = (detection.stamp - onset) / NS_PER_S
        return list(self.traces.values())


def collect(plan: tuple[float, DemoConfig, int]) -> list[TouchTrace]:
    """Return the traces of one build; none where its skin is too slow for an arm."""
    seconds, config, seed = plan
    listeners: list[TraceListener] = []
    vocabulary = load_model(config.model).card.vocabulary

    def watch(score: CommandScore) -> list[Listener]:
        listeners.append(TraceListener(score, vocabulary, seed))
        return list(listeners)

    try:
        run_build(seconds, config, seed, watch)
    except ArmError:
        return []
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


def choose(
    action: str,
    gesture: str,
    miss: float,
    wrong: float,
    traces: list[TouchTrace],
    duration: float = 0.0,
) -> Choice:
    """Choose the threshold of an action.

    Args:
        action: plain action of the default map.
        gesture: gesture that asks for it.
        miss: cost of a touch that asks for it and does not get it.
        wrong: cost of another touch that gets it.
        traces: all tracked touches.
        duration: least duration of a touch that makes the arm do more [s].
    """
    stops = action in HALTING_ACTIONS
    least = 0.0 if action in REDUCING_ACTIONS else duration
    used = [trace for trace in traces if trace.works or not stops]
    values = np.array(
        [
            trace.value(action, gesture) * (trace.duration >= least - 1e-6)
            for trace in used
        ]
    )
    asks = np.array([trace.true == gesture for trace in used])
    choices = []
    for threshold in GRID:
        given = values >= threshold
        missed, unasked = int((asks & ~given).sum()), int((~asks & given).sum())
        cost = miss * missed + wrong * float(chi2.ppf(0.95, 2 * unasked + 2) / 2)
        counts = int(asks.sum()), missed, int((~asks).sum()), unasked
        choices.append(Choice(action, gesture, threshold, cost, *counts))
    least = min(choice.cost for choice in choices)
    equal = [choice for choice in choices if choice.cost == least]
    return equal[0] if stops else equal[-1]


def choose_duration(traces: list[TouchTrace]) -> float:
    """Choose how long a touch lasts at least that makes the arm do more [s].

    Each duration is judged by the least costs of all actions that it applies to.
    """
    costs = {
        action: cost for action, cost in COSTS.items() if action not in REDUCING_ACTIONS
    }
    totals = [
        sum(
            choose(action, *cost, traces, duration).cost
            for action, cost in costs.items()
        )
        for duration in DURATIONS
    ]
    return DURATIONS[int(np.argmin(totals))]


def choose_standing(
    gesture: str, miss: float, traces: Iterable[TouchTrace]
) -> tuple[Choice, list[float]]:
    """Choose the probability from which a moving arm stands for a possible stop.

    Args:
        gesture: gesture that stops the arm.
        miss: cost of such a touch for which it does not stand in time.
        traces: all tracked touches.

    Returns:
        The choice, and when the arm stands for the touches that ask for it [s].
    """
    used = [trace for trace in traces if trace.works]
    asks = np.array([trace.true == gesture for trace in used])
    found = []
    for threshold in GRID:
        first = [trace.first_stop(gesture, threshold) for trace in used]
        begun = np.array([math.inf if at is None else at for at in first])
        late = int((asks & (begun > LATEST_STOP)).sum())
        others = int((~asks & np.isfinite(begun)).sum())
        cost = miss * late + WAIT_COST * others
        counts = int(asks.sum()), late, int((~asks).sum()), others
        choice = Choice("stand", gesture, threshold, cost, *counts)
        found.append((choice, begun[asks & np.isfinite(begun)].tolist()))
    return min(found, key=lambda pair: pair[0].cost)


def format_choice(choice: Choice, hours: float) -> str:
    """Format a choice as a row of a table."""
    low, high = compute_wilson(choice.asked - choice.missed, choice.asked)
    got = 1.0 - choice.missed / max(choice.asked, 1)
    return format_row(
        [
            choice.action,
            choice.gesture,
            f"{choice.threshold:.2f}",
            f"{got:.1%} of {choice.asked} ({low:.0%} to {high:.0%})",
            f"{choice.wrong} of {choice.others}",
            f"{choice.wrong / hours:.1f}",
        ]
    )


def compute_wilson(count: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a share after Wilson (1927)."""
    if total == 0:
        return 0.0, 1.0
    z, share = 1.96, count / total
    centre = share + z * z / (2 * total)
    half = z * np.sqrt(share * (1 - share) / total + (z / (2 * total)) ** 2)
    scale = 1 + z * z / total
    return float((centre - half) / scale), float((centre + half) / scale)


HEAD = ["action", "gesture", "confidence", "obeyed", "unasked", "unasked an hour"]


def main() -> None:
    """Print the tables."""
    command = tyro.cli(Command)
    stored = [trace for path in command.read for trace in read_traces(path)]
    traces = stored or collect_all(command)
    if command.traces is not None:
        write_traces(command.traces, traces)
    caused = [trace for trace in traces if trace.cause is not None]
    builds = {trace.build for trace in traces}
    build_seconds = min(command.build_seconds, 60.0 * command.minutes)
    hours = len(builds) * build_seconds / 3600.0
    accidents = sum(trace.true == NONE for trace in caused)
    print(f"{len(caused)} touches, {accidents} of them accidents, in {hours:.2f} hours")
    duration = choose_duration(caused)
    print(f"what makes the arm do more lasts {duration:g} s or longer")
    print(format_head(HEAD))
    for action, cost in COSTS.items():
        print(format_choice(choose(action, *cost, caused, duration), hours))
    gesture, miss, _ = COSTS["pause"]
    standing, delays = choose_standing(gesture, miss, caused)
    print(format_choice(standing, hours))
    print(
        f"an arm at work begins to stop {np.median(delays):.2f} s after the onset of "
        f"a {gesture}, p95 {np.percentile(delays, 95):.2f} s"
    )
    print("gestures that could let an arm go on, by the cost of resume:")
    print(format_head(HEAD))
    for gesture in ("double_pat", "grab", "poke", "stroke"):
        cost = COSTS["resume"][1:]
        choice = choose("resume", gesture, *cost, caused, duration)
        print(format_choice(choice, hours))


if __name__ == "__main__":
    main()
