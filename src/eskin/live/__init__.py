"""This package recognises gestures live, one reading at a time and without torch."""

from eskin.live.decision import UNKNOWN, Decision, DecisionFilter
from eskin.live.detection import Detection
from eskin.live.graph_batch import (
    HISTORY,
    NO_HISTORY,
    NODE_FIELDS,
    SHEAR_FIELDS,
    GraphBatch,
    create_empty_batch,
    join_graphs,
)
from eskin.live.graph_builder import GraphBuilder, GraphConfig
from eskin.live.graph_features import (
    NODE_SCALARS,
    PRESSURE_SUMMARY,
    SHEAR_SUMMARY,
    compress_shear,
    compute_load_motion,
    compute_node_scalars,
    compute_summary,
)
from eskin.live.graph_stream import (
    WHOLE_SKIN,
    GraphStream,
    TouchNodes,
    pack_touch_nodes,
)
from eskin.live.logits import compute_probabilities
from eskin.live.model_config import (
    LENGTH_CM,
    MAX_DEVIATIONS,
    MIN_SLOTS,
    SLOT_NS,
    DecisionConfig,
    ModelCard,
    NetworkConfig,
    check_limits,
)
from eskin.live.model_file import MODELS, Model, check_weights, load_model, save_model
from eskin.live.neighbours import FixedNeighbours, find_live_neighbours
from eskin.live.network import Network
from eskin.live.recognizer import Recognizer, build_detection, mount_skin, warm_up

__all__ = [
    "Decision",
    "DecisionConfig",
    "DecisionFilter",
    "Detection",
    "FixedNeighbours",
    "GraphBatch",
    "GraphBuilder",
    "GraphConfig",
    "GraphStream",
    "HISTORY",
    "LENGTH_CM",
    "MAX_DEVIATIONS",
    "MIN_SLOTS",
    "MODELS",
    "Model",
    "ModelCard",
    "NODE_FIELDS",
    "NODE_SCALARS",
    "NO_HISTORY",
    "Network",
    "NetworkConfig",
    "PRESSURE_SUMMARY",
    "Recognizer",
    "SHEAR_FIELDS",
    "SHEAR_SUMMARY",
    "SLOT_NS",
    "TouchNodes",
    "UNKNOWN",
    "WHOLE_SKIN",
    "build_detection",
    "check_limits",
    "check_weights",
    "compress_shear",
    "compute_load_motion",
    "compute_node_scalars",
    "compute_probabilities",
    "compute_summary",
    "create_empty_batch",
    "find_live_neighbours",
    "join_graphs",
    "load_model",
    "mount_skin",
    "pack_touch_nodes",
    "save_model",
    "warm_up",
]
