"""Run an exported network with onnxruntime alone, one step a reading.

    eskin export ur5 --onnx ur5.onnx
    python examples/07_onnx_step.py --model ur5.onnx

`OnnxSteps` needs only numpy and onnxruntime; what it is fed, one reading of one touch
at a time, is computed here by eskin from a finger that presses on a small skin.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime
import tyro

from eskin.live import GraphBatch, GraphStream, compute_node_scalars, compute_summary
from eskin.robot import load_robot
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import Calibration, Scan, TouchPipeline

RATE = 50  # scans a second [Hz]
SECOND = 1_000_000_000  # [ns]


class OnnxSteps:
    """Runs the network on the readings of one touch."""

    def __init__(self, path: Path) -> None:
        """Open the network, and start before the first reading."""
        self.session = onnxruntime.InferenceSession(str(path))
        shapes = {one.name: one.shape for one in self.session.get_inputs()}
        self.window = np.zeros(shapes["window"], np.float32)
        self.present = np.zeros(shapes["present"], np.float32)
        known = self.session.get_modelmeta().custom_metadata_map
        self.gestures = json.loads(known["vocabulary"])
        self.slot_ns = round(float(known["slot_seconds"]) * SECOND)
        self.slot = 0

    def compute_probabilities(
        self, stamp: int, inputs: dict[str, np.ndarray]
    ) -> dict[str, float]:
        """Return the probability of each gesture after a reading."""
        slot = stamp // self.slot_ns
        if passed := min(slot - self.slot, len(self.present)):
            self.window = np.roll(self.window, -passed, axis=0)
            self.present = np.roll(self.present, -passed)
            self.window[-passed:] = 0
            self.present[-passed:] = 0
        self.slot = slot
        feeds = {**inputs, "window": self.window, "present": self.present}
        features, _, probabilities = self.session.run(None, feeds)
        self.window[-1] = features
        self.present[-1] = 1
        return dict(zip(self.gestures, probabilities.tolist(), strict=True))


def build_inputs(graph: GraphBatch) -> dict[str, np.ndarray]:
    """Return the inputs of the network for the contact graph of one reading."""
    scalars = compute_node_scalars(graph)
    scalars[:, -1] = 0  # The network `ur5` uses no shear.
    real = {
        "scalars": scalars,
        "positions": graph.positions,
        "normals": graph.normals,
        "shear": np.zeros_like(graph.shear),
        "forces": graph.pressure * graph.areas,
        "areas": graph.areas,
        "summary": compute_summary(graph, False),
    }
    inputs = {name: np.float32(values) for name, values in real.items()}
    return {**inputs, "targets": graph.targets, "sources": np.int64(graph.sources)}


@dataclass(frozen=True)
class Example:
    """Run an exported network with onnxruntime alone."""

    model: Path
    """The network, as eskin export wrote it."""


def main(example: Example) -> None:
    """Press a skin for 0.3 s and print what the network says of each reading."""
    skin = build_grid_skin(12, 12, calibrated=True)
    rng = np.random.default_rng(0)
    mounted = MountedSkin(skin, load_robot("table"))
    pipeline = TouchPipeline(mounted, Calibration.uniform(skin.count, 4095, 100.0))
    graphs = GraphStream(mounted)
    steps = OnnxSteps(example.model)
    distance = np.linalg.norm(skin.positions - skin.positions[70], axis=1)
    for index in range(3 * RATE):
        t = index / RATE
        press = 1600 * np.sin(np.pi * np.clip((t - 2.0) / 0.3, 0, 1))
        shape = np.exp(-((distance / 0.012) ** 2))
        counts = rng.normal(20, 1, skin.count) + press * shape
        received = np.ones(skin.count, bool)
        scan = Scan(round(t * SECOND), np.int32(counts), received, np.zeros(0))
        for touch, graph in graphs.build_graphs(pipeline.push_scan(scan)).items():
            said = steps.compute_probabilities(scan.stamp, build_inputs(graph))
            best = max(said, key=lambda name: said[name])
            print(f"{t:.2f} s  touch {touch}  {best} {said[best]:.0%}")


if __name__ == "__main__":
    main(tyro.cli(Example))
