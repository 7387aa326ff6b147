"""This package learns from recordings: it trains, scores and compares (needs torch)."""

from eskin.learn.augment import AugmentConfig
from eskin.learn.checkpoint import to_model, to_network
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.evaluation import Evaluation, evaluate
from eskin.learn.ground_truth import Segment
from eskin.learn.metrics import ClassificationScore, score_predictions
from eskin.learn.training import TrainConfig, Trainer

__all__ = [
    "AugmentConfig",
    "Dataset",
    "Evaluation",
    "ClassificationScore",
    "Segment",
    "TrainConfig",
    "Trainer",
    "evaluate",
    "prepare",
    "score_predictions",
    "to_model",
    "to_network",
]
