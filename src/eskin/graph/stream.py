"""From the touches of each reading to their graphs."""

import numpy as np
from jaxtyping import Int

from eskin.graph.batch import GraphBatch
from eskin.graph.builder import GraphBuilder
from eskin.graph.config import GraphConfig
from eskin.graph.history import NOTHING, history_of
from eskin.skin import MountedSkin
from eskin.touch import Reading, Touch, TouchState

WHOLE_SKIN = 0
"""The one sequence of a skin whose distances mean nothing; touches count from 1."""

NOBODY = np.empty(0, dtype=np.int64)

Taxels = dict[int, np.ndarray]
"""Taxels of each sequence, by its key."""

Histories = dict[int, np.ndarray]
"""The history of each sequence, by its key."""


class GraphStream:
    """The graph of every open touch at every reading, in one stream.

    On a skin that is not calibrated there is one sequence of graphs for the whole
    skin, going on whether or not anything touches it.
    """

    def __init__(self, mounted: MountedSkin, config: GraphConfig | None = None) -> None:
        """Start before the first reading."""
        self.builder = GraphBuilder(mounted, config)
        self.calibrated = mounted.skin.calibrated
        self.earlier: Taxels = {}

    def key_of(self, touch: Touch) -> int:
        """The sequence that a touch belongs to."""
        return touch.id if self.calibrated else WHOLE_SKIN

    def push(self, state: TouchState) -> dict[int, GraphBatch]:
        """The graph of each sequence at the next reading.

        A touch between two contacts has a graph without pressure.
        """
        now, earlier, histories = self.sequences(state)
        active = np.zeros(self.builder.mounted.skin.count, dtype=bool)
        for taxels in now.values():
            active[taxels] = True
        self.builder.advance(state.reading, active)
        return {
            key: self.builder.graph(
                taxels, earlier.get(key, NOBODY), histories.get(key, NOTHING)
            )
            for key, taxels in now.items()
        }

    def sequences(self, state: TouchState) -> tuple[Taxels, Taxels, Histories]:
        """Active taxels now and one reading ago, and the history of each sequence."""
        if not self.calibrated:
            now, earlier = {WHOLE_SKIN: self.whole_skin(state)}, self.earlier
            self.earlier = now
            return now, earlier, {}
        now, earlier, histories = {}, {}, {}
        taxels = state.records.loads["taxel"].copy()
        for touch in state.open_records:
            key = int(touch["id"])
            now[key] = taxels[slice(*touch["loads"])]
            earlier[key] = taxels[slice(*touch["before"])]
            histories[key] = history_of(touch, state.reading.stamp)
        return now, earlier, histories

    def whole_skin(self, state: TouchState) -> Int[np.ndarray, "active"]:
        """All active taxels, whatever touch they belong to."""
        parts = [contact.taxels for contact in state.contacts]
        return np.unique(np.concatenate([*parts, self.sheared(state.reading)]))

    def sheared(self, reading: Reading) -> Int[np.ndarray, "sheared"]:
        """Taxels whose shear tells of a touch, whatever their pressure."""
        if reading.shear is None:
            return NOBODY
        size = np.linalg.norm(reading.shear, axis=1)
        enough = size >= self.builder.config.shear_on
        return np.flatnonzero(enough & reading.valid)
