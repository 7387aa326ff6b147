"""What one push through the recogniser costs, as shares of the same run.

    python -m benchmarks.push

The ur5 skin with the arm moving and a hand on the forearm; every stage as a ratio to
forward kinematics of one pose, since machines differ and are shared.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
import tyro

import eskin
from eskin.learn.checkpoint import to_model
from eskin.model import ModelCard, NetworkConfig
from eskin.nn import RecogniserNetwork
from eskin.robot import Kinematics

VOCABULARY = ("none", "poke", "double_pat", "grab", "stroke")
RADIUS = 0.04  # [m] of the hand's contact


@dataclass(frozen=True)
class Command:
    """Time one push, touched and idle."""

    pushes: int = 400
    """Readings timed of each kind."""


def main() -> None:
    """Time and print."""
    command = tyro.cli(Command)
    skin, robot = eskin.load_skin("ur5"), eskin.load_robot("ur5")
    mounted = eskin.MountedSkin(skin, robot)
    kinematics, q = Kinematics(robot), np.zeros(6)
    unit = median([lambda: kinematics.poses(q)] * command.pushes)
    centre = skin.positions[skin.taxels_of("forearm_front")].mean(axis=0)
    near = np.linalg.norm(skin.positions - centre, axis=1) < RADIUS
    near &= skin.patch_index == skin.patch_index[skin.taxels_of("forearm_front")[0]]
    print("| push | active taxels | p50 [ms] | forward kinematics |")
    print("|---|---|---|---|")
    for name, active in (("touched", near), ("idle", np.zeros_like(near))):
        seconds = median(pushes(mounted, active, command.pushes))
        cells = [name, active.sum(), f"{1e3 * seconds:.2f}", f"{seconds / unit:.0f} x"]
        print(f"| {' | '.join(map(str, cells))} |")


def pushes(
    mounted: eskin.MountedSkin, active: np.ndarray, count: int
) -> list[Callable[[], object]]:
    """Pushes of readings in which some taxels are pressed while the arm moves."""
    torch.manual_seed(0)
    network = RecogniserNetwork(NetworkConfig(), len(VOCABULARY), shear=False)
    model = to_model(network.eval(), ModelCard(VOCABULARY))
    recognizer = eskin.Recognizer(model, mounted, None)
    valid = np.ones(len(active), dtype=bool)
    made = []
    for n in range(count):
        pressure = np.where(active, 20.0 + np.sin(0.1 * n), 0.0).astype(np.float32)
        q = np.full(6, 0.002 * n)
        reading = eskin.Reading(20_000_000 * (n + 1), pressure, valid, q)
        made.append(lambda reading=reading: recognizer.push(reading))
    return made


def median(calls: list[Callable[[], object]]) -> float:
    """Median time of the calls, the first tenth left out as warm-up [s]."""
    times = []
    for call in calls:
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return float(np.median(times[len(times) // 10 :]))


if __name__ == "__main__":
    main()
