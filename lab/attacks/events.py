"""Count the events of things and people that start, speed up or send off an arm.

    python -m lab.attacks events                       # about 3,000 events, an hour
    python -m lab.attacks events --events 8 --only bounce grab --keep kept.jsonl
    python -m lab.attacks events --map commands.yaml   # with another command map
    python -m lab.attacks events --kept kept.jsonl --policy.question.window 0.8

Every event meets three arms, each with a policy of its own: one was paused long ago (or
as the event begins, where something swings on after a pause), one works slowly, one at
full speed. The simulated robot stands still in all three. A row has the number of
questions that the three arms have asked, and of events after which the paused arm has
started, the slow one sped up, the working one was made to do more, and was stopped,
even for a moment. `any` counts the events with one of the first three.

What is kept has a line of JSON for each event: what its arms were told, what was
detected, and all that its policies were told. A command goes on where it was
interrupted, by the file that it keeps. `--kept` tells policies of what was kept again,
with other numbers, and simulates nothing.
"""

import json
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

import numpy as np

from eskin.command import ASK, SUSPEND, PolicyConfig
from eskin.command.actions import ADVANCING_ACTIONS
from eskin.live import load_model
from eskin.sim.sensor.build import BuildKind
from lab.attacks.event_draws import World
from lab.attacks.event_people import GESTURES, PEOPLE
from lab.attacks.event_stage import ARMS, Line, Setup, Stage
from lab.attacks.event_streams import MIXES, RANDOM, STREAMS
from lab.attacks.event_things import THINGS
from lab.crosstalk import find_interval
from lab.tables import format_head, format_row

STOPS = ("pause", "hold", SUSPEND)
"""Actions that stop an arm, even for a moment."""
HEAD = ("row", "events", "asked", "started", "sped up", "moved on", "any") + (
    "stopped",
    "detected",
)
Lines = list[Line]
"""Kept records of events."""
Build = tuple[BuildKind, int]
"""Kind and seed of a build."""


@dataclass(frozen=True)
class Group:
    """A group has rows of one kind."""

    worlds: dict[str, World]
    """World of each row."""
    events: int
    """Usual number of events of each row on each kind of builds."""


GROUPS = {
    "single": Group(THINGS | PEOPLE, 10),
    "streams": Group(STREAMS, 6),
    "mixes": Group(MIXES, 20),
    "random": Group(RANDOM, 20),
    "gestures": Group(GESTURES, 4),
}
"""Groups by their names; `random` and `gestures` begin with meant touches."""
WORLDS = {
    row: world for group in GROUPS.values() for row, world in group.worlds.items()
}


@dataclass(frozen=True)
class Command:
    """Count the events that start, speed up or send off an arm."""

    events: int | None = None
    """Number of events of each row on each kind of builds; by default that of its
    group."""
    kinds: tuple[BuildKind, ...] = ("fresh", "shifted", "logarithmic") + (
        "capacitive",
        "linear",
    )
    """Kinds of builds; each row is run on each."""
    builds: int = 4
    """Number of builds of each kind that share the events of a row."""
    only: tuple[str, ...] = ()
    """Parts of the names of rows, or names of groups; by default all."""
    map: Path | None = None
    """Command map: a file, or `paper`; the default one unless given."""
    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""
    policy: PolicyConfig = field(
        default_factory=lambda: PolicyConfig(check_period=None)
    )
    """How careful the policies are."""
    keep: Path | None = None
    """File to which a line of JSON is appended for each event; rows of builds that it
    has are not simulated again."""
    kept: tuple[Path, ...] = ()
    """Such files, of whose events policies are told again; nothing is simulated."""
    seed: int = 40000
    """Seed of the first build of each kind, its events and people."""


def get_build(line: Line) -> Build:
    """Return kind and seed of the build of an event."""
    return line["kind"], line["build"]


def select_rows(command: Command) -> Iterator[tuple[str, World, int]]:
    """Yield name, world and number of events of each row that is wanted."""
    for name, group in GROUPS.items():
        for row, world in group.worlds.items():
            wanted = [part == name or part in row for part in command.only]
            if any(wanted) or not wanted:
                events = group.events if command.events is None else command.events
                yield row, world, events


def does_more(line: Line, arm: str) -> bool:
    """Return whether a touch of an event made an arm do more.

    What the policy does by itself once the skin is sound again does not count.
    """
    return any(
        accepted and gesture and action in ADVANCING_ACTIONS
        for action, gesture, accepted, *_ in line["decided"][arm]
    )


def count_questions(line: Line, arms: Iterable[str] = ARMS) -> int:
    """Return how many questions arms have asked in an event."""
    told = [one for arm in arms for one in line["decided"][arm]]
    return sum(action == ASK and accepted for action, _, accepted, *_ in told)


def is_stopped(line: Line) -> bool:
    """Return whether the working arm was stopped in an event, even for a moment."""
    told = line["decided"]["working"]
    return any(accepted and action in STOPS for action, _, accepted, *_ in told)


