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
"""Sides of each kind of pair: the first has the gesture; on the second it is none."""

SIDES: tuple[Side, ...] = ("bent", "flat", "folded", "apart")
"""All sides; each has a folder of its own."""

SIDE_SKINS: dict[str, str] = {"bent": "bent", "flat": "flat"}
"""Presets of the sides that have a skin of their own."""

SOURCE_SKINS = {"flat": "bent"}
"""Preset on which a side's counts are made, where that is not its own."""

NONE_KINDS = {"grab": "press", "double_pat": "single_pat"}
"""Kind of `none` that has the counts of a gesture on the other side."""


@dataclass(frozen=True)
class PairPlace:
    """This class tells where a clip stands among the pairs of its set."""

    number: int
    """Number of the pair among those of its kind."""
    side: Side
    """Side of the pair."""
    gesture: str
    """Gesture of the pair's first clip."""

    @property
    def kind(self) -> PairKind:
        """Return the kind of pair."""
        return find_pair_kind(self.side)

    @property
    def is_second(self) -> bool:
        """Tell whether the clip is the one labelled `none`."""
        return self.side == PAIR_SIDES[self.kind][1]


def parse_pair_kind(name: str) -> PairKind:
    """Return the kind of pair of a name.

    Raises:
        ValueError: there is none.
    """
    for kind in PAIR_SIDES:
        if kind == name:
            return kind
    raise ValueError(f"no pairs of '{name}'; allowed are {', '.join(PAIR_SIDES)}")


def find_pair_kind(side: Side) -> PairKind:
    """Return the kind of pair that a side is of."""
    return "bending" if side in PAIR_SIDES["bending"] else "merging"


Seed = tuple[int, ...]
"""Entropy of `np.random.SeedSequence`; no two of a set are the same."""


def build_rng(seed: Seed) -> np.random.Generator:
    """Build a fresh generator, which draws the same every time."""
    return np.random.default_rng(np.random.SeedSequence(seed))


ACCIDENTS, QUIET = "accidents", "quiet"
"""Kinds of streams: of nothing but accidental contacts, and without any contact."""


@dataclass(frozen=True)
class Origin:
    """An origin names something that is drawn from a seed of its own."""

    name: str
    """Name in recordings."""
    seed: Seed
    """Seed that it is drawn from."""

    def rng(self) -> np.random.Generator:
        """Return a fresh generator, which draws the same every time."""
        return build_rng(self.seed)


@dataclass(frozen=True)
class BuildOrigin(Origin):
    """A build origin names a sensor build that is drawn from a seed of its own."""

    kind: Literal["fresh", "shifted"]
    """Laws that it is drawn from."""


@dataclass(frozen=True)
class ClipPlan:
    """A clip plan holds everything needed to make one clip or stream alone."""

    set_name: str
    """Name of the set."""
    seed: Seed
    """Seed of all that is drawn for this clip alone."""
    person: Origin
    """Person who touches."""
    company: Origin | None
    """Person who may touch at the same time; None where there is no other."""
    build: BuildOrigin
    """Build of the sensor."""
    session: Origin
    """Origin of what stays the same while the skin is attached once, such as the drift
    of the gains since the build was made."""
    at: float
    """Start of the clip since that of the session [s]."""
    seconds: float
    """Length of the clip [s]."""
    gesture: str | None
    """Gesture, `none` or an unknown gesture; None draws one after the other, as in a
    stream."""
    kind: str | None
    """Variant; None draws it. Of a stream, `ACCIDENTS` or `QUIET`; None is a stream of
    all that people do."""
    groups: tuple[int, ...]
    """Pose groups that the pose is drawn from."""
    pose: Seed | None
    """Seed of the pose, where clips share it; None draws it for this clip alone."""
    moving: bool
    """Whether the robot moves."""
    fold_share: float
    """Chance of a pose where patches of two links meet."""
    concurrent: float
    """Chance of a second touch at the same time."""
    difficulty: float
    """Factor by which spreads widen and rare variants gain; 0 is the easiest."""
    regime: Literal["paper", "cost"] | None
    """Law of durations; None draws it."""
    pair: PairPlace | None = None
    """Place among pairs with the same counts; None is of no pair."""

    def rng(self) -> np.random.Generator:
        """Return a fresh generator of what is drawn for this clip alone."""
        return build_rng(self.seed)
