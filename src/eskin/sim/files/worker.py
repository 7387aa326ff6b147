"""A process that makes files of a set."""

import os
import signal
import threading
from collections.abc import Callable
from functools import lru_cache
from multiprocessing import parent_process
from multiprocessing.connection import wait
from multiprocessing.synchronize import Event
from pathlib import Path

from eskin.errors import GenerationError
from eskin.sim.files.index import ClipRow
from eskin.sim.files.maker import Maker
from eskin.sim.files.settings import Settings
from eskin.sim.files.sitting import Sitting
from eskin.sim.files.sitting_file import write_sitting

stops: list[Event] = []
"""The event at which this process ends its work."""


def begin(stop: Event) -> None:
    """Prepare this process: it ends with its parent, which alone hears Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stops[:] = [stop]
    threading.Thread(target=end_with_parent, daemon=True).start()


def end_with_parent() -> None:
    """Wait for the parent to be gone, then leave at once."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def go_on() -> None:
    """Stop where the parent says so."""
    if any(stop.is_set() for stop in stops):
        raise GenerationError("generation was stopped")


@lru_cache(maxsize=1)
def maker_of(factory: Callable[[str], Maker], skin: str) -> Maker:
    """The maker of a skin, prepared once a process."""
    return factory(skin)


def work(
    folder: Path,
    settings: Settings,
    sitting: Sitting,
    factory: Callable[[str], Maker],
) -> tuple[ClipRow, ...]:
    """Write one file."""
    maker = maker_of(factory, settings.skin_of(sitting))
    return write_sitting(folder, settings, sitting, maker, go_on)
