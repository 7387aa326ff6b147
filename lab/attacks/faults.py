"""Attack a simulated arm with faults of its skin, which nobody touches.

    python -m lab.attacks faults --minutes 30 --seeds 3

An arm works in its skin, and every fault is simulated in turn. The table has what an
hour of it does: touches that open, detections, questions of the arm, and commands that
are accepted, which nobody gave. An operator releases every hold after one second, and
lets a paused arm go on after five, so that neither hides what would follow.
"""

from collections import Counter
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from typing import final

from eskin.arms import SimulatedArm
from eskin.command import ASK, SUSPEND, Policy, PolicyConfig, load_commands
from eskin.drivers import ManualClock
from eskin.live import Detection, Model, Recognizer, load_model
from eskin.sim.demo.headless import SynchronousStream
from eskin.sim.demo.live_source import LiveSource
from eskin.sim.interactive import InteractiveSkin
from eskin.stream import (
    CommandEvent,
    Context,
    Listener,
    Message,
    Recognition,
    RecognitionState,
)
from eskin.touch import Scan
from eskin.units import NS_PER_S
from lab.attacks.skin_faults import FAULTS, FaultySkin, build_target
from lab.tables import format_head, format_row

HOLD_SECONDS = 1.0
"""Time after which the operator releases a hold [s]."""
PAUSE_SECONDS = 5.0
"""Time after which the operator lets a paused arm go on [s]."""
ACTIONS = (SUSPEND, "pause", "slow", ASK, "resume", "normal", "next_waypoint")
"""Columns of the table for commands; those after `ask` need an answer."""


@dataclass(frozen=True)
class Command:
    """Simulate faults of a skin that nobody touches."""

    minutes: float = 30.0
    """Simulated time of each row and seed [min]."""
    seeds: int = 3
    """Number of seeds of each row, from 0 on."""
    build_minutes: float = 10.0
    """Time after which another build of the skin with its fault is taken [min]."""
    only: tuple[str, ...] = ()
    """Rows to simulate; all unless given."""
    workers: int = 2
    """Number of processes."""


@dataclass
class FaultTally:
    """Counts what happened in a row of the table."""

    seconds: float = 0.0
    """Simulated time [s]."""
    touches: int = 0
    """Number of touches that opened."""
    detections: int = 0
    """Number of detections, of any word."""
    stopped: float = 0.0
    """Time in which the arm was held or paused, or stood for a touch [s]."""
    holds: Counter[str] = field(default_factory=Counter)
    """Causes of holds, in words."""
    commands: Counter[str] = field(default_factory=Counter)
    """Accepted commands of touches."""

    def add_counts(self, other: "FaultTally") -> None:
        """Add the counts of another build."""
        self.seconds += other.seconds
        self.touches += other.touches
        self.detections += other.detections
        self.stopped += other.stopped
        self.holds += other.holds
        self.commands += other.commands

    def rate(self, count: float) -> float:
        """Return a count as so many an hour."""
        return count * 3600.0 / self.seconds


