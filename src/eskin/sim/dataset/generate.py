"""This module generates sets of clips with any number of processes."""

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from fcntl import LOCK_EX, LOCK_NB, flock
from functools import lru_cache
from multiprocessing import parent_process
from multiprocessing.connection import wait
from multiprocessing.synchronize import Event
from pathlib import Path

from eskin.errors import GenerationError
from eskin.files import atomic_path
from eskin.sim.dataset.clip_generator import ClipGenerator, Simulator
from eskin.sim.dataset.index import INDEX_NAME, ClipRow, to_text
from eskin.sim.dataset.session_file import write_session
from eskin.sim.dataset.session_plan import SessionPlan
from eskin.sim.dataset.settings import SETTINGS_NAME, GenerationSettings, claim_folder


class SetFolder:
    """A set folder grows file by file in the set's order, and files are whole."""

    def __init__(self, folder: Path, sessions: Sequence[SessionPlan]) -> None:
        """Open the folder without changing what an earlier generation left."""
        self.folder = folder
        self.sessions = tuple(sessions)
        self.index = folder / INDEX_NAME

    def resume(self) -> int:
        """Remove incomplete files; return how many are complete.

        Files count as far as each exists and has a line of the index for every clip, in
        the order in which they were made.
        """
        kept = done = 0
        for session_plan in self.sessions:
            size = self.find_size(session_plan, kept)
            if size is None:
                break
            kept, done = kept + size, done + 1
        if self.index.exists():
            os.truncate(self.index, kept)
        else:
            with atomic_path(self.index, durable=True) as part:
                part.touch()
        for session_plan in self.sessions[done:]:
            path = self.folder / session_plan.file
            path.unlink(missing_ok=True)
            path.with_name(path.name + ".part").unlink(missing_ok=True)
        return done

    def find_size(self, session_plan: SessionPlan, start: int) -> int | None:
        """Return the bytes of a file's lines in the index; None if they are cut."""
        if not (self.index.exists() and (self.folder / session_plan.file).exists()):
            return None
        begin = f'{{"file": "{session_plan.file}", "number": '.encode()
        size = 0
        with self.index.open("rb") as file:
            file.seek(start)
            for number in range(session_plan.clips):
                line = file.readline()
                if not (
                    line.startswith(begin + b"%d," % number) and line[-1:] == b"\n"
                ):
                    return None
                size += len(line)
        return size

    def add(self, rows: Sequence[ClipRow]) -> None:
        """Append the clips of the next file, which exists already."""
        with self.index.open("a", encoding="utf-8") as file:
            file.write(to_text(rows))
            file.flush()
            os.fsync(file.fileno())


stop_events: list[Event] = []
"""Event at which this process stops its work."""


def start_worker(stop: Event) -> None:
    """Prepare this process: it ends with its parent, which alone handles Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stop_events[:] = [stop]
    threading.Thread(target=exit_with_parent, daemon=True).start()


def exit_with_parent() -> None:
    """Wait for the parent to be gone, then exit at once."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def check_stopped() -> None:
    """Raise if the parent asked to stop."""
    if any(stop.is_set() for stop in stop_events):
        raise GenerationError("generation was stopped")


@lru_cache(maxsize=1)
def get_generator(factory: Callable[[str], ClipGenerator], skin: str) -> ClipGenerator:
    """Return the clip generator of a skin, built once a process."""
    return factory(skin)


def write_file(
    folder: Path,
    settings: GenerationSettings,
    session_plan: SessionPlan,
    factory: Callable[[str], ClipGenerator],
) -> tuple[ClipRow, ...]:
    """Write one file."""
    generator = get_generator(factory, settings.find_skin(session_plan))
    return write_session(folder, settings, session_plan, generator, check_stopped)


THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
PENDING_PER_WORKER = 2
"""Files in work or waiting for their turn in the index, for each process."""

Rows = Generator[tuple[ClipRow, ...], None, None]


