"""Define the abstract target of the fuzzer."""

import random
from abc import ABC, abstractmethod
from pathlib import Path

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
