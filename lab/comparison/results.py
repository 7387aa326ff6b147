"""This module trains methods and stores their predictions in a file of results."""

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np
import torch
from jaxtyping import Bool
from joblib import Parallel, delayed

from eskin.compiled import digest_code
from eskin.errors import EskinError
from eskin.files import atomic_path
from eskin.learn.dataset import hold_out
from eskin.progress import track_progress
from eskin.touch import PipelineConfig
from lab.comparison.examples import Examples
from lab.comparison.methods import Method

PAPER_NETWORK = "eskin_paper_network.network"
"""Module of the one method whose code is in a package of its own."""


@dataclass(frozen=True)
class AnsweredClips:
    """Answered clips hold a method's predictions for some examples."""

    truth: tuple[str, ...]
    """Gesture of each example."""
    answer: tuple[str, ...]
    """Predicted gesture."""
    people: tuple[str, ...]
    """Person of each example, or session."""

    @property
    def correct(self) -> Bool[np.ndarray, "example"]:
        """Return which predictions are correct."""
        return np.array(self.truth) == np.array(self.answer)


@dataclass(frozen=True)
class MethodResult:
    """A method result holds the predictions of a method that was trained once."""

    method: str
    """Name of the method."""
    seed: int
    """Seed of its random draws."""
    seconds: float
    """Time of training and prediction [s]."""
    answered: Mapping[str, AnsweredClips]
    """Predictions on validation, `val`, and on the tests, by name."""


@final
@dataclass(frozen=True)
class TrainingTask:
    """A training task trains a method once and tests it."""

    name: str
    """Name of the method."""
    method: Method
    """Method to train."""
    train: Examples
    """Examples to train on, less those held out for validation."""
    tests: Mapping[str, Examples]
    """Examples to test on, by name of the test."""
    seed: int
    """Seed of all random draws."""
    share: float = 0.2
    """Share of the recordings held out for validation."""

    @property
    def label(self) -> str:
        """Return a name of the task: its method, its seed and its places."""
        places = dict.fromkeys(each.place for each in self.tests.values())
        tested = ", ".join(places) or "the examples held out"
        held = f" less {self.share:.0%}" if self.share else ""
        return (
            f"{self.name}, seed {self.seed}: {self.train.place}{held}, tested on "
            f"{tested}"
        )

    @property
    def digest(self) -> str:
        """Return a digest of all that determines the result: code, settings, data."""
        tests = {name: each.digest for name, each in self.tests.items()}
        text = (
            f"{digest_code(__name__)} {digest_code(PAPER_NETWORK)} "
            f"{PipelineConfig()} {self.method} "
            f"{self.train.digest} {tests} {self.seed} {self.share}"
        )
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def run(self) -> MethodResult:
        """Train the method and test it."""
        started = time.monotonic()
        train, val = split_examples(self.train, self.share)
        predict = self.method.fit(train, self.seed)
        tests = {"val": val, **self.tests} if val.paths else self.tests
        answered = {}
        for name, examples in tests.items():
            # A copy caches no windows: those of many tests do not fit in memory.
            predicted = predict(replace(examples)).argmax(axis=1)
            answered[name] = AnsweredClips(
                truth=examples.labels,
                answer=tuple(train.gestures[n] for n in predicted.tolist()),
                people=examples.groups,
            )
        seconds = round(time.monotonic() - started, 1)
        return MethodResult(self.name, self.seed, seconds, answered)


@dataclass(frozen=True)
class KeptResult:
    """A kept result is a result with the label and the digest of its task."""

    label: str
    """Label of the task."""
    digest: str
    """Digest of the task when it was run."""
    result: MethodResult
    """The result."""


def find_stale(tasks: Sequence[TrainingTask], path: Path) -> list[str]:
    """Return the labels of tasks whose results are of other code, settings or data.

    Args:
        tasks: tasks to look for.
        path: file of results.

    Raises:
        EskinError: if the file is damaged.
    """
    kept = read_results(path)
    known = ((task, kept.get(task.label)) for task in tasks)
    return [task.label for task, each in known if each and each.digest != task.digest]


