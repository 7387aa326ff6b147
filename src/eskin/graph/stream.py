"""From the touches of each reading to their graphs."""

from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.batch import GraphBatch
from eskin.graph.builder import GraphBuilder
from eskin.graph.config import GraphConfig
from eskin.graph.history import NOTHING, Histories
from eskin.skin import MountedSkin
from eskin.touch import Reading, Touch, TouchState
from eskin.touch.poses import LivePoses

WHOLE_SKIN = 0
"""The one sequence of a skin whose distances mean nothing; touches count from 1."""

NOBODY = np.empty(0, dtype=np.int64)


class Share(NamedTuple):
    """What the graph of one sequence is made of at one reading."""

    taxels: Int[np.ndarray, "active"]
    """Its active taxels now."""

    earlier: Int[np.ndarray, "earlier"]
    """Those it had one reading ago."""

    history: Float[np.ndarray, "column"]
    """What it has been so far; see `eskin.graph.history.HISTORY`."""


@final
class GraphStream:
    """The graph of every open touch at every reading, in one stream.

    On a skin that is not calibrated there is one sequence of graphs for the whole
    skin, going on whether or not anything touches it.
    """

    def __init__(
        self,
        mounted: MountedSkin,
        config: GraphConfig | None = None,
        poses: LivePoses | None = None,
    ) -> None:
        """Start before the first reading.

        Args:
            mounted: the skin on its robot.
            config: of the graphs.
            poses: of the robot's links, shared with who else asks for them.
        """
        self.builder = GraphBuilder(mounted, config, poses)
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
        shares = self.advance(state)
        return {key: self.builder.graph(*share) for key, share in shares.items()}

    def advance(self, state: TouchState) -> dict[int, Share]:
        """Take in the next reading; return what each sequence has a share of."""
        now = self.taxels_now(state)
        self.inherit(state.closed)
        felt = [*now.values(), *(contact.taxels for contact in state.contacts)]
        self.builder.advance(state.reading, np.concatenate([NOBODY, *felt]))
        histories = self.histories.push(state) if self.calibrated else {}
        shares = {
            key: Share(
                taxels, self.earlier.get(key, NOBODY), histories.get(key, NOTHING)
            )
            for key, taxels in now.items()
        }
        self.earlier = now
        return shares

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
