"""This package builds contact graphs: the taxels of a touch, neighbours, features."""

from eskin.graph.batch import (
    HISTORY,
    NO_HISTORY,
    NODE_FIELDS,
    SHEAR_FIELDS,
    GraphBatch,
    create_empty_batch,
    join_graphs,
)
from eskin.graph.builder import GraphBuilder, GraphConfig
from eskin.graph.features import (
    NODE_SCALARS,
    PRESSURE_SUMMARY,
    SHEAR_SUMMARY,
    compress_shear,
    compute_load_motion,
    compute_node_scalars,
    compute_summary,
)
from eskin.graph.neighbours import FixedNeighbours, find_live_neighbours
from eskin.graph.stream import (
    WHOLE_SKIN,
    GraphStream,
    PackedTouchNodes,
    TouchNodes,
    pack_touch_nodes,
)

__all__ = [
    "HISTORY",
    "NODE_FIELDS",
    "NODE_SCALARS",
    "NO_HISTORY",
    "SHEAR_FIELDS",
    "PRESSURE_SUMMARY",
    "SHEAR_SUMMARY",
    "WHOLE_SKIN",
    "FixedNeighbours",
    "GraphBatch",
    "GraphBuilder",
    "GraphConfig",
    "GraphStream",
    "PackedTouchNodes",
    "TouchNodes",
    "compress_shear",
    "compute_load_motion",
    "compute_node_scalars",
    "compute_summary",
    "create_empty_batch",
    "find_live_neighbours",
    "join_graphs",
    "pack_touch_nodes",
]
