"""`eskin evaluate` scores a model on clips and on continuous streams."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from eskin.cli.checks import Range, check_picture, load_overrides
from eskin.errors import RecordingError
from eskin.learn.dataset import prepare
from eskin.learn.events import (
    RATES,
    CurvePoint,
    ErrorCount,
    EventScore,
    NonGestureTally,
    Tally,
    TracedStream,
    draw_curves,
    interpolate_missed,
    is_stream,
    measure_curve,
    score_events,
    trace_recordings,
)
from eskin.learn.events.event_scoring import Delays
from eskin.live import Model, load_model
from eskin.progress import track_progress
from eskin.recording import find_recordings, read_recording
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.learn.evaluation import Evaluation


def summarise_people(people: dict[str, float]) -> dict[str, float]:
    """Return each person's score with mean, standard deviation and worst score.

    A person named like one of these three becomes, for example, `person mean`.
    """
    if not people:
        return {}
    values = list(people.values())
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    summary = {"mean": float(np.mean(values)), "sd": spread, "worst": min(values)}
    named = {f"person {n}" if n in summary else n: v for n, v in people.items()}
    return {name: round(value, 4) for name, value in (named | summary).items()}


def build_event_result(score: EventScore) -> dict[str, object]:
    """Return the score of streams as plain values; None for undefined ones."""
    total = score.total
    people = {name: tally.f1 for name, tally in score.per_subject.items()}
    return {
        **build_tally_row(total),
        "f1_interval": [round_or_none(value) for value in score.f1_interval],
        "false_per_hour": round_or_none(score.false_per_hour, 2),
        **build_delay_row(score.all_delays),
        "per_gesture": {
            name: build_tally_row(tally) | build_delay_row(score.delays[name])
            for name, tally in score.per_gesture.items()
        },
        "per_subject": summarise_people(
            {name: f1 for name, f1 in people.items() if not math.isnan(f1)}
        ),
        "simultaneous_f1": round_or_none(score.simultaneous.f1),
        "simultaneous": build_tally_row(score.simultaneous),
        "unknown_abstained": round_or_none(1 - score.unknown_total.share),
        "unknown": build_non_gesture_rows(score.unknown),
        "accidents_detected": round_or_none(score.accidents.share),
        "accidents": score.accidents.count,
        "none": build_non_gesture_rows(score.none),
        "errors": build_error_row(score.total_errors),
        "near_words": build_non_gesture_rows(score.near_words),
        "ece": round_or_none(score.reliability.error),
        "confusion": {"names": score.names, "counts": score.confusion.tolist()},
        "events": int(score.confusion[:-1].sum()),
        "hours": round(score.hours, 4),
    }


def build_error_row(errors: ErrorCount) -> dict[str, object]:
    """Return the errors of streams as plain values."""
    return {
        "made": errors.made,
        "found": errors.found,
        "missed": errors.missed,
        "wrong_names": errors.wrong_names,
        "accidents": errors.accidents,
        "accidents_per_hour": round_or_none(errors.accidents_per_hour, 2),
        "accidents_interval": [round_or_none(v, 2) for v in errors.accidents_interval],
        "near_words": errors.near_words,
        "duplicates": errors.duplicates,
        "no_errors": errors.no_errors,
    }


def build_tally_row(tally: Tally) -> dict[str, object]:
    """Return a tally as plain values."""
    return {
        "precision": round_or_none(tally.precision),
        "recall": round_or_none(tally.recall),
        "f1": round_or_none(tally.f1),
        "count": tally.matched + tally.missed,
        "false": tally.false,
    }


def build_delay_row(delays: Delays) -> dict[str, object]:
    """Return delays as plain values [ms]."""
    return {
        "latency_ms_p50": round_or_none(1000 * delays.latency(50), 1),
        "latency_ms_p95": round_or_none(1000 * delays.latency(95), 1),
        "from_onset_ms_p50": round_or_none(1000 * delays.from_onset(50), 1),
        "from_onset_ms_p95": round_or_none(1000 * delays.from_onset(95), 1),
    }


def build_non_gesture_rows(
    left: dict[str, NonGestureTally],
) -> dict[str, dict[str, int]]:
    """Return the counts of events that are no gesture as plain values."""
    return {
        name: {"count": one.count, "mistaken": one.mistaken}
        for name, one in left.items()
    }


def round_or_none(value: float, digits: int = 4) -> float | None:
    """Round a number; return None for NaN, which JSON does not have."""
    return None if math.isnan(value) else round(value, digits)


def print_event_score(score: EventScore, console: Console) -> None:
    """Print the score of streams."""
    table = Table("events", "precision", "recall", "F1", "count", "false", "p50", "p95")
    rows = score.per_gesture | {"all": score.total}
    for name, tally in rows.items():
        delays = score.delays.get(name, score.all_delays)
        table.add_row(
            name,
            *(describe(v, ".2f") for v in (tally.precision, tally.recall, tally.f1)),
            *(str(n) for n in (tally.matched + tally.missed, tally.false)),
            *(describe_delay(delays.latency(p)) for p in (50, 95)),
        )
    console.print(table)
    print("p50, p95: time from the end of the touch until it was recognised")
    print(describe_errors(score.total_errors))
    print(f"near-words taken for a gesture: {describe_near_words(score.near_words)}")
    print(
        f"events: F1 {describe(score.total.f1)} "
        f"{describe_interval(*score.f1_interval)}; "
        f"at once: F1 {describe(score.simultaneous.f1)}; accidental contacts "
        f"detected: {score.accidents.mistaken} of {score.accidents.count}"
    )


def describe_errors(errors: ErrorCount) -> str:
    """Return the errors of streams as two lines of text."""
    rate = errors.accidents_per_hour
    low, high = errors.accidents_interval
    return (
        f"{format_count(errors.made, 'gesture')} made: {errors.found} found, "
        f"{errors.missed} missed, {errors.wrong_names} called another one\n"
        f"accidents, detected without a touch on purpose: {describe(rate, '.2f')} an "
        f"hour ({describe(low, '.2f')} to {describe(high, '.2f')}) in "
        f"{errors.hours:.2f} h; {errors.duplicates} detected twice"
    )


def describe_near_words(near_words: dict[str, NonGestureTally]) -> str:
    """Return the near-words that were detected as a gesture, by kind, as text."""
    kinds = []
    for kind, tally in near_words.items():
        low, high = tally.interval
        share = f"{tally.share:.0%} ({low:.0%} to {high:.0%})"
        kinds.append(f"{kind} {tally.mistaken} of {tally.count}, {share}")
    return "; ".join(kinds) or "none was made"


def describe(value: float, form: str = ".3f") -> str:
    """Return a number as text; `-` where there is none."""
    return "-" if math.isnan(value) else f"{value:{form}}"


def describe_delay(seconds: float) -> str:
    """Return how long after the end of a touch it was recognised, or before it."""
    if math.isnan(seconds):
        return "-"
    return f"{abs(1000 * seconds):.0f} ms{' before' if seconds < 0 else ''}"


def describe_interval(low: float, high: float) -> str:
    """Return a confidence interval as text, unless too few examples gave none."""
    if math.isnan(low) or low == high:
        return "(too few examples, or all alike, for an interval)"
    return f"({low:.3f} to {high:.3f})"


CLIP_KEYS = (
    "accuracy",
    "accuracy_interval",
    "macro_f1",
    "per_class",
    "per_subject",
    "ece",
    "instants",
)
"""Keys of the result for clips; their values are None without clips."""


@dataclass(frozen=True)
class EvaluateCommand:
    """Score a model on labelled recordings.

    Simulated clips are scored one by one and simulated streams by their events. Other
    recordings are scored both ways.
    """

    model: tyro.conf.Positional[Path]
    """Name of weights that come with eskin, or a model file (.safetensors)."""

    data: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or folders of them."""

    events: Literal["streams", "all", "none"] = "streams"
    """Recordings that are scored by their events; `all` includes clips."""

    picture: Path | None = None
    """Path of a plot of the confusion matrix of clips (.png)."""

    reliability: Path | None = None
    """Path of a reliability diagram of clips: accuracy by confidence (.png)."""

    event_picture: Path | None = None
    """Path of a plot of the confusion matrix of events (.png)."""

    event_reliability: Path | None = None
    """Path of a reliability diagram of detections on streams: accuracy by confidence
    (.png)."""

    curve: Path | None = None
    """Path of the operating curve of streams (.png): missed gestures by accidents an
    hour as the probability that a gesture needs moves."""

    calibration: Path | None = None
    """Calibration file, as eskin calibrate writes it, to use in place of the recorded
    ones."""

    robot_urdf: str | None = None
    """Robot in place of the recorded one: a URDF file or a preset's name."""

    workers: Annotated[int | None, Range(1)] = None
    """Number of processes that replay streams; by default one for each core."""


