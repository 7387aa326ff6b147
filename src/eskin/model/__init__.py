"""The model file: weights without code, and all that must be known to use them."""

from eskin.model.config import (
    LEAST_SLOTS,
    LENGTH_CM,
    SLOT_NS,
    DecisionConfig,
    ModelCard,
    NetworkConfig,
    check_limits,
)
from eskin.model.file import MODELS, Model, checked_weights, load_model, save_model

__all__ = [
    "LEAST_SLOTS",
    "LENGTH_CM",
    "SLOT_NS",
    "MODELS",
    "DecisionConfig",
    "Model",
    "ModelCard",
    "NetworkConfig",
    "check_limits",
    "checked_weights",
    "load_model",
    "save_model",
]
