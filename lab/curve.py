"""Draw the operating curve of weights: missed gestures by accidents an hour.

python -m lab.curve --sets FOLDER [--clips N] [--picture FILE]: streams of each sensor
family: skins at work, untouched (`quiet`) ones and those touched by accident. Sets that
are missing in FOLDER are generated there. The probability that a gesture needs moves;
what is shipped is marked. A table a family tells accidents by kind of stream, and the
misses at 0.5 and 5 accidents an hour.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from eskin.cli.checks import Range
from eskin.learn.commands.evaluate import POINT_HEADS, describe_missed, format_point
from eskin.learn.events import (
    CurvePoint,
    ScoredStream,
    TracedStream,
    draw_curves,
    measure_curve,
    trace_recordings,
)
from eskin.live import DecisionConfig, load_model
from eskin.recording import find_recordings, read_recording
from lab.program import run_program
from lab.simulated_sets import made_set
from lab.tables import format_head, format_row

SETS = ("streams-families", "quiet-families", "accidents-families")
"""Skins at work, whose gestures count as missed; untouched and bumped ones."""


@dataclass(frozen=True)
class Command:
    """Draw the operating curve of weights on simulated streams, by sensor family."""

    sets: Path = Path("sets")
    """Folder of the sets."""
    model: Path = Path("ur5")
    """Name of weights that come with eskin, or a model file."""
    clips: Annotated[int | None, Range(1)] = None
    """Number of streams of each set; all unless given."""
    seed: int = 0
    """Random seed of the sets."""
    workers: Annotated[int, Range(1)] = os.cpu_count() or 1
    """Number of processes."""
    picture: Path | None = None
    """Path of the curves (.png)."""


def run(command: Command) -> dict[str, object]:
    """Print the tables, and draw the curves of all sets together."""
    model = load_model(command.model)
    decision = model.card.decision
    vocabulary = model.card.vocabulary
    traced = {name: trace_set(command, name) for name in SETS}
    families = sorted({family for found in traced.values() for family in found})
    curves: dict[str, list[CurvePoint]] = {}
    for family in families:
        parts = {
            name: measure_curve(
                partial(decide, found.get(family, ())), decision, vocabulary
            )
            for name, found in traced.items()
            if found.get(family)
        }
        every = [
            stream for found in traced.values() for stream in found.get(family, ())
        ]
        curves[family] = measure_curve(partial(decide, every), decision, vocabulary)
        print(format_family(family, curves[family], parts), flush=True)
    if command.picture is not None:
        draw_curves(curves, command.picture, "at work, untouched and bumped")
    return {
        family: [[p.threshold, p.accidents_per_hour, p.missed] for p in points]
        for family, points in curves.items()
    }


def trace_set(command: Command, name: str) -> dict[str, list[TracedStream]]:
    """Return the traces of a set of streams, by the family of their sensors."""
    folder = made_set(
        command.sets,
        name,
        skin="ur5",
        clips=command.clips,
        seed=command.seed,
        workers=command.workers,
    )
    found: dict[str, list[TracedStream]] = {}
    paths = find_recordings([folder])
    model = load_model(command.model)
    for stream in trace_recordings(paths, model, command.workers):
        notes = read_recording(stream.path).metadata.notes
        found.setdefault(notes.get("family", "one"), []).append(stream)
    return found


def decide(
    streams: Sequence[TracedStream], decision: DecisionConfig
) -> list[ScoredStream]:
    """Return streams with the detections of settings."""
    return [stream.decide(decision) for stream in streams]


def format_family(
    family: str, points: Sequence[CurvePoint], parts: dict[str, list[CurvePoint]]
) -> str:
    """Format the table of a family."""
    heads = [*POINT_HEADS, *(f"accidents/h, {name}" for name in parts), ""]
    rows = [f"\n{family}", format_head(heads)]
    for number, point in enumerate(points):
        each = [f"{part[number].accidents_per_hour:.2f}" for part in parts.values()]
        mark = "shipped" * point.is_shipped
        rows.append(format_row([*format_point(point), *each, mark]))
    rows.append(f"\n{describe_missed(points)}")
    return "\n".join(rows)


if __name__ == "__main__":
    raise SystemExit(run_program(run))