def count_told(lines: Lines) -> list[int]:
    """Count the questions, and the events that have told an arm something.

    Returns:
        The number of questions, then of events that have started the paused arm, sped
        up the slow one, made the working one do more, any of these, and stopped it.
    """
    more = np.array([[does_more(line, arm) for arm in ARMS] for line in lines], bool)
    more = more.reshape(-1, len(ARMS))
    return [
        sum(map(count_questions, lines)),
        *more.sum(axis=0).tolist(),
        int(more.any(axis=1).sum()),
        sum(map(is_stopped, lines)),
    ]


def describe_detections(lines: Lines) -> str:
    """Return how often each gesture was detected, with its median confidence."""
    found: dict[str, list[float]] = {}
    for line in lines:
        for gesture, confidence, _ in line["detections"]:
            found.setdefault(gesture, []).append(confidence)
    order = sorted(found, key=lambda one: -len(found[one]))
    return ", ".join(f"{n} {len(found[n])} ({np.median(found[n]):.2f})" for n in order)


def format_share(part: int, whole: int) -> str:
    """Format a share of events with its 95 % interval (Clopper and Pearson 1934)."""
    low, high = find_interval(part, whole)
    return f"{part} ({100 * low:.2f} to {100 * high:.2f} %)"


def format_counts(name: str, lines: Lines, has_intervals: bool) -> str:
    """Format a row of the table."""
    asked, *counts, stopped = count_told(lines)
    whole = len(lines)
    shares = [format_share(n, whole) if has_intervals else str(n) for n in counts]
    said = [] if has_intervals else [describe_detections(lines)]
    return format_row([name, str(whole), str(asked), *shares, str(stopped), *said])


def print_rows(kind: str, lines: Lines) -> None:
    """Print the counts of each row of a kind of builds."""
    for row in WORLDS:
        own = [one for one in lines if one["row"] == row]
        if own:
            print(format_counts(f"{kind}: {row}", own, False), flush=True)


def print_groups(lines: Lines) -> None:
    """Print the counts of each group on all builds, and of each row with a start."""
    print(format_head(HEAD[:-1]))
    for name, group in GROUPS.items():
        own = [one for one in lines if one["row"] in group.worlds]
        if own:
            print(format_counts(f"**{name}**", own, True))
        for row in group.worlds:
            some = [one for one in own if one["row"] == row]
            if any(does_more(line, arm) for line in some for arm in ARMS):
                print(format_counts(row, some, True))
    print_answers(lines)


def print_answers(lines: Lines) -> None:
    """Print how many questions of a paused arm pokes at random have answered."""
    for row in RANDOM:
        own = [one for one in lines if one["row"] == row]
        asked = [one for one in own if count_questions(one, ["paused"])]
        if asked:
            answered = sum(does_more(line, "paused") for line in asked)
            share = format_share(answered, len(asked))
            print(f"{row}: of {len(asked)} questions answered {share}")


def simulate_build(
    command: Command, setup: Setup, build: Build, done: Lines, file: TextIO | None
) -> Lines:
    """Return the lines of a build, those that are done included; keep the others.

    Args:
        command: says which rows.
        setup: model and rules.
        build: kind and seed of the build.
        done: lines that are done.
        file: file to which the others are appended, if any.
    """
    stage = None
    lines: Lines = []
    for row, world, events in select_rows(command):
        own = [one for one in done if (one["row"], *get_build(one)) == (row, *build)]
        if not own:
            kind, seed = build
            stage = stage or Stage(kind, seed, setup)
            share = (events + seed - command.seed) // command.builds
            told = stage.run_row(row, world, share, file is not None)
            own = [{"row": row, "kind": kind, "build": seed} | one for one in told]
            # Rows are kept as a whole, so that none is taken for done before it is.
            if file and own:
                print("\n".join(map(json.dumps, own)), file=file, flush=True)
        lines += own
    return lines


def replay_lines(lines: Lines, setup: Setup) -> Lines:
    """Return lines with what policies decide that are told of their events now."""
    stages: dict[Build, Stage] = {}
    told: Lines = []
    for line in lines:
        build = get_build(line)
        if build not in stages:
            stages[build] = Stage(*build, setup)
        told.append(line | stages[build].replay(line["row"], line["trace"]))
    return told


def read_lines(paths: Iterable[Path]) -> Lines:
    """Read what was kept in files; those that are missing hold nothing."""
    texts = [path.read_text("utf-8").splitlines() for path in paths if path.exists()]
    return [json.loads(line) for text in texts for line in text]


def main(command: Command) -> None:
    """Print how many events of each row and group command an arm."""
    setup = Setup(load_model(command.model), command.map, command.policy)
    print(format_head(HEAD))
    every: Lines = []
    if command.kept:
        wanted = {row for row, *_ in select_rows(command)}
        kept = [one for one in read_lines(command.kept) if one["row"] in wanted]
        for kind in dict.fromkeys(line["kind"] for line in kept):
            lines = replay_lines([one for one in kept if one["kind"] == kind], setup)
            print_rows(kind, lines)
            every += lines
        return print_groups(every)
    done = read_lines([command.keep] if command.keep else [])
    with command.keep.open("a") if command.keep else nullcontext() as file:
        for kind in command.kinds:
            lines = []
            for seed in range(command.seed, command.seed + command.builds):
                lines += simulate_build(command, setup, (kind, seed), done, file)
            print_rows(kind, lines)
            every += lines
    print_groups(every)
