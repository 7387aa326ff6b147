"""What to say of a touch, and when: once, when sure, at closing at the latest."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.recording.labels import NONE
from eskin.touch import Touch

NANOSECONDS = 1_000_000_000
UNKNOWN = "unknown"
"""Said of a touch that is like nothing in the vocabulary."""


@dataclass(frozen=True)
class DecisionConfig:
    """How sure is sure."""

    threshold: float = 0.8
    """Probability from which a gesture is said while the touch goes on."""

    thresholds: Mapping[str, float] = field(default_factory=dict)
    """The same for single gestures, in place of `threshold`; above 1 waits for the
    touch to close."""

    hold_seconds: float = 0.06
    """How long it must stay above [s]."""

    least: float = 0.3
    """Probability below which a touch that closes is unknown; 0 never abstains."""

    rearm_seconds: float = 0.2
    """On a skin that may press on itself for ever: how long `none` must be likeliest
    until what follows is another touch [s]."""

    still: float = 0.02
    """Travel below which a touch has no direction [m]."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is to be said of a touch now."""

    touch: Touch
    """The touch, as it is known now."""

    gesture: str
    """One of the vocabulary, or `unknown`."""

    confidence: float
    """Calibrated probability of the likeliest gesture."""

    onset: int
    """When it began [ns since the epoch]."""


@dataclass
class Hearing:
    """What is known of one open touch."""

    onset: int
    said: bool = False
    leader: int = -1
    since: int = 0
    quiet_since: int | None = None
    latest: Float[np.ndarray, "class"] | None = None


@final
class Decider:
    """Says one thing of every touch; stateful.

    1. While a touch is open, a gesture other than `none` is said once its probability
       has been above its threshold for the whole of `hold_seconds`.
    2. When it closes and nothing has been said, the likeliest class at its last contact
       is said, be it `none`; or `unknown` where that is below `least`.
    3. A touch that takes another over is spoken for if either has been spoken of.
    4. On a skin that is not calibrated, contact may never end, under a tight sleeve
       say. There `none` ends a touch: once it has been the likeliest class for
       `rearm_seconds`, what follows is heard as a touch of its own.
    """

    def __init__(
        self,
        vocabulary: tuple[str, ...],
        config: DecisionConfig | None = None,
        none_ends: bool = False,
    ) -> None:
        """Start without touches.

        Args:
            vocabulary: classes in the order of the probabilities.
            config: how sure is sure.
            none_ends: whether the fourth rule holds.

        Raises:
            ValueError: a threshold is of no gesture in the vocabulary.
        """
        self.vocabulary = vocabulary
        self.config = config or DecisionConfig()
        self.thresholds = thresholds_of(vocabulary, self.config)
        self.hold = round(self.config.hold_seconds * NANOSECONDS)
        self.rearm = round(self.config.rearm_seconds * NANOSECONDS)
        self.none_ends = none_ends
        self.hearings: dict[int, Hearing] = {}

    def push(
        self,
        stamp: int,
        touches: tuple[Touch, ...],
        closed: tuple[Touch, ...],
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
            hearing = self.hearings.setdefault(touch.id, Hearing(touch.onset))
            if self.none_ends and self.is_over(hearing, stamp, probabilities[touch.id]):
                hearing = self.hearings[touch.id] = Hearing(stamp, quiet_since=0)
            verdict = self.hear(hearing, touch, stamp, probabilities[touch.id])
            if verdict is not None:
                verdicts.append(verdict)
        return verdicts

    def is_over(
        self, hearing: Hearing, stamp: int, probabilities: Float[np.ndarray, "class"]
    ) -> bool:
        """Whether `none` has been likeliest for long enough, and still is."""
        if self.vocabulary[int(probabilities.argmax())] != NONE:
            hearing.quiet_since = None
            return False
        if hearing.quiet_since is None:
            hearing.quiet_since = stamp
        return stamp - hearing.quiet_since >= self.rearm

    def hear(
        self,
        hearing: Hearing,
        touch: Touch,
        stamp: int,
        probabilities: Float[np.ndarray, "class"],
    ) -> Verdict | None:
        """Take in the probabilities of an open touch."""
        if touch.last == stamp or hearing.latest is None:
            hearing.latest = probabilities
        leader = int(probabilities.argmax())
        if leader != hearing.leader or probabilities[leader] < self.thresholds[leader]:
            sure = probabilities[leader] >= self.thresholds[leader]
            hearing.leader, hearing.since = leader if sure else -1, stamp
        held = hearing.leader >= 0 and stamp - hearing.since >= self.hold
        if hearing.said or not held:
            return None
        hearing.said = True
        confidence = float(probabilities[leader])
        return Verdict(touch, self.vocabulary[leader], confidence, hearing.onset)

    def close(self, closed: tuple[Touch, ...]) -> list[Verdict]:
        """What there is to say of touches that have closed."""
        verdicts = []
        for touch in closed:
            hearing = self.hearings.pop(touch.id, Hearing(touch.onset))
            if touch.merged_into is not None:
                new = Hearing(touch.onset)
                heir = self.hearings.setdefault(touch.merged_into, new)
                heir.said |= hearing.said
            elif not hearing.said and hearing.latest is not None:
                verdicts.append(self.last_word(touch, hearing, hearing.latest))
        return verdicts

    def last_word(
        self,
        touch: Touch,
        hearing: Hearing,
        probabilities: Float[np.ndarray, "class"],
    ) -> Verdict:
        """What is said of a touch at closing."""
        leader = int(probabilities.argmax())
        confidence = float(probabilities[leader])
        known = confidence >= self.config.least
        gesture = self.vocabulary[leader] if known else UNKNOWN
        return Verdict(touch, gesture, confidence, hearing.onset)


def thresholds_of(
    vocabulary: tuple[str, ...], config: DecisionConfig
) -> Float[np.ndarray, "class"]:
    """The threshold of each class while a touch is open; `none` waits for its end."""
    strange = sorted(set(config.thresholds) - set(vocabulary))
    if strange:
        raise ValueError(
            f"threshold of '{strange[0]}', which the model does not know; allowed are "
            f"{', '.join(vocabulary)}; correct the name"
        )
    every = dict.fromkeys(vocabulary, config.threshold) | dict(config.thresholds)
    every[NONE] = np.inf
    return np.array([every[name] for name in vocabulary])