def run(command: EvaluateCommand) -> dict[str, object]:
    """Score the model, print tables, and draw the plots asked for."""
    for picture in list_pictures(command):
        check_picture(picture)
    workers = os.cpu_count() or 1 if command.workers is None else command.workers
    model = load_model(command.model)
    clips, streams = split_by_scoring(find_recordings(command.data), command.events)
    check_pictures(command, clips, streams)
    result: dict[str, object] = {key: None for key in CLIP_KEYS}
    if clips:
        result = score_clips(command, model, clips)
    events = score_streams(command, model, streams, workers) if streams else None
    return result | {"events": events}


def split_by_scoring(
    paths: Sequence[Path], events: Literal["streams", "all", "none"]
) -> tuple[list[Path], list[Path]]:
    """Split recordings into those to score as clips and those to score by events."""
    if not paths:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    clips: list[Path] = []
    streams: list[Path] = []
    for path in paths:
        recording = read_recording(path)
        simulated = recording.metadata.simulated
        stream = is_stream(recording)
        if not simulated or not stream:
            clips.append(path)
        known = stream and recording.label_set.known
        if events == "all" or (events == "streams" and known):
            streams.append(path)
    if not clips and not streams:
        raise RecordingError(
            "all recordings given are streams, which --events none leaves out; give "
            "clips, or leave out --events none"
        )
    return clips, streams


