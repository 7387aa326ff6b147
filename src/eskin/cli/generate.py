"""`eskin generate`: simulated touches as recordings."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from eskin.sim.dataset.generate import generate
from eskin.sim.dataset.settings import GenerationSettings

SetName = Literal[
    "train",
    "val",
    "test-s",
    "test-p",
    "test-x",
    "test-m",
    "paper",
    "paper-5",
    "streams",
    "streams-fresh",
    "accidents",
    "quiet",
    "pairs",
]

SkinName = Literal[
    "ur5",
    "ur5-half",
    "ur5-double",
    "ur5-sparse",
    "ur5-dense",
    "ur5-shapes",
    "ur5-missing",
    "ur10",
    "base",
    "post",
]


@dataclass(frozen=True)
class Command:
    """Simulate people who touch a skin, and record them."""

    out: tyro.conf.Positional[Path]
    """Folder for the recordings and their index; the same command goes on where it
    stopped."""

    skin: SkinName = "ur5"
    """What is touched."""

    set: SetName = "train"
    """Which set of clips, or of streams."""

    clips: int | None = None
    """How many clips, or streams, or clips of each kind of pair; as many as the set has
    unless given."""

    subjects: int | None = None
    """How many people; as many as suit the clips unless given."""

    seed: int = 0
    """Decides everything that is drawn."""

    workers: int | None = None
    """How many processes; one a core unless given."""

    difficulty: float | None = None
    """How wide spreads are, 0 the easiest; the published one unless given."""


def run(command: Command) -> dict[str, object]:
    """Generate and return clips, seconds and clips a minute."""
    workers = os.cpu_count() or 1 if command.workers is None else command.workers
    if workers < 1:
        raise ValueError(f"--workers is {workers}; allowed are 1 and above; change it")
    settings = GenerationSettings(
        command.set,
        command.skin,
        command.seed,
        command.clips,
        command.subjects,
        command.difficulty,
    )
    with progress(settings.clip_set.clips) as tell:
        result = generate(command.out, settings, workers, tell=tell)
    rate = round(result.clips_per_minute, 1)
    print(
        f"{command.out}: {result.clips} clips in {result.files} recordings, "
        f"{result.made} of them made in {result.seconds:.1f} s, {rate} a minute"
    )
    return {
        "clips": result.clips,
        "made": result.made,
        "recordings": result.files,
        "seconds": round(result.seconds, 2),
        "clips_per_minute": rate,
    }


@contextmanager
def progress(total: int) -> Iterator[Callable[[int], None]]:
    """A bar on stderr that is told how many clips are done; none off a terminal."""
    console = Console(stderr=True)
    columns = BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(
        "clips", *columns, console=console, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("clips", total=total)
        yield lambda done: bar.update(task, completed=done)
