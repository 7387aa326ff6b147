"""The model file: weights without code, and all that must be known to use them."""

from eskin.model.card import ModelCard
from eskin.model.config import LENGTH_CM, SLOT_NS, NetworkConfig
from eskin.model.file import Model, load_model, save_model

__all__ = [
    "LENGTH_CM",
    "SLOT_NS",
    "Model",
    "ModelCard",
    "NetworkConfig",
    "load_model",
    "save_model",
]
