"""This module computes the pressure on taxels from a recorded pressure movie."""

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.kernels import compute_movie_pressure
from eskin.sim.contact.press import MoviePress
from eskin.sim.contact.pressure import (
    PressureField,
    build_taxel_geometry,
    stretch_steps_on_dome,
)
from eskin.skin import Dome

N_PER_KPA_M2 = 1e3
"""Force of 1 kPa on 1 m2 [N]."""


def compute_movie_field(
    press: MoviePress, chart: Chart, constants: Constants
) -> PressureField:
    """Compute the pressure of a movie on a chart's taxels, and its true contact."""
    pressure = compute_movie_pressure(
        press.pressure,
        press.pitch,
        press.middle,
        press.centre,
        press.angle,
        build_taxel_geometry(chart, constants),
    )
    pressed = pressure.max(axis=0, initial=0.0) > 0.0
    touched = press.pressure >= constants.value("contact.touched")
    cells = np.where(press.force > 0.0, touched.sum(axis=(1, 2)), 0)
    return PressureField(
        taxels=chart.taxels[pressed],
        pressure=pressure[:, pressed],
        area=cells * press.pitch**2,
        force=press.force,
        centroid=compute_movie_centroid(press, chart),
    )


def compute_movie_force(
    pressure: Float[np.ndarray, "time row column"], pitch: float
) -> Float[np.ndarray, "time"]:
    """Return the force of a movie at each step [N]."""
    return pressure.sum(axis=(1, 2)) * pitch**2 * N_PER_KPA_M2


def find_middle(
    pressure: Float[np.ndarray, "*time row column"],
) -> Float[np.ndarray, "*time 2"]:
    """Find row and column of the centre of pressure; NaN without pressure."""
    rows, columns = np.arange(pressure.shape[-2]), np.arange(pressure.shape[-1])
    with np.errstate(invalid="ignore"):
        by_row = pressure.sum(axis=-1) / pressure.sum(axis=(-2, -1))[..., None]
        by_column = pressure.sum(axis=-2) / pressure.sum(axis=(-2, -1))[..., None]
    return np.stack([by_row @ rows, by_column @ columns], axis=-1)


def compute_movie_centroid(
    press: MoviePress, chart: Chart
) -> Float[np.ndarray, "time 2"]:
    """Return where the force acts, unrolled (s, t); the centre without force [m]."""
    from_middle = np.nan_to_num(find_middle(press.pressure) - press.middle)
    y, x = press.pitch * from_middle.T
    cos, sin = np.cos(press.angle), np.sin(press.angle)
    offsets = np.column_stack([x * cos - y * sin, x * sin + y * cos])
    if isinstance(chart.surface, Dome):
        start = press.centre[:, None]
        offsets = stretch_steps_on_dome(start, offsets[:, None], chart.radius)[:, 0]
    return press.centre + offsets
