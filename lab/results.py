"""Compare recognisers on simulated people, and print the tables.

python -m lab.results [PART] --sets FOLDER [--form short]: PART is one of table,
large, clips, robustness, study, leaks or all. Sets that are missing in FOLDER are
generated there. The answers of each method are kept in one file per table, so that
nothing is trained twice and an interrupted run can be resumed: those of the long form
in `lab/kept`, its pictures in `docs/pictures`; those of the short form, a smoke
test, beside the sets. Answers of other code, settings or clips are reported and
computed again.
"""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Literal

import tyro
from matplotlib.figure import Figure

from eskin.cli import compare
from eskin.learn.plots import save_figure
from lab import leaks, robustness
from lab.baselines import NETWORKS
from lab.comparison import (
    ABLATIONS,
    METHODS,
    Method,
    MethodResult,
    RecogniserMethod,
    RunKey,
    TrainingTask,
    find_examples,
    read_results,
)
from lab.comparison.study import COLOURS, plot_shares
from lab.comparison.table import compute_accuracies, compute_mean, compute_std
from lab.corruption import KINDS, Kind
from lab.simulated_sets import made_set

Part = Literal["table", "large", "clips", "robustness", "study", "leaks", "all"]
TESTS = ("test-s", "test-p", "test-x", "test-m")
OF_581 = {29: 33, 58: 67, 116: 134, 232: 269, 464: 539}
"""Number of training clips, and the size of the whole set with that number."""


@dataclass(frozen=True)
class Form:
    """Sets the extent of the tables."""

    draws: int
    """Number of paper-size sets."""
    clips: int | None
    """Number of clips of each; that of the paper if None."""
    table: tuple[str, ...]
    """Methods trained on paper-size sets."""
    network_draws: int
    """Number of these sets for the networks of others."""
    train: int | None
    """Number of clips of the large training set; all if None."""
    test: int | None
    """Number of clips of each large test set; all if None."""
    tests: tuple[str, ...]
    """Large test sets."""
    large: tuple[str, ...]
    """Methods trained on the large training set."""
    sizes: tuple[int, ...]
    """Numbers of training clips in the curve."""
    curve_draws: int
    """Number of sets per point of the curve, and for robustness."""
    leak_draws: int
    """Number of sets for the test of leaks."""
    corrupted: tuple[str, ...]
    """Methods tested on corrupted clips."""
    kinds: tuple[Kind, ...]
    """Kinds of corruption."""
    studies: Mapping[str, tuple[int, tuple[str, ...]]]
    """Studies of neighbours and pooling, by name of the picture: number of paper-size
    sets, and further options."""
    steps: int | None = None
    """Number of training steps of our network; that of its settings if None."""

    @property
    def methods(self) -> dict[str, Method]:
        """Return all methods by name, ablations included."""
        return {
            name: self.shorten(method) for name, method in (METHODS | ABLATIONS).items()
        }

    def shorten(self, method: Method) -> Method:
        """Return a method with fewer steps, if it trains our network."""
        if self.steps is None or not isinstance(method, RecogniserMethod):
            return method
        config = replace(method.config, epochs=1, steps=self.steps)
        return replace(method, config=config)


FORMS = {
    "short": Form(
        draws=1,
        clips=33,
        table=("boosting-on-touch", "svm-max", "gradient-boosting"),
        network_draws=0,
        train=40,
        test=16,
        tests=("test-m",),
        large=("boosting-on-touch", "gradient-boosting"),
        sizes=(29,),
        curve_draws=1,
        leak_draws=1,
        corrupted=("eskin", "random-forest"),
        kinds=("dead",),
        studies={
            "study": (
                1,
                ("--networks", "paper", "--k", "8", "--epochs", "1", "--seeds", "1"),
            )
        },
        steps=10,
    ),
    "long": Form(
        draws=10,
        clips=None,
        table=tuple(name for name in METHODS if name not in NETWORKS),
        network_draws=3,
        train=3000,
        test=1000,
        tests=TESTS,
        large=tuple(name for name in METHODS if name not in ("paper", "3d-cnn")),
        sizes=(29, 58, 116, 232, 464),
        curve_draws=3,
        leak_draws=5,
        corrupted=("eskin", "boosting-on-touch", "gradient-boosting", "random-forest"),
        kinds=KINDS,
        studies={
            "study": (1, ("--epochs", "5", "--seeds", "1")),
            "study_ours": (3, ("--networks", "eskin", "--seeds", "1")),
        },
    ),
}


