"""From a press to the pressure that taxels feel.

The parts of a body share its load as springs that sink together, each makes an ellipse
of a size that depends on its load, and the pressure in it is an inverted paraboloid
(Pawluk and Howe 1999).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.contact_kernels import Dents, Ground, imprint
from eskin.sim.contact.dents import dents_of
from eskin.sim.contact.film import grid_neighbours, spread
from eskin.sim.contact.press import Press
from eskin.skin.round import Dome

__all__ = ["Felt", "feel", "grid_neighbours", "spread"]


@dataclass(frozen=True, eq=False)
class Felt:
    """What one press does to the skin through time."""

    taxels: Int[np.ndarray, "active"]
    """Indices into the skin's taxels, ascending, of all that are ever pressed."""
    pressure: Float[np.ndarray, "time active"]
    """Mean pressure over the sensing part of each [kPa]."""
    area: Float[np.ndarray, "time"]
    """True area of contact, on taxels or beside them [m2]."""
    force: Float[np.ndarray, "time"]
    """True force on the surface, on taxels or beside them [N]."""
    centroid: Float[np.ndarray, "time 2"]
    """Where the force acts, unrolled (s, t); s goes on past a turn of a tube [m]."""


def feel(press: Press, chart: Chart, constants: Constants) -> Felt:
    """What the taxels of a chart feel of a press on it, and what it truly is."""
    dents, area, centroid = dents_of(press, chart, constants)
    ground = ground_of(chart, constants)
    part_of, taxel_of = np.nonzero(within_reach(dents, ground))
    reached = np.unique(taxel_of)
    column_of = np.zeros(len(chart.taxels), dtype=np.int64)
    column_of[reached] = np.arange(len(reached))
    pressure = imprint(
        *(dents, ground, part_of, taxel_of, column_of, len(reached)),
        *(NODES, WEIGHTS, constants.value("contact.fine_below")),
    )
    pressed = pressure.max(axis=0, initial=0.0) > 0.0
    return Felt(
        taxels=chart.taxels[reached[pressed]],
        pressure=pressure[:, pressed],
        area=area,
        force=np.maximum(press.force, 0.0),
        centroid=centroid,
    )


def ground_of(chart: Chart, constants: Constants) -> Ground:
    """The chart's taxels, of which only the middle part senses."""
    cells = chart.cells * np.sqrt(constants.value("contact.fill"))
    dome = chart.radius if isinstance(chart.surface, Dome) else np.inf
    return Ground(chart.unrolled, cells, chart.circumference, dome)


def within_reach(dents: Dents, ground: Ground) -> Bool[np.ndarray, "part taxel"]:
    """Which parts may ever meet which taxels, by boxes about their ways."""
    loaded = dents.peak > 0.0
    used = np.any(loaded, axis=0)
    low = np.where(loaded[..., None], dents.centres, np.inf).min(axis=0, initial=FAR)
    high = np.where(loaded[..., None], dents.centres, -np.inf).max(axis=0, initial=-FAR)
    size = np.where(loaded, dents.axes.max(axis=2), 0.0).max(axis=0, initial=0.0)
    half = (high - low) / 2 + size[:, None]
    half = half + np.abs(ground.cells).sum(axis=1).max(axis=0, initial=0.0)
    if np.isfinite(ground.dome):
        half = half * DOME_STRETCH
    away = ground.centres - (low + high)[:, None] / 2
    if np.isfinite(ground.whole):
        away[..., 0] -= ground.whole * np.round(away[..., 0] / ground.whole)
    return used[:, None] & np.all(np.abs(away) <= half[:, None], axis=2)


FAR = 1e6
"""Farther than anything of a robot [m]."""

DOME_STRETCH = np.pi / 2
"""Most that a dome's chart stretches lengths: at its rim, a quarter turn off."""


def quadrature() -> tuple[Float[np.ndarray, "2 3"], Float[np.ndarray, "2 3"]]:
    """Gauss nodes and weights, of two points in the first row, of three in the other.

    The weights sum to 1.
    """
    nodes, weights = np.zeros((2, 3)), np.zeros((2, 3))
    for row, count in enumerate((2, 3)):
        nodes[row, :count], weights[row, :count] = np.polynomial.legendre.leggauss(
            count
        )
    return nodes, weights / 2


NODES, WEIGHTS = quadrature()
