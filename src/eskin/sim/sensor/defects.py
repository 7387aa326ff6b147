"""This module draws lasting faults of taxels and lines, and losses of readings."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from eskin.sim.constants import Constants
from eskin.skin import Skin


@dataclass(frozen=True, eq=False)
class Defects:
    """Defects are lasting faults of taxels and lines, and on the way to the host."""

    dead: Bool[np.ndarray, "taxel"]
    """Taxels, alone or in a dead row or column, that no longer respond."""
    stuck: Float[np.ndarray, "taxel"]
    """Reading of a stuck taxel, relative to full scale; NaN of the others."""
    lines: tuple[str, ...]
    """Dead rows and columns, such as `patch:row:3`."""
    dropped: float
    """Share of a patch's readings that do not arrive."""
    dropped_run: float
    """Mean length of a run of them [readings]."""


def build_intact_defects(skin: Skin, constants: Constants) -> Defects:
    """Return defects of a sensor in which nothing is broken."""
    whole = np.zeros(skin.count, dtype=bool)
    run = constants.value("sensor.dropped_run")
    return Defects(whole, np.full(skin.count, np.nan), (), 0.0, run)


def draw_defects(
    kind: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> Defects:
    """Draw the defects of a build of some kind."""
    share = constants.draw(f"sensor.defective.{kind}", rng)
    broken = rng.permutation(skin.count)[: round(share * skin.count)]
    is_stuck = rng.random(len(broken)) < constants.value("sensor.stuck")
    stuck = np.full(skin.count, np.nan)
    stuck[broken[is_stuck]] = rng.random(int(is_stuck.sum()))
    dead = np.zeros(skin.count, dtype=bool)
    dead[broken[~is_stuck]] = True
    lines = draw_lines(kind, skin, constants, rng)
    for line in lines:
        dead |= find_line_taxels(line, skin)
    return Defects(
        dead=dead,
        stuck=stuck,
        lines=lines,
        dropped=constants.value(f"sensor.dropped.{kind}"),
        dropped_run=constants.value("sensor.dropped_run"),
    )


def draw_lines(
    kind: str, skin: Skin, constants: Constants, rng: np.random.Generator
) -> tuple[str, ...]:
    """Draw the dead rows and columns."""
    chance = constants.value(f"sensor.dead_line.{kind}")
    lines = [draw_line(index, skin, rng) for index in range(len(skin.patches))]
    hit = rng.random(len(lines)) < chance
    return tuple(line for line, is_hit in zip(lines, hit, strict=True) if is_hit)


def draw_line(index: int, skin: Skin, rng: np.random.Generator) -> str:
    """Draw a row or a column of a patch."""
    taxel = int(rng.choice(np.flatnonzero(skin.patch_index == index)))
    is_row = bool(rng.random() < 0.5)
    number = (skin.rows if is_row else skin.columns)[taxel]
    return f"{skin.patches[index].id}:{'row' if is_row else 'column'}:{number}"


def find_line_taxels(line: str, skin: Skin) -> Bool[np.ndarray, "taxel"]:
    """Find the taxels of a line that is named as in `Defects.lines`."""
    patch, what, number = line.rsplit(":", 2)
    inside = np.zeros(skin.count, dtype=bool)
    inside[skin.find_taxels(patch)] = True
    numbers = skin.rows if what == "row" else skin.columns
    return inside & (numbers == int(number))
