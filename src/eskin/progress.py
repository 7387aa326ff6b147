"""This module shows how far a long command is, and closes what was opened."""

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Self, TypeVar

T = TypeVar("T")
PERIOD = 10.0
"""Interval between two lines where the output is no terminal [s]."""


@contextmanager
def show_progress(
    what: str, total: int, done: int = 0, quiet: bool = False
) -> Iterator[Callable[[int], None]]:
    """Show on stderr how much is done; yield a function of the number that is done.

    Args:
        what: what is counted, such as `clips`.
        total: number of all.
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
        yield print_progress(what, total, done)
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


def print_progress(
    what: str, total: int, begun: int, now: Callable[[], float] = monotonic
) -> Callable[[int], None]:
    """Return a function of the number done that prints a line every ten seconds.

    Args:
        what: what is counted.
        total: number of all.
        begun: number that is done at the beginning.
        now: clock [s].
    """
    start = last = now()

    def update(done: int) -> None:
        nonlocal last
        if (time := now()) - last < PERIOD or done >= total:
            return
        last = time
        left = (time - start) * (total - done) / max(done - begun, 1)
        line = f"{what}: {done} of {total}"
        line += f", about {left:.0f} s left" if done > begun else ""
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()

    return update


def track_progress(items: Iterable[T], what: str, total: int) -> Iterator[T]:
    """Yield the items, and show how many of all were taken."""
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
