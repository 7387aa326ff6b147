"""From the touches of each reading to their graphs."""

from typing import final

import numpy as np
from jaxtyping import Int

from eskin.graph.batch import NOTHING, GraphBatch
from eskin.graph.builder import GraphBuilder
from eskin.graph.config import GraphConfig
from eskin.graph.share_kernels import shares_of
from eskin.graph.shares import HeldShares, Share, Shares, held_shares
from eskin.skin import MountedSkin
from eskin.structref_kernels import unpack
from eskin.touch import LinkPoseCache, Reading, TouchState

WHOLE_SKIN = 0
"""The one sequence of a skin whose distances mean nothing; touches count from 1."""

NOBODY = np.empty(0, dtype=np.int64)


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
        poses: LinkPoseCache | None = None,
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
        self.nothing = held_shares({})

    def key_of(self, touch: int) -> int:
        """The sequence that the touch of that id belongs to."""
        return touch if self.calibrated else WHOLE_SKIN

    def push(self, state: TouchState) -> dict[int, GraphBatch]:
        """The graph of each sequence at the next reading.

        A touch between two contacts has a graph without pressure.
        """
        shares: Shares = unpack(self.shares(state).packed)
        self.builder.advance(state.reading, shares.active)
        return {
            int(key): self.builder.graph(
                shares.active[slice(*now)], shares.earlier[slice(*before)], history
            )
            for key, now, before, history in zip(
                *(shares.keys, shares.now, shares.before, shares.histories),
                strict=True,
            )
        }

    def shares(self, state: TouchState) -> HeldShares:
        """What each sequence has a share of at the next reading."""
        if not self.calibrated:
            taxels, earlier = self.whole_skin(state), self.earlier
            self.earlier = taxels
            return held_shares({WHOLE_SKIN: Share(taxels, earlier, NOTHING)})
        if not state.open:
            return self.nothing
        packed, most = shares_of(state.tracking.packed, state.reading.stamp)
        return HeldShares([touch.id for touch in state.open], most, packed)

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
