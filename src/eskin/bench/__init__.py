"""Measuring what a step costs: scenes in memory, fair timing, a row a method."""

from eskin.bench.latency import LatencyConfig, latency, scaled
from eskin.bench.scene import Scene, large_skin
from eskin.bench.timing import EngineSubject, Row, pinned, time_together

__all__ = [
    "EngineSubject",
    "LatencyConfig",
    "Row",
    "Scene",
    "large_skin",
    "latency",
    "pinned",
    "scaled",
    "time_together",
]
