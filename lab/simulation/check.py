"""Compare a property of the simulation with its target."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from lab.tables import format_head, format_row

HEAD = ("property", "target", "measured", "met", "source")


@dataclass(frozen=True)
class BandCheck:
    """Holds a measured property and its target."""

    name: str
    """Name of the property."""
    target: str
    """Target, as text."""
    source: str
    """Source of the target."""
    measured: str
    """Measured value, as text."""
    met: bool
    """Whether the target is met."""


def within(
    name: str,
    value: float,
    low: float,
    high: float,
    source: str,
    unit: str = "",
    target: str = "",
) -> BandCheck:
    """Check that a number lies between two others; `target` replaces their text."""
    target = f"{target or f'{low:.3g} to {high:.3g}'} {unit}".strip()
    measured = f"{value:.3g} {unit}".strip()
    return BandCheck(name, target, source, measured, bool(low <= value <= high))


def at_most(
    name: str, value: float, high: float, source: str, unit: str = ""
) -> BandCheck:
    """Check that a number does not exceed another."""
    return within(name, value, -np.inf, high, source, unit, f"at most {high:.3g}")


def at_least(name: str, value: float, low: float, source: str) -> BandCheck:
    """Check that a number reaches another."""
    return within(name, value, low, np.inf, source, "", f"at least {low:.3g}")


def ordered(name: str, values: dict[str, float], source: str, unit: str) -> BandCheck:
    """Check that numbers rise in the order in which they are given."""
    numbers = np.array(list(values.values()))
    measured = ", ".join(f"{key} {value:.3g}" for key, value in values.items())
    return BandCheck(
        name,
        " < ".join(values),
        source,
        f"{measured} {unit}".strip(),
        bool((np.diff(numbers) > 0).all()),
    )


def as_table(title: str, checks: Iterable[BandCheck]) -> str:
    """Format the checks as a table in Markdown."""
    rows = [f"\n**{title}**\n", format_head(HEAD)]
    rows += [
        format_row([c.name, c.target, c.measured, "yes" if c.met else "NO", c.source])
        for c in checks
    ]
    return "\n".join(rows)
