"""This module finds touches that may be a stop before they are recognised."""

from dataclasses import dataclass
from typing import final

from eskin.command.actions import (
    HALTING_ACTIONS,
    STAND_CONFIDENCE,
    TOGGLES,
    required_confidence,
)
from eskin.command.command_map import NON_GESTURES, CommandMap
from eskin.live import UNKNOWN, Detection
from eskin.skin import Skin
from eskin.stream import RecognitionState


@dataclass(frozen=True)
class StopRules:
    """Stop rules tell, for each patch, which classes stop a working arm."""

    gestures: tuple[tuple[int, ...], ...]
    """Indices of the gestures in the vocabulary that stop the arm, by patch."""

    required: tuple[float, ...]
    """Least probability of them that the arm pauses for, by patch."""

    names: tuple[str, ...]
    """Names of the patches."""

    vocabulary: tuple[str, ...]
    """Classes in the order of the probabilities."""

    @classmethod
    def build(
        cls, commands: CommandMap, vocabulary: tuple[str, ...], skin: Skin
    ) -> "StopRules":
        """Find the rules of a command map that stop an arm at work."""
        gestures, required = [], []
        for patch in skin.patches:
            found: dict[int, float] = {}
            for index, gesture in enumerate(vocabulary):
                rule = commands.find_rule(gesture, patch.link, patch.id)
                if rule is None or gesture in NON_GESTURES:
                    continue
                action = rule.action_or_function
                action = TOGGLES.get(action, (action,))[0]
                if action in HALTING_ACTIONS:
                    found[index] = required_confidence(action, rule.confidence)
            gestures.append(tuple(found))
            required.append(min(found.values(), default=1.0))
        names = tuple(patch.id for patch in skin.patches)
        return cls(tuple(gestures), tuple(required), names, vocabulary)


@final
class PossibleStops:
    """Possible stops are open touches of which the recogniser cannot say yet.

    The chance of a touch is the probability that it is one of the gestures that stop
    the arm where it is. An arm stands for less of a chance than it pauses for, since it
    goes on by itself.

    Attributes:
        waiting: ids of the touches for which the arm stands until they are recognised.
        ended: ids of those among them that have just closed without being recognised,
            and whose chance suffices for a pause.
    """

    def __init__(self, rules: StopRules) -> None:
        """Start without touches."""
        self.rules = rules
        self.chances: dict[int, tuple[float, float]] = {}
        self.decided: set[int] = set()
        self.waiting: set[int] = set()
        self.ended: tuple[int, ...] = ()

    def update(
        self, recognition: RecognitionState, works: bool
    ) -> list[tuple[int, float]]:
        """Return the touches that the arm waits for from now on, with their chances.

        Args:
            recognition: next recognition state.
            works: whether the arm is at work; if not, it waits for no touch.
        """
        state, begun = recognition.state, []
        self.ended = ()
        for touch in state.closed:
            self.close(touch.id, touch.merged_into)
        if not state.open:
            return []
        for row in state.rows:
            probabilities = recognition.probabilities.get(row.id)
            if row.closed or not row.confirmed or probabilities is None:
                continue
            patch = int(state.records.contacts[row.contact]["patch"])
            gestures = self.rules.gestures[patch]
            chance = sum(float(probabilities[index]) for index in gestures)
            self.chances[row.id] = chance, self.rules.required[patch]
            if row.id in self.decided or row.id in self.waiting or not works:
                continue
            least = min(self.rules.required[patch], STAND_CONFIDENCE)
            if row.last == state.reading.stamp and chance >= least:
                self.waiting.add(row.id)
                begun.append((row.id, chance))
        return begun

    def close(self, touch: int, merged_into: int) -> None:
        """Forget a touch that has closed; what it merged into is waited for instead."""
        if touch in self.waiting:
            self.waiting.discard(touch)
            chance, required = self.chances.get(touch, (0.0, 1.0))
            if not merged_into and chance >= required:
                self.ended += (touch,)
            if merged_into and merged_into not in self.decided:
                self.waiting.add(merged_into)
        if merged_into and touch in self.decided:
            self.decided.add(merged_into)
        self.decided.discard(touch)
        self.chances.pop(touch, None)

    def add_detection(self, detection: Detection) -> None:
        """Note that a touch is decided: the arm no longer stands for it."""
        self.decided.add(detection.touch)
        self.waiting.discard(detection.touch)

    def find_chance(self, detection: Detection) -> float | None:
        """Return the chance that an unknown touch is a stop; None if it is too small.

        It is that of its latest reading, or its confidence if the likeliest gesture
        stops the arm.
        """
        rules = self.rules
        patch = rules.names.index(detection.patch)
        chance, required = self.chances.get(
            detection.touch, (0.0, rules.required[patch])
        )
        likely = [rules.vocabulary[index] for index in rules.gestures[patch]]
        if detection.gesture == UNKNOWN and detection.likeliest in likely:
            chance = max(chance, detection.confidence)
        return chance if chance >= required else None
