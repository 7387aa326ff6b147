"""This module builds the graphs of all touches in a stream of readings."""

from collections.abc import Mapping
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import Packed, pack, unpack
from eskin.live.graph_batch import (
    HISTORY,
    NO_HISTORY,
    GraphBatch,
)
from eskin.live.graph_builder import GraphBuilder, GraphConfig
from eskin.live.touch_node_kernels import TouchNodeArrays, collect_touch_nodes
from eskin.skin import MountedSkin
from eskin.touch import LinkPoseCache, TouchState

WHOLE_SKIN = 0
"""Key of the one sequence of a skin that is not calibrated; ids of touches start at
1."""

NO_TAXELS = np.empty(0, dtype=np.int64)


class TouchNodes(NamedTuple):
    """Touch nodes are the taxels and the history of a sequence at one reading."""

    taxels: Int[np.ndarray, "active"]
    """Active taxels now."""
    earlier: Int[np.ndarray, "earlier"]
    """Active taxels one reading ago."""
    history: Float[np.ndarray, "column"]
    """History of the touch so far, with the columns `HISTORY`."""


class PackedTouchNodes(NamedTuple):
    """This tuple holds the touch nodes of all sequences, packed for kernels."""

    keys: list[int]
    """Keys of the sequences."""
    max_taxels: int
    """Largest number of taxels of a sequence, now and one reading ago together."""
    packed: Packed
    """Packed `TouchNodeArrays`."""


@final
class GraphStream:
    """A graph stream builds the graph of every open touch at every reading.

    The graphs of a touch are one sequence. On a skin that is not calibrated there is
    one sequence for the whole skin, which goes on even while nothing touches it.
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
            config: settings of the graphs.
            poses: poses of the robot's links, shared with other users of them.
        """
        self.builder = GraphBuilder(mounted, config, poses)
        self.calibrated = mounted.skin.calibrated
        self.earlier = NO_TAXELS
        self.no_nodes = pack_touch_nodes({})

    def get_key(self, touch: int) -> int:
        """Return the key of the sequence that the touch with that id belongs to."""
        return touch if self.calibrated else WHOLE_SKIN

    def push(self, state: TouchState) -> dict[int, GraphBatch]:
        """Return the graph of each sequence at the next reading, by key.

        A touch between two contacts has a graph without pressure.
        """
        nodes: TouchNodeArrays = unpack(self.find_touch_nodes(state).packed)
        self.builder.advance(state.reading, nodes.active)
        spans = zip(nodes.keys, nodes.active_spans, nodes.earlier_spans, strict=True)
        return {
            int(key): self.builder.build(
                nodes.active[slice(*now)], nodes.earlier[slice(*before)], history
            )
            for (key, now, before), history in zip(spans, nodes.histories, strict=True)
        }

    def find_touch_nodes(self, state: TouchState) -> PackedTouchNodes:
        """Return the taxels and the history of each sequence at the next reading."""
        if not self.calibrated:
            nodes = TouchNodes(self.find_active_taxels(state), self.earlier, NO_HISTORY)
            self.earlier = nodes.taxels
            return pack_touch_nodes({WHOLE_SKIN: nodes})
        if not state.tracking.open:
            return self.no_nodes
        packed, max_taxels = collect_touch_nodes(
            state.tracking.packed, state.reading.stamp
        )
        return PackedTouchNodes(
            [touch.id for touch in state.tracking.open], max_taxels, packed
        )

    def find_active_taxels(self, state: TouchState) -> Int[np.ndarray, "active"]:
        """Return all taxels in contact or under shear, whatever their touch."""
        parts, reading = [contact.taxels for contact in state.contacts], state.reading
        if reading.shear is not None:
            size = np.linalg.norm(reading.shear, axis=1)
            sheared = size >= self.builder.config.shear_on
            parts.append(np.flatnonzero(sheared & reading.valid))
        return np.unique(np.concatenate([NO_TAXELS, *parts]))


def pack_touch_nodes(nodes: Mapping[int, TouchNodes]) -> PackedTouchNodes:
    """Pack the taxels and histories of sequences, given by key, for compiled code."""
    values, keys = list(nodes.values()), list(nodes)
    active, now = concatenate([each.taxels for each in values])
    earlier, before = concatenate([each.earlier for each in values])
    rows = np.array([each.history for each in values], np.float64)
    histories = rows.reshape(-1, len(HISTORY))
    key_array = np.array(keys, np.int64)
    packed = pack(TouchNodeArrays(key_array, active, earlier, now, before, histories))
    sizes = [len(each.taxels) + len(each.earlier) for each in values]
    return PackedTouchNodes(keys, max(sizes, default=0), packed)


def concatenate(
    parts: list[np.ndarray],
) -> tuple[Int[np.ndarray, "load"], Int[np.ndarray, "sequence 2"]]:
    """Return all parts one after another, and the span of each."""
    ends = np.cumsum([0, *map(len, parts)])
    return np.concatenate([NO_TAXELS, *parts]), np.stack([ends[:-1], ends[1:]], axis=1)
