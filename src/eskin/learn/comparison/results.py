"""This module trains methods and keeps their answers in files, each once only."""

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

from eskin.errors import EskinError
from eskin.files import atomic_path
from eskin.learn.comparison.examples import Examples
from eskin.learn.comparison.methods import Method
from eskin.learn.dataset import track_progress
from eskin.learn.holdout import hold_out
from eskin.touch import PipelineConfig

FORMAT = 2
"""Format of results, raised whenever a method changes in a way that its settings do not
show."""


@dataclass(frozen=True)
class AnsweredClips:
    """Answered clips hold what a method answered to some clips."""

    truth: tuple[str, ...]
    """Gesture that each clip was generated for."""
    answer: tuple[str, ...]
    """Gesture that was answered."""
    people: tuple[str, ...]
    """Person of each clip."""

    @property
    def correct(self) -> Bool[np.ndarray, "clip"]:
        """Return which answers are correct."""
        return np.array(self.truth) == np.array(self.answer)


@dataclass(frozen=True)
class MethodResult:
    """A method result holds the answers of a method that was trained once."""

    method: str
    """Name of the method."""
    seed: int
    """Seed of its random draws."""
    seconds: float
    """Time that it took to learn and to answer [s]."""
    answered: Mapping[str, AnsweredClips]
    """Answers by the name of what was asked: `val`, and the tests."""


@final
@dataclass(frozen=True)
class TrainingTask:
    """A training task trains a method once and asks it some tests."""

    name: str
    """Name of the method."""
    method: Method
    """Method that learns."""
    train: Examples
    """Clips to learn from, apart from those held out for validation."""
    tests: Mapping[str, Examples]
    """Clips to answer, by name."""
    seed: int
    """Seed of all random draws."""
    share: float = 0.2
    """Share of the recordings held out."""

    @property
    def key(self) -> str:
        """Return a name of all that decides the result: the name of its file."""
        tests = {name: each.digest for name, each in self.tests.items()}
        facts = f"{FORMAT} {PipelineConfig()} {self.method} {self.train.digest} "
        facts += f"{tests} {self.seed} {self.share}"
        short = hashlib.sha256(facts.encode()).hexdigest()[:12]
        return f"{self.name}-{self.seed}-{short}"

    def is_done(self, folder: Path) -> bool:
        """Tell whether there is a file of the result."""
        return self.find_file(folder).exists()

    def find_file(self, folder: Path) -> Path:
        """Return the path of the result's file."""
        return folder / f"{self.key}.json"

    def load_or_run(self, folder: Path) -> MethodResult:
        """Return the result from its file, which is written if it is missing."""
        path = self.find_file(folder)
        if path.exists():
            return read_result(path)
        result = self.run()
        write_result(path, result)
        return result

    def run(self) -> MethodResult:
        """Learn and answer."""
        started = time.monotonic()
        learned, held = split_examples(self.train, self.share)
        predict = self.method.fit(learned, self.seed)
        asked = {"val": held, **self.tests} if held.clips else self.tests
        answered = {}
        for name, examples in asked.items():
            # A copy keeps no windows: those of many tests do not fit in memory.
            predicted = predict(replace(examples)).argmax(axis=1)
            answered[name] = AnsweredClips(
                truth=tuple(clip.gesture for _, clip in examples.clips),
                answer=tuple(learned.gestures[n] for n in predicted.tolist()),
                people=examples.people,
            )
        seconds = round(time.monotonic() - started, 1)
        return MethodResult(self.name, self.seed, seconds, answered)


def run_tasks(
    tasks: Sequence[TrainingTask],
    folder: Path,
    workers: int = 1,
    seconds: float = np.inf,
) -> list[MethodResult | None]:
    """Return the results of tasks, in their order; what has a file is not run again.

    Args:
        tasks: tasks to run, in this order.
        folder: folder that keeps results.
        workers: number of processes.
        seconds: time after which no further task is begun [s].

    Returns:
        The results, None for tasks that were not begun.
    """
    end = time.monotonic() + seconds
    jobs = (delayed(run_before)(task, folder, end) for task in tasks)
    found: Any = Parallel(n_jobs=workers, return_as="generator")(jobs)
    return list(track_progress(found, "Comparing", len(tasks)))


def run_before(task: TrainingTask, folder: Path, end: float) -> MethodResult | None:
    """Return the result of a task, if it can begin before a time on this machine."""
    torch.set_num_threads(1)
    if not task.is_done(folder) and time.monotonic() > end:
        return None
    return task.load_or_run(folder)


def split_examples(examples: Examples, share: float) -> tuple[Examples, Examples]:
    """Hold out whole sessions for validation, the same for every method.

    Returns:
        The examples to learn from, and those held out.
    """
    made: dict[int, set[str]] = {}
    for n, clip in examples.clips:
        made.setdefault(n, set()).add(clip.gesture)
    rng = np.random.default_rng(0)
    found = hold_out(examples.sessions, made, share, rng)
    return examples.select(found.train), examples.select(found.held)


def write_result(path: Path, result: MethodResult) -> None:
    """Write a result as JSON, whole or not at all."""
    facts = asdict(result)
    facts["answered"] = {
        name: {key: " ".join(values) for key, values in asdict(each).items()}
        for name, each in result.answered.items()
    }
    with atomic_path(path) as part:
        part.write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


def read_result(path: Path) -> MethodResult:
    """Read a result from its file.

    Raises:
        EskinError: if the file is damaged.
    """
    try:
        return parse_result(path.read_text(encoding="utf-8"))
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise EskinError(
            f"{path} is no result ({error!r}); allowed are files that eskin compare "
            "and eskin study keep; delete it, and it is made again"
        ) from None


def parse_result(text: str) -> MethodResult:
    """Return the result that a text holds."""
    facts = json.loads(text)
    answered = {
        name: AnsweredClips(**{key: tuple(text.split()) for key, text in each.items()})
        for name, each in facts["answered"].items()
    }
    return MethodResult(facts["method"], facts["seed"], facts["seconds"], answered)
