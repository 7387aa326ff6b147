"""The last slots of one sequence of features."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.model import SLOT_NS

NEVER = np.iinfo(np.int64).min


@final
class Window:
    """A ring of slots of 20 ms; readings that share a slot give their maximum.

    A slot keeps its absolute number, so that what a pause has left behind is not taken
    for new.
    """

    def __init__(self, slots: int, channels: int) -> None:
        """Start empty."""
        self.slots = slots
        self.features = np.zeros((slots, channels), np.float32)
        self.numbers = np.full(slots, NEVER, np.int64)
        self.now = 0

    def push(self, stamp: int, features: Float[np.ndarray, "channel"]) -> None:
        """Take in a reading, later than the one before [ns since the epoch]."""
        self.now = stamp // SLOT_NS
        place = self.now % self.slots
        if self.numbers[place] == self.now:
            np.maximum(self.features[place], features, out=self.features[place])
        else:
            self.features[place] = features
            self.numbers[place] = self.now

    def view(
        self,
    ) -> tuple[Float[np.ndarray, "slot channel"], Float[np.ndarray, "slot"]]:
        """Features by slot, the latest last, zero where there are none; and where."""
        numbers = np.arange(self.now - self.slots + 1, self.now + 1)
        places = numbers % self.slots
        present = (self.numbers[places] == numbers).astype(np.float32)
        return self.features[places] * present[:, None], present
