"""This module draws faults of taxels and lines, losses, and electrical events."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import Constants
from eskin.sim.sensor.electronics import Electronics
from eskin.sim.sensor.flaws import FlawDraw, draw_some
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
    every = [draw_line(index, skin, rng) for index in range(len(skin.patches))]
    hit = rng.random(len(every)) < constants.value(f"sensor.dead_line.{kind}")
    lines = tuple(line for line, is_hit in zip(every, hit, strict=True) if is_hit)
    for line in lines:
        dead |= find_line_taxels(line, skin)
    return Defects(
        dead=dead,
        stuck=stuck,
        lines=lines,
        dropped=constants.value(f"sensor.dropped.{kind}"),
        dropped_run=constants.value("sensor.dropped_run"),
    )


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


def draw_family_defects(draw: FlawDraw, skin: Skin) -> Defects:
    """Draw the lasting faults of a build of a family; readings get lost one by one."""
    rng = draw.rng
    dead = draw_some(draw, skin, "dead")
    stuck = np.full(skin.count, np.nan)
    stuck[draw_some(draw, skin, "stuck")] = rng.random()
    stuck = np.where(np.isnan(stuck), np.nan, rng.random(skin.count))
    share = draw.take("dead_line", "dead_line")
    hit = rng.random(len(skin.patches)) < share
    if draw.levels is not None and share > 0.0:
        hit[rng.integers(len(skin.patches))] = True
    lines = tuple(draw_line(int(patch), skin, rng) for patch in np.flatnonzero(hit))
    for line in lines:
        dead |= find_line_taxels(line, skin)
    return Defects(dead, stuck, lines, draw.take("lost", "lost"), dropped_run=1.0)


ELECTRICAL_EVENTS = ("line_step", "stuck_line", "dropout", "burst")
"""Kinds of events: a row or column jumps or reads full scale; a patch is silent or
noisy."""

Counts = Int[np.ndarray, "reading taxel"]
Received = Bool[np.ndarray, "reading taxel"]


def add_electrical_event(
    kind: str,
    counts: Counts,
    received: Received,
    skin: Skin,
    electronics: Electronics,
    rng: np.random.Generator,
    constants: Constants,
    onset: int | None = None,
) -> tuple[Counts, Received, dict[str, float | str]]:
    """Add one electrical event to a copy of counts.

    `onset` is the first reading of the event, drawn unless given.

    Returns:
        The counts, whether each arrives, and what was drawn.

    Raises:
        ValueError: there is no such kind.
    """
    if kind not in ELECTRICAL_EVENTS:
        raise ValueError(
            f"electrical event '{kind}' is unknown; allowed are "
            f"{', '.join(ELECTRICAL_EVENTS)}; take one of them"
        )
    counts = counts.copy()
    received = received.copy()
    readings = len(counts)
    if onset is None:
        onset = int(constants.draw("sensor.electrical.onset", rng) * readings)
    length = draw_event_length(kind, electronics.period, constants, rng)
    during = slice(onset, min(onset + length, readings))
    patch = int(rng.integers(len(skin.patches)))
    drawn = {"electrical": kind, "onset": onset, "readings": during.stop - onset}
    if kind in ("line_step", "stuck_line"):
        line = draw_line(patch, skin, rng)
        inside = find_line_taxels(line, skin)
    else:
        line = skin.patches[patch].id
        inside = skin.patch_index == patch
    full = electronics.full_scale
    size = 0.0
    if kind == "dropout":
        received[during, inside] = False
    elif kind == "stuck_line":
        counts[during, inside] = full
    else:
        size = constants.draw(EVENT_SIZES[kind], rng)
        shape = (during.stop - during.start, int(inside.sum()))
        one = np.ones(shape) if kind == "line_step" else rng.standard_normal(shape)
        steps = np.round(full * size * one).astype(np.int32)
        counts[during, inside] = np.clip(counts[during, inside] + steps, 0, full)
    counts[~received] = 0
    return counts, received, drawn | {"place": line, "size": size}


EVENT_SIZES = {
    "line_step": "sensor.electrical.step",
    "burst": "sensor.electrical.burst",
}


def draw_event_length(
    kind: str, period: float, constants: Constants, rng: np.random.Generator
) -> int:
    """Draw how many readings, a period [s] apart, an event lasts."""
    if kind == "dropout":
        return max(round(constants.draw("sensor.electrical.dropout", rng)), 1)
    name = "burst_hold" if kind == "burst" else "hold"
    seconds = constants.draw(f"sensor.electrical.{name}", rng)
    return max(round(seconds / period), 1)
