"""This package defines the recogniser's network in torch."""

from eskin.learn.nn.batch import (
    GraphTensors,
    NetworkInput,
    SlotIndex,
    build_graph_tensors,
)
from eskin.learn.nn.encoder import Encoder
from eskin.learn.nn.network import RecogniserNetwork, TemporalHead

__all__ = [
    "Encoder",
    "GraphTensors",
    "NetworkInput",
    "RecogniserNetwork",
    "SlotIndex",
    "TemporalHead",
    "build_graph_tensors",
]