def list_pictures(command: EvaluateCommand) -> list[Path]:
    """List the paths of all plots that are asked for."""
    pictures = (
        command.picture,
        command.reliability,
        command.event_picture,
        command.event_reliability,
        command.curve,
    )
    return [picture for picture in pictures if picture is not None]


def check_pictures(
    command: EvaluateCommand, clips: Sequence[Path], streams: Sequence[Path]
) -> None:
    """Raise if a plot is asked for without recordings to draw it of."""
    for picture, things, name in (
        (command.picture, clips, "clips"),
        (command.reliability, clips, "clips"),
        (command.event_picture, streams, "streams"),
        (command.event_reliability, streams, "streams"),
        (command.curve, streams, "streams"),
    ):
        if picture is not None and not things:
            raise RecordingError(
                f"no {name} among the recordings to draw {picture} of; give some, or "
                "leave the picture out"
            )


def score_clips(
    command: EvaluateCommand, model: Model, paths: Sequence[Path]
) -> dict[str, object]:
    """Score recordings gesture by gesture."""
    from eskin.learn.commands.models import evaluate_model
    from eskin.learn.plots import draw_confusion, draw_reliability

    card = model.card
    overrides = load_overrides(command.calibration, command.robot_urdf)
    dataset = prepare(paths, card.pipeline, card.graph_used, overrides=overrides)
    dataset.report_truncated(print)
    result = evaluate_model(model, dataset)
    print_clip_score(result)
    if command.picture is not None:
        draw_confusion(
            result.segments.confusion,
            model.card.vocabulary,
            command.picture,
            f"{format_count(result.segments.confusion.sum(), 'gesture')}, "
            f"{result.segments.accuracy:.1%} right",
        )
    if command.reliability is not None:
        title = format_count(result.reliability.count.sum(), "gesture")
        draw_reliability(result.reliability, command.reliability, title)
    return {
        "accuracy": round(result.segments.accuracy, 4),
        "accuracy_interval": [round_or_none(value) for value in result.interval],
        "macro_f1": round(result.segments.macro_f1, 4),
        "per_class": result.segments.per_class,
        "per_subject": summarise_people(result.per_subject),
        "ece": round(result.ece, 4),
        "instants": result.instants
        and {
            "accuracy": round(result.instants.accuracy, 4),
            "macro_f1": round(result.instants.macro_f1, 4),
        },
    }


