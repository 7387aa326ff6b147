"""Run targets of the fuzzer with one input after the other; collect the findings."""

import random
import resource
import signal
import sys
import time
import traceback
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from eskin.errors import EskinError


class Target(ABC):
    """Wraps a reader and generates its inputs."""

    @abstractmethod
    def __init__(self, folder: Path) -> None:
        """Create the valid inputs; files go into the folder."""

    @abstractmethod
    def make(self, rng: random.Random) -> bytes:
        """Return a mutated input, which depends only on the state of `rng`."""

    @abstractmethod
    def feed(self, data: bytes) -> bool:
        """Read an input and return whether it was accepted.

        Any exception raised here is a finding.
        """


def check_refusal(error: EskinError) -> None:
    """Check that the message of an error is one line that is not empty."""
    text = str(error)
    if not text or len(text.splitlines()) != 1:
        raise AssertionError(f"the message is not one line: {text!r:.300}") from error


LONGEST = 5.0
"""Time after which a reader counts as hung [s]."""
MEMORY = 1 << 30
"""Memory that may be allocated beyond that at the start [bytes]."""
PLACES = 2**40
"""Number of inputs per seed."""


class HangError(BaseException):
    """Raised when an input takes too long."""


@dataclass
class Outcome:
    """Holds the outcome of a run."""

    inputs: int = 0
    accepted: int = 0
    seconds: float = 0.0
    grown: int = 0
    """Growth of the peak resident memory since the start [bytes]."""
    findings: dict[str, str] = field(default_factory=dict)
    """First input of every kind of finding, by exception and place."""


def fuzz(target: Target, first: int, inputs: int, seed: int) -> Outcome:
    """Run a target; input number n does not depend on the inputs before it."""
    outcome = Outcome()
    start = time.monotonic()
    before = resident_peak()
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
    """Limit time and memory, and turn warnings into errors."""
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
    """Raise an error when the alarm rings."""
    raise HangError(f"more than {LONGEST:g} s")


def where(error: BaseException) -> str:
    """Describe an exception by its type and its last places in this project."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f"{Path(x.filename).name}:{x.lineno}" for x in frames if is_ours(x)]
    return f"{type(error).__name__} from {' > '.join(ours[-3:])}"


def is_ours(frame: traceback.FrameSummary) -> bool:
    """Return whether a frame is in eskin or in these lab."""
    return "eskin" in frame.filename or "lab" in frame.filename


def resident_peak() -> int:
    """Return the peak resident memory [bytes]."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
