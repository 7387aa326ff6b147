"""Check the simulation against measured and published properties.

python -m lab.simulation [PART], where PART is physics, rig, sensor, families
or all.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import tyro

from eskin.sim.constants import load_constants
from lab.simulation.check import as_table
from lab.simulation.element import element_checks
from lab.simulation.families import family_table
from lab.simulation.physics import physics_checks
from lab.simulation.rig import rig_checks

Part = Literal["physics", "rig", "sensor", "families", "all"]


BUILDS = 6
"""Builds of each family that are measured."""


@dataclass(frozen=True)
class Command:
    """Print properties of the simulation beside their targets."""

    part: tyro.conf.Positional[Part] = "all"
    """Tables to print."""
    people: int = 100
    """Number of people; three times as many on the rig, where spreads are compared."""
    seed: int = 0
    """Seed of people and touches."""


def physics(command: Command) -> str:
    """Check areas, profiles and times of contact."""
    checks = physics_checks(load_constants(), command.people, command.seed)
    return as_table("Contact", checks)


def rig(command: Command) -> str:
    """Check areas, peaks and durations on the grid of CoST."""
    constants = load_constants()
    people = 3 * command.people
    difficulty = constants.value("sets.difficulty")
    checks = rig_checks(constants, people, 4, difficulty, command.seed)
    return as_table(f"The rig of CoST, {people} people, 4 captures each", checks)


def sensor(command: Command) -> str:
    """Check one element against logged presses."""
    return as_table("One element", element_checks(load_constants(), command.seed))


def families(command: Command) -> str:
    """Measure builds of every family as real arrays were measured."""
    return family_table(load_constants(), BUILDS, command.seed)


PARTS: dict[str, Callable[[Command], str]] = {
    "physics": physics,
    "rig": rig,
    "sensor": sensor,
    "families": families,
}


def main() -> None:
    """Print the chosen tables."""
    command = tyro.cli(Command)
    for name, table in PARTS.items():
        if command.part in (name, "all"):
            print(table(command), flush=True)


if __name__ == "__main__":
    main()
