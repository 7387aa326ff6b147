"""Make streams, play them to the eskin that is imported, and compare what it says."""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import chain, repeat
from pathlib import Path
from typing import Literal

import numpy as np
import tyro

import lab.release
from eskin import MountedSkin, Recognizer
from eskin.errors import RecordingError
from eskin.learn.events import ScoredStream, read_true_events
from eskin.live import Detection, load_model
from eskin.recording import read_recording
from eskin.touch import Calibration
from eskin.units import NS_PER_S
from lab.release.scoring import Figures, Follower, score_stream
from lab.release.streams import DRAWS, find_folder, find_streams, make, read_builds
from lab.tables import format_head, format_row

Part = Literal["make", "play", "compare"]
Found = dict[str, dict[str, Figures]]
"""Figures of streams by their names, by draws."""
RESAMPLED = 1000
"""Number of bootstrap samples."""
RELEASE_FIELD = "release_seconds"
"""Time constant with which pressure falls once a sensor is let go, in a calibration."""
PRESS_ERROR = 0.15
"""Standard deviation of its logarithm, as presses measure it."""


@dataclass(frozen=True)
class Command:
    """Measure how touches end on sensors that release slowly, or creep."""

    part: tyro.conf.Positional[Part]
    """`make FOLDER`, `play FOLDER OUT.json` or `compare A.json [B.json ...]`."""
    paths: tyro.conf.Positional[tuple[Path, ...]]
    """The folder, or the files."""
    seed: int = 7300
    """Seed of the streams; 7400 is the final one, which is opened once."""
    only: tuple[str, ...] = tuple(DRAWS)
    """Draws to make or to play."""
    streams: int | None = None
    """Number of streams of each draw to make, or to play of those that were made; all
    unless given."""
    presses: bool = False
    """Give calibrations the time constant of the release that presses would measure,
    with an error of 15 %; by default calibrations are nominal."""
    by_kind: bool = False
    """Compare the builds of each family by themselves, too."""
    model: Path = Path("ur5")
    """Name of weights that come with eskin, or a model file."""
    workers: int = 1
    """Number of processes."""


def main(args: list[str] | None = None) -> None:
    """Make, play or compare."""
    command = tyro.cli(Command, args=args, description=lab.release.__doc__)
    for name in command.only:
        if name not in DRAWS:
            raise SystemExit(f"--only has '{name}'; allowed are {', '.join(DRAWS)}")
    if command.part == "make":
        for name in command.only:
            number = 0 if command.workers == 1 else command.workers
            made = make(command.paths[0], name, command.seed, command.streams, number)
            print(made, flush=True)
    elif command.part == "play":
        folder, out = command.paths
        found: Found = {}
        for name in command.only:
            found[name] = play(command, folder, name)
            out.write_text(json.dumps(found) + "\n", "utf-8")
        print(compare({out.stem: found}, command.by_kind))
    else:
        files = {path.stem: json.loads(path.read_text()) for path in command.paths}
        print(compare(files, command.by_kind))


def play(command: Command, folder: Path, name: str) -> dict[str, Figures]:
    """Play all streams of a draw; return their figures by kind of build and file."""
    made = find_folder(folder, name, command.seed)
    paths = find_streams(made)[: command.streams]
    builds = read_builds(made)
    times = [float(builds[path.name]["time constant"]) for path in paths]
    names = [f"{builds[path.name]['kind']} {path.name}" for path in paths]
    if command.workers == 1:
        every = list(map(play_stream, paths, repeat(command), times))
    else:
        with ProcessPoolExecutor(command.workers) as pool:
            every = list(pool.map(play_stream, paths, repeat(command), times))
    return dict(zip(names, every, strict=True))


def play_stream(path: Path, command: Command, release: float) -> Figures:
    """Play one stream, whose build releases with a time constant [s]."""
    recording = read_recording(path)
    calibration = recording.calibration
    if calibration is None:
        raise RecordingError(f"{path} has no calibration; make it again")
    if command.presses and release:
        calibration = measure_release(calibration, release, path.name)
    mounted = MountedSkin(recording.skin, recording.load_robot())
    model = load_model(command.model)
    recognizer = Recognizer(model, mounted, calibration)
    follower = Follower()
    detections: list[Detection] = []
    stamp = 0
    for scan in recording.scans():
        stamp = scan.stamp
        detections += recognizer.push(scan)
        state = recognizer.state
        if state is not None:
            follower.push(state)
    seconds = (recording.end - recording.start) / NS_PER_S
    events = read_true_events(recording)
    stream = ScoredStream(events, detections, seconds, path.name)
    return score_stream(stream, follower.finish(stamp), model.card.vocabulary)


def measure_release(calibration: Calibration, release: float, name: str) -> Calibration:
    """Return a calibration with the release that presses would measure.

    Conductance, a power of the pressure, falls with the time constant `release` [s].
    The error is drawn by the name of a stream.
    """
    if RELEASE_FIELD not in Calibration.__dataclass_fields__:
        raise ValueError(
            "--presses needs a calibration that knows how the sensor releases; this "
            "eskin has none; leave it out"
        )
    rng = np.random.default_rng(list(name.encode()))
    exponent = 1.0 if calibration.curve == "linear" else calibration.exponent
    measured = exponent * release * np.exp(PRESS_ERROR * rng.standard_normal())
    return replace(calibration, **{RELEASE_FIELD: float(measured)})


def count(streams: Sequence[Figures], name: str) -> float:
    """Return the sum of a figure over streams."""
    return float(sum(chain.from_iterable(stream[name] for stream in streams)))


