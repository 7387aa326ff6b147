"""This package measures the recogniser: one step, and bytes to detections."""

from eskin.sim.bench.scene import BenchScene, large_skin

__all__ = ["BenchScene", "large_skin"]
