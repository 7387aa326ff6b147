"""Measure the weights that come with eskin on skins that `eskin skin design` makes.

    python -m lab.designed_skins measure --work FOLDER --only panda
    python -m lab.designed_skins table --work FOLDER

`measure` designs a skin, simulates the people of a set who touch it, and classifies
their clips with weights that never saw it; for `ur5`, with the skin of the weights. The
folder keeps what is made, so each skin may be measured by a run of its own, and a run
that was stopped goes on. `table` compares the accuracy on each skin with that on the
ur5 skin for the same people and the same gestures, with 95 % intervals from drawing the
people anew.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

from eskin.cli.main import run
from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import classify_clips, find_person
from eskin.learn.metrics import bootstrap_accuracy, resample_clusters
from eskin.live import load_model
from eskin.recording import find_recordings
from lab.tables import format_head, format_row


@dataclass(frozen=True)
class ExampleSkin:
    """An example says how a skin is designed; without a robot it comes with eskin."""

    text: str
    """Covered part of the robot."""
    robot: str = ""
    """URDF of the robot in example-robot-data."""
    density: float = 1.5
    """Density of the taxels [1/cm2]."""
    links: tuple[str, ...] = ()
    """Links that are covered; all where there are none."""


SKINS = {
    "ur5": ExampleSkin("arm, the skin of the weights"),
    "panda": ExampleSkin("arm, all links", "panda_description/urdf/panda.urdf"),
    "talos": ExampleSkin(
        "humanoid, torso",
        "talos_data/robots/talos_full_v2.urdf",
        1.2,
        ("torso_2_link",),
    ),
    "go2": ExampleSkin("quadruped, all links", "go2_description/urdf/go2.urdf"),
}


def find_robot(path: str) -> Path:
    """Return the URDF of an example robot."""
    parts = ("cmeel.prefix", "share", "example-robot-data", "robots")
    for place in filter(None, sys.path):
        found = Path(place).joinpath(*parts, path)
        if found.is_file():
            return found
    raise SystemExit("example-robot-data is not installed: pip install '.[models]'")


def call(*words: object) -> None:
    """Run a command of eskin; stop where it fails."""
    if run([str(word) for word in words]) != 0:
        raise SystemExit(f"eskin {' '.join(map(str, words[:2]))} failed")


def measure(name: str, command: "Command") -> None:
    """Design a skin, simulate a set on it, and classify the clips of the set."""
    skin = SKINS[name]
    work = command.work
    sets = work / "sets" / name
    where: list[object] = ["--skin", "ur5"]
    if skin.robot:
        folder = work / "skins" / name
        urdf = find_robot(skin.robot)
        if not (folder / "skin.yaml").exists():
            links = ["--links", *skin.links] if skin.links else []
            asked = ["--out", folder, "--density", skin.density, *links]
            call("skin", "design", urdf, *asked)
        where = ["--skin", folder, "--robot-urdf", urdf]
    wanted = ["--set", command.set, "--clips", command.clips, "--workers", 1]
    call("generate", sets, *where, *wanted)
    loaded = load_model(command.model)
    card = loaded.card
    paths = find_recordings([sets])
    dataset = prepare(paths, card.pipeline, card.graph_used)
    found = classify_clips(to_network(loaded), card, dataset)
    rows = [
        [find_person(dataset, recording), card.vocabulary[truth], bool(truth == said)]
        for recording, truth, said in zip(
            found.recording.tolist(), found.truth, found.predicted, strict=True
        )
    ]
    (work / f"{name}.json").write_text(json.dumps(rows) + "\n", encoding="utf-8")
    correct = np.mean([row[2] for row in rows])
    print(f"{name}: {len(rows)} clips, accuracy {correct:.1%}", flush=True)


@dataclass(frozen=True, eq=False)
class ClipAnswers:
    """Answers hold what weights said of clips."""

    people: np.ndarray
    gestures: np.ndarray
    correct: np.ndarray

    def select(self, gestures: Sequence[str]) -> "ClipAnswers":
        """Return the answers to some gestures."""
        kept = np.isin(self.gestures, gestures)
        return ClipAnswers(self.people[kept], self.gestures[kept], self.correct[kept])


def read_answers(path: Path) -> ClipAnswers:
    """Read what `measure` wrote."""
    people, gestures, correct = zip(*json.loads(path.read_text()), strict=True)
    return ClipAnswers(
        np.array(people), np.array(gestures), np.array(correct, dtype=bool)
    )


def compare(own: ClipAnswers, other: ClipAnswers) -> tuple[float, float, float]:
    """Return the difference of two accuracies and its 95 % interval."""
    names, index = np.unique(
        np.concatenate([own.people, other.people]), return_inverse=True
    )
    rows = np.split(index, [len(own.people)])
    sums = [
        np.bincount(row, weights, len(names))
        for row, each in zip(rows, (own, other), strict=True)
        for weights in (each.correct.astype(np.float64), np.ones(len(row)))
    ]
    a, n, b, m = resample_clusters(np.stack(sums, axis=1), 0).T
    low, high = np.percentile(a / n - b / m, [2.5, 97.5])
    return float(own.correct.mean() - other.correct.mean()), float(low), float(high)


def print_table(work: Path) -> None:
    """Print a row for each skin that was measured."""
    vocabulary = ("none", "double_pat", "grab", "poke", "stroke")
    print(
        format_head(
            ("skin", "clips", "accuracy", *vocabulary, "ur5, same gestures", "less")
        )
    )
    reference = read_answers(work / "ur5.json")
    for name, skin in SKINS.items():
        path = work / f"{name}.json"
        if not path.exists():
            continue
        own = read_answers(path)
        same = reference.select(sorted(set(own.gestures)))
        low, high = bootstrap_accuracy(own.correct, own.people.tolist())
        less, most, least = (-100 * each for each in compare(own, same))
        shares = [own.select([gesture]).correct for gesture in vocabulary]
        print(
            format_row(
                (
                    f"{name} ({skin.text})",
                    str(len(own.correct)),
                    f"{own.correct.mean():.1%} ({low:.1%}-{high:.1%})",
                    *(f"{each.mean():.0%}" if len(each) else "-" for each in shares),
                    f"{same.correct.mean():.1%}",
                    "" if name == "ur5" else f"{less:.1f} ({least:.1f} to {most:.1f})",
                )
            )
        )


@dataclass(frozen=True)
class Command:
    """Measure skins, or print the table of those that were measured."""

    what: tyro.conf.Positional[Literal["measure", "table"]]
    """What to do."""
    work: Path
    """Folder of all that is made."""
    only: tuple[str, ...] = tuple(SKINS)
    """Skins to measure."""
    set: str = "test-p"
    """Set whose people touch the skins."""
    clips: int = 300
    """Number of clips on each."""
    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""


def main() -> None:
    """Measure skins, or print the table of those that were measured."""
    command = tyro.cli(Command)
    if command.what == "table":
        print_table(command.work)
        return
    for name in command.only:
        measure(name, command)


if __name__ == "__main__":
    main()
