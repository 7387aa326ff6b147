"""This package recognises gestures live, one reading at a time and without torch."""

from eskin.live.decision import UNKNOWN, Decision, DecisionFilter
from eskin.live.detection import Detection
from eskin.live.logits import compute_probabilities
from eskin.live.network import Network
from eskin.live.recognizer import Recognizer, build_detection, mount_skin, warm_up

__all__ = [
    "UNKNOWN",
    "Decision",
    "DecisionFilter",
    "Detection",
    "Network",
    "Recognizer",
    "build_detection",
    "compute_probabilities",
    "mount_skin",
    "warm_up",
]