def run_tasks(
    tasks: Sequence[TrainingTask], path: Path, workers: int = 1, seconds: float = np.inf
) -> list[MethodResult | None]:
    """Run the tasks whose results a file does not hold; return the results of all.

    Stale results (see `find_stale`) are replaced.

    Args:
        tasks: tasks to run, in this order.
        path: file of results, one a line (JSON Lines).
        workers: number of processes.
        seconds: time after which no further task is begun [s].

    Returns:
        The results in the order of the tasks, None for those that were not begun.

    Raises:
        EskinError: if the file is damaged, or two tasks have the same name.
    """
    end = time.monotonic() + seconds
    digests = {task.label: task.digest for task in tasks}
    unclear = [task.label for task in tasks if digests[task.label] != task.digest]
    if unclear:
        raise EskinError(
            f"several trainings are named '{unclear[0]}'; allowed is each name once; "
            "rename the folder of one"
        )
    kept = read_results(path).values()
    by_key = {(each.label, each.digest): each.result for each in kept}
    results = [by_key.get((task.label, task.digest)) for task in tasks]
    missing = [n for n, result in enumerate(results) if result is None]
    jobs = (delayed(run_before)(n, tasks[n], end) for n in missing)
    run: Any = Parallel(n_jobs=workers, return_as="generator_unordered")(jobs)
    for n, result in track_progress(run, "Comparing", len(missing)):
        if result is not None:
            results[n] = result
            keep_result(path, KeptResult(tasks[n].label, tasks[n].digest, result))
    return results


def run_before(
    number: int, task: TrainingTask, end: float
) -> tuple[int, MethodResult | None]:
    """Return a task's number and its result; None if the time `end` has passed."""
    torch.set_num_threads(1)
    return number, None if time.monotonic() > end else task.run()


def split_examples(examples: Examples, share: float) -> tuple[Examples, Examples]:
    """Divide examples into training and validation, the same for every method."""
    gestures: dict[int, set[str]] = {}
    for n, gesture in zip(examples.recordings, examples.labels, strict=True):
        gestures.setdefault(n, set()).add(gesture)
    rng = np.random.default_rng(0)
    holdout = hold_out(examples.sessions, gestures, share, rng)
    return examples.select(holdout.train), examples.select(holdout.held)


def keep_result(path: Path, kept: KeptResult) -> None:
    """Write a result into a file, in place of the result of the same label."""
    results = {**read_results(path), kept.label: kept}
    lines = (f"{format_result(each)}\n" for each in results.values())
    with atomic_path(path) as part:
        part.write_text("".join(lines), encoding="utf-8")


def read_results(path: Path) -> dict[str, KeptResult]:
    """Return the results in a file by the labels of their tasks; none without a file.

    Raises:
        EskinError: if the file is damaged.
    """
    if not path.exists():
        return {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        return {kept.label: kept for kept in map(parse_result, lines)}
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise EskinError(
            f"{path} is no file of results ({error!r}); allowed are files that "
            "lab.compare keeps; delete it, and its results are made again"
        ) from None


def format_result(kept: KeptResult) -> str:
    """Return a result as a line of JSON."""
    facts = asdict(kept)
    facts["result"]["answered"] = {
        name: {key: " ".join(values) for key, values in each.items()}
        for name, each in facts["result"]["answered"].items()
    }
    return json.dumps(facts)


def parse_result(line: str) -> KeptResult:
    """Return the result that a line of JSON holds."""
    facts = json.loads(line)
    result = facts["result"]
    answered = {
        name: AnsweredClips(**{key: tuple(text.split()) for key, text in each.items()})
        for name, each in result["answered"].items()
    }
    found = MethodResult(result["method"], result["seed"], result["seconds"], answered)
    return KeptResult(facts["label"], facts["digest"], found)
