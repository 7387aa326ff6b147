"""How many clips a minute come out as files."""

import tempfile
from pathlib import Path

from benchmarks.simulation.check import Check, at_least
from eskin.sim.files.generate import generate
from eskin.sim.files.settings import Settings

WANTED = 6000.0
WORKERS = 2


def speed_checks(clips: int, seed: int) -> list[Check]:
    """Clips of `train` a minute in two processes, their start included."""
    with tempfile.TemporaryDirectory() as folder:
        done = generate(
            Path(folder), Settings("train", seed=seed, clips=clips), WORKERS
        )
    name = f"{clips} clips as files, {WORKERS} processes"
    rate = done.clips_per_minute
    return [at_least(name, rate, WANTED, "this project", "clips/min")]