@final
class FaultTallyListener(Listener):
    """Counts touches, detections and commands."""

    name = "tally"
    message_types = (Detection, RecognitionState, CommandEvent)
    size = 1
    drop = "never"

    def __init__(self, tally: FaultTally) -> None:
        """Store the tally to add to."""
        self.tally = tally
        self.newest = 0

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Count a message."""
        if isinstance(item, RecognitionState):
            for row in item.state.rows:
                if row.id > self.newest:
                    self.newest = row.id
                    self.tally.touches += 1
        elif isinstance(item, Detection):
            self.tally.detections += 1
        elif isinstance(item, CommandEvent) and item.accepted:
            if item.action == "hold":
                self.tally.holds[item.reason.cause.words] += 1
            elif item.touch is not None:
                self.tally.commands[item.action] += 1

    def close(self) -> None:
        """Do nothing."""


@final
class Operator:
    """An operator releases a held arm after a time, and lets a paused arm go on."""

    def __init__(self, arm: SimulatedArm, tally: FaultTally) -> None:
        """Start with an arm that works."""
        self.arm = arm
        self.tally = tally
        self.held_since: int | None = None
        self.paused_since: int | None = None
        self.last: int | None = None

    def update(self, now: int) -> None:
        """Look at the arm at a time [ns]."""
        state = self.arm.state()
        held = state.hold_reason is not None
        paused = state.paused
        waits = state.speed_limit == 0.0
        if self.last is not None and (held or paused or waits):
            self.tally.stopped += (now - self.last) / NS_PER_S
        self.last = now
        self.held_since = (self.held_since or now) if held else None
        self.paused_since = (self.paused_since or now) if paused else None
        if self.held_since and now - self.held_since >= HOLD_SECONDS * NS_PER_S:
            self.arm.release()
            self.held_since = None
        if self.paused_since and now - self.paused_since >= PAUSE_SECONDS * NS_PER_S:
            self.arm.resume()
            self.paused_since = None


@dataclass(frozen=True)
class AttackPlan:
    """A plan says which faults are simulated on one build of the skin."""

    faults: tuple[str, ...]
    """Names of the faults, each on a skin and an arm of its own."""
    seconds: float
    """Simulated time [s]."""
    seed: int
    """Seed of the build and of the faults."""


@final
class AttackedArm:
    """An arm at work in a skin with a fault, its policy, and its operator."""

    def __init__(
        self, fault: str, source: LiveSource, model: Model, plan: AttackPlan
    ) -> None:
        """Start the arm and its policy."""
        skin = source.skin
        vocabulary = model.card.vocabulary
        self.tally = FaultTally()
        self.arm = SimulatedArm(clock=source.clock)
        self.operator = Operator(self.arm, self.tally)
        target = build_target(skin.mounted.skin, skin.calibration, plan.seed)
        self.faulty = FaultySkin(fault, target)
        commands = load_commands(None, vocabulary, skin.mounted.skin)
        recognizer = Recognizer(model, skin.mounted, skin.calibration)
        policy = Policy(self.arm, commands, vocabulary, PolicyConfig(check_period=None))
        listeners = [FaultTallyListener(self.tally), Recognition(recognizer), policy]
        self.stream = SynchronousStream(source, listeners)

    def push(self, scan: Scan) -> None:
        """Feel the next scan with the fault, in the pose of this arm."""
        self.operator.update(scan.stamp)
        posed = replace(scan, q=self.arm.q_at(scan.stamp))
        self.stream.publish(self.faulty.corrupt(posed))


def attack(plan: AttackPlan) -> list[FaultTally]:
    """Simulate faults of one build; nobody touches, so one skin serves all."""
    clock = ManualClock(NS_PER_S)
    skin = InteractiveSkin("ur5", plan.seed, loses=False)
    source = LiveSource(skin, SimulatedArm(clock=clock), clock)
    model = load_model("ur5")
    arms = [AttackedArm(fault, source, model, plan) for fault in plan.faults]
    end = clock.now() + round(plan.seconds * NS_PER_S)
    while source.due <= end:
        scan = source.read()
        assert scan is not None
        for arm in arms:
            arm.push(scan)
    for arm in arms:
        arm.stream.close()
        arm.tally.seconds = plan.seconds
    return [arm.tally for arm in arms]


def plan_builds(command: Command, names: list[str]) -> list[AttackPlan]:
    """Plan the builds of all seeds."""
    plans = []
    for number in range(command.seeds):
        left = 60.0 * command.minutes
        build = 0
        while left > 0:
            part = min(left, 60.0 * command.build_minutes)
            seed = 1000 * number + build
            plans.append(AttackPlan(tuple(names), part, seed))
            left = left - part
            build = build + 1
    return plans


def print_attacks(command: Command, names: list[str]) -> None:
    """Print the table of what faults do to an arm that nobody touches."""
    tallies = [FaultTally() for _ in names]
    with get_context("spawn").Pool(command.workers) as pool:
        for parts in pool.imap_unordered(attack, plan_builds(command, names)):
            for tally, part in zip(tallies, parts, strict=True):
                tally.add_counts(part)
            print(f"<!-- {tallies[0].seconds / 60:.0f} min -->", flush=True)
    print(f"{tallies[0].seconds / 3600:.2f} hours a row, counts an hour")
    print(format_head(["fault", "touches", "detections", *ACTIONS, "holds", "works"]))
    for name, tally in zip(names, tallies, strict=True):
        assert set(tally.commands) <= set(ACTIONS), tally.commands
        counts = [tally.touches, tally.detections]
        counts += [tally.commands[action] for action in ACTIONS]
        counts.append(sum(tally.holds.values()))
        cells = [f"{tally.rate(count):,.0f}" for count in counts]
        works = 100.0 * (1.0 - tally.stopped / tally.seconds)
        print(format_row([name, *cells, f"{works:.1f} %"]))
    for name, tally in zip(names, tallies, strict=True):
        for reason, count in tally.holds.most_common(3):
            print(f"<!-- {name}: held {count} times: {reason} -->")


def main(command: Command) -> None:
    """Print a table of the faults."""
    names = [name for name in FAULTS if not command.only or name in command.only]
    print_attacks(command, names)
