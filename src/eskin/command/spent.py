"""Which touches have commanded, or asked to, so that each does so once."""

from collections.abc import Sequence
from typing import final

from eskin.touch.records import TouchBrief


@final
class Spent:
    """Touches that have commanded or asked; who takes one over is barred for it."""

    def __init__(self) -> None:
        """Nobody has."""
        self.asked: set[tuple[int, int]] = set()
        self.barred: set[int] = set()

    def add(self, touch: int, onset: int) -> None:
        """Remember a touch by its id and its onset [ns since the epoch]."""
        self.asked.add((touch, onset))

    def has(self, touch: int, onset: int) -> bool:
        """Whether a touch has commanded or asked, or took over one that did."""
        return touch in self.barred or (touch, onset) in self.asked

    def joins(self, touch: int, before: int, over: Sequence[TouchBrief]) -> bool:
        """Whether another touch that has commanded or asked is one with this now.

        Args:
            touch: id of what this touch is now.
            before: its id until now.
            over: touches that have closed, in their order.
        """
        joined = {touch}
        for closed in reversed(over):
            if closed.merged_into in joined:
                joined.add(closed.id)
        known = self.barred | {number for number, _ in self.asked}
        return bool((joined - {before}) & known)

    def forget(self, over: Sequence[TouchBrief]) -> None:
        """Let go of touches that have closed."""
        for touch in over:
            asked = {key for key in self.asked if key[0] == touch.id}
            if touch.merged_into and (asked or touch.id in self.barred):
                self.barred.add(touch.merged_into)
            self.asked -= asked
            self.barred.discard(touch.id)
