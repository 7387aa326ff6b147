"""Evaluate the weights that come with eskin on simulated people they have not seen.

python -m lab.recogniser [PART] --sets FOLDER, where PART is clips, streams,
skins, pairs, all (of these), or final: the final sets, which are to be opened only when
nothing is chosen any more. Sets that are missing in FOLDER are generated there (about
8 GB for all); prepared recordings are kept in FOLDER/pack. The command prints the
tables of docs/results.md.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from eskin.learn.checkpoint import to_network
from eskin.learn.commands.evaluate import describe_near_words
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import Evaluation, score_dataset
from eskin.learn.events import (
    EventScore,
    ScoredStream,
    score_events,
    trace_recordings,
)
from eskin.live import Model, load_model
from eskin.recording import find_recordings, read_recording
from eskin.sim.dataset.sets import FINAL_SETS, PAIR_SIDES
from lab.simulated_sets import made_set
from lab.tables import format_head, format_row

Part = Literal["clips", "streams", "skins", "pairs", "final", "all"]

TESTS = ("test-s", "test-p", "test-x", "test-m")
STREAMS = ("streams-fresh", "streams", "quiet", "accidents")
FINAL_STREAMS = (
    *(f"final-{name}" for name in STREAMS),
    "final-streams-families",
)
FINAL_CLIPS = tuple(name for name in FINAL_SETS if name not in FINAL_STREAMS)
SKINS = ("ur5-half", "ur5-double", "ur5-shapes", "ur5-missing", "ur10", "base")


@dataclass(frozen=True)
class Command:
    """Evaluate a model on the simulated test sets."""

    part: tyro.conf.Positional[Part] = "all"
    """Tables to print."""
    sets: Path = Path("sets")
    """Folder of the sets."""
    model: Path = Path("ur5")
    """Name of weights that come with eskin, or a model file."""
    clips: int | None = None
    """Number of clips of each test set, or streams of each set; all unless given."""
    only: tuple[str, ...] = ()
    """Sets or skins to evaluate; all unless given."""
    seed: int = 0
    """Random seed of the sets; final sets are drawn anew for new weights."""
    workers: int = os.cpu_count() or 1
    """Number of processes that prepare and replay."""


def main() -> None:
    """Print the chosen tables."""
    command = tyro.cli(Command)
    for name, table in PARTS.items():
        if command.part == name or (command.part == "all" and table is not final):
            print(table(command), flush=True)


def clips(command: Command) -> str:
    """Evaluate the four test sets."""
    return evaluate_clip_sets(command, TESTS)


def final(command: Command) -> str:
    """Evaluate the final sets."""
    tables = (
        evaluate_clip_sets(command, FINAL_CLIPS),
        evaluate_stream_sets(command, FINAL_STREAMS),
    )
    return "\n\n".join(tables)


def evaluate_clip_sets(command: Command, names: Sequence[str]) -> str:
    """Evaluate the chosen ones of sets of clips."""
    rows = [format_clip_head("set", load_model(command.model))]
    for name in choose_names(command, names):
        found = evaluate_clips(command, find_set(command, name))
        rows.append(format_clip_row(name, found))
    return "\n".join(rows)


def skins(command: Command) -> str:
    """Evaluate other skins and robots, beside the skin of training."""
    rows = [format_clip_head("skin", load_model(command.model))]
    for skin in choose_names(command, ("ur5", *SKINS)):
        rows.append(
            format_clip_row(
                skin, evaluate_clips(command, find_set(command, "test-p", skin))
            )
        )
    return "\n".join(rows)


def pairs(command: Command) -> str:
    """Evaluate pairs of clips with the same counts: each side, and their mean."""
    folder = find_set(command, "pairs")
    heads = ("kind", "accuracy, first side", "accuracy, second side", "accuracy")
    rows = [format_head(heads)]
    for kind, sides in PAIR_SIDES.items():
        shares = [evaluate_clips(command, folder / s).segments.accuracy for s in sides]
        cells = (f"{share:.1%}" for share in (*shares, np.mean(shares)))
        rows.append(format_row([kind, *cells]))
    return "\n".join(rows)


def streams(command: Command) -> str:
    """Evaluate events of continuous streams."""
    return evaluate_stream_sets(command, STREAMS)


def evaluate_stream_sets(command: Command, names: Sequence[str]) -> str:
    """Evaluate events of the chosen ones of sets of streams."""
    rows = [format_head(STREAM_HEADS)]
    near_words = []
    vocabulary = load_model(command.model).card.vocabulary
    for name in choose_names(command, names):
        by_family = replay_streams(command, find_set(command, name))
        parts = {name: [*chain(*by_family.values())]}
        if len(by_family) > 1:
            some = sorted(by_family.items())
            parts |= {f"{name}, {family}": streams for family, streams in some}
        for part, streams in parts.items():
            score = score_events(streams, vocabulary)
            rows.append(format_stream_row(part, score))
            kinds = describe_near_words(score.near_words)
            near_words.append(f"near-words taken for a gesture, {part}: {kinds}")
    return "\n".join([*rows, "", *near_words])


def choose_names(command: Command, names: Sequence[str]) -> list[str]:
    """Return the names that are chosen by `--only`."""
    return [name for name in names if not command.only or name in command.only]


def find_set(command: Command, name: str, skin: str = "ur5") -> Path:
    """Return the folder of a set, and generate it if it is missing."""
    return made_set(
        command.sets,
        name,
        skin=skin,
        clips=command.clips,
        seed=command.seed,
        workers=command.workers,
    )


def evaluate_clips(command: Command, folder: Path) -> Evaluation:
    """Evaluate the model on a set of clips."""
    model = load_model(command.model)
    dataset = prepare(
        find_recordings([folder]),
        model.card.pipeline,
        model.card.graph_used,
        command.sets / "pack",
        command.workers,
    )
    return score_dataset(to_network(model), model.card, dataset)


def replay_streams(command: Command, folder: Path) -> dict[str, list[ScoredStream]]:
    """Return the detections of a set of streams, by the family of their sensors."""
    model = load_model(command.model)
    paths = find_recordings([folder])
    by_family: dict[str, list[ScoredStream]] = {}
    for stream in trace_recordings(paths, model, command.workers):
        family = read_recording(stream.path).metadata.notes.get("family", "")
        by_family.setdefault(family, []).append(stream.decide())
    return by_family


def format_clip_head(first: str, model: Model) -> str:
    """Format the head of a table of clips."""
    heads = (first, "clips", "accuracy (95 % interval)", "people: SD, worst")
    return format_head([*heads, *model.card.vocabulary, "ECE"])


def format_clip_row(name: str, found: Evaluation) -> str:
    """Format a row of a table of clips, with the recall of each class."""
    people = list(found.per_subject.values())
    low, high = found.interval
    return format_row(
        [
            name,
            str(found.segments.confusion.sum()),
            f"{found.segments.accuracy:.1%} ({low:.1%}-{high:.1%})",
            f"{np.std(people, ddof=1):.1%}, {min(people):.1%}",
            *(f"{r['recall']:.1%}" for r in found.segments.per_class.values()),
            f"{found.ece:.3f}",
        ]
    )


STREAM_HEADS = (
    "set",
    "hours",
    "gestures",
    "missed",
    "wrong names",
    "accidents/h (95 % interval)",
    "near-words taken",
    "detected twice",
    "F1 (95 % interval)",
    "F1, two touches at once",
    "latency p50",
    "latency p95",
    "accidental contacts detected as gestures",
)
"""Heads of the columns of `format_stream_row`."""


def format_stream_row(name: str, score: EventScore) -> str:
    """Format a row of the table of streams; without gestures some cells are empty."""
    errors = score.total_errors
    near = score.total_near_words
    delays = score.all_delays
    low, high = score.f1_interval
    least, most = errors.accidents_interval
    shares = (f"{errors.missed_share:.1%}", f"{errors.wrong_name_share:.1%}")
    found = (
        f"{score.total.f1:.3f} ({low:.3f}-{high:.3f})",
        f"{score.simultaneous.f1:.3f}",
        *(f"{delays.latency(p):.2f} s" for p in (50, 95)),
    )
    cells = (
        name,
        f"{score.hours:.2f}",
        str(errors.made),
        *(cell if errors.made else "" for cell in shares),
        f"{errors.accidents_per_hour:.2f} ({least:.2f}-{most:.2f})",
        f"{near.mistaken} of {near.count}",
        str(errors.duplicates),
        *(cell if errors.made else "" for cell in found),
        f"{score.accidents.mistaken} of {score.accidents.count}",
    )
    return format_row(cells)


PARTS: dict[str, Callable[[Command], str]] = {
    "clips": clips,
    "streams": streams,
    "skins": skins,
    "pairs": pairs,
    "final": final,
}


if __name__ == "__main__":
    main()
