"""A finger that presses one spot on purpose, and the taxel that felt most of it."""

from typing import final

import numpy as np

from eskin.touch.state import TouchState
from eskin.units import NS_PER_S

LEAST_FORCE = 0.5
"""Of a press that is meant [N]."""

LEAST_SECONDS = 0.15
"""That it lasts [s]."""


@final
class PressFinder:
    """Finds presses in what is felt, one after the other; stateful."""

    def __init__(self) -> None:
        """Wait for the first."""
        self.since: int | None = None
        self.force = 0.0
        self.taxel = -1

    def push(self, state: TouchState) -> int | None:
        """Take the next reading in.

        Returns:
            The taxel of most pressure when the press that has just ended was hardest;
            None while nothing ends.
        """
        contact = max(state.contacts, key=lambda one: one.force, default=None)
        stamp = state.reading.stamp
        if contact is not None and contact.force >= LEAST_FORCE:
            self.since = stamp if self.since is None else self.since
            if contact.force > self.force:
                pressure = state.reading.pressure[contact.taxels]
                self.force = contact.force
                self.taxel = int(contact.taxels[np.argmax(pressure)])
            return None
        since, taxel = self.since, self.taxel
        self.since, self.force, self.taxel = None, 0.0, -1
        long = since is not None and stamp - since >= LEAST_SECONDS * NS_PER_S
        return taxel if long else None
