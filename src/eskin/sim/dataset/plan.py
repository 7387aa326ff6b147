"""Clip plans define everything about a clip before it is simulated."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from eskin.sim.sensor.build import BuildKind

PairKind = Literal["bending", "merging"]
Side = Literal["bent", "flat", "folded", "apart"]

PAIR_SIDES: dict[PairKind, tuple[Side, Side]] = {
    "bending": ("bent", "flat"),
    "merging": ("folded", "apart"),
}
"""Sides of each kind of pair: the first shows the gesture, the second shows `none`."""

SIDES: tuple[Side, ...] = ("bent", "flat", "folded", "apart")
"""All sides; each has a folder of its own."""

SIDE_SKINS: dict[str, str] = {"bent": "bent", "flat": "flat"}
"""Preset skins of the sides that have their own."""

SOURCE_SKINS = {"flat": "bent"}
"""Preset skin on which the counts of another are simulated."""

NONE_KINDS = {"grab": "press", "double_pat": "single_pat"}
"""Kind of `none` on the second side that has the counts of each gesture."""


@dataclass(frozen=True)
class PairMember:
    """A pair member says which clip of which pair of its set a clip is."""

    number: int
    """Number of the pair among those of its kind; -1 for the lead-in."""
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
        ValueError: there is no such kind.
    """
    for kind in PAIR_SIDES:
        if kind == name:
            return kind
    raise ValueError(f"no pairs of '{name}'; allowed are {', '.join(PAIR_SIDES)}")


def find_pair_kind(side: Side) -> PairKind:
    """Return the kind of pair that a side belongs to."""
    return "bending" if side in PAIR_SIDES["bending"] else "merging"


Seed = tuple[int, ...]
"""Entropy of `np.random.SeedSequence`; unique within a set."""


def build_rng(seed: Seed) -> np.random.Generator:
    """Build a random generator in its initial state."""
    return np.random.default_rng(np.random.SeedSequence(seed))


ACCIDENTS, QUIET = "accidents", "quiet"
"""Kinds of streams: with accidental contacts only, and without any contact."""


@dataclass(frozen=True)
class Origin:
    """An origin is the name of something random and the seed that it is drawn from."""

    name: str
    """Name in recordings."""
    seed: Seed
    """Seed that it is drawn from."""

    def rng(self) -> np.random.Generator:
        """Return a random generator in its initial state."""
        return build_rng(self.seed)


@dataclass(frozen=True)
class BuildOrigin(Origin):
    """A build origin is the name, seed and kind of a sensor build."""

    kind: BuildKind
    """Laws that it is drawn from."""


@dataclass(frozen=True, kw_only=True)
class ClipPlan:
    """A clip plan holds everything needed to simulate one clip or stream alone."""

    set_name: str
    """Name of the set."""
    seed: Seed
    """Seed of everything that is drawn for this clip alone."""
    person: Origin
    """Person who touches."""
    company: Origin | None = None
    """Another person who may touch at the same time, if any."""
    build: BuildOrigin
    """Build of the sensor."""
    session: Origin
    """Origin of what is constant during a session, such as the drift of the gains."""
    at: float = 0.0
    """Start of the clip since the start of the session [s]."""
    seconds: float
    """Length of the clip [s]."""
    gesture: str | None
    """Gesture, `none` or an unknown gesture; None is a stream of touches."""
    kind: str | None
    """Variant; None draws it. For streams `ACCIDENTS`, `QUIET`, or None for one with
    gestures."""
    groups: tuple[int, ...]
    """Pose groups that the pose is drawn from."""
    pose: Seed | None = None
    """Seed of a pose that several clips share; None draws one for this clip alone."""
    moving: bool = False
    """Whether the robot moves."""
    fold_share: float = 0.0
    """Probability of a pose in which patches of two links face each other closely."""
    concurrent: float = 0.0
    """Probability of a second touch at the same time."""
    difficulty: float
    """Factor by which spreads widen and rare variants gain weight; 0 is the easiest."""
    regime: Literal["paper", "cost"] | None = None
    """Distribution of durations; None draws it."""
    pair: PairMember | None = None
    """Pair with the same counts that the clip belongs to, if any."""

    def rng(self) -> np.random.Generator:
        """Return the random generator of this clip alone, in its initial state."""
        return build_rng(self.seed)
