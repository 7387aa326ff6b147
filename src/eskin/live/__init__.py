"""Gestures recognised live: one reading in, detections out, without torch."""

from eskin.live.decision import UNKNOWN, Decider, Verdict
from eskin.live.detection import Detection
from eskin.live.network import Network
from eskin.live.recognizer import Recognizer, warm_up
from eskin.live.window import Window

__all__ = [
    "UNKNOWN",
    "Decider",
    "Detection",
    "Network",
    "Recognizer",
    "Verdict",
    "Window",
    "warm_up",
]
