"""Whether an arm did what the touches on it asked for."""

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Literal, final

from eskin.live import Detection
from eskin.stream import Commanded
from eskin.units import NS_PER_S

GRACE = 1.0
"""A command counts for a touch until so long after the touch's end [s]."""

Verdict = Literal["correct", "wrong", "missed"]


@dataclass
class Try:
    """A touch that asks for something."""

    gesture: str
    """What was done."""
    wanted: str
    """The action that it asks for."""
    begin: int
    """Stamp of its first contact [ns since the epoch]."""
    end: int | None = None
    """Stamp of its last contact; None while it goes on."""
    given: Commanded | None = None
    """The first command that was obeyed because of it."""
    refusals: list[Commanded] = field(default_factory=list)
    """What was understood but not obeyed, and why."""
    said: list[str] = field(default_factory=list)
    """What it was recognised as."""

    @property
    def verdict(self) -> Verdict:
        """What came of it."""
        if self.given is None:
            return "missed"
        return "correct" if self.given.action == self.wanted else "wrong"

    @property
    def lost(self) -> str:
        """Why it was not rightly obeyed, without the figures; empty where it was."""
        if self.verdict == "correct":
            return ""
        if self.refusals and self.given is None:
            return re.split(r"[:\d]", self.refusals[-1].why)[0].strip()
        others = [word for word in self.said if word != self.gesture]
        if others:
            return f"said to be {others[-1]}"
        return "the arm had changed meanwhile" if self.said else "nothing was said"

    @property
    def delay(self) -> float | None:
        """From its last contact to the command; negative if earlier [s]."""
        if self.given is None or self.end is None:
            return None
        return (self.given.stamp - self.end) / NS_PER_S

    def takes(self, stamp: int) -> bool:
        """Whether a command at that time counts for it."""
        over = self.end is not None and stamp > self.end + GRACE * NS_PER_S
        return self.begin <= stamp and not over


@final
@dataclass
class Score:
    """Touches that ask for something beside the commands that were obeyed.

    A command counts for the touch that it comes during, or within 1 s of whose end; the
    first of them is what the touch did. One more, or one without a touch, is a false
    alarm. That the arm is held, for whatever reason, is no command.
    """

    tries: list[Try] = field(default_factory=list)
    """All touches that ask for something, oldest first."""
    false_alarms: list[Commanded] = field(default_factory=list)
    """Commands that nobody gave."""
    commands: int = 0
    """All commands that were obeyed."""
    holds: int = 0
    """How often the arm was held without being asked."""

    def add(self, attempt: Try) -> None:
        """Begin a touch."""
        self.tries.append(attempt)

    def hear(self, command: Commanded) -> None:
        """Take in what was decided."""
        if not command.accepted:
            latest = self.latest(command.stamp)
            if latest is not None:
                latest.refusals.append(command)
            return
        if command.touch is None:
            self.holds += 1
            return
        self.commands += 1
        latest = self.latest(command.stamp)
        if latest is None or latest.given is not None:
            self.false_alarms.append(command)
        else:
            latest.given = command

    def note(self, detection: Detection) -> None:
        """Take in what was recognised."""
        latest = self.latest(detection.stamp)
        if latest is not None:
            latest.said.append(detection.gesture)

    def latest(self, stamp: int) -> Try | None:
        """The latest touch that a decision at that time counts for."""
        return next((t for t in reversed(self.tries) if t.takes(stamp)), None)

    def count(self, verdict: Verdict) -> int:
        """How many touches came to that."""
        return sum(attempt.verdict == verdict for attempt in self.tries)

    def lost(self) -> dict[str, int]:
        """Why touches were not rightly obeyed, and how many; most frequent first."""
        reasons = Counter(attempt.lost for attempt in self.tries)
        return {why: count for why, count in reasons.most_common() if why}

    def delays(self) -> list[float]:
        """From the end of each touch rightly obeyed to its command [s]."""
        return [
            attempt.delay
            for attempt in self.tries
            if attempt.verdict == "correct" and attempt.delay is not None
        ]
