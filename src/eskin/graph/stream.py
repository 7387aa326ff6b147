"""From the touches of each reading to their graphs."""

from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.batch import GraphBatch
from eskin.graph.builder import GraphBuilder
from eskin.graph.config import GraphConfig
from eskin.graph.history import NOTHING, history_of
from eskin.skin import MountedSkin
from eskin.touch import Reading, TouchState
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
        self.earlier = NOBODY

    def key_of(self, touch: int) -> int:
        """The sequence that the touch of that id belongs to."""
        return touch if self.calibrated else WHOLE_SKIN

    def push(self, state: TouchState) -> dict[int, GraphBatch]:
        """The graph of each sequence at the next reading.

        A touch between two contacts has a graph without pressure.
        """
        shares = self.advance(state)
        return {key: self.builder.graph(*share) for key, share in shares.items()}

    def advance(self, state: TouchState) -> dict[int, Share]:
        """Take in the next reading; return what each sequence has a share of."""
        if self.calibrated:
            shares = shares_of(state)
        else:
            taxels = self.whole_skin(state)
            shares = {WHOLE_SKIN: Share(taxels, self.earlier, NOTHING)}
            self.earlier = taxels
        felt = [share.taxels for share in shares.values()]
        self.builder.advance(state.reading, np.concatenate([NOBODY, *felt]))
        return shares

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


def shares_of(state: TouchState) -> dict[int, Share]:
    """The share of each open touch, by its id."""
    taxels, stamp = state.records.loads["taxel"].copy(), state.reading.stamp
    return {
        touch.id: Share(
            taxels[slice(*touch.loads)],
            taxels[slice(*touch.before)],
            history_of(touch, stamp),
        )
        for touch in state.open_rows
    }