@dataclass(frozen=True)
class Command:
    """Compute and print the tables."""

    part: tyro.conf.Positional[Part] = "all"
    """Table to compute."""

    form: Literal["short", "long"] = "long"
    """Sets the extent of the tables."""

    sets: Path = Path("sets")
    """Folder of the sets."""

    workers: int = os.cpu_count() or 1
    """Number of processes that train."""

    minutes: float = math.inf
    """Time after which a part begins no further training [min]."""

    @property
    def results(self) -> Path:
        """Folder of the answers of methods."""
        short = self.form == "short"
        return self.sets / "kept" if short else Path("lab/kept")

    @property
    def pictures(self) -> Path:
        """Folder of the pictures."""
        short = self.form == "short"
        return self.sets / "pictures" if short else Path("docs/pictures")

    def options(self, table: str) -> dict[str, object]:
        """Return the options of the comparison of a table."""
        return {
            "results": self.results / f"{table}.jsonl",
            "pack": self.sets / "pack",
            "workers": self.workers,
            "minutes": self.minutes,
        }


def main() -> None:
    """Compute and print the chosen tables."""
    command = tyro.cli(Command)
    for name, part in PARTS.items():
        if command.part in (name, "all"):
            print(f"\n## {name}\n", flush=True)
            part(command, FORMS[command.form])
    print(f"\n{describe_trainings(command.results)}")


def describe_trainings(results: Path) -> str:
    """Format the number of trainings kept in a folder, and their total time."""
    files = [read_results(path) for path in results.glob("*.jsonl")]
    seconds = [kept.result.seconds for kept in chain(*map(dict.values, files))]
    hours = sum(seconds) / 3600
    return f"{len(seconds)} trainings kept, of {hours:.1f} hours on one core together"


def paper_sets(command: Command, count: int) -> list[Path]:
    """Generate paper-size sets, each with its own people, poses, build and seed."""
    return [paper_set(command, FORMS[command.form].clips, n) for n in range(count)]


def paper_set(command: Command, clips: int | None, seed: int) -> Path:
    """Generate a paper-size set; with `clips`, of six people and that many clips."""
    return made_set(
        *(command.sets, "paper"),
        clips=clips,
        people=None if clips is None else 6,
        seed=seed,
        workers=command.workers,
    )


