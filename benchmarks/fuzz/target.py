"""What is fed with mutated inputs: the abstract target."""

import random
from abc import ABC, abstractmethod
from pathlib import Path

from eskin.errors import EskinError


class Target(ABC):
    """A reader, and the inputs it is tried with."""

    @abstractmethod
    def __init__(self, folder: Path) -> None:
        """Make the valid inputs; files go into the folder."""

    @abstractmethod
    def make(self, rng: random.Random) -> bytes:
        """A mutated input; the same for the same state of `rng`."""

    @abstractmethod
    def feed(self, data: bytes) -> bool:
        """Let the reader read it; whether it was accepted.

        Whatever is raised here is a finding.
        """


def check_refusal(error: EskinError) -> None:
    """Hold an error to what users are promised: one line that says something."""
    text = str(error)
    if not text or len(text.splitlines()) != 1:
        raise AssertionError(f"the message is not one line: {text!r:.300}") from error
