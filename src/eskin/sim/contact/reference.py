"""An independent look at contact: rigid ellipsoids in MuJoCo under a Winkler law.

Nothing of it is used to make clips. It shares with `contact` what a body is and how
stiff: not the areas of its parts, nor the shape of the pressure, nor how curvatures and
gaps are reckoned.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import map_coordinates

from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.contact import Felt
from eskin.sim.contact.dents import KPA, MM, placed
from eskin.sim.contact.press import Press
from eskin.sim.contact.reference_scene import Scene, Sheet

__all__ = ["Agreement", "agreement", "feel_in_mujoco"]


@dataclass(frozen=True)
class Agreement:
    """How near the model comes to the reference at one instant."""

    area: float
    """True area of contact over that of the reference."""
    centroid: float
    """Distance of the centroids [m]."""
    correlation: float
    """Of the pressures of all taxels about the body."""
    strict: float
    """Of the pressures of those taxels only that either feels."""


def feel_in_mujoco(press: Press, chart: Chart, constants: Constants) -> Felt:
    """What `feel` gives for the first step of a press, by way of MuJoCo.

    Needs MuJoCo (extra `sim`).

    Raises:
        ValueError: the parts cannot carry the force.
        ExtraError: MuJoCo is not installed.
    """
    press = instant(press, 0)
    sheet = sheet_about(press, chart, constants)
    scene = Scene(press, chart, sheet)
    pressure = pressed(press, scene, constants)
    loads = pressure * scene.areas / KPA
    taxels, felt = on_taxels(pressure, sheet, chart, constants)
    touched = pressure > constants.value("contact.touched")
    return Felt(
        taxels=chart.taxels[taxels],
        pressure=felt[None],
        area=np.array([scene.areas[touched].sum()]),
        force=np.array([loads.sum()]),
        centroid=(loads @ sheet.unrolled / loads.sum())[None],
    )


def instant(press: Press, step: int) -> Press:
    """One step of a press."""
    only = slice(step, step + 1)
    return replace(
        press,
        force=press.force[only],
        centre=press.centre[only],
        angle=press.angle[only],
    )


def sheet_about(press: Press, chart: Chart, constants: Constants) -> Sheet:
    """Points about the press's centre that hold all the body may touch, once."""
    deepest = constants.value("contact.deepest") * MM
    reach = np.sqrt(2 * press.stamps.radii.max() * deepest)
    offsets = placed(press)[0]
    low, high = offsets.min(axis=0) - reach, offsets.max(axis=0) + reach
    beyond = max(high[0] - low[0] - chart.circumference, 0.0) / 2
    low[0], high[0] = low[0] + beyond, high[0] - beyond
    spacing = np.sqrt(np.prod(high - low) / constants.value("contact.reference.points"))
    s, t = (np.arange(*ends, spacing) for ends in zip(low, high, strict=True))
    return Sheet(press.centre[0], s, t)


def pressed(
    press: Press, scene: Scene, constants: Constants
) -> Float[np.ndarray, "point"]:
    """Pressure at every point [kPa] once the parts carry the force together.

    Raises:
        ValueError: they are too small to.
    """
    low, high = 0.0, constants.value("contact.deepest") * MM
    while load(pressures(press, scene, high), scene) < press.force[0]:
        high *= 2
        if high > 2 * press.stamps.radii[:, 0].max():
            raise ValueError(
                "the parts sink in altogether before they carry "
                f"{press.force[0]:.1f} N; take a larger or stiffer body, or less force"
            )
    for _ in range(int(constants.value("contact.reference.halvings"))):
        depth = (low + high) / 2
        enough = load(pressures(press, scene, depth), scene) >= press.force[0]
        low, high = (low, depth) if enough else (depth, high)
    return pressures(press, scene, high)


def load(pressure: Float[np.ndarray, "point"], scene: Scene) -> float:
    """Force of a field of pressure [N]."""
    return float(pressure @ scene.areas / KPA)


def pressures(press: Press, scene: Scene, depth: float) -> Float[np.ndarray, "point"]:
    """Pressure at every point [kPa] for parts that moved by a depth.

    p = k b / (2 pi R) (exp(m d) - 1), with R the mean radius of a part. Where two parts
    overlap the stiffer answer stands, as one body cannot press twice.
    """
    stamps, flesh = press.stamps, press.flesh
    stiff = (
        stamps.stiffness * flesh.b / (2 * np.pi * np.sqrt(stamps.radii.prod(axis=1)))
    )
    total = np.zeros(len(scene.areas))
    for part in range(stamps.count):
        field = stiff[part] * np.expm1(flesh.m * scene.depths(part, depth)) * KPA
        np.maximum(total, field, out=total)
    return total


SIDE = 6
"""Points along each side of a taxel's sensing part, where its mean is taken."""


def on_taxels(
    pressure: Float[np.ndarray, "point"],
    sheet: Sheet,
    chart: Chart,
    constants: Constants,
) -> tuple[Int[np.ndarray, "under"], Float[np.ndarray, "under"]]:
    """Taxels of the chart under a sheet, and their mean pressures [kPa]."""
    away = chart.unrolled - sheet.centre
    middle = sheet.s.mean()
    away[:, 0] = chart.wrapped(away[:, 0] - middle) + middle
    first, last = (np.array([sheet.s[end], sheet.t[end]]) for end in (0, -1))
    under = np.flatnonzero(np.all((away >= first) & (away <= last), axis=1))
    places = (np.arange(SIDE) + 0.5) * 2 / SIDE - 1
    places = places * np.sqrt(constants.value("contact.fill"))
    steps = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
    points = away[under, None] + np.einsum("pd,ids->ips", steps, chart.cells[under])
    samples = map_coordinates(
        pressure.reshape(len(sheet.s), len(sheet.t)),
        np.moveaxis((points - first) / sheet.spacing, -1, 0),
        order=1,
    )
    return under, samples.mean(axis=1)


def agreement(felt: Felt, reference: Felt) -> Agreement:
    """Compare the first step of what was felt with the reference for it."""
    mine = dict(zip(felt.taxels.tolist(), felt.pressure[0].tolist(), strict=True))
    theirs = dict(
        zip(reference.taxels.tolist(), reference.pressure[0].tolist(), strict=True)
    )
    pairs = np.array(
        [(mine.get(i, 0.0), theirs.get(i, 0.0)) for i in mine.keys() | theirs.keys()]
    )
    touched = pairs[pairs.any(axis=1)]
    return Agreement(
        area=float(felt.area[0] / reference.area[0]),
        centroid=float(np.linalg.norm(felt.centroid[0] - reference.centroid[0])),
        correlation=correlation_of(pairs),
        strict=correlation_of(touched) if len(touched) > 1 else 1.0,
    )


def correlation_of(pairs: Float[np.ndarray, "taxel 2"]) -> float:
    """Pearson's correlation of two pressures; nan where one is the same everywhere."""
    if np.ptp(pairs, axis=0).min() == 0:
        return np.nan
    return float(np.corrcoef(pairs.T)[0, 1])
