"""What methods answered, kept in files so that each is trained once only."""

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
"""Of results; raised whenever a method is changed that its settings do not tell of."""


@dataclass(frozen=True)
class AnsweredClips:
    """What a method answered to some clips."""

    truth: tuple[str, ...]
    """What each was made for."""

    answer: tuple[str, ...]
    """What was answered."""

    people: tuple[str, ...]
    """Who made each."""

    @property
    def right(self) -> Bool[np.ndarray, "clip"]:
        """Which answers are right."""
        return np.array(self.truth) == np.array(self.answer)


@dataclass(frozen=True)
class MethodResult:
    """What came of one method that learned once."""

    method: str
    """Its name."""

    seed: int
    """That decided what was drawn."""

    seconds: float
    """Time that it took to learn and to answer [s]."""

    answered: Mapping[str, AnsweredClips]
    """By the name of what was asked: `val`, and the tests."""


@final
@dataclass(frozen=True)
class TrainingTask:
    """One method to be trained once, and what it is asked then."""

    name: str
    """Of the method."""

    method: Method
    """That learns."""

    train: Examples
    """To learn from, but for what is held out to validate on."""

    tests: Mapping[str, Examples]
    """To answer, by name."""

    seed: int
    """Decides everything that is drawn."""

    share: float = 0.2
    """Share of the recordings held out."""

    @property
    def key(self) -> str:
        """Names what decides the result, so that a file of that name is the result."""
        tests = {name: each.digest for name, each in self.tests.items()}
        facts = f"{FORMAT} {PipelineConfig()} {self.method} {self.train.digest} "
        facts += f"{tests} {self.seed} {self.share}"
        short = hashlib.sha256(facts.encode()).hexdigest()[:12]
        return f"{self.name}-{self.seed}-{short}"

    def is_done(self, folder: Path) -> bool:
        """Whether there is a file of the result."""
        return self.file(folder).exists()

    def file(self, folder: Path) -> Path:
        """Where the result is kept."""
        return folder / f"{self.key}.json"

    def done(self, folder: Path) -> MethodResult:
        """The result from its file, which is made where it is not there yet."""
        path = self.file(folder)
        if path.exists():
            return read_result(path)
        result = self.run()
        folder.mkdir(parents=True, exist_ok=True)
        write_result(path, result)
        return result

    def run(self) -> MethodResult:
        """Learn and answer."""
        started = time.monotonic()
        learned, held = split_examples(self.train, self.share)
        answers = self.method.fit(learned, self.seed)
        asked = {"val": held, **self.tests} if held.every else self.tests
        answered = {}
        for name, examples in asked.items():
            # Windows of many tests at once are more than memory holds.
            said = answers(replace(examples)).argmax(axis=1)
            answered[name] = AnsweredClips(
                truth=tuple(clip.gesture for _, clip in examples.every),
                answer=tuple(learned.gestures[n] for n in said.tolist()),
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
    """The results of tasks, in their order; what has a file is not done again.

    Args:
        tasks: to do, in the order given.
        folder: where results are kept.
        workers: how many processes do them.
        seconds: after how long no further task is begun [s].

    Returns:
        None in place of what was not begun any more.
    """
    end = time.monotonic() + seconds
    jobs = (delayed(run_before)(task, folder, end) for task in tasks)
    found: Any = Parallel(n_jobs=workers, return_as="generator")(jobs)
    return list(track_progress(found, "Comparing", len(tasks)))


def run_before(task: TrainingTask, folder: Path, end: float) -> MethodResult | None:
    """The result of a task, if it can be begun before a time on this machine."""
    torch.set_num_threads(1)
    if not task.is_done(folder) and time.monotonic() > end:
        return None
    return task.done(folder)


def split_examples(examples: Examples, share: float) -> tuple[Examples, Examples]:
    """Whole sittings held out to validate on, the same ones for every method.

    Returns:
        What is learned from, and what is held out.
    """
    made: dict[int, set[str]] = {}
    for n, clip in examples.every:
        made.setdefault(n, set()).add(clip.gesture)
    rng = np.random.default_rng(0)
    found = hold_out(examples.sittings, made, share, rng)
    return examples.only(found.train), examples.only(found.held)


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
        EskinError: if it is damaged.
    """
    try:
        return parse_result(path.read_text(encoding="utf-8"))
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise EskinError(
            f"{path} is no result ({error!r}); allowed are files that eskin compare "
            "and eskin study keep; delete it, and it is made again"
        ) from None


def parse_result(text: str) -> MethodResult:
    """The result that a file holds."""
    facts = json.loads(text)
    answered = {
        name: AnsweredClips(**{key: tuple(text.split()) for key, text in each.items()})
        for name, each in facts["answered"].items()
    }
    return MethodResult(facts["method"], facts["seed"], facts["seconds"], answered)
