"""This package measures the latency and the throughput of the engine.

`scene` needs no torch; `latency`, which also times the baselines, does.
"""

from eskin.bench.scene import BenchScene, SceneReading, large_skin

__all__ = ["BenchScene", "SceneReading", "large_skin"]
