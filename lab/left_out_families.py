"""Measure what weights lose on a family of sensors that they were not trained on.

    python -m lab.weights --sets SETS --out FOLDER --weights all-families ...
    python -m lab.left_out_families --sets SETS --models FOLDER

The weights `all-families` and `without-FAMILY` of each family, all of which the first
command makes, are trained equally long, and tested on the clips of the validation set
of all families. What is lost is the difference on the family that was left out, with a
95 % interval from drawing the sessions anew; each session has a build and a person of
its own.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import predict_clips
from eskin.learn.metrics import bootstrap_difference
from eskin.live import load_model
from eskin.recording import find_recordings
from eskin.sim.sensor import FAMILIES
from lab.tables import format_head, format_row


@dataclass(frozen=True)
class Command:
    """Measure what weights lose on a family that they were not trained on."""

    sets: Path
    """Folder of the sets, and of the prepared recordings."""
    models: Path
    """Folder of the weights."""
    validation: str = "tunefam"
    """Name of the set in that folder."""
    workers: int = 1
    """Number of processes that prepare."""


def main() -> None:
    """Print the table."""
    command = tyro.cli(Command)
    everything = load_model(command.models / "all-families.safetensors")
    card = everything.card
    dataset = prepare(
        find_recordings([command.sets / command.validation]),
        pipeline=card.pipeline,
        graph=card.graph_used,
        pack=command.sets / "pack",
        workers=command.workers,
    )
    found = predict_clips(to_network(everything), dataset, card.vocabulary)
    trained, session = found.predicted == found.truth, np.asarray(found.recording)
    names = [r.metadata.notes.get("family", "") for r in dataset.recordings]
    family = np.array(names)[session]
    print(
        format_head(["family", "clips", "trained on it", "left out", "lost [points]"])
    )
    for name in FAMILIES:
        of_family = family == name
        model = load_model(command.models / f"without-{name}.safetensors")
        found = predict_clips(to_network(model), dataset, model.card.vocabulary)
        right = found.predicted == found.truth
        parts = trained[of_family], right[of_family]
        ends = bootstrap_difference(*parts, cluster=session[of_family].tolist())
        lost = parts[0].mean() - parts[1].mean()
        points = [f"{100.0 * each:.1f}" for each in (lost, *ends)]
        shares = (f"{each[of_family].mean():.1%}" for each in (trained, right))
        cells = [name, str(of_family.sum()), *shares]
        print(format_row([*cells, "{} [{}, {}]".format(*points)]))


if __name__ == "__main__":
    main()
