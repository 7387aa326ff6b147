"""How far long work has come, for who watches a terminal."""

from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import track

T = TypeVar("T")


def shown(items: Iterable[T], what: str, total: int) -> Iterator[T]:
    """The same items; until the last, a bar stands on the terminal if there is one.

    Args:
        items: as they get ready.
        what: is done.
        total: how many there are.
    """
    console = Console(stderr=True)
    silent = not console.is_terminal
    yield from track(
        items, what, total, console=console, transient=True, disable=silent
    )
