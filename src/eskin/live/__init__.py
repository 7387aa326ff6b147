"""This package recognises gestures live, one reading at a time and without torch."""

from eskin.live.classifier import TouchClassifier
from eskin.live.decision import (
    UNKNOWN,
    Decision,
    DecisionFilter,
    Detection,
    build_detection,
)
from eskin.live.first_use import warm_up
from eskin.live.graph import (
    GRAPH_FIELDS,
    HISTORY,
    NODE_FIELDS,
    SHEAR_FIELDS,
    GraphBatch,
    create_empty_batch,
    join_graphs,
)
from eskin.live.graph_builder import (
    FixedNeighbours,
    GraphBuilder,
    GraphConfig,
    GraphStream,
    find_live_neighbours,
)
from eskin.live.graph_features import (
    NODE_SCALARS,
    PRESSURE_SUMMARY,
    SHEAR_SUMMARY,
    compress_shear,
    compute_node_scalars,
    compute_summary,
)
from eskin.live.model_config import (
    EDGE_SCALARS,
    ESKIN,
    LENGTH_CM,
    LONG_STRIDE,
    LONG_TAPS,
    MAX_DEVIATIONS,
    SHORT_STRIDE,
    SHORT_TAPS,
    SLOT_NS,
    DecisionConfig,
    ModelCard,
    NetworkConfig,
    check_limits,
)
from eskin.live.model_file import (
    MODELS,
    Model,
    check_parameters,
    check_weights,
    load_model,
)
from eskin.live.network import Network, compute_probabilities
from eskin.live.recognizer import Recognizer

__all__ = [
    "Decision",
    "DecisionConfig",
    "DecisionFilter",
    "Detection",
    "EDGE_SCALARS",
    "ESKIN",
    "FixedNeighbours",
    "GRAPH_FIELDS",
    "GraphBatch",
    "GraphBuilder",
    "GraphConfig",
    "GraphStream",
    "HISTORY",
    "LENGTH_CM",
    "LONG_STRIDE",
    "LONG_TAPS",
    "MAX_DEVIATIONS",
    "MODELS",
    "Model",
    "ModelCard",
    "NODE_FIELDS",
    "NODE_SCALARS",
    "Network",
    "NetworkConfig",
    "PRESSURE_SUMMARY",
    "Recognizer",
    "SHEAR_FIELDS",
    "SHEAR_SUMMARY",
    "SHORT_STRIDE",
    "SHORT_TAPS",
    "SLOT_NS",
    "TouchClassifier",
    "UNKNOWN",
    "build_detection",
    "check_limits",
    "check_parameters",
    "check_weights",
    "compress_shear",
    "compute_node_scalars",
    "compute_probabilities",
    "compute_summary",
    "create_empty_batch",
    "find_live_neighbours",
    "join_graphs",
    "load_model",
    "warm_up",
]
