"""This module shows how far a long command is, and closes what was opened."""

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from time import monotonic
from typing import Self, TypeVar

T = TypeVar("T")
PERIOD = 10.0
"""Interval between two lines where the output is no terminal [s]."""


@contextmanager
def show_progress(
    what: str, total: int | None, done: int = 0, quiet: bool = False
) -> Iterator[Callable[[int], None]]:
    """Show on stderr how much is done; yield a function of the number that is done.

    Args:
        what: noun of the things that are counted, such as `clips`.
        total: number of all; None where it is not known.
        done: number that is done at the beginning.
        quiet: whether to show nothing.
    """
    if quiet:
        yield lambda number: None
        return
    # Most commands show none, and start faster without it.
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    if not console.is_terminal:
        with print_progress(what, total, done) as update:
            yield update
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=total, completed=done)
        yield lambda number: bar.update(task, completed=number)


@contextmanager
def print_progress(
    what: str, total: int | None, begun: int
) -> Iterator[Callable[[int], None]]:
    """Print a line every ten seconds; yield a function of the number that is done.

    A thread prints the lines, so that one comes while the first or the next takes long.

    Args:
        what: noun of the things that are counted.
        total: number of all; None where it is not known.
        begun: number that is done at the beginning.
    """
    start = monotonic()
    done = begun
    over = Event()

    def update(number: int) -> None:
        nonlocal done
        done = number

    def write_lines() -> None:
        while not over.wait(PERIOD):
            show_line(describe_progress(what, done, total, begun, monotonic() - start))

    thread = Thread(target=write_lines, name="eskin progress", daemon=True)
    thread.start()
    try:
        yield update
    finally:
        over.set()
        thread.join()


def describe_progress(
    what: str, done: int, total: int | None, begun: int, seconds: float
) -> str:
    """Describe how much is done, and how long the rest will take where that is known.

    Args:
        what: noun of the things that are counted.
        done: number that is done.
        total: number of all; None where it is not known.
        begun: number that was done at the beginning.
        seconds: time since the beginning [s].
    """
    if total is None:
        return f"{what}: {done}"
    if done == begun or done >= total:
        return f"{what}: {done} of {total}"
    left = seconds * (total - done) / (done - begun)
    return f"{what}: {done} of {total}, about {left:.0f} s left"


def show_line(text: str) -> None:
    """Show on stderr which part of a long command begins."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def track_progress(
    items: Iterable[T], what: str, total: int
) -> Generator[T, None, None]:
    """Yield the items, and show how many of all were taken.

    It shows that until it has ended or is closed. A variable keeps it open when its
    user raises, as long as the traceback is kept: give it a name in
    `with contextlib.closing` only.
    """
    with show_progress(what, total) as update:
        for number, item in enumerate(items, 1):
            yield item
            update(number)


class Closing(ABC):
    """Holds files, ports or threads until it is closed."""

    @abstractmethod
    def close(self) -> None:
        """Release all resources; a second call does nothing."""

    def __enter__(self) -> Self:
        """Return the object itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the object, whether or not an error occurred."""
        self.close()
