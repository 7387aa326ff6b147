"""The model file: weights without code, and all that must be known to use them."""

from eskin.model.card import ModelCard
from eskin.model.config import LEAST_SLOTS, LENGTH_CM, SLOT_NS, NetworkConfig
from eskin.model.decision import DecisionConfig
from eskin.model.file import MODELS, Model, load_model, save_model
from eskin.model.limits import check_limits
from eskin.model.weights import checked_weights

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
