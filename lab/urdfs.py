"""Load the URDFs of installed packages, or of folders, with and without their meshes.

    python -m lab.urdfs [FOLDER ...]

Such packages are `example-robot-data` and `icub-models`. A line for each file says
whether its kinematics and all its shapes can be used, its kinematics alone, or nothing,
and why.
"""

import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from eskin.errors import RobotError
from eskin.robot import Kinematics, Robot, load_urdf
from eskin.units import format_count
from lab.program import run_program


@dataclass(frozen=True)
class UrdfsCommand:
    """Load the URDFs of folders."""

    folders: tyro.conf.Positional[tuple[Path, ...]] = ()
    """Folders with URDFs; those of installed packages where none are given."""


def find_urdfs(folders: Iterable[Path]) -> list[Path]:
    """Return the URDF files in folders, in the order of their paths."""
    return sorted({path for folder in folders for path in folder.rglob("*.urdf")})


def refuse_shapes(robot: Robot) -> list[RobotError]:
    """Return why each of the shapes that cannot be read cannot."""
    refused = []
    for geom in (geom for link in robot.links for geom in link.geoms):
        try:
            _ = geom.shape
        except RobotError as error:
            refused.append(error)
    return refused


def try_urdf(path: Path) -> tuple[str, str]:
    """Load a URDF; return how much of it can be used, and its sizes or why not all."""
    try:
        robot = load_urdf(path)
        Kinematics(robot).poses(np.zeros(len(robot.joint_names)))
    except RobotError as error:
        return "refused", str(error)
    if refused := refuse_shapes(robot):
        return "without shapes", f"{len(refused)}, the first: {refused[0]}"
    return "loaded", f"{path}: {format_count(len(robot.joint_names), 'joint')}"


def run(command: UrdfsCommand) -> dict[str, object]:
    """Print a line for each URDF, then how many can be used."""
    folders = command.folders or tuple(map(Path, filter(None, sys.path)))
    counts = Counter({"loaded": 0, "without shapes": 0, "refused": 0})
    for path in find_urdfs(folders):
        result, told = try_urdf(path)
        counts[result] += 1
        print(f"{result}: {told}")
    print(", ".join(f"{count} {result}" for result, count in counts.items()))
    return dict(counts)


if __name__ == "__main__":
    sys.exit(run_program(run))
