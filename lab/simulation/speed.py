"""Measure the rate of generated clips, and its memory."""

import resource
import tempfile
from pathlib import Path

from eskin.sim.dataset import GenerationSettings, generate
from lab.simulation.check import BandCheck, at_least, at_most

WANTED = 6000.0
WORKERS = 2
MEMORY = 1000.0  # [MB], so that many processes fit on a laptop
FEW = 60
"""Number of clips that are generated twice, with one process and with more."""


def speed_checks(clips: int, seed: int) -> list[BandCheck]:
    """Check clips per minute with the start-up, memory, and equality of the files.

    The memory is that of the largest process started so far, by any part.
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
    """Check that recordings and index do not depend on the number of processes."""
    one, more = made(1, seed), made(WORKERS, seed)
    differ = sum(one[name] != more[name] for name in one) + len(
        one.keys() ^ more.keys()
    )
    name = f"{FEW} clips of test-m, 1 and {WORKERS} processes: files that differ"
    return at_most(name, differ, 0, "this project")


def made(workers: int, seed: int) -> dict[str, bytes]:
    """Generate a small set and return its files."""
    with tempfile.TemporaryDirectory() as folder:
        generate(
            Path(folder), GenerationSettings("test-m", seed=seed, clips=FEW), workers
        )
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}
