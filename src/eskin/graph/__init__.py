"""Contact graphs: which taxels a touch concerns, their neighbours and features."""

from eskin.graph.batch import GraphBatch, join, no_graphs
from eskin.graph.builder import GraphBuilder
from eskin.graph.config import GraphConfig
from eskin.graph.features import (
    NODE_SCALARS,
    PRESSURE_SUMMARY,
    SHEAR_SUMMARY,
    compressed,
    node_scalars,
    pressure_summary,
    shear_summary,
)
from eskin.graph.neighbours import FixedNeighbours, live_neighbours
from eskin.graph.shares import HeldShares, Share, held_shares
from eskin.graph.stream import WHOLE_SKIN, GraphStream

__all__ = [
    "NODE_SCALARS",
    "PRESSURE_SUMMARY",
    "SHEAR_SUMMARY",
    "WHOLE_SKIN",
    "FixedNeighbours",
    "GraphBatch",
    "GraphBuilder",
    "GraphConfig",
    "GraphStream",
    "HeldShares",
    "Share",
    "compressed",
    "held_shares",
    "join",
    "live_neighbours",
    "no_graphs",
    "node_scalars",
    "pressure_summary",
    "shear_summary",
]
