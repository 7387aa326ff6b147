"""This module generates sets of clips, with any number of processes."""

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
from functools import lru_cache, partial
from multiprocessing import parent_process
from multiprocessing.connection import wait
from multiprocessing.synchronize import Event
from pathlib import Path

from eskin.errors import GenerationError
from eskin.files import atomic_path
from eskin.sim.dataset.clip_generator import ClipGenerator, SimulatorFactory
from eskin.sim.dataset.devices import DeviceFactory
from eskin.sim.dataset.index import INDEX_NAME, ClipRow, to_text
from eskin.sim.dataset.plan import SessionPlan
from eskin.sim.dataset.session_file import write_session
from eskin.sim.dataset.sets import DEVICES
from eskin.sim.dataset.settings import SETTINGS_NAME, GenerationSettings, claim_folder


class SetFolder:
    """A set folder receives complete files and index lines, in the set's order."""

    def __init__(self, folder: Path, sessions: Sequence[SessionPlan]) -> None:
        """Open the folder without changing anything in it."""
        self.folder = folder
        self.sessions = tuple(sessions)
        self.index = folder / INDEX_NAME

    def resume(self) -> int:
        """Remove incomplete files; return the number of complete ones.

        A file is complete if it exists, the index has a line for each of its clips, and
        all files before it are complete.
        """
        kept = done = 0
        for session_plan in self.sessions:
            size = self.find_index_size(session_plan, kept)
            if size is None:
                break
            kept = kept + size
            done = done + 1
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

    def find_index_size(self, session_plan: SessionPlan, start: int) -> int | None:
        """Return the bytes of a file's index lines, or None if it is incomplete."""
        if not (self.index.exists() and (self.folder / session_plan.file).exists()):
            return None
        begin = f'{{"file": "{session_plan.file}", "number": '.encode()
        size = 0
        with self.index.open("rb") as file:
            file.seek(start)
            for number in range(session_plan.clips):
                line = file.readline()
                complete = line[-1:] == b"\n"
                if not (complete and line.startswith(begin + b"%d," % number)):
                    return None
                size += len(line)
        return size

    def append_rows(self, rows: Sequence[ClipRow]) -> None:
        """Append the rows of the next file, which exists already, to the index."""
        with self.index.open("a", encoding="utf-8") as file:
            file.write(to_text(rows))
            file.flush()
            os.fsync(file.fileno())


stop_events: list[Event] = []
"""Event that stops this worker process; empty in the main process."""


def start_worker(stop: Event) -> None:
    """Prepare a worker, which ends with its parent process."""
    stop_events[:] = [stop]
    threading.Thread(target=exit_with_parent, daemon=True).start()


def exit_with_parent() -> None:
    """Wait for the parent process to end, then exit at once."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def check_stopped() -> None:
    """Raise an error if the parent process stopped the generation."""
    if any(stop.is_set() for stop in stop_events):
        raise GenerationError("generation was stopped")


@lru_cache(maxsize=1)
def get_generator(factory: Callable[[str], ClipGenerator], skin: str) -> ClipGenerator:
    """Return the clip generator of a skin, built once per process."""
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
"""Files per process that are being written or wait for their turn in the index."""

Rows = Generator[tuple[ClipRow, ...], None, None]


WriteSessions = Callable[..., Rows]
"""Function that writes files of sessions and yields their rows in order; it is called
as `write_sessions`, but for the number of workers."""


@dataclass(frozen=True)
class GenerationResult:
    """A generation result holds counts of what was generated."""

    clips: int
    """Clips in the folder."""
    made: int
    """Clips that were generated now."""
    files: int
    """Recordings in the folder."""
    seconds: float
    """Duration of the generation [s]."""

    @property
    def clips_per_minute(self) -> float:
        """Return the number of clips generated per minute."""
        return 60 * self.made / self.seconds if self.made else 0.0


def generate(
    folder: Path | str,
    settings: GenerationSettings,
    workers: int = 0,
    factory: Callable[[str], ClipGenerator] | None = None,
    on_progress: Callable[[int], None] = lambda done: None,
    write: WriteSessions | None = None,
) -> GenerationResult:
    """Generate a set, or the part of it that is missing.

    Complete files are kept, even after an error, and are not generated again. Neither
    recordings nor index depend on the number of workers.

    Args:
        folder: folder of the set; created if it is missing.
        settings: settings of the set.
        workers: number of processes; 0 uses the calling one.
        factory: function that builds the clip generator of a skin; must be importable
            by other processes; None builds the simulator of the set.
        on_progress: function that is called with the number of complete clips.
        write: function that writes sessions elsewhere, as `open_cluster` yields it;
            None uses processes of this computer.

    Raises:
        GenerationError: the folder holds something else, or a clip cannot be made.
    """
    if workers < 0:
        raise ValueError(f"{workers} workers requested; allowed are 0 and above")
    started = time.monotonic()
    folder = Path(folder)
    if factory is None and settings.set_name == DEVICES:
        factory = DeviceFactory(settings.recorded)
    factory = factory or SimulatorFactory(settings.robot, settings.recorded)
    claim_folder(folder, settings)
    with lock_folder(folder):
        archive = SetFolder(folder, settings.sessions)
        done = archive.resume()
        kept = sum(session_plan.clips for session_plan in settings.sessions[:done])
        missing = settings.sessions[done:]
        made = 0
        on_progress(kept)
        if write is None:
            write = partial(write_sessions, workers=workers)
        written = write(folder, settings, missing, factory=factory)
        try:
            with closing(written):
                for rows in written:
                    archive.append_rows(rows)
                    made += len(rows)
                    on_progress(kept + made)
        except BaseException:
            archive.resume()
            raise
    files = len(settings.sessions)
    seconds = time.monotonic() - started
    return GenerationResult(kept + made, made, files, seconds)


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock the folder, or raise an error if another process generates there."""
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
    """Write the files of sessions; yield their rows in order.

    Files that are not yet yielded are bounded in number.
    """
    workers = min(workers, len(sessions))
    if not workers:
        for session_plan in sessions:
            yield write_file(folder, settings, session_plan, factory)
        return
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    left = deque(sessions)
    waiting = deque[Future]()
    pool = ProcessPoolExecutor(workers, context, start_worker, (stop,))
    try:
        while left or waiting:
            while left and len(waiting) < PENDING_PER_WORKER * workers:
                task = (folder, settings, left.popleft(), factory)
                with start_workers():
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
def start_workers() -> Iterator[None]:
    """Start processes in this block with one thread, which Ctrl-C does not reach.

    There may be one on every core; the main process ends them.
    """
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
