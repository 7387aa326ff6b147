"""Compare methods on a public set of recordings, with people or sessions held out.

    python -m lab.real_recordings sleeve --data ../shared/data/sleeve
    python -m lab.real_recordings shearsense --data ../shared/data/shearsense
    python -m lab.real_recordings socialtouch --data ../shared/data/socialtouch
    python -m lab.real_recordings capfingerid --data ../shared/data/capfingerid

The same with `cost` and `haart`. The set is converted as by `eskin convert`, then
compared as by `lab.compare --recordings`: one session (sleeve) or one person (all
others) is held out at a time. Answers are kept in WORK/kept, so that an interrupted
comparison can go on.
"""

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import tyro

from eskin.recording import NONE, find_recordings, read_recording
from eskin.sets import (
    LAYOUTS,
    ConversionResult,
    convert_shearsense,
    convert_sleeve,
    convert_socialtouch,
    convert_table,
)
from eskin.sets.conversion import SetName
from eskin.sets.socialtouch import find_group
from lab.compare import CompareCommand, run_compare
from lab.program import run_program

CONVERT: Mapping[str, Callable[[Path, Path], ConversionResult]] = {
    "sleeve": convert_sleeve,
    "shearsense": convert_shearsense,
    "socialtouch": convert_socialtouch,
} | {
    name: partial(convert_table, layout=layout, name=name)
    for name, layout in LAYOUTS.items()
}
"""Functions that convert a set to recordings, by its name."""


@dataclass(frozen=True)
class RealCommand:
    """Compare methods on a public set, with people or sessions held out."""

    kind: tyro.conf.Positional[SetName]
    """Data set."""
    data: Path
    """Folder of the data set, as downloaded."""
    work: Path = Path("sets")
    """Folder that keeps recordings, prepared recordings, and answers."""
    seeds: int = 1
    """Number of trainings of each method."""
    methods: tuple[str, ...] = ()
    """Methods to compare, all unless given; the others are compared with the first."""
    workers: int = 1
    """Number of processes that train at once."""
    minutes: float = math.inf
    """Time after which no further training is started [min]."""


def run_real(command: RealCommand) -> dict[str, object]:
    """Convert a set, print the tables of each comparison, and return their rows."""
    folder = command.work / command.kind
    CONVERT[command.kind](command.data, folder)
    hold_out = "session" if command.kind == "sleeve" else "subject"
    usual = CompareCommand(
        recordings=(folder,),
        hold_out=hold_out,
        seeds=command.seeds,
        methods=command.methods,
        pack=command.work / "pack",
        workers=command.workers,
        minutes=command.minutes,
    )
    found = {}
    for title, compare in build_comparisons(usual, folder).items():
        print(f"\n**{title}**\n", flush=True)
        name = "-".join(title.lower().replace(",", "").split())
        kept = command.work / "kept" / f"{command.kind}-{name}.jsonl"
        found[title] = run_compare(replace(compare, results=kept))["rows"]
    return found


def build_comparisons(usual: CompareCommand, folder: Path) -> dict[str, CompareCommand]:
    """Return the comparisons of a set by title.

    That of a skin with shear is also made without it; that of social touch also with
    the groups of its gestures as classes.
    """
    paths = find_recordings((folder,))
    recordings = [read_recording(path) for path in paths]
    if folder.name == "socialtouch":
        gestures = {label.gesture for each in recordings for label in each.labels}
        groups = {name: find_group(name) for name in sorted(gestures - {NONE})}
        grouped = replace(usual, rename=groups)
        return {"All gestures": usual, "Groups of gestures": grouped}
    if recordings[0].skin.has_shear:
        pressure = replace(usual, shear=False)
        return {"Pressure": pressure, "Pressure and shear": usual}
    return {"Segments": usual}


if __name__ == "__main__":
    sys.exit(run_program(run_real))
