"""Halve and double each number of a question, alone, and see what that costs.

    python -m lab.attacks events --seed 52000 --keep kept.jsonl
    python -m lab.question_numbers kept.jsonl
    python -m lab.question_numbers kept.jsonl --only window --people 2

Policies are told again of the mixes, streams and random touches that were kept, and
people start a paused arm as in `lab.starts`. A row has the share of mixes and streams,
and of questions beside random touches, after which an arm did more; the share of people
who start it at the first try, and the median time from question to motion. The first
row has the numbers as they are.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import tyro

from eskin.command import PolicyConfig, QuestionConfig
from eskin.live import load_model
from eskin.sim.sensor.build import BuildKind
from lab.attacks.event_stage import ARMS, Setup
from lab.attacks.events import GROUPS, does_more, read_lines, replay_lines
from lab.commanded_arm import format_times
from lab.starts import Starter, Try, count_started, measure_times
from lab.tables import format_head, format_row
from lab.touched_arm import KINDS, list_seeds

PLAYED = ("mixes", "streams", "random")
"""Groups of events that are told again."""
HEAD = ("number", "value", *PLAYED, "first try", "question to motion p50 / p95 [s]")


@dataclass(frozen=True)
class Command:
    """Halve and double each number of a question."""

    kept: tyro.conf.Positional[Path]
    """File that `lab.attacks events --keep` has written."""
    only: tuple[str, ...] = ()
    """Names of numbers; by default all."""
    events: int = 4
    """Every so many events are told again."""
    builds: int = 2
    """Number of builds of each kind that people touch."""
    people: int = 6
    """Number of people on each build."""
    kinds: tuple[BuildKind, ...] = KINDS
    """Kinds of builds that people touch."""
    seed: int = 62000
    """Seed of the first build of each kind and its people."""


def vary_numbers(command: Command) -> Iterator[tuple[str, float, QuestionConfig]]:
    """Yield name, value and configuration of each number, halved and doubled."""
    usual = QuestionConfig()
    yield "as they are", 1.0, usual
    for field in fields(QuestionConfig):
        if not command.only or field.name in command.only:
            for factor in (0.5, 2.0):
                value = factor * getattr(usual, field.name)
                yield field.name, value, replace(usual, **{field.name: value})


def count_events(command: Command, config: PolicyConfig) -> list[str]:
    """Return the events of each group after which an arm did more, and all."""
    setup = Setup(load_model("ur5"), None, config)
    found = []
    for name in PLAYED:
        rows = GROUPS[name].worlds
        kept = [one for one in read_lines([command.kept]) if one["row"] in rows]
        told = replay_lines(kept[:: command.events], setup)
        more = sum(any(does_more(line, arm) for arm in ARMS) for line in told)
        found.append(f"{more} of {len(told)}")
    return found


def play_people(command: Command, config: PolicyConfig) -> list[list[Try]]:
    """Return the tries of each person."""
    people: list[list[Try]] = []
    for kind in command.kinds:
        for seed in list_seeds(kind, command.seed, command.builds):
            people += Starter(kind, seed, config).run(command.people)
    return people


def main(args: list[str] | None = None) -> None:
    """Print the table."""
    command = tyro.cli(Command, args=args)
    print(format_head(HEAD), flush=True)
    for name, value, question in vary_numbers(command):
        config = PolicyConfig(question=question, check_period=None)
        counts = count_events(command, config)
        people = play_people(command, config)
        tries = [one for own in people for one in own]
        first = f"{count_started(people, 1)} of {len(people)}"
        times = format_times(measure_times(tries, "asked"))
        print(format_row([name, f"{value:g}", *counts, first, times]), flush=True)


if __name__ == "__main__":
    main()
