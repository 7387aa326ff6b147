"""What to say of a touch, and when: once, when sure, at closing at the latest."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

import numpy as np
from jaxtyping import Float

from eskin.model import DecisionConfig
from eskin.recording.labels import NONE
from eskin.units import NS_PER_S

UNKNOWN = "unknown"
"""Said of a touch that is like nothing in the vocabulary."""


@runtime_checkable
class Audible(Protocol):
    """What is to be known of a touch: a `Touch`, or the row that records it."""

    @property
    def id(self) -> int:
        """Its number."""
        ...

    @property
    def onset(self) -> int:
        """Stamp of its first contact [ns since the epoch]."""
        ...

    @property
    def last(self) -> int:
        """Stamp of its last contact so far [ns since the epoch]."""
        ...

    @property
    def merged_into(self) -> int | None:
        """The touch that it turned out to be a part of; None or 0 if of none."""
        ...


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is to be said of a touch now."""

    touch: int
    """Id of the touch."""

    gesture: str
    """One of the vocabulary, or `unknown`."""

    confidence: float
    """Calibrated probability of the likeliest gesture."""

    onset: int
    """When it began [ns since the epoch]."""

    likeliest: str = ""
    """The likeliest gesture where it is unknown."""


@dataclass
class Hearing:
    """What is known of one open touch."""

    onset: int
    said: str | None = None
    leader: int = -1
    since: int = 0
    other_since: int | None = None
    latest: list[float] | None = None


@final
class Decider:
    """Says one thing of every touch; stateful.

    1. While a touch is open, a gesture other than `none` is said once its probability
       has been above its threshold for the whole of `hold_seconds`; the threshold may
       be lower without contact.
    2. When it closes and nothing has been said, the likeliest class at its last reading
       is said, be it `none`; or `unknown` where that is below `least`. By then it is
       known that no further contact came.
    3. A touch that takes another over is spoken for if either has been spoken of.
    4. On a skin that is not calibrated, contact may never end, under a tight sleeve
       say. There a touch ends once another class than the one that was said of it,
       or `none`, has been likeliest for the whole of `hold_seconds`; another begins
       only with contact after that. Its last word is of its last contact: what comes
       after that may be of the next touch.
    """

    def __init__(
        self,
        vocabulary: tuple[str, ...],
        config: DecisionConfig | None = None,
        change_ends: bool = False,
    ) -> None:
        """Start without touches.

        Args:
            vocabulary: classes in the order of the probabilities.
            config: how sure is sure.
            change_ends: whether the fourth rule holds.

        Raises:
            ValueError: a threshold is of no gesture in the vocabulary.
        """
        self.vocabulary = vocabulary
        self.config = config or DecisionConfig()
        self.thresholds = thresholds_of(vocabulary, self.config)
        self.lifted = [
            every if math.isinf(every) else min(every, self.config.lifted)
            for every in self.thresholds
        ]
        self.lift = round(self.config.lift_seconds * NS_PER_S)
        self.hold = round(self.config.hold_seconds * NS_PER_S)
        self.change_ends = change_ends
        self.hearings: dict[int, Hearing] = {}

    def push(
        self,
        stamp: int,
        touches: Sequence[Audible],
        closed: Sequence[Audible],
        probabilities: Mapping[int, Float[np.ndarray, "class"]],
    ) -> list[Verdict]:
        """What there is to say at the next reading.

        Args:
            stamp: of the reading [ns since the epoch].
            touches: those that are open.
            closed: those that have just closed.
            probabilities: of every open touch, by its id.
        """
        verdicts = self.close(closed)
        for touch in touches:
            hearing = self.hearings.get(touch.id)
            if hearing is None:
                hearing = self.hearings[touch.id] = Hearing(touch.onset)
            # Plain numbers: arrays of a few cost more to look at one by one.
            chances: list[float] = probabilities[touch.id].tolist()
            if self.change_ends and self.is_over(hearing, stamp, chances):
                start_anew(hearing, touch, stamp)
            verdict = self.hear(hearing, touch, stamp, chances)
            if verdict is not None:
                verdicts.append(verdict)
        return verdicts

    def is_over(self, hearing: Hearing, stamp: int, probabilities: list[float]) -> bool:
        """Whether another class has been likeliest for long enough."""
        leader = self.vocabulary[likeliest(probabilities)]
        if leader != NONE and hearing.said in (None, leader):
            hearing.other_since = None
            return False
        if hearing.other_since is None:
            hearing.other_since = stamp
        return stamp - hearing.other_since >= self.hold

    def hear(
        self,
        hearing: Hearing,
        touch: Audible,
        stamp: int,
        probabilities: list[float],
    ) -> Verdict | None:
        """Take in the probabilities of an open touch."""
        if touch.last == stamp or not self.change_ends:
            hearing.latest = probabilities
        leader = likeliest(probabilities)
        is_lifted = stamp - touch.last >= self.lift
        threshold = (self.lifted if is_lifted else self.thresholds)[leader]
        sure = probabilities[leader] >= threshold
        if leader != hearing.leader or not sure:
            hearing.leader, hearing.since = leader if sure else -1, stamp
        held = hearing.leader >= 0 and stamp - hearing.since >= self.hold
        felt = touch.last >= hearing.onset
        if hearing.said is not None or not held or not felt:
            return None
        hearing.said = self.vocabulary[leader]
        return Verdict(touch.id, hearing.said, probabilities[leader], hearing.onset)

    def close(self, closed: Sequence[Audible]) -> list[Verdict]:
        """What there is to say of touches that have closed."""
        verdicts = []
        for touch in closed:
            hearing = self.hearings.pop(touch.id, Hearing(touch.onset))
            if touch.merged_into:
                new = Hearing(touch.onset)
                heir = self.hearings.setdefault(touch.merged_into, new)
                heir.said = heir.said or hearing.said
            elif hearing.said is None and hearing.latest is not None:
                verdicts.append(self.last_word(touch, hearing, hearing.latest))
        return verdicts

    def last_word(
        self,
        touch: Audible,
        hearing: Hearing,
        probabilities: list[float],
    ) -> Verdict:
        """What is said of a touch at closing."""
        leader = likeliest(probabilities)
        confidence = probabilities[leader]
        gesture = self.vocabulary[leader]
        if confidence >= self.config.least:
            return Verdict(touch.id, gesture, confidence, hearing.onset)
        return Verdict(touch.id, UNKNOWN, confidence, hearing.onset, gesture)


def start_anew(hearing: Hearing, touch: Audible, stamp: int) -> None:
    """End what was heard of a touch: what it feels from now on is another one.

    A touch without contact of which nothing was said still waits for its last word.
    """
    if hearing.said is not None or touch.last == stamp:
        hearing.onset, hearing.said, hearing.latest = stamp, None, None


def likeliest(probabilities: list[float]) -> int:
    """The first of the classes that none is likelier than."""
    return probabilities.index(max(probabilities))


def thresholds_of(vocabulary: tuple[str, ...], config: DecisionConfig) -> list[float]:
    """The threshold of each class while a touch is open; `none` waits for its end."""
    strange = sorted(set(config.thresholds) - set(vocabulary))
    if strange:
        raise ValueError(
            f"threshold of '{strange[0]}', which the model does not know; allowed are "
            f"{', '.join(vocabulary)}; correct the name"
        )
    every = dict.fromkeys(vocabulary, config.threshold) | dict(config.thresholds)
    every[NONE] = math.inf
    return [every[name] for name in vocabulary]