def split_draws(draws: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Return the training set and the test set of each draw."""
    return tuple(d / "train" for d in draws), tuple(d / "test" for d in draws)


def table(command: Command, form: Form) -> None:
    """Compare all methods on paper-size sets (Table III)."""
    draws = paper_sets(command, form.draws)
    show_compared(command, form, draws, form.table)
    if form.network_draws:
        print("\nNetworks of others on the first of these:\n")
        networks = ("eskin", *NETWORKS)
        show_compared(command, form, draws[: form.network_draws], networks)


def show_compared(
    command: Command, form: Form, draws: Sequence[Path], methods: tuple[str, ...]
) -> None:
    """Compare methods on some draws."""
    trains, tests = split_draws(draws)
    compare.run_compare(
        compare.CompareCommand(
            trains,
            tests,
            methods=methods,
            **command.options("table"),  # type: ignore
        )
    )


def large(command: Command, form: Form) -> None:
    """Compare methods trained on many people, on the large tests."""
    sets, workers = command.sets, command.workers
    train = made_set(sets, "train", clips=form.train, workers=workers)
    tests = tuple(
        made_set(sets, name, clips=form.test, workers=workers) for name in form.tests
    )
    compare.run_compare(
        compare.CompareCommand(
            (train,),
            tests,
            methods=form.large,
            **command.options("large"),  # type: ignore
        )
    )


def clips(command: Command, form: Form) -> None:
    """Compute accuracy against the number of training clips, with ablations."""
    names = ("eskin", "boosting-on-touch", "random-forest", *ABLATIONS)
    methods = {name: form.methods[name] for name in names}
    tests = [draw / "test" for draw in paper_sets(command, form.curve_draws)]
    asked: dict[tuple[str, int, RunKey], TrainingTask] = {}
    for size in form.sizes:
        for draw, test in enumerate(tests):
            train = paper_set(command, OF_581[size], draw) / "train"
            for name, method in methods.items():
                task = build_task(command, name, method, train, test, draw)
                asked[name, size, (draw, draw)] = task
    tasks = list(asked.values())
    results = command.results / "clips.jsonl"
    done = compare.train_all(tasks, results, command.workers, command.minutes)
    found: dict[int, dict[str, dict[RunKey, MethodResult]]] = {}
    for (name, size, place), result in zip(asked, done, strict=True):
        if result is not None:
            by_name = found.setdefault(size, {})
            by_name.setdefault(name, {})[place] = result
    # A row is of all methods and all sets, or there is none.
    whole = {
        size: by_name
        for size, by_name in found.items()
        if sum(map(len, by_name.values())) == len(methods) * len(tests)
    }
    if whole:
        rows = [(str(size), "test", by_name) for size, by_name in whole.items()]
        print(robustness.ahead_table("training clips", rows))
        draw_clips_curve(
            {
                name: {
                    size: compute_accuracies(list(by_name[name].values()), "test")
                    for size, by_name in whole.items()
                }
                for name in methods
            },
            command.pictures / "clips_curve.png",
        )


def draw_clips_curve(
    found: Mapping[str, Mapping[int, Sequence[float]]], path: Path
) -> None:
    """Draw accuracy against the number of training clips.

    Args:
        found: accuracies by method and by number of clips.
        path: path of the picture.
    """
    figure = Figure(figsize=(5.2, 3.6), dpi=120, layout="constrained")
    axes = figure.subplots()
    for colour, (name, by_size) in zip(COLOURS, found.items(), strict=False):
        points = [
            (compute_mean(shares), compute_std(shares)) for shares in by_size.values()
        ]
        plot_shares(axes, list(by_size), points, colour, name)
    sizes = sorted({size for by_size in found.values() for size in by_size})
    axes.set(xscale="log", xlabel="training clips", ylabel="accuracy [%]")
    axes.set_xticks(sizes, [str(size) for size in sizes])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8)
    save_figure(figure, path)


def build_task(
    command: Command, name: str, method: Method, train: Path, test: Path, seed: int
) -> TrainingTask:
    """Build the task of one training of a method, without held-out clips."""
    pack = command.sets / "pack"
    learned, asked = (find_examples([place], pack) for place in (train, test))
    return TrainingTask(name, method, learned, {"test": asked}, seed, share=0.0)


def corrupted(command: Command, form: Form) -> None:
    """Measure the accuracy on corrupted clips of skin, wiring, robot or rate."""
    trains, tests = split_draws(paper_sets(command, form.curve_draws))
    robustness.main(
        robustness.Command(
            *(trains, tests, form.corrupted, form.kinds),
            picture=command.pictures / "robustness.png",
            **command.options("robustness"),  # type: ignore
        ),
        form.methods,
    )


def show_study(command: Command, form: Form) -> None:
    """Compare numbers of neighbours and kinds of pooling (Fig. 32)."""
    for name, (draws, words) in form.studies.items():
        data = [str(place) for place in paper_sets(command, draws)]
        picture = str(command.pictures / f"{name}.png")
        chosen = tyro.cli(
            compare.StudyCommand, args=[*data, *words, "--picture", picture]
        )
        changed = {**vars(chosen), **command.options("study")}
        print(f"On {draws} of the sets:\n")
        compare.run_study(compare.StudyCommand(**changed))
        print()


def show_leaks(command: Command, form: Form) -> None:
    """Test for leaks: train on data that predict nothing."""
    trains, tests = split_draws(paper_sets(command, form.leak_draws))
    pack = command.sets / "pack"
    leaks.show(leaks.Command(trains, tests, pack, steps=form.steps))


PARTS: dict[str, Callable[[Command, Form], None]] = {
    "table": table,
    "large": large,
    "clips": clips,
    "robustness": corrupted,
    "study": show_study,
    "leaks": show_leaks,
}


if __name__ == "__main__":
    main()
