"""This module decides which gesture of a touch to report, and when.

Each touch is reported once: as soon as a gesture is certain, at closing at the latest.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

import numpy as np
from jaxtyping import Float

from eskin.live.model_config import DecisionConfig
from eskin.recording.records import NONE
from eskin.units import NS_PER_S

UNKNOWN = "unknown"
"""Gesture reported where no class is probable enough."""


@runtime_checkable
class TouchLike(Protocol):
    """An object like this tells when a touch happens, as a `Touch` does."""

    @property
    def id(self) -> int:
        """Id of the touch."""
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
        """Id of the touch that it was merged into; None or 0 if it was not."""
        ...


@dataclass(frozen=True, eq=False)
class Decision:
    """A decision holds what is reported of a touch."""

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
class TouchEvidence:
    """Evidence accumulates over the readings of an open touch."""

    onset: int
    """When the touch began [ns since the epoch]."""
    gesture: str | None = None
    """Gesture that was reported, if any."""
    leader: int = -1
    """Likeliest class while it is above its threshold, or -1."""
    since: int = 0
    """Stamp since which it is the leader [ns since the epoch]."""
    other_since: int | None = None
    """Stamp since which a class other than the reported one is likeliest."""
    latest: list[float] | None = None
    """Probabilities for the decision at closing."""


@final
class DecisionFilter:
    """A filter turns probabilities into one decision for each touch; it is stateful.

    1. While a touch is open, a gesture other than `none` is reported once its
       probability has been above its threshold for the whole of `hold_seconds`; the
       threshold may be lower without contact.
    2. When it closes and nothing has been reported, the likeliest class at its last
       reading is reported, even `none`; or `unknown` where that is below `least`.
    3. A touch that merges into another counts as reported if either was reported.
    4. On a skin that is not calibrated, contact may never end, as under a tight sleeve.
       There a touch ends once another class than the reported one, or `none`, has been
       likeliest for the whole of `hold_seconds`; another touch begins only with contact
       after that. The decision at closing uses the probabilities at its last contact,
       since later readings may belong to the next touch.
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
            config: thresholds and times.
            change_ends: whether the fourth rule applies.

        Raises:
            ValueError: a threshold is of no gesture in the vocabulary.
        """
        self.vocabulary = vocabulary
        self.config = config or DecisionConfig()
        self.thresholds = build_thresholds(vocabulary, self.config)
        self.lifted = [
            threshold if math.isinf(threshold) else min(threshold, self.config.lifted)
            for threshold in self.thresholds
        ]
        self.lift = round(self.config.lift_seconds * NS_PER_S)
        self.hold = round(self.config.hold_seconds * NS_PER_S)
        self.change_ends = change_ends
        self.evidence: dict[int, TouchEvidence] = {}

    def push(
        self,
        stamp: int,
        touches: Sequence[TouchLike],
        closed: Sequence[TouchLike],
        probabilities: Mapping[int, Float[np.ndarray, "class"]],
    ) -> list[Decision]:
        """Return the decisions at the next reading.

        Args:
            stamp: stamp of the reading [ns since the epoch].
            touches: touches that are open.
            closed: touches that have just closed.
            probabilities: probabilities of every open touch, by its id.
        """
        decisions = self.close(closed)
        for touch in touches:
            evidence = self.evidence.get(touch.id)
            if evidence is None:
                evidence = self.evidence[touch.id] = TouchEvidence(touch.onset)
            # A list, since reading single elements of an array is slower.
            by_class: list[float] = probabilities[touch.id].tolist()
            if self.change_ends and self.has_changed(evidence, stamp, by_class):
                reset_evidence(evidence, touch, stamp)
            decision = self.update(evidence, touch, stamp, by_class)
            if decision is not None:
                decisions.append(decision)
        return decisions

    def has_changed(
        self, evidence: TouchEvidence, stamp: int, probabilities: list[float]
    ) -> bool:
        """Return whether another class has been likeliest for long enough."""
        leader = self.vocabulary[find_likeliest(probabilities)]
        if leader != NONE and evidence.gesture in (None, leader):
            evidence.other_since = None
            return False
        if evidence.other_since is None:
            evidence.other_since = stamp
        return stamp - evidence.other_since >= self.hold

    def update(
        self,
        evidence: TouchEvidence,
        touch: TouchLike,
        stamp: int,
        probabilities: list[float],
    ) -> Decision | None:
        """Update the evidence of an open touch, and return a decision if it is due."""
        if touch.last == stamp or not self.change_ends:
            evidence.latest = probabilities
        leader = find_likeliest(probabilities)
        is_lifted = stamp - touch.last >= self.lift
        threshold = (self.lifted if is_lifted else self.thresholds)[leader]
        certain = probabilities[leader] >= threshold
        if leader != evidence.leader or not certain:
            evidence.leader, evidence.since = leader if certain else -1, stamp
        held = evidence.leader >= 0 and stamp - evidence.since >= self.hold
        has_contact = touch.last >= evidence.onset
        if evidence.gesture is not None or not held or not has_contact:
            return None
        evidence.gesture = self.vocabulary[leader]
        return Decision(
            touch.id, evidence.gesture, probabilities[leader], evidence.onset
        )

    def close(self, closed: Sequence[TouchLike]) -> list[Decision]:
        """Return the decisions about touches that have closed."""
        decisions = []
        for touch in closed:
            evidence = self.evidence.pop(touch.id, TouchEvidence(touch.onset))
            if touch.merged_into:
                new = TouchEvidence(touch.onset)
                target = self.evidence.setdefault(touch.merged_into, new)
                target.gesture = target.gesture or evidence.gesture
            elif evidence.gesture is None and evidence.latest is not None:
                decisions.append(self.decide(touch, evidence.onset, evidence.latest))
        return decisions

    def decide(
        self, touch: TouchLike, onset: int, probabilities: list[float]
    ) -> Decision:
        """Return the decision about a touch at closing."""
        leader = find_likeliest(probabilities)
        confidence, gesture = probabilities[leader], self.vocabulary[leader]
        if confidence >= self.config.least:
            return Decision(touch.id, gesture, confidence, onset)
        return Decision(touch.id, UNKNOWN, confidence, onset, gesture)


def reset_evidence(evidence: TouchEvidence, touch: TouchLike, stamp: int) -> None:
    """Drop the evidence of a touch: later contact is treated as another touch.

    A touch without contact that was not reported still waits for its closing.
    """
    if evidence.gesture is not None or touch.last == stamp:
        evidence.onset, evidence.gesture, evidence.latest = stamp, None, None


def find_likeliest(probabilities: list[float]) -> int:
    """Return the first of the classes with the highest probability."""
    return probabilities.index(max(probabilities))


def build_thresholds(
    vocabulary: tuple[str, ...], config: DecisionConfig
) -> list[float]:
    """Return the threshold of each class while a touch is open; infinity for `none`."""
    unknown = sorted(set(config.thresholds) - set(vocabulary))
    if unknown:
        raise ValueError(
            f"threshold of '{unknown[0]}', which the model does not know; allowed are "
            f"{', '.join(vocabulary)}; correct the name"
        )
    thresholds = dict.fromkeys(vocabulary, config.threshold) | dict(config.thresholds)
    thresholds[NONE] = math.inf
    return [thresholds[name] for name in vocabulary]
