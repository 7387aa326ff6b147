"""Play the worlds with each tuned number halved and doubled.

    python -m lab.vary play FOLDER FOUND.jsonl
    python -m lab.vary play FOLDER FOUND.jsonl --modules touch.outage_kernels
    python -m lab.vary play FOLDER TRUE.jsonl --names NoiseBand.noise_sigmas --edited

Each variant adds a line to the file, and those that are there are not played again.
One process plays all of them (`lab.vary.rewrite`). With `--edited` each is played by
sources in which the number is changed, which are compiled for it: the figures must be
the same.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import tyro

import eskin
from lab.vary.make import SETTINGS
from lab.vary.numbers import Number, Sources
from lab.vary.rewrite import Slots, write_copy, write_edited

FACTORS = (0.5, 2.0)
"""What each number is multiplied by."""


@dataclass(frozen=True)
class Command:
    """Play the worlds with each tuned number halved and doubled."""

    folder: tyro.conf.Positional[Path]
    """Folder of the worlds."""
    found: tyro.conf.Positional[Path]
    """File of the figures, a line a variant in JSON."""
    sources: Path = Path(eskin.__file__).parent
    """Folder of the package whose numbers are varied."""
    names: tuple[str, ...] = ()
    """Numbers to vary, such as `ContactConfig.on` or `PressEnd.fall_rate`; all unless
    given."""
    modules: tuple[str, ...] = ()
    """Modules whose numbers are varied, in this order; all unless given."""
    moved: Path | None = None
    """File of figures of other worlds: only variants are played that move some."""
    edited: bool = False
    """Whether the sources of each variant are changed and compiled."""
    minutes: float = float("inf")
    """Time after which no further variant is begun [min]."""


@dataclass(frozen=True)
class Variant:
    """A variant is one number times a factor; the first has all as they are."""

    key: str
    """The number, as of `Number.key`; empty for none."""
    factor: float
    value: float

    @property
    def changed(self) -> dict[str, float]:
        """The changed number by its key."""
        return {self.key: self.value} if self.key else {}


AS_IS = Variant("", 1.0, 0.0)
"""The variant in which nothing is changed."""


def list_variants(numbers: Iterable[Number]) -> list[Variant]:
    """List the variants of some numbers, without those that change nothing."""
    found = [AS_IS]
    for number in numbers:
        for factor in FACTORS:
            value = number.scale(factor)
            if value != number.value:
                found.append(Variant(number.key, factor, value))
    return found


def choose_numbers(sources: Sources, command: Command) -> list[Number]:
    """List the numbers that are to be varied.

    Raises:
        ValueError: there is no number or module of a name.
    """
    numbers = sources.list_numbers()
    modules = command.modules or tuple(sources.modules)
    labels = {number.label for number in numbers}
    unknown = [*(set(command.names) - labels), *(set(modules) - set(sources.modules))]
    if unknown:
        raise ValueError(
            f"no tuned number or module '{unknown[0]}'; allowed are those that "
            "`lab.vary.numbers` finds; leave it out for all"
        )
    return [
        number
        for module in modules
        for number in numbers
        if number.module == module
        and (not command.names or number.label in command.names)
    ]


def digest(sources: Sources, folder: Path) -> str:
    """Return a digest of the front end and of the settings of the worlds."""
    found = hashlib.sha256((folder / SETTINGS).read_bytes())
    for module in sources.modules:
        place = sources.folder.joinpath(*module.split("."))
        found.update(place.with_suffix(".py").read_bytes())
    return found.hexdigest()[:16]


def read_lines(path: Path) -> list[dict]:
    """Read the lines of a file of figures; there are none without it."""
    if not path.is_file():
        return []
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


def find_moved(path: Path) -> set[tuple[str, float]]:
    """Return the variants of a file that move some figure."""
    lines = read_lines(path)
    usual = next(line for line in lines if not line["key"])
    return {
        (line["key"], line["factor"])
        for line in lines
        if line["figures"] != usual["figures"]
    }


def main(command: Command) -> None:
    """Play the variants that are not played yet."""
    begun = time.monotonic()
    sources = Sources(command.sources.resolve())
    mark = digest(sources, command.folder)
    done = read_lines(command.found)
    if any(line["digest"] != mark for line in done):
        fail(f"{command.found} is of other sources or worlds; give another file")
    try:
        variants = list_variants(choose_numbers(sources, command))
    except ValueError as error:
        fail(str(error))
    if command.moved:
        moved = find_moved(command.moved)
        variants = [
            one for one in variants if one is AS_IS or (one.key, one.factor) in moved
        ]
    played = {(line["key"], line["factor"]) for line in done}
    left = [one for one in variants if (one.key, one.factor) not in played]
    print(f"{len(variants)} variants, {len(left)} to play", flush=True)
    for parts in split(left, command.edited):
        minutes = command.minutes - (time.monotonic() - begun) / 60
        if minutes > 0:
            play_parts(sources, parts, command, mark, minutes)


def fail(text: str) -> NoReturn:
    """Print one line, and end the program."""
    print(text, file=sys.stderr)
    sys.exit(2)


def split(variants: list[Variant], each: bool) -> Iterator[list[Variant]]:
    """Yield the variants one by one, or all together."""
    if each:
        yield from ([one] for one in variants)
    elif variants:
        yield variants


def play_parts(
    sources: Sources,
    variants: list[Variant],
    command: Command,
    mark: str,
    minutes: float,
) -> None:
    """Play some variants by one copy of the sources.

    Where one ends the process, that is its line, and the next process goes on.
    """
    with tempfile.TemporaryDirectory() as work:
        if command.edited:
            write_edited(sources, variants[0].changed, Path(work))
        else:
            write_copy(Slots.build(sources), Path(work))
        paths = os.pathsep.join([work, *filter(None, sys.path)])
        ends_at = time.time() + 60 * minutes
        while variants and time.time() < ends_at:
            before = len(read_lines(command.found))
            task = {
                "folder": str(command.folder),
                "found": str(command.found),
                "sources": str(sources.folder),
                "digest": mark,
                "edited": command.edited,
                "ends_at": ends_at,
                "variants": [vars(one) for one in variants],
            }
            child = subprocess.run(
                [sys.executable, "-m", "lab.vary.child"],
                input=json.dumps(task),
                text=True,
                env={**os.environ, "PYTHONPATH": paths},
            )
            played = len(read_lines(command.found)) - before
            variants = variants[played:]
            if child.returncode and variants and variants[0] is not AS_IS:
                failed, *variants = variants
                write_line(command.found, failed, mark, {}, f"exit {child.returncode}")
            elif child.returncode:
                fail(
                    f"the worlds of {command.folder} cannot be played; make them again"
                )


def write_line(
    path: Path, variant: Variant, mark: str, figures: dict, error: str = ""
) -> None:
    """Add the line of a variant to a file of figures."""
    line = {"digest": mark, **vars(variant), "figures": figures, "error": error}
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line) + "\n")
