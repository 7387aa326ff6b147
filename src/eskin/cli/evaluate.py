"""`eskin evaluate`: this command scores a model on clips and on continuous streams."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from eskin.cli.checks import check_picture, tell_cut
from eskin.errors import RecordingError
from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare, track_progress
from eskin.learn.evaluation import Evaluation, evaluate
from eskin.learn.events import (
    EventScore,
    NonGestureTally,
    Tally,
    is_stream,
    score_events,
    trace_recordings,
)
from eskin.learn.events.event_scoring import Delays
from eskin.learn.plots import draw_confusion, draw_reliability
from eskin.model import Model, load_model
from eskin.recording import find_recordings, read_recording


def by_person(people: dict[str, float]) -> dict[str, float]:
    """Each person's score, their mean, spread and least.

    A person who is called like one of these three is `person mean`, say.
    """
    if not people:
        return {}
    values = list(people.values())
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    three = {"mean": float(np.mean(values)), "sd": spread, "worst": min(values)}
    named = {f"person {n}" if n in three else n: v for n, v in people.items()}
    return {name: round(value, 4) for name, value in (named | three).items()}


def event_rows(score: EventScore) -> dict[str, object]:
    """The score of streams as plain values; None where there is nothing to tell."""
    total = score.total
    people = {name: tally.f1 for name, tally in score.per_subject.items()}
    return {
        **tally_row(total),
        "f1_interval": [known(value) for value in score.f1_interval],
        "false_per_hour": known(score.false_per_hour, 2),
        **delay_row(score.all_delays),
        "per_gesture": {
            name: tally_row(tally) | delay_row(score.delays[name])
            for name, tally in score.per_gesture.items()
        },
        "per_subject": by_person(
            {name: f1 for name, f1 in people.items() if not math.isnan(f1)}
        ),
        "simultaneous_f1": known(score.simultaneous.f1),
        "simultaneous": tally_row(score.simultaneous),
        "unknown_abstained": known(1 - score.unknown_total.share),
        "unknown": left_rows(score.unknown),
        "accidents_detected": known(score.accidents.share),
        "accidents": score.accidents.count,
        "none": left_rows(score.none),
        "ece": known(score.reliability.error),
        "confusion": {"names": score.names, "counts": score.confusion.tolist()},
        "events": int(score.confusion[:-1].sum()),
        "hours": round(score.hours, 4),
    }


def tally_row(tally: Tally) -> dict[str, object]:
    """A tally as plain values."""
    return {
        "precision": known(tally.precision),
        "recall": known(tally.recall),
        "f1": known(tally.f1),
        "count": tally.matched + tally.missed,
        "false": tally.false,
    }


def delay_row(delays: Delays) -> dict[str, object]:
    """Delays as plain values [ms]."""
    return {
        "latency_ms_p50": known(1000 * delays.latency(50), 1),
        "latency_ms_p95": known(1000 * delays.latency(95), 1),
        "from_onset_ms_p50": known(1000 * delays.from_onset(50), 1),
        "from_onset_ms_p95": known(1000 * delays.from_onset(95), 1),
    }


def left_rows(left: dict[str, NonGestureTally]) -> dict[str, dict[str, int]]:
    """Events of which no gesture should be said, as plain values."""
    return {
        name: {"count": one.count, "mistaken": one.mistaken}
        for name, one in left.items()
    }


def known(value: float, digits: int = 4) -> float | None:
    """A number that JSON has; None where it is not known."""
    return None if math.isnan(value) else round(value, digits)


def show_events(score: EventScore, console: Console) -> None:
    """Print the score of streams."""
    table = Table("events", "precision", "recall", "F1", "count", "false", "p50", "p95")
    rows = score.per_gesture | {"all": score.total}
    for name, tally in rows.items():
        delays = score.delays.get(name, score.all_delays)
        table.add_row(
            name,
            *(f"{v:.2f}" for v in (tally.precision, tally.recall, tally.f1)),
            *(str(n) for n in (tally.matched + tally.missed, tally.false)),
            *(f"{1000 * delays.latency(p):.0f} ms" for p in (50, 95)),
        )
    console.print(table)
    low, high = score.f1_interval
    accidents, unknown = score.accidents, score.unknown_total
    print(
        f"events: F1 {score.total.f1:.3f} ({low:.3f} to {high:.3f}), "
        f"{score.false_per_hour:.1f} false an hour in {score.hours:.2f} h"
    )
    print(
        f"at once: F1 {score.simultaneous.f1:.3f}; mistaken for a gesture: "
        f"{accidents.mistaken} of {accidents.count} accidental contacts, "
        f"{unknown.mistaken} of {unknown.count} unknown gestures"
    )


CLIP_KEYS = (
    "accuracy",
    "accuracy_interval",
    "macro_f1",
    "per_class",
    "per_subject",
    "ece",
    "instants",
)
"""What is said of clips; None where there are none."""


@dataclass(frozen=True)
class Command:
    """Score a model on labelled recordings.

    Simulated clips are scored one by one, simulated streams by their events, other
    recordings both ways.
    """

    model: tyro.conf.Positional[Path]
    """The model: one that comes with eskin, or a file (.safetensors)."""

    data: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or folders of them."""

    events: Literal["streams", "all", "none"] = "streams"
    """Which recordings are scored by their events; `all` has clips among them."""

    picture: Path | None = None
    """Where to draw the confusions of clips (.png)."""

    reliability: Path | None = None
    """Where to draw how often clips are right, by how sure the model was (.png)."""

    event_picture: Path | None = None
    """Where to draw the confusions of events (.png)."""

    event_reliability: Path | None = None
    """Where to draw how often detections on streams are right, by how sure they were
    (.png)."""

    workers: int | None = None
    """How many processes replay streams; one a core unless given."""


