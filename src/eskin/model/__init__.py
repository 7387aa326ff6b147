"""This package holds the model file: weights without code, and their settings."""

from eskin.model.config import (
    LENGTH_CM,
    MAX_DEVIATIONS,
    MIN_SLOTS,
    SLOT_NS,
    DecisionConfig,
    ModelCard,
    NetworkConfig,
    check_limits,
)
from eskin.model.file import MODELS, Model, check_weights, load_model, save_model

__all__ = [
    "MIN_SLOTS",
    "LENGTH_CM",
    "MAX_DEVIATIONS",
    "MODELS",
    "SLOT_NS",
    "DecisionConfig",
    "Model",
    "ModelCard",
    "NetworkConfig",
    "check_limits",
    "check_weights",
    "load_model",
    "save_model",
]
