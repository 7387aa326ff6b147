"""Measuring what a step costs: scenes in memory, fair timing, a row a method.

Scenes need no torch; what times the baselines too is in the modules.
"""

from eskin.bench.scene import Instant, Scene, large_skin

__all__ = ["Instant", "Scene", "large_skin"]
