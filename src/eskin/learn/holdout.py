"""Which recordings are held out to validate on."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eskin.learn.dataset import Dataset


@dataclass(frozen=True)
class Holdout:
    """Recordings to train on and to validate on, by their indices."""

    train: frozenset[int]
    """To train on."""

    held: frozenset[int]
    """To validate on."""

    wanted: int
    """How many were asked for to validate on."""

    def __str__(self) -> str:
        """What is held out, and why it may be another number than asked for."""
        count = len(self.train) + len(self.held)
        text = f"{len(self.held)} of {count} recordings held out for validation"
        if len(self.held) == self.wanted:
            return text
        return (
            f"{text}, {self.wanted} asked for: sessions are held out whole, at most "
            "half of all, and no gesture altogether"
        )


def hold_out(
    sittings: Mapping[int, tuple[str, str]],
    made: Mapping[int, set[str]],
    share: float,
    rng: np.random.Generator,
) -> Holdout:
    """Hold out whole sessions of a person; single recordings where there is only one.

    What is held out leaves every class something to train on.

    Args:
        sittings: person and session of each recording to divide, by its index.
        made: the classes that each recording has examples of.
        share: of the recordings to hold out.
        rng: draws the order.
    """
    order = rng.permutation(sorted(sittings)).tolist()
    wanted = round(share * len(order))
    train, held = frozenset(order), frozenset[int]()
    for group in group_sessions(sittings, order):
        fits = len(held) + len(group) <= wanted
        if wanted and not held:
            fits = fits or 2 * len(group) <= len(order)
        rest = train - group
        if fits and find_classes(rest, made) == find_classes(train, made):
            train, held = rest, held | group
    return Holdout(train, held, wanted)


def group_sessions(
    sittings: Mapping[int, tuple[str, str]], order: list[int]
) -> list[frozenset[int]]:
    """The recordings of each sitting; each alone where all are of one."""
    groups: dict[tuple[str, str], set[int]] = {}
    for index in order:
        groups.setdefault(sittings[index], set()).add(index)
    if len(groups) < 2:
        return [frozenset({index}) for index in order]
    return [frozenset(group) for group in groups.values()]


def find_classes(recordings: frozenset[int], made: Mapping[int, set[str]]) -> set[str]:
    """The classes that some recordings have examples of."""
    return {gesture for index in recordings for gesture in made.get(index, ())}


def find_sessions(
    dataset: Dataset, recordings: list[int]
) -> dict[int, tuple[str, str]]:
    """Person and session of some recordings."""
    metadata = {index: dataset.recordings[index].metadata for index in recordings}
    return {index: (facts.subject, facts.session) for index, facts in metadata.items()}


def find_gestures(dataset: Dataset, vocabulary: tuple[str, ...]) -> dict[int, set[str]]:
    """The classes that each recording has examples of."""
    made: dict[int, set[str]] = {}
    for segment in dataset.segments:
        if segment.gesture in vocabulary:
            made.setdefault(segment.recording, set()).add(segment.gesture)
    return made
