"""Simulate the worlds, and convert those of real recordings.

python -m lab.vary make FOLDER
python -m lab.vary make LONGER --seconds 300 --seed 1
"""

import json
from dataclasses import dataclass
from pathlib import Path

import tyro

from lab.vary.worlds import (
    HALF,
    MATRICES,
    REAL,
    list_arms,
    make_arm,
    make_matrix,
    make_real,
)

SETTINGS = "worlds.json"
"""File that tells of what seed the worlds of a folder are, and how long."""


@dataclass(frozen=True)
class Command:
    """Simulate the worlds, and convert those of real recordings."""

    folder: tyro.conf.Positional[Path]
    """Folder of the worlds; those that are there are kept."""
    seconds: float = 90.0
    """Length of each world, except for those that are half as long [s]."""
    seed: int = 0
    """Seed, from which builds, people and touches are drawn."""
    data: Path = Path("../shared/data")
    """Folder with one folder for each public set, as downloaded."""


def find_seconds(name: str, seconds: float) -> float:
    """Return the length of a world [s]."""
    return 0.5 * seconds if name in HALF else seconds


def main(command: Command) -> None:
    """Make the worlds."""
    folder = command.folder
    folder.mkdir(parents=True, exist_ok=True)
    settings = {"seconds": command.seconds, "seed": command.seed}
    (folder / SETTINGS).write_text(json.dumps(settings), "utf-8")
    for name, (kind, number) in list_arms(command.seed).items():
        make_arm(folder, kind, number, find_seconds(name, command.seconds))
    for name in MATRICES:
        seconds = find_seconds(name, command.seconds)
        make_matrix(folder, name, seconds, command.seed)
    for kind in REAL:
        problem = make_real(folder, command.data, kind)
        if problem:
            print(f"left out: {kind} ({problem})")
