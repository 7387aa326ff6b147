"""Plans decide everything about a clip before it is made."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

PairKind = Literal["bending", "merging"]
Side = Literal["bent", "flat", "folded", "apart"]

PAIR_SIDES: dict[PairKind, tuple[Side, Side]] = {
    "bending": ("bent", "flat"),
    "merging": ("folded", "apart"),
}
"""The gesture is on the first side; on the second, the same counts are none."""

SIDES: tuple[Side, ...] = ("bent", "flat", "folded", "apart")
"""All sides; each has a folder of its own."""

SIDE_SKINS: dict[str, str] = {"bent": "bent", "flat": "flat"}
"""Presets of the sides that have a skin of their own."""

SOURCE_SKINS = {"flat": "bent"}
"""The preset that a side's counts are made on, where that is not its own."""

NONE_KINDS = {"grab": "press", "double_pat": "single_pat"}
"""Kind of `none` that has the counts of a gesture on the other side."""


@dataclass(frozen=True)
class PairPlace:
    """Where a clip stands among the pairs of its set."""

    number: int
    """Which pair of its kind."""
    side: Side
    """Which of the two clips."""
    gesture: str
    """What the first clip of the pair shows."""

    @property
    def kind(self) -> PairKind:
        """What tells the two clips apart."""
        return find_pair_kind(self.side)

    @property
    def is_second(self) -> bool:
        """Whether it is the one that is `none`."""
        return self.side == PAIR_SIDES[self.kind][1]


def parse_pair_kind(name: str) -> PairKind:
    """The kind of pair of that name.

    Raises:
        ValueError: there is none.
    """
    for kind in PAIR_SIDES:
        if kind == name:
            return kind
    raise ValueError(f"no pairs of '{name}'; allowed are {', '.join(PAIR_SIDES)}")


def find_pair_kind(side: Side) -> PairKind:
    """The kind of pair that a side is of."""
    return "bending" if side in PAIR_SIDES["bending"] else "merging"


Seed = tuple[int, ...]
"""Entropy of `np.random.SeedSequence`; no two of a set are the same."""

ACCIDENTS, QUIET = "accidents", "quiet"
"""Kinds of streams: of nothing but accidental contacts, and without any contact."""


@dataclass(frozen=True)
class Origin:
    """Somebody or something that is drawn from a seed of its own."""

    name: str
    """How it is called in recordings."""
    seed: Seed
    """What it is drawn from."""

    def rng(self) -> np.random.Generator:
        """A fresh generator: drawing with it gives the same every time."""
        return np.random.default_rng(np.random.SeedSequence(self.seed))


@dataclass(frozen=True)
class BuildOrigin(Origin):
    """A sensor build that is drawn from a seed of its own."""

    kind: Literal["fresh", "shifted"]
    """Which laws it is drawn from."""


@dataclass(frozen=True)
class ClipPlan:
    """Everything needed to make one clip, or one stream, alone."""

    set_name: str
    """The set it belongs to."""
    seed: Seed
    """Decides all that is drawn for this clip alone."""
    person: Origin
    """Who touches."""
    company: Origin | None
    """Who else may touch at the same time; None where nobody else is there."""
    build: BuildOrigin
    """The sensor."""
    session: Origin
    """The sitting: decides what stays the same while the skin is attached once, such
    as the drift of the gains since the build was made."""
    at: float
    """Start of the clip since that of the sitting [s]."""
    seconds: float
    """Length of the clip [s]."""
    gesture: str | None
    """What is done: a gesture, `none` or an unknown gesture; None draws one after the
    other, as in a stream."""
    kind: str | None
    """Variant; None draws it. Of a stream, `ACCIDENTS` or `QUIET`; None is a stream of
    all that people do."""
    groups: tuple[int, ...]
    """Pose groups to take the pose from."""
    pose: Seed | None
    """Decides the pose, where clips share it; None draws it for this clip alone."""
    moving: bool
    """Whether the robot moves."""
    fold_share: float
    """Chance of a pose where patches of two links meet."""
    concurrent: float
    """Chance of a second touch at the same time."""
    difficulty: float
    """How far spreads are widened and rare ways preferred; 0 is the easiest."""
    regime: Literal["paper", "cost"] | None
    """How long touches last; None draws it."""
    pair: PairPlace | None = None
    """Where it stands among pairs with the same counts; None is of no pair."""

    def rng(self) -> np.random.Generator:
        """A fresh generator of what is drawn for this clip alone."""
        return np.random.default_rng(np.random.SeedSequence(self.seed))
