"""This module trains methods and keeps their answers in a file, each once only."""

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

from eskin.code_digest import digest_code
from eskin.errors import EskinError
from eskin.files import atomic_path
from eskin.learn.comparison.examples import Examples
from eskin.learn.comparison.methods import Method
from eskin.learn.dataset import track_progress
from eskin.learn.holdout import hold_out
from eskin.touch import PipelineConfig


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
    def label(self) -> str:
        """Return a name of the task: its method, its seed and its folders of clips."""
        places = dict.fromkeys(each.place for each in self.tests.values())
        tested = ", ".join(places) or "the clips held out"
        held = f" less {self.share:.0%}" if self.share else ""
        return (
            f"{self.name}, seed {self.seed}: {self.train.place}{held}, tested on "
            f"{tested}"
        )

    @property
    def digest(self) -> str:
        """Return a digest of all that decides the result: code, settings and clips."""
        tests = {name: each.digest for name, each in self.tests.items()}
        facts = (
            f"{digest_code(__name__)} {PipelineConfig()} {self.method} "
            f"{self.train.digest} {tests} {self.seed} {self.share}"
        )
        return hashlib.sha256(facts.encode()).hexdigest()[:16]

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


@dataclass(frozen=True)
class KeptResult:
    """A kept result is a result with the name and the digest of its task."""

    label: str
    """Name of the task."""
    digest: str
    """Digest of the code, settings and clips that the result was made with."""
    result: MethodResult
    """The result."""


def find_stale(tasks: Sequence[TrainingTask], path: Path) -> list[str]:
    """Return the names of tasks whose results other code, settings or clips gave.

    Args:
        tasks: tasks to look for.
        path: file that keeps results.

    Raises:
        EskinError: if the file is damaged.
    """
    kept = read_results(path)
    known = ((task, kept.get(task.label)) for task in tasks)
    return [task.label for task, each in known if each and each.digest != task.digest]


def run_tasks(
    tasks: Sequence[TrainingTask],
    path: Path,
    workers: int = 1,
    seconds: float = np.inf,
) -> list[MethodResult | None]:
    """Return the results of tasks, in their order; what the file holds is not run.

    A stale result (see `find_stale`) is replaced by that of the task as it is now.

    Args:
        tasks: tasks to run, in this order.
        path: file that keeps results, one a line (JSON Lines).
        workers: number of processes.
        seconds: time after which no further task is begun [s].

    Returns:
        The results, None for tasks that were not begun.

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
    kept = {
        (each.label, each.digest): each.result for each in read_results(path).values()
    }
    found = [kept.get((task.label, task.digest)) for task in tasks]
    missing = [n for n, result in enumerate(found) if result is None]
    jobs = (delayed(run_before)(n, tasks[n], end) for n in missing)
    run: Any = Parallel(n_jobs=workers, return_as="generator_unordered")(jobs)
    for n, result in track_progress(run, "Comparing", len(missing)):
        if result is not None:
            found[n] = result
            keep_result(path, KeptResult(tasks[n].label, tasks[n].digest, result))
    return found


def run_before(
    number: int, task: TrainingTask, end: float
) -> tuple[int, MethodResult | None]:
    """Return the result of a task, if it can begin before a time on this machine."""
    torch.set_num_threads(1)
    return number, None if time.monotonic() > end else task.run()


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


def keep_result(path: Path, kept: KeptResult) -> None:
    """Write a result into a file, in the place of the one of the same name."""
    results = {**read_results(path), kept.label: kept}
    with atomic_path(path) as part:
        part.write_text(
            "".join(f"{format_result(each)}\n" for each in results.values()),
            encoding="utf-8",
        )


def read_results(path: Path) -> dict[str, KeptResult]:
    """Return the results in a file by the names of their tasks; none without a file.

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
            f"{path} is no file of results ({error!r}); allowed are files that eskin "
            "compare and eskin study keep; delete it, and its results are made again"
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
    return KeptResult(
        facts["label"],
        facts["digest"],
        MethodResult(result["method"], result["seed"], result["seconds"], answered),
    )
