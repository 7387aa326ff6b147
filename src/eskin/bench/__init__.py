"""This package measures what a step of the engine costs, in time and in dropped data.

`scene` needs no torch; `latency`, which also times the baselines, does.
"""

from eskin.bench.scene import BenchScene, SceneReading, large_skin

__all__ = ["BenchScene", "SceneReading", "large_skin"]
