"""From the touches of each reading to their graphs."""

import numpy as np
from jaxtyping import Int

from eskin.graph.batch import GraphBatch
from eskin.graph.builder import GraphBuilder
from eskin.graph.config import GraphConfig
from eskin.graph.history import NOTHING, Histories
from eskin.skin import MountedSkin
from eskin.touch import Reading, Touch, TouchState

WHOLE_SKIN = 0
"""The one sequence of a skin whose distances mean nothing; touches count from 1."""

NOBODY = np.empty(0, dtype=np.int64)


class GraphStream:
    """The graph of every open touch at every reading, in one stream.

    On a skin that is not calibrated there is one sequence of graphs for the whole
    skin, going on whether or not anything touches it.
    """

    def __init__(self, mounted: MountedSkin, config: GraphConfig | None = None) -> None:
        """Start before the first reading."""
        self.builder = GraphBuilder(mounted, config)
        self.calibrated = mounted.skin.calibrated
        self.earlier: dict[int, np.ndarray] = {}
        self.histories = Histories()

    def key_of(self, touch: Touch) -> int:
        """The sequence that a touch belongs to."""
        return touch.id if self.calibrated else WHOLE_SKIN

    def push(self, state: TouchState) -> dict[int, GraphBatch]:
        """The graph of each sequence at the next reading.

        A touch between two contacts has a graph without pressure.
        """
        now = self.taxels_now(state)
        self.inherit(state.closed)
        active = np.zeros(self.builder.mounted.skin.count, dtype=bool)
        for taxels in (*now.values(), *(contact.taxels for contact in state.contacts)):
            active[taxels] = True
        self.builder.advance(state.reading, active)
        histories = self.histories.push(state) if self.calibrated else {}
        graphs = {
            key: self.builder.graph(
                taxels, self.earlier.get(key, NOBODY), histories.get(key, NOTHING)
            )
            for key, taxels in now.items()
        }
        self.earlier = now
        return graphs

    def inherit(self, closed: tuple[Touch, ...]) -> None:
        """Give what a touch had a reading ago to the one that has taken it over."""
        for touch in closed:
            if touch.merged_into is not None and touch.id in self.earlier:
                heir = self.earlier.get(touch.merged_into, NOBODY)
                both = np.concatenate([heir, self.earlier.pop(touch.id)])
                self.earlier[touch.merged_into] = both

    def taxels_now(self, state: TouchState) -> dict[int, Int[np.ndarray, "active"]]:
        """The active taxels of each sequence at this reading."""
        if not self.calibrated:
            parts = [contact.taxels for contact in state.contacts]
            parts.append(self.sheared(state.reading))
            return {WHOLE_SKIN: np.unique(np.concatenate(parts))}
        touching = {
            track.id: track.contact.taxels
            for track in state.tracks
            if track.last == state.reading.stamp
        }
        return {
            touch.id: np.concatenate(
                [NOBODY, *(touching[t] for t in touch.tracks if t in touching)]
            )
            for touch in state.touches
        }

    def sheared(self, reading: Reading) -> Int[np.ndarray, "sheared"]:
        """Taxels whose shear tells of a touch, whatever their pressure."""
        if reading.shear is None:
            return NOBODY
        size = np.linalg.norm(reading.shear, axis=1)
        enough = size >= self.builder.config.shear_on
        return np.flatnonzero(enough & reading.valid)
