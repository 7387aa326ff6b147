"""The two sides of each kind of pair, and what is done in each."""

from dataclasses import dataclass
from typing import Literal

PairKind = Literal["bending", "merging"]
Side = Literal["bent", "flat", "folded", "apart"]

KINDS: dict[PairKind, tuple[Side, Side]] = {
    "bending": ("bent", "flat"),
    "merging": ("folded", "apart"),
}
"""The gesture is on the first side; on the second, the same counts are none."""

SIDES: tuple[Side, ...] = ("bent", "flat", "folded", "apart")
"""All sides; each has a folder of its own."""

SKINS: dict[str, str] = {"bent": "bent", "flat": "flat"}
"""Presets of the sides that have a skin of their own."""

SOURCES = {"flat": "bent"}
"""The preset that a side's counts are made on, where that is not its own."""

INSTEAD = {"grab": "press", "double_pat": "single_pat"}
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
        return kind_of_side(self.side)

    @property
    def is_second(self) -> bool:
        """Whether it is the one that is `none`."""
        return self.side == KINDS[self.kind][1]


def kind_named(name: str) -> PairKind:
    """The kind of pair of that name.

    Raises:
        ValueError: there is none.
    """
    for kind in KINDS:
        if kind == name:
            return kind
    raise ValueError(f"no pairs of '{name}'; allowed are {', '.join(KINDS)}")


def kind_of_side(side: Side) -> PairKind:
    """The kind of pair that a side is of."""
    return "bending" if side in KINDS["bending"] else "merging"
