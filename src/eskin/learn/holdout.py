"""This module chooses which recordings are held out for validation."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eskin.learn.dataset import Dataset


@dataclass(frozen=True)
class Holdout:
    """A holdout divides recordings, by their indices, into training and validation."""

    train: frozenset[int]
    """Recordings to train on."""
    held: frozenset[int]
    """Recordings to validate on."""
    wanted: int
    """Number of recordings that should be held out."""

    def __str__(self) -> str:
        """Return the number held out, and why it may differ from the one asked for."""
        count = len(self.train) + len(self.held)
        recordings = f"recording{'s' * (count != 1)}"
        text = f"{len(self.held)} of {count} {recordings} held out for validation"
        if len(self.held) == self.wanted:
            return text
        return (
            f"{text}, {self.wanted} asked for: sessions are held out whole, at most "
            "half of all recordings, and training keeps every gesture"
        )


def hold_out(
    sessions: Mapping[int, tuple[str, str]],
    gestures: Mapping[int, set[str]],
    share: float,
    rng: np.random.Generator,
) -> Holdout:
    """Hold out whole sessions of a person, or recordings if there is one session.

    Every class keeps recordings to train on.

    Args:
        sessions: person and session of each recording, by its index.
        gestures: classes that each recording has examples of.
        share: share of the recordings to hold out.
        rng: source of the random order.
    """
    order = rng.permutation(sorted(sessions)).tolist()
    wanted = round(share * len(order))
    train, held = frozenset(order), frozenset[int]()
    for group in group_sessions(sessions, order):
        fits = len(held) + len(group) <= wanted
        if wanted and not held:
            fits = fits or 2 * len(group) <= len(order)
        rest = train - group
        if fits and find_classes(rest, gestures) == find_classes(train, gestures):
            train, held = rest, held | group
    return Holdout(train, held, wanted)


def group_sessions(
    sessions: Mapping[int, tuple[str, str]], order: list[int]
) -> list[frozenset[int]]:
    """Return the recordings of each session; each alone if all are of one."""
    groups: dict[tuple[str, str], set[int]] = {}
    for index in order:
        groups.setdefault(sessions[index], set()).add(index)
    if len(groups) < 2:
        return [frozenset({index}) for index in order]
    return [frozenset(group) for group in groups.values()]


def find_classes(
    recordings: frozenset[int], gestures: Mapping[int, set[str]]
) -> set[str]:
    """Return the classes that some recordings have examples of."""
    return {gesture for index in recordings for gesture in gestures.get(index, ())}


def find_sessions(
    dataset: Dataset, recordings: list[int]
) -> dict[int, tuple[str, str]]:
    """Return person and session of some recordings."""
    metadata = [dataset.recordings[index].metadata for index in recordings]
    pairs = [(each.subject, each.session) for each in metadata]
    return dict(zip(recordings, pairs, strict=True))


def find_gestures(dataset: Dataset, vocabulary: tuple[str, ...]) -> dict[int, set[str]]:
    """Return the classes that each recording has examples of."""
    gestures: dict[int, set[str]] = {}
    for segment in dataset.segments:
        if segment.gesture in vocabulary:
            gestures.setdefault(segment.recording, set()).add(segment.gesture)
    return gestures
