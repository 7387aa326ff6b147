"""This module adds electrical events that no touch made: connectors, interference."""

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import Constants, load_constants
from eskin.sim.sensor.build import SensorBuild
from eskin.sim.sensor.defects import draw_line, find_line_taxels
from eskin.skin import Skin

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
    build: SensorBuild,
    rng: np.random.Generator,
    constants: Constants | None = None,
    onset: int | None = None,
) -> tuple[Counts, Received, dict[str, float | str]]:
    """Add one electrical event to a copy of counts.

    Args:
        kind: one of `ELECTRICAL_EVENTS`.
        counts: counts of the converter.
        received: whether each count arrives.
        skin: skin of the taxels.
        build: skin as built.
        rng: random generator.
        constants: constants of the simulation; the published ones unless given.
        onset: first reading of the event; drawn unless given.

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
    constants = constants or load_constants()
    counts, received = counts.copy(), received.copy()
    readings = len(counts)
    if onset is None:
        onset = int(constants.draw("sensor.electrical.onset", rng) * readings)
    hold = draw_event_length(kind, build, constants, rng)
    during = slice(onset, min(onset + hold, readings))
    patch = int(rng.integers(len(skin.patches)))
    drawn = {"electrical": kind, "onset": onset, "readings": during.stop - onset}
    if kind in ("line_step", "stuck_line"):
        line = draw_line(patch, skin, rng)
        inside = find_line_taxels(line, skin)
    else:
        line = skin.patches[patch].id
        inside = skin.patch_index == patch
    full = build.electronics.full_scale
    size = 0.0
    if kind == "dropout":
        received[during, inside] = False
    elif kind == "stuck_line":
        counts[during, inside] = full
    else:
        size = constants.draw(EVENT_SIZES[kind], rng)
        shape = (during.stop - during.start, int(inside.sum()))
        added = full * size * draw_event_shape(kind, shape, rng)
        steps = np.round(added).astype(np.int32)
        counts[during, inside] = np.clip(counts[during, inside] + steps, 0, full)
    counts[~received] = 0
    return counts, received, drawn | {"place": line, "size": size}


EVENT_SIZES = {
    "line_step": "sensor.electrical.step",
    "burst": "sensor.electrical.burst",
}


def draw_event_shape(
    kind: str, shape: tuple[int, int], rng: np.random.Generator
) -> Float[np.ndarray, "reading part"]:
    """Draw an event of size 1: a step, or noise."""
    return np.ones(shape) if kind == "line_step" else rng.standard_normal(shape)


def draw_event_length(
    kind: str, build: SensorBuild, constants: Constants, rng: np.random.Generator
) -> int:
    """Draw how many readings an event lasts."""
    if kind == "dropout":
        return max(round(constants.draw("sensor.electrical.dropout", rng)), 1)
    name = "burst_hold" if kind == "burst" else "hold"
    seconds = constants.draw(f"sensor.electrical.{name}", rng)
    return max(round(seconds / build.electronics.period), 1)
