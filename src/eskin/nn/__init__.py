"""The recogniser's network in torch: equivariant layers, encoder, temporal head."""

from eskin.nn.batch import (
    GraphTensors,
    NetworkInput,
    Places,
    graph_tensors,
    network_input,
    summary,
)
from eskin.nn.encoder import Encoder, EquivariantLayer
from eskin.nn.head import TemporalHead
from eskin.nn.network import RecogniserNetwork

__all__ = [
    "Encoder",
    "EquivariantLayer",
    "GraphTensors",
    "NetworkInput",
    "Places",
    "RecogniserNetwork",
    "TemporalHead",
    "graph_tensors",
    "network_input",
    "summary",
]
