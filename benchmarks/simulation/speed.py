"""How many clips a minute come out as files, and what that takes."""

import resource
import tempfile
from pathlib import Path

from benchmarks.simulation.check import BandCheck, at_least, at_most
from eskin.sim.dataset import GenerationSettings, generate

WANTED = 6000.0
WORKERS = 2
MEMORY = 1000.0  # [MB], so that many processes fit on a laptop
FEW = 60
"""Clips that are made twice, with one process and with more."""


def speed_checks(clips: int, seed: int) -> list[BandCheck]:
    """Clips of `train` a minute, their start included, memory, and the same bytes.

    The memory is that of the largest process started so far, of whatever part.
    """
    with tempfile.TemporaryDirectory() as folder:
        settings = GenerationSettings("train", seed=seed, clips=clips)
        done = generate(Path(folder), settings, WORKERS)
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    name = f"{clips} clips as files, {WORKERS} processes"
    return [
        at_least(name, done.clips_per_minute, WANTED, "this project", "clips/min"),
        at_most("largest process", largest, MEMORY, "this project", "MB"),
        same_bytes(seed),
    ]


def same_bytes(seed: int) -> BandCheck:
    """Whether recordings and index depend on the number of processes."""
    one, more = made(1, seed), made(WORKERS, seed)
    differ = sum(one[name] != more[name] for name in one) + len(
        one.keys() ^ more.keys()
    )
    name = f"{FEW} clips of test-m, 1 and {WORKERS} processes: files that differ"
    return at_most(name, differ, 0, "this project")


def made(workers: int, seed: int) -> dict[str, bytes]:
    """Every file of a small set."""
    with tempfile.TemporaryDirectory() as folder:
        generate(
            Path(folder), GenerationSettings("test-m", seed=seed, clips=FEW), workers
        )
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}