def divide(part: float, whole: float) -> float:
    """Return a share; NaN of nothing."""
    return part / whole if whole else float("nan")


def measure_share(
    parts: Sequence[str], wholes: Sequence[str]
) -> Callable[[Sequence[Figures]], float]:
    """Return the function that divides sums of figures by sums of others."""

    def measure(streams: Sequence[Figures]) -> float:
        part = sum(count(streams, name) for name in parts)
        return divide(part, sum(count(streams, name) for name in wholes))

    return measure


def measure_percentile(
    name: str, percent: float
) -> Callable[[Sequence[Figures]], float]:
    """Return the function that gives a percentile of times over streams [s]."""

    def measure(streams: Sequence[Figures]) -> float:
        values = list(chain.from_iterable(stream[name] for stream in streams))
        return float(np.percentile(values, percent)) if values else float("nan")

    return measure


ALL = ("matched", "missed")
MEASURES: dict[str, Callable[[Sequence[Figures]], float]] = {
    "recall": measure_share(("matched",), ALL),
    "precision": measure_share(("matched",), ("matched", "false")),
    "F1": measure_share(("matched", "matched"), (*ALL, "matched", "false")),
    "touches felt": measure_share(("felt",), ("touches",)),
    "touches cut in true contact": measure_share(("cut",), ("touches",)),
    "touches parted at a gap": measure_share(("parted",), ("touches",)),
    "touches joined to an earlier one": measure_share(("joined",), ("touches",)),
    "false gestures a touch": measure_share(("false",), ("touches",)),
    "false gestures of no true touch, a touch": measure_share(
        ("false, of no true touch",), ("touches",)
    ),
    "opened beside, a touch": measure_share(("opened beside",), ("touches",)),
    "opened after, a touch": measure_share(("opened after",), ("touches",)),
    "poke told after its end, median [s]": measure_percentile("poke", 50),
    "poke told after its end, p95 [s]": measure_percentile("poke", 95),
    "latency, median [s]": measure_percentile("latency", 50),
    "latency, p95 [s]": measure_percentile("latency", 95),
    "end late, median [s]": measure_percentile("late", 50),
    "end late, p90 [s]": measure_percentile("late", 90),
    "closed after the true end, median [s]": measure_percentile("closed", 50),
    "closed after the true end, p90 [s]": measure_percentile("closed", 90),
}
"""Figures of some streams, by their names in the table."""


def resample(
    measure: Callable[[Sequence[Figures]], float], sides: Sequence[Sequence[Figures]]
) -> Iterator[list[float]]:
    """Yield a figure of each side, over the same streams drawn with replacement."""
    rng = np.random.default_rng(0)
    number = len(sides[0])
    for _ in range(RESAMPLED):
        chosen = rng.integers(number, size=number).tolist()
        yield [measure([side[n] for n in chosen]) for side in sides]


def find_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return the 95 % interval of bootstrap values; NaN values are left out."""
    known = np.array(values)[~np.isnan(values)]
    if not len(known):
        return float("nan"), float("nan")
    low, high = np.percentile(known, [2.5, 97.5])
    return float(low), float(high)


def split_by_kind(found: Found) -> Found:
    """Return draws, each with the streams of each kind of build as further draws."""
    split: Found = {}
    for draw, streams in found.items():
        split[draw] = streams
        kinds = sorted({name.split()[0] for name in streams})
        for kind in kinds if len(kinds) > 1 else ():
            own = {name: one for name, one in streams.items() if name.startswith(kind)}
            split[f"{draw}, {kind}"] = own
    return split


def compare(files: dict[str, Found], by_kind: bool = False) -> str:
    """Return a table of all figures, a column a file and one a difference.

    Differences are those of each file to the first, over the same streams.
    """
    if by_kind:
        files = {stem: split_by_kind(found) for stem, found in files.items()}
    names = list(files)
    heads = [*names, *(f"{name} less {names[0]}" for name in names[1:])]
    rows = [format_head(["draw", "figure, with its 95 % interval", *heads])]
    first = files[names[0]]
    for draw in first:
        shared = [
            name
            for name in first[draw]
            if all(name in file.get(draw, {}) for file in files.values())
        ]
        if not shared:
            continue
        sides = [[file[draw][name] for name in shared] for file in files.values()]
        touches = count(sides[0], "touches")
        gestures = count(sides[0], "matched") + count(sides[0], "missed")
        what = f"{len(shared)} streams, {touches:.0f} touches, {gestures:.0f} gestures"
        rows.append(format_row([draw, what, *("" for _ in heads)]))
        for name, measure in MEASURES.items():
            drawn = np.array(list(resample(measure, sides)))
            values = [measure(side) for side in sides]
            cells = [
                format_figure(value, find_interval(drawn[:, n].tolist()))
                for n, value in enumerate(values)
            ]
            for n in range(1, len(values)):
                difference = (drawn[:, n] - drawn[:, 0]).tolist()
                gained = values[n] - values[0]
                cells.append(format_figure(gained, find_interval(difference), "+"))
            rows.append(format_row([draw, name, *cells]))
    return "\n".join(rows)


def format_figure(
    value: float, interval: tuple[float, float], sign: Literal["", "+"] = ""
) -> str:
    """Format a figure with its interval."""
    low, high = interval
    return f"{value:{sign}.3f} ({low:{sign}.3f} to {high:{sign}.3f})"


if __name__ == "__main__":
    main()
