"""`eskin evaluate`: score a model on labelled recordings."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from eskin.cli.checks import check_writable, tell_cut
from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import Evaluation, evaluate
from eskin.learn.pictures import draw_confusion
from eskin.model import load_model
from eskin.recording import find_recordings


@dataclass(frozen=True)
class Command:
    """Score a model on labelled recordings."""

    model: tyro.conf.Positional[Path]
    """The model (.safetensors)."""

    data: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or folders of them."""

    picture: Path | None = None
    """Where to draw the confusions (.png)."""


def run(command: Command) -> dict[str, object]:
    """Score, print tables, and draw the confusions if asked."""
    if command.picture is not None:
        check_writable(command.picture)
    model = load_model(command.model)
    dataset = prepare(
        find_recordings(command.data), model.card.pipeline, model.card.graph_used
    )
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
    return {
        "accuracy": round(result.segments.accuracy, 4),
        "macro_f1": round(result.segments.macro_f1, 4),
        "per_class": result.segments.per_class,
        "per_subject": by_person(result.per_subject),
        "ece": round(result.ece, 4),
        "instants": {
            "accuracy": round(result.instants.accuracy, 4),
            "macro_f1": round(result.instants.macro_f1, 4),
        },
    }


def by_person(people: dict[str, float]) -> dict[str, float]:
    """Each person's accuracy, their mean, spread and least.

    A person who is called like one of these three is `person mean`, say.
    """
    values = list(people.values())
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    three = {"mean": float(np.mean(values)), "sd": spread, "worst": min(values)}
    named = {f"person {n}" if n in three else n: v for n, v in people.items()}
    return {name: round(value, 4) for name, value in (named | three).items()}


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
    print(
        f"segments: accuracy {result.segments.accuracy:.3f}, "
        f"macro F1 {result.segments.macro_f1:.3f}, ECE {result.ece:.3f}"
    )
    print(
        f"instants: accuracy {result.instants.accuracy:.3f}, "
        f"macro F1 {result.instants.macro_f1:.3f}"
    )
    for name, value in result.per_subject.items():
        print(f"  {name}: {value:.3f}")
