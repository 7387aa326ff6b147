"""Feeding a target with one input after the other, and noting what must not happen."""

import random
import resource
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from benchmarks.fuzz.target import Target

LONGEST = 5.0
"""From here on an input hangs its reader [s]."""
MEMORY = 1 << 30
"""More than at the start that may be asked for [bytes]."""
PLACES = 2**40
"""Inputs that one seed can make."""


class HangError(BaseException):
    """An input took too long."""


@dataclass
class Outcome:
    """What came of the inputs."""

    inputs: int = 0
    accepted: int = 0
    seconds: float = 0.0
    grown: int = 0
    """How much more memory was resident at most than at the start [bytes]."""
    findings: dict[str, str] = field(default_factory=dict)
    """The first input of every kind of finding, by what was raised and where."""


def fuzz(target: Target, first: int, inputs: int, seed: int) -> Outcome:
    """Feed a target; input number n is the same whatever came before it."""
    outcome, start, before = Outcome(), time.monotonic(), resident_peak()
    with limits():
        for number in range(first, first + inputs):
            data = target.make(random.Random(seed * PLACES + number))
            outcome.inputs += 1
            try:
                signal.setitimer(signal.ITIMER_REAL, LONGEST)
                outcome.accepted += target.feed(data)
            except (Exception, HangError) as error:
                outcome.findings.setdefault(where(error), f"input {number}: {error!r}")
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
    outcome.seconds = time.monotonic() - start
    outcome.grown = resident_peak() - before
    return outcome


@contextmanager
def limits() -> Iterator[None]:
    """No hang, no more memory than allowed, and no warning goes unheard."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    old, hard = resource.getrlimit(resource.RLIMIT_AS)
    handler = signal.signal(signal.SIGALRM, hang)
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (old, hard))
        signal.signal(signal.SIGALRM, handler)


def hang(number: int, frame: FrameType | None) -> None:
    """What the alarm does."""
    raise HangError(f"more than {LONGEST:g} s")


def where(error: BaseException) -> str:
    """What was raised, and the last places of ours on the way to it."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f"{Path(x.filename).name}:{x.lineno}" for x in frames if ours_is(x)]
    return f"{type(error).__name__} from {' > '.join(ours[-3:])}"


def ours_is(frame: traceback.FrameSummary) -> bool:
    """Whether it is a line of eskin, or of these benchmarks."""
    return "eskin" in frame.filename or "benchmarks" in frame.filename


def resident_peak() -> int:
    """The most memory that was resident so far [bytes]."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