def score_streams(
    command: EvaluateCommand, model: Model, paths: Sequence[Path], workers: int
) -> dict[str, object]:
    """Score recordings by their events, with the detections that are made live."""
    traced = []
    overrides = load_overrides(command.calibration, command.robot_urdf)
    traces = trace_recordings(paths, model, workers, overrides)
    for stream in track_progress(traces, "Replaying", len(paths)):
        if stream.truncated:
            print(f"{stream.path} is cut or damaged: used up to there")
        traced.append(stream)
    decided = [stream.decide() for stream in traced]
    score = score_events(decided, model.card.vocabulary)
    print_event_score(score, Console())
    draw_event_pictures(command, score)
    result = build_event_result(score)
    if command.curve is not None:
        points = draw_curve(command.curve, traced, model, score)
        result["curve"] = [build_point_row(point) for point in points]
        result["missed_at_accidents_per_hour"] = {
            f"{rate:g}": round_or_none(interpolate_missed(points, rate))
            for rate in RATES
        }
    return result


def draw_curve(
    path: Path, streams: Sequence[TracedStream], model: Model, score: EventScore
) -> list[CurvePoint]:
    """Draw and print the operating curve of streams; return its points."""
    points = measure_curve(
        lambda decision: [stream.decide(decision) for stream in streams],
        model.card.decision,
        model.card.vocabulary,
    )
    draw_curves({"": points}, path, f"{score.hours:.2f} h of streams")
    table = Table(*POINT_HEADS, "")
    for point in points:
        table.add_row(*format_point(point), "shipped" * point.is_shipped)
    Console().print(table)
    print(describe_missed(points))
    return points


def build_point_row(point: CurvePoint) -> dict[str, object]:
    """Return a point of the operating curve as plain values."""
    return {
        "threshold": point.threshold,
        "is_shipped": point.is_shipped,
        "accidents_per_hour": round_or_none(point.accidents_per_hour, 2),
        "accidents_interval": [round_or_none(v, 2) for v in point.accidents_interval],
        "missed": round_or_none(point.missed),
        "missed_interval": [round_or_none(v) for v in point.missed_interval],
        "wrong_names": round_or_none(point.wrong_names),
        "false_per_hour": round_or_none(point.false_per_hour, 2),
        "false_interval": [round_or_none(v, 2) for v in point.false_interval],
    }


POINT_HEADS = ("threshold", "accidents/h (95 %)", "missed (95 %)", "wrong names")
"""Heads of the columns of `format_point`."""


def format_point(point: CurvePoint) -> tuple[str, ...]:
    """Return threshold, accidents, misses and wrong names as text, with intervals."""
    least, most = point.accidents_interval
    low, high = point.missed_interval
    return (
        f"{point.threshold:g}",
        f"{point.accidents_per_hour:.2f} ({least:.2f}-{most:.2f})",
        f"{describe(point.missed)} ({describe(low)}-{describe(high)})",
        describe(point.wrong_names),
    )


def describe_missed(points: Sequence[CurvePoint]) -> str:
    """Return the misses at some numbers of accidents an hour as text."""
    if math.isnan(points[0].missed):
        return "no gestures, so no share of missed ones"
    shares = []
    for rate in RATES:
        share = interpolate_missed(points, rate)
        text = "not reached" if math.isnan(share) else f"{share:.1%}"
        shares.append(f"{text} at {rate:g}")
    return f"missed, by accidents an hour: {', '.join(shares)}"


def draw_event_pictures(command: EvaluateCommand, score: EventScore) -> None:
    """Draw the plots of streams that are asked for."""
    from eskin.learn.plots import draw_confusion, draw_reliability

    if command.event_picture is not None:
        events = format_count(score.confusion[:-1].sum(), "event")
        title = f"{events}, F1 {score.total.f1:.3f}"
        draw_confusion(score.confusion, score.names, command.event_picture, title)
    if command.event_reliability is not None:
        title = format_count(score.reliability.count.sum(), "detection")
        draw_reliability(score.reliability, command.event_reliability, title)


def print_clip_score(result: "Evaluation") -> None:
    """Print the scores of clips."""
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
    print(
        f"segments: accuracy {describe(result.segments.accuracy)} "
        f"{describe_interval(*result.interval)}, "
        f"macro F1 {describe(result.segments.macro_f1)}, ECE {describe(result.ece)}"
    )
    if result.instants is not None:
        print(
            f"instants: accuracy {result.instants.accuracy:.3f}, "
            f"macro F1 {result.instants.macro_f1:.3f}"
        )
    people = Table("person", "accuracy")
    for name, value in summarise_people(result.per_subject).items():
        people.add_row(name, f"{value:.3f}")
    console.print(people)