def run(command: Command) -> dict[str, object]:
    """Score, print tables, and draw what is asked for."""
    for picture in pictures_of(command):
        check_picture(picture)
    workers = os.cpu_count() or 1 if command.workers is None else command.workers
    if workers < 1:
        raise ValueError(f"--workers is {workers}; allowed are 1 and above; change it")
    model = load_model(command.model)
    clips, streams = sort_out(find_recordings(command.data), command.events)
    check_pictures(command, clips, streams)
    of_clips: dict[str, object] = {key: None for key in CLIP_KEYS}
    if clips:
        of_clips = score_clips(command, model, clips)
    of_events = score_streams(command, model, streams, workers) if streams else None
    return of_clips | {"events": of_events}


def sort_out(
    paths: Sequence[Path], events: Literal["streams", "all", "none"]
) -> tuple[list[Path], list[Path]]:
    """Recordings to score as clips, and those to score by their events."""
    if not paths:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    clips: list[Path] = []
    streams: list[Path] = []
    for path in paths:
        recording = read_recording(path)
        simulated, stream = recording.metadata.simulated, is_stream(recording)
        known = simulated or bool(recording.labels)
        if not simulated or not stream:
            clips.append(path)
        if events == "all" or (events == "streams" and stream and known):
            streams.append(path)
    if not clips and not streams:
        raise RecordingError(
            "all recordings given are streams, which --events none leaves out; leave "
            "that away, or give clips"
        )
    return clips, streams


def pictures_of(command: Command) -> list[Path]:
    """Every picture that is asked for."""
    of_clips = command.picture, command.reliability
    of_events = command.event_picture, command.event_reliability
    return [picture for picture in (*of_clips, *of_events) if picture is not None]


def check_pictures(
    command: Command, clips: Sequence[Path], streams: Sequence[Path]
) -> None:
    """Refuse pictures of what is not there."""
    for picture, things, name in (
        (command.picture, clips, "clips"),
        (command.reliability, clips, "clips"),
        (command.event_picture, streams, "streams"),
        (command.event_reliability, streams, "streams"),
    ):
        if picture is not None and not things:
            raise RecordingError(
                f"no {name} among the recordings to draw {picture} of; give some, or "
                "leave the picture out"
            )


def score_clips(
    command: Command, model: Model, paths: Sequence[Path]
) -> dict[str, object]:
    """Score recordings gesture by gesture."""
    dataset = prepare(paths, model.card.pipeline, model.card.graph_used)
    tell_cut(dataset)
    result = evaluate(to_network(model), model.card, dataset)
    show(result)
    if command.picture is not None:
        draw_confusion(
            result.segments.confusion,
            model.card.vocabulary,
            command.picture,
            f"{result.segments.confusion.sum()} gestures, "
            f"{result.segments.accuracy:.1%} right",
        )
    if command.reliability is not None:
        title = f"{result.reliability.count.sum()} gestures"
        draw_reliability(result.reliability, command.reliability, title)
    return {
        "accuracy": round(result.segments.accuracy, 4),
        "accuracy_interval": [round(value, 4) for value in result.interval],
        "macro_f1": round(result.segments.macro_f1, 4),
        "per_class": result.segments.per_class,
        "per_subject": by_person(result.per_subject),
        "ece": round(result.ece, 4),
        "instants": result.instants
        and {
            "accuracy": round(result.instants.accuracy, 4),
            "macro_f1": round(result.instants.macro_f1, 4),
        },
    }


def score_streams(
    command: Command, model: Model, paths: Sequence[Path], workers: int
) -> dict[str, object]:
    """Score recordings by their events, with what the recogniser says live."""
    takes = []
    for stream in track_progress(
        trace_recordings(paths, model, workers), "Replaying", len(paths)
    ):
        if stream.truncated:
            print(f"{stream.path} is cut or damaged: used up to there")
        takes.append(stream.decide())
    score = score_events(takes, model.card.vocabulary)
    show_events(score, Console())
    draw(command, score)
    return event_rows(score)


def draw(command: Command, score: EventScore) -> None:
    """Draw what is asked for of streams."""
    if command.event_picture is not None:
        title = f"{score.confusion[:-1].sum()} events, F1 {score.total.f1:.3f}"
        draw_confusion(score.confusion, score.names, command.event_picture, title)
    if command.event_reliability is not None:
        title = f"{score.reliability.count.sum()} detections"
        draw_reliability(score.reliability, command.event_reliability, title)


def show(result: Evaluation) -> None:
    """Print the scores."""
    table = Table("gesture", "precision", "recall", "F1", "count")
    for name, row in result.segments.per_class.items():
        if row["count"]:
            table.add_row(
                name,
                *(f"{row[k]:.2f}" for k in ("precision", "recall", "f1")),
                f"{row['count']:g}",
            )
    console = Console()
    console.print(table)
    low, high = result.interval
    print(
        f"segments: accuracy {result.segments.accuracy:.3f} "
        f"({low:.3f} to {high:.3f}), macro F1 {result.segments.macro_f1:.3f}, "
        f"ECE {result.ece:.3f}"
    )
    if result.instants is not None:
        print(
            f"instants: accuracy {result.instants.accuracy:.3f}, "
            f"macro F1 {result.instants.macro_f1:.3f}"
        )
    people = Table("person", "accuracy")
    for name, value in by_person(result.per_subject).items():
        people.add_row(name, f"{value:.3f}")
    console.print(people)
