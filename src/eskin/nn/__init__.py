"""This package defines the network in torch: layers, encoder, temporal heads."""

from eskin.nn.batch import GraphTensors, NetworkInput, SlotIndex, build_graph_tensors
from eskin.nn.encoder import Encoder, EquivariantLayer
from eskin.nn.head import TemporalHead
from eskin.nn.network import RecogniserNetwork

__all__ = [
    "Encoder",
    "EquivariantLayer",
    "GraphTensors",
    "NetworkInput",
    "SlotIndex",
    "RecogniserNetwork",
    "TemporalHead",
    "build_graph_tensors",
]
