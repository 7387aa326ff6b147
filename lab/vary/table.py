"""Print a row a number: what halving and doubling it moves.

    python -m lab.vary table FOUND.jsonl
    python -m lab.vary table FOUND.jsonl LONGER.jsonl

Of a variant that is in several files the last one counts, if its number has the value
that it has now. Figures are summed over the worlds, shares and times are means.
`+3 -15` are true touches that became right and wrong. A figure is given where it moves
clearly: of touches and openings, where gains and losses differ by more than 1.96
standard deviations of as many coin tosses; of the others by `CLEAR`. `little` is all
that moves less, `nothing` is no difference in any figure of any world.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import tyro

import eskin
from lab.tables import format_head, format_row
from lab.vary.numbers import Number, Sources
from lab.vary.play import FACTORS, read_lines

CLEAR = {
    "deaf": 0.002,
    "masked": 0.02,
    "polarity": 0.02,
    "faults": 1.0,
    "onset error": 0.01,
    "end error": 0.02,
    "force": 0.3,
    "false seconds": 1.0,
}
"""Differences of means over worlds from which they are clear: of shares, of the number
of faults, of times [s] and of the force [N]."""
SUMMED = ("openings", "parts")
"""Figures that are counted, and summed."""
SHARES = ("deaf", "masked", "polarity")
NAMES = {"parts": "cut in two", "masked": "faulty masked"}
"""Names of figures in the table, where they differ."""
SIGMAS = 1.96
MOST = 5
"""Number of figures of a variant that are printed, the ones that move most."""
Figures = dict[str, dict]
"""Figures by world, as `lab.vary.play` writes them."""


@dataclass(frozen=True)
class Command:
    """Print a row a number: what halving and doubling it moves."""

    found: tyro.conf.Positional[tuple[Path, ...]]
    """Files of figures; the later ones count first."""
    sources: Path = Path(eskin.__file__).parent
    """Folder of the package whose numbers were varied."""
    without: tuple[str, ...] = ()
    """Worlds that do not count, as where the front end is chaotic."""


@dataclass(frozen=True)
class Change:
    """A change of one figure."""

    text: str
    size: float
    """Its size in units of the smallest one that is clear."""


def compare_outcomes(name: str, usual: Figures, found: Figures) -> Change | None:
    """Compare the outcomes of the true touches of all worlds."""
    gained = lost = before = 0
    for world, figures in usual.items():
        old = figures["outcomes"][name]
        new = found[world]["outcomes"][name]
        before += old.count("1")
        for one, other in zip(old, new, strict=True):
            gained += other > one
            lost += other < one
    if not gained and not lost:
        return None
    text = f"{name} {before} to {before + gained - lost} (+{gained} -{lost})"
    return Change(text, measure(gained, lost))


def compare_counts(name: str, usual: Figures, found: Figures) -> Change | None:
    """Compare counted figures of all worlds."""
    pairs = [(usual[one]["counts"][name], found[one]["counts"][name]) for one in usual]
    gained = sum(max(new - old, 0.0) for old, new in pairs)
    lost = sum(max(old - new, 0.0) for old, new in pairs)
    if not gained and not lost:
        return None
    before = sum(old for old, _ in pairs)
    text = f"{NAMES.get(name, name)} {before:g} to {before + gained - lost:g}"
    return Change(text, measure(gained, lost))


def measure(gained: float, lost: float) -> float:
    """Return the size of a change, 1 where it is just clear."""
    return abs(gained - lost) / (SIGMAS * math.sqrt(gained + lost))


def compare_means(name: str, usual: Figures, found: Figures) -> Change | None:
    """Compare the mean of a figure over all worlds."""
    worlds = [one for one in usual if is_counted(name, usual[one])] or list(usual)
    old = sum(usual[one]["counts"][name] for one in worlds) / len(worlds)
    new = sum(found[one]["counts"][name] for one in worlds) / len(worlds)
    if all(usual[one]["counts"][name] == found[one]["counts"][name] for one in worlds):
        return None
    unit = CLEAR[name]
    text = f"{NAMES.get(name, name)} {format_mean(name, old)} to "
    return Change(text + format_mean(name, new), abs(new - old) / unit)


def is_counted(name: str, figures: dict) -> bool:
    """Return whether a world tells something of a figure."""
    if name in ("onset error", "end error", "force"):
        return figures["counts"]["touches"] > 0
    return True


def format_mean(name: str, value: float) -> str:
    """Format a mean."""
    if name in SHARES:
        return f"{100 * value:.2f} %"
    unit = {"faults": "", "force": " N"}.get(name, " s")
    return f"{value:.3g}{unit}"


def leave_out(worlds: Collection[str], lines: list[dict]) -> list[dict]:
    """Return the lines of a file without some worlds."""
    for line in lines:
        for world in worlds:
            line["figures"].pop(world, None)
    return lines


def compare(usual: Figures, found: Figures) -> list[Change]:
    """List what differs between two variants, the largest changes first."""
    outcomes = next(iter(usual.values()))["outcomes"]
    changes = [compare_outcomes(name, usual, found) for name in outcomes]
    changes += [compare_counts(name, usual, found) for name in SUMMED]
    changes += [compare_means(name, usual, found) for name in CLEAR]
    kept = [one for one in changes if one]
    return sorted(kept, key=lambda one: -one.size)


def describe(line: dict | None, usual: Figures) -> str:
    """Return the cell of a variant."""
    if line is None:
        return "not played"
    if line["error"]:
        return f"fails ({line['error'][:60]})"
    changes = compare(usual, line["figures"])
    clear = [one.text for one in changes if one.size >= 1.0]
    if clear:
        return ", ".join(clear[:MOST])
    return "little" if changes else "nothing"


def format_value(value: float) -> str:
    """Format the value of a number."""
    return f"{value:.4g}"


def build_row(number: Number, files: list[list[dict]]) -> list[str]:
    """Build the row of a number."""
    cells = [f"`{number.label}`", format_value(number.value)]
    for factor in FACTORS:
        if number.scale(factor) == number.value:
            cells.append("cannot be less")
            continue
        line = None
        usual = {}
        for lines in files:
            same = [
                one
                for one in lines
                if one["key"] == number.key and one["value"] == number.scale(factor)
            ]
            if same:
                line = same[0]
                usual = next(one["figures"] for one in lines if not one["key"])
        cells.append(describe(line, usual))
    return cells


def main(command: Command) -> None:
    """Print the table, a part a module, and the numbers that are not varied."""
    sources = Sources(command.sources)
    files = [leave_out(command.without, read_lines(path)) for path in command.found]
    numbers = sources.list_numbers()
    for module in sources.modules:
        own = [number for number in numbers if number.module == module]
        if own:
            print(f"\n## {module.replace('.', '/')}.py\n")
            print(format_head(["number", "value", "halved", "doubled"]))
            for number in own:
                print(format_row(build_row(number, files)))
    rest: dict[str, list[str]] = {}
    for place in sources.list_places():
        why = sources.why_not_tuned(place)
        if why:
            rest.setdefault(why, []).append(f"`{place[1]}`")
    print("\n## Not varied\n")
    print(format_head(["why", "constants"]))
    for why, names in rest.items():
        print(format_row([why, ", ".join(dict.fromkeys(names))]))
