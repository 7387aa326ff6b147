"""Contact graphs: which taxels a touch concerns, their neighbours and features."""

from eskin.graph.batch import GraphBatch, join, no_graphs
from eskin.graph.builder import GraphBuilder
from eskin.graph.config import GraphConfig
from eskin.graph.neighbours import FixedNeighbours, live_neighbours
from eskin.graph.node_features import NODE_SCALARS, compressed, node_scalars
from eskin.graph.shares import HeldShares, Share, held_shares
from eskin.graph.shear_summary import SHEAR_SUMMARY, shear_summary
from eskin.graph.stream import WHOLE_SKIN, GraphStream
from eskin.graph.summary import PRESSURE_SUMMARY, pressure_summary

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