@dataclass(frozen=True)
class GenerationResult:
    """This result counts what was generated."""

    clips: int
    """Clips in the folder."""
    made: int
    """Clips among them that were not there before."""
    files: int
    """Recordings in the folder."""
    seconds: float
    """Time it took [s]."""

    @property
    def clips_per_minute(self) -> float:
        """Return the clips made in a minute."""
        return 60 * self.made / self.seconds if self.made else 0.0


def generate(
    folder: Path | str,
    settings: GenerationSettings,
    workers: int = 0,
    factory: Callable[[str], ClipGenerator] = Simulator,
    on_progress: Callable[[int], None] = lambda done: None,
) -> GenerationResult:
    """Generate a set, or what is missing of it.

    Complete files stay whatever happens, and are not made again. Neither recordings nor
    index depend on the number of workers.

    Args:
        folder: folder of the set; created if it is missing.
        settings: settings of the set.
        workers: number of processes; 0 works in this one.
        factory: function that builds the clip generator of a skin; other processes must
            find it by name.
        on_progress: function that is called with the number of clips that are done.

    Raises:
        GenerationError: the folder holds something else, or a clip cannot be made.
    """
    if workers < 0:
        raise ValueError(f"{workers} workers asked; allowed are 0 and above")
    started, folder = time.monotonic(), Path(folder)
    claim_folder(folder, settings)
    with lock_folder(folder):
        return generate_missing(
            folder, settings, workers, factory, on_progress, started
        )


def generate_missing(
    folder: Path,
    settings: GenerationSettings,
    workers: int,
    factory: Callable[[str], ClipGenerator],
    on_progress: Callable[[int], None],
    started: float,
) -> GenerationResult:
    """Generate what is missing in a folder."""
    archive = SetFolder(folder, settings.sessions)
    done = archive.resume()
    kept = sum(session_plan.clips for session_plan in settings.sessions[:done])
    missing = settings.sessions[done:]
    made = 0
    on_progress(kept)
    try:
        with closing(
            write_sessions(folder, settings, missing, workers, factory)
        ) as finished:
            for rows in finished:
                archive.add(rows)
                made += len(rows)
                on_progress(kept + made)
    except BaseException:
        archive.resume()
        raise
    files = len(settings.sessions)
    return GenerationResult(kept + made, made, files, time.monotonic() - started)


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock the folder against other generations.

    Raises:
        GenerationError: another one is running there.
    """
    with (folder / SETTINGS_NAME).open() as file:
        try:
            flock(file, LOCK_EX | LOCK_NB)
        except BlockingIOError as error:
            raise GenerationError(
                f"another eskin generate is writing to {folder}; wait until it is "
                "done, or give another folder"
            ) from error
        yield


def write_sessions(
    folder: Path,
    settings: GenerationSettings,
    sessions: Sequence[SessionPlan],
    workers: int,
    factory: Callable[[str], ClipGenerator],
) -> Rows:
    """Write the files of sessions; yield their rows in order."""
    workers = min(workers, len(sessions))
    if not workers:
        for session_plan in sessions:
            yield write_file(folder, settings, session_plan, factory)
        return
    yield from write_in_workers(folder, settings, sessions, workers, factory)


def write_in_workers(
    folder: Path,
    settings: GenerationSettings,
    sessions: Sequence[SessionPlan],
    workers: int,
    factory: Callable[[str], ClipGenerator],
) -> Rows:
    """Write files in other processes, a bounded number at a time; yield their rows."""
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    left, waiting = deque(sessions), deque[Future]()
    with limit_threads():
        pool = ProcessPoolExecutor(workers, context, start_worker, (stop,))
        try:
            while left or waiting:
                while left and len(waiting) < PENDING_PER_WORKER * workers:
                    task = (folder, settings, left.popleft(), factory)
                    waiting.append(pool.submit(write_file, *task))
                yield waiting.popleft().result()
        except BrokenProcessPool as error:
            raise GenerationError(
                "a worker died, perhaps for want of memory; run the same command "
                "again with fewer --workers to go on"
            ) from error
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def limit_threads() -> Iterator[None]:
    """Limit new processes to one thread each, since they are as many as the cores."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
