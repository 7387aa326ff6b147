"""Compare the engine's logits with those of the torch network on the whole window.

    python -m lab.exact --sets SETS

The clips are of every skin that comes with eskin; missing ones are generated under
`--sets`. A tenth of the clips of the ur5 skin are also played as worse streams: with
lost readings, with patches that disappear and return, and at a changing rate.
"""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
import tyro

from eskin.learn.batches import build_network_input, cut_windows
from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare
from eskin.learn.nn import RecogniserNetwork
from eskin.live import Model, Recognizer, load_model
from eskin.recording import (
    Recording,
    RecordingWriter,
    find_recordings,
    read_recording,
    write_all,
)
from eskin.robot import load_robot
from eskin.sim.commands.generate import (
    SKINS,
    GenerateCommand,
    run,
)
from eskin.skin import MountedSkin
from eskin.touch import Scan
from eskin.units import NS_PER_S

ALLOWED = 1e-4
TURN = 1_300_000_000


@dataclass(frozen=True)
class Command:
    """Compare the engine with torch."""

    sets: Path = Path("sets")
    """Folder of the clips."""
    clips: int = 1000
    """Clips of the ur5 skin; a tenth of them of each other skin."""
    every: int = 7
    """Only every n-th window is compared."""


def as_recorded(scans: Iterator[Scan]) -> Iterator[Scan]:
    """Return every scan."""
    return scans


def some_lost(scans: Iterator[Scan]) -> Iterator[Scan]:
    """Drop one scan in ten at random."""
    rng = np.random.default_rng(0)
    return (scan for scan in scans if rng.random() > 0.1)


def slower_half(scans: Iterator[Scan]) -> Iterator[Scan]:
    """Drop every other scan during alternate spans of three seconds."""
    for n, scan in enumerate(scans):
        if n % 2 == 0 or scan.stamp // (3 * NS_PER_S) % 2 == 0:
            yield scan


def halves_in_turn(scans: Iterator[Scan]) -> Iterator[Scan]:
    """Silence either half of the taxels in turn, for 1.3 s each."""
    for scan in scans:
        received = scan.received.copy()
        half = len(received) // 2
        silent = slice(half) if scan.stamp // TURN % 2 == 0 else slice(half, None)
        received[silent] = False
        yield replace(scan, received=received)


STREAMS: dict[str, Callable[[Iterator[Scan]], Iterator[Scan]]] = {
    "as recorded": as_recorded,
    "a tenth lost": some_lost,
    "25 and 50 Hz in turn": slower_half,
    "patches leave and come back": halves_in_turn,
}
FIRST = [next(iter(STREAMS.items()))]
USUAL = "ur5"


def main() -> None:
    """Compare and print."""
    command = tyro.cli(Command)
    model = load_model("ur5")
    print("| skin | stream | recordings | windows | largest difference |")
    print("|---|---|---|---|---|")
    worst = 0.0
    for skin in SKINS:
        clips = command.clips if skin == USUAL else command.clips // 10
        folder = command.sets / f"exact-{skin}-{clips}"
        run(GenerateCommand(folder, skin=skin, set="test-m", clips=clips))
        paths = find_recordings([folder])
        for name, stream in STREAMS.items() if skin == USUAL else FIRST:
            some = (
                paths if (name, stream) in FIRST else paths[:: max(1, len(paths) // 10)]
            )
            found = [
                gap
                for path in some
                for gap in compute_differences(
                    model, read_recording(path), stream, command.every
                )
            ]
            worst = max(worst, *found)
            print(
                f"| {skin} | {name} | {len(some)} | {len(found)} | {max(found):.1e} |"
            )
    if worst > ALLOWED:
        raise SystemExit(f"a logit differs by {worst:.1e}; allowed is {ALLOWED:.0e}")


def compute_differences(
    model: Model,
    recording: Recording,
    stream: Callable[[Iterator[Scan]], Iterator[Scan]],
    every: int,
) -> list[float]:
    """Return the largest difference of a logit in each compared window."""
    mounted = MountedSkin(recording.skin, load_robot(recording.robot_name))
    recognizer = Recognizer(model, mounted, recording.calibration)
    live: dict[int, list[np.ndarray]] = {}
    for scan in stream(recording.scans()):
        recognizer.push(scan)
        for key, logits in recognizer.logits.items():
            live.setdefault(key, []).append(logits.copy())
    rows = np.array([row for rows in live.values() for row in rows])
    offline, ends = compute_torch_logits(
        to_network(model), model, recording, stream, every
    )
    return list(np.abs(rows[ends] - offline).max(axis=1))


def compute_torch_logits(
    network: RecogniserNetwork,
    model: Model,
    recording: Recording,
    stream: Callable[[Iterator[Scan]], Iterator[Scan]],
    every: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return torch's logits of some windows, and the last reading of each."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stream.mcap"
        with RecordingWriter(
            path,
            recording.robot_name,
            recording.skin,
            recording.calibration,
            recording.metadata,
        ) as writer:
            write_all(writer, stream(recording.scans()), ())
        dataset = prepare([path], model.card.pipeline, model.card.graph_used)
    ends = np.arange(0, len(dataset.stamps), every)
    windows = cut_windows(dataset, ends, dataset.starts[ends], network.config.slots)
    with torch.no_grad():
        graphs = dataset.graphs.select(windows.rows)
        return network(
            build_network_input(graphs, windows, network.shear)
        ).numpy(), ends


if __name__ == "__main__":
    main()
