"""Compute contact independently: ellipsoids in MuJoCo, a Winkler law.

It is not used to generate clips. It shares with `eskin.sim.contact` the shape and
stiffness of bodies, but not the areas of pads, the shape of the pressure, nor the
computation of curvatures and gaps.
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from eskin.registry import find_mujoco
from eskin.sim.constants import MM, Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.press import Press
from eskin.sim.contact.pressure import (
    KPA_PER_PA,
    PressureField,
    compute_long_axes,
    compute_pad_offsets,
)
from eskin.skin import Dome, Plane, Surface, Tube

AWAY = -1.0
"""Position of a part that is not evaluated: off the surface [m]."""
LARGE = 2.0
"""Half length of planes and tubes [m]."""


@dataclass(frozen=True, eq=False)
class TaxelSheet:
    """Describes an even grid of points on a chart, about a centre."""

    centre: Float[np.ndarray, "2"]
    """Unrolled (s, t) [m]."""
    s: Float[np.ndarray, "row"]
    """Even steps along s from the centre [m]."""
    t: Float[np.ndarray, "column"]
    """Even steps along t from the centre [m]."""

    @property
    def unrolled(self) -> Float[np.ndarray, "point 2"]:
        """Places of the points on the chart, row by row [m]."""
        steps = np.stack(np.meshgrid(self.s, self.t, indexing="ij"), axis=2)
        return self.centre + steps.reshape(-1, 2)

    @property
    def spacing(self) -> Float[np.ndarray, "2"]:
        """Distance of neighbours along s and t [m]."""
        return np.array([self.s[1] - self.s[0], self.t[1] - self.t[0]])


@final
class MujocoScene:
    """Measures how deep parts of a body sink into a sheet of points on a surface.

    The body lies on the surface at the press's centre, bent as far as it conforms;
    each part then moves along its own normal. MuJoCo's `tactile` sensor measures how
    deep the points lie in the parts.

    Attributes:
        areas: area that each point stands for [m2].
    """

    def __init__(self, press: Press, chart: Chart, sheet: TaxelSheet) -> None:
        """Build the scene of the first step of a press.

        Raises:
            ExtraError: MuJoCo is not installed.
        """
        self.mujoco = find_mujoco("the reference of contact")
        surface = at_origin(chart.surface)
        wrapped = surface.wrap(sheet.unrolled)
        self.areas = wrapped.area_scale * sheet.spacing.prod()
        text = write_scene(
            write_mesh(wrapped.positions, len(sheet.s), len(sheet.t)),
            write_solid(surface),
            write_parts(press, *poses(press, chart, surface)),
        )
        self.model = self.mujoco.MjModel.from_xml_string(text)
        self.data = self.mujoco.MjData(self.model)

    def depths(self, part: int, depth: float) -> Float[np.ndarray, "point"]:
        """Return the depth of every point in one part that has moved by a depth [m]."""
        self.data.qpos[:] = AWAY
        self.data.qpos[part] = depth
        self.mujoco.mj_forward(self.model, self.data)
        return self.data.sensordata[: len(self.areas)].copy()


def at_origin(surface: Surface) -> Plane | Tube | Dome:
    """Return the same surface in its own frame."""
    match surface:
        case Tube(radius=radius):
            return Tube(radius, np.eye(4))
        case Dome(radius=radius):
            return Dome(radius, np.eye(4))
        case _:
            return Plane(np.eye(4))


def write_scene(mesh: str, solid: str, parts: str) -> str:
    """Format a scene for MuJoCo, in which nothing collides with the sensing sheet."""
    return f"""<mujoco>
      <asset>{mesh}</asset>
      <worldbody>
        {solid}
        <geom name="sheet" type="mesh" mesh="sheet" contype="0" conaffinity="0"/>
        {parts}
      </worldbody>
      <sensor><tactile geom="sheet" mesh="sheet"/></sensor>
    </mujoco>"""


def write_mesh(points: Float[np.ndarray, "point 3"], rows: int, columns: int) -> str:
    """Format the sheet, with two triangles per cell."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=2)
    vertex = " ".join(f"{number:.9g}" for number in points.ravel())
    face = " ".join(map(str, faces.ravel()))
    return f'<mesh name="sheet" inertia="shell" vertex="{vertex}" face="{face}"/>'


def write_solid(surface: Plane | Tube | Dome) -> str:
    """Format the solid that the parts collide with."""
    match surface:
        case Tube(radius=radius):
            return f'<geom type="cylinder" size="{radius} {LARGE}"/>'
        case Dome(radius=radius):
            return f'<geom type="sphere" size="{radius}"/>'
        case _:
            return f'<geom type="plane" size="{LARGE} {LARGE} {LARGE}"/>'


def write_parts(
    press: Press,
    positions: Float[np.ndarray, "part 3"],
    rotations: Float[np.ndarray, "part 3 3"],
) -> str:
    """Format an ellipsoid per part, with its radii at the contact, free to sink."""
    across, along = press.pads.radii.T
    sizes = np.column_stack([across, np.sqrt(across * along), across])
    turns = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    return "".join(
        f'<body pos="{spaced(position)}" quat="{spaced(turn)}">'
        '<joint type="slide" axis="0 0 -1"/>'
        f'<geom type="ellipsoid" pos="0 0 {size[0]}" size="{spaced(size)}"'
        ' mass="1" conaffinity="0"/></body>'
        for position, turn, size in zip(positions, turns, sizes, strict=True)
    )


def spaced(numbers: Float[np.ndarray, "number"]) -> str:
    """Format numbers for an attribute."""
    return " ".join(f"{number:.9g}" for number in numbers)


def poses(
    press: Press, chart: Chart, surface: Surface
) -> tuple[Float[np.ndarray, "part 3"], Float[np.ndarray, "part 3 3"]]:
    """Return contact positions of the parts, and axes: across, along, outward.

    On a round surface the body is bent to an arc of its curvature times conformity.
    """
    at = surface.wrap(press.centre[:1])
    s_axis, normal = at.tangents[0], at.normals[0]
    axes = np.stack([s_axis, np.cross(normal, s_axis)])
    bends = np.array([isinstance(surface, Tube | Dome), isinstance(surface, Dome)])
    bent, straight = (
        compute_pad_offsets(press)[0] * part @ axes for part in (bends, ~bends)
    )
    curvature = press.tissue.conformity / chart.radius
    turns = Rotation.from_rotvec(np.cross(normal, bent) * curvature).as_matrix()
    normals = turns @ normal
    arc = (normals - normal) / curvature if curvature > 0.0 else bent
    long = np.einsum("kij,kj->ki", turns, compute_long_axes(press)[0] @ axes)
    rotations = np.stack([np.cross(long, normals), long, normals], axis=2)
    return at.positions[0] + straight + arc, rotations


@dataclass(frozen=True)
class Agreement:
    """Compares the model with the reference at one instant."""

    area: float
    """Ratio of the area of contact to that of the reference."""
    centroid: float
    """Distance of the centroids [m]."""
    correlation: float
    """Correlation of the pressures of all taxels near the body."""
    strict: float
    """Correlation of the pressures of the taxels that are pressed in either."""


def feel_in_mujoco(press: Press, chart: Chart, constants: Constants) -> PressureField:
    """Compute the pressure of the first step of a press with MuJoCo.

    Needs MuJoCo (extra `sim`).

    Raises:
        ValueError: the parts cannot carry the force.
        ExtraError: MuJoCo is not installed.
    """
    press = instant(press, 0)
    sheet = sheet_about(press, chart, constants)
    scene = MujocoScene(press, chart, sheet)
    pressure = pressed(press, scene, constants)
    loads = pressure * scene.areas / KPA_PER_PA
    taxels, felt = on_taxels(pressure, sheet, chart, constants)
    touched = pressure > constants.value("contact.touched")
    return PressureField(
        taxels=chart.taxels[taxels],
        pressure=felt[None],
        area=np.array([scene.areas[touched].sum()]),
        force=np.array([loads.sum()]),
        centroid=(loads @ sheet.unrolled / loads.sum())[None],
    )


def instant(press: Press, step: int) -> Press:
    """Return one step of a press."""
    only = slice(step, step + 1)
    return replace(
        press,
        force=press.force[only],
        centre=press.centre[only],
        angle=press.angle[only],
    )


def sheet_about(press: Press, chart: Chart, constants: Constants) -> TaxelSheet:
    """Build a sheet that covers once all points the body may touch."""
    deepest = constants.value("contact.deepest") * MM
    reach = np.sqrt(2 * press.pads.radii.max() * deepest)
    offsets = compute_pad_offsets(press)[0]
    low, high = offsets.min(axis=0) - reach, offsets.max(axis=0) + reach
    beyond = max(high[0] - low[0] - chart.circumference, 0.0) / 2
    low[0], high[0] = low[0] + beyond, high[0] - beyond
    spacing = np.sqrt(np.prod(high - low) / constants.value("contact.reference.points"))
    s, t = (np.arange(*ends, spacing) for ends in zip(low, high, strict=True))
    return TaxelSheet(press.centre[0], s, t)


def pressed(
    press: Press, scene: MujocoScene, constants: Constants
) -> Float[np.ndarray, "point"]:
    """Return the pressure at every point [kPa] when the parts carry the force together.

    Raises:
        ValueError: the parts are too small for the force.
    """
    low, high = 0.0, constants.value("contact.deepest") * MM
    while load(pressures(press, scene, high), scene) < press.force[0]:
        high *= 2
        if high > 2 * press.pads.radii[:, 0].max():
            raise ValueError(
                "the parts sink in altogether before they carry "
                f"{press.force[0]:.1f} N; take a larger or stiffer body, or less force"
            )
    for _ in range(int(constants.value("contact.reference.halvings"))):
        depth = (low + high) / 2
        enough = load(pressures(press, scene, depth), scene) >= press.force[0]
        low, high = (low, depth) if enough else (depth, high)
    return pressures(press, scene, high)


def load(pressure: Float[np.ndarray, "point"], scene: MujocoScene) -> float:
    """Return the force of a field of pressure [N]."""
    return float(pressure @ scene.areas / KPA_PER_PA)


def pressures(
    press: Press, scene: MujocoScene, depth: float
) -> Float[np.ndarray, "point"]:
    """Return the pressure at every point [kPa] for parts that moved by a depth.

    p = k b / (2 pi R) (exp(m d) - 1), with R the mean radius of a part. Where two parts
    overlap, the larger pressure counts, because one body cannot press twice.
    """
    stamps, flesh = press.pads, press.tissue
    stiff = (
        stamps.stiffness * flesh.b / (2 * np.pi * np.sqrt(stamps.radii.prod(axis=1)))
    )
    total = np.zeros(len(scene.areas))
    for part in range(stamps.count):
        field = stiff[part] * np.expm1(flesh.m * scene.depths(part, depth)) * KPA_PER_PA
        np.maximum(total, field, out=total)
    return total


SIDE = 6
"""Number of sampling points along each side of a taxel's sensing part."""


def on_taxels(
    pressure: Float[np.ndarray, "point"],
    sheet: TaxelSheet,
    chart: Chart,
    constants: Constants,
) -> tuple[Int[np.ndarray, "under"], Float[np.ndarray, "under"]]:
    """Return the taxels of the chart under a sheet, and their mean pressures [kPa]."""
    away = chart.unrolled - sheet.centre
    middle = sheet.s.mean()
    away[:, 0] = chart.wrap_s(away[:, 0] - middle) + middle
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


def agreement(felt: PressureField, reference: PressureField) -> Agreement:
    """Compare the first step of a pressure field with its reference."""
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
        correlation=compute_correlation(pairs),
        strict=compute_correlation(touched) if len(touched) > 1 else 1.0,
    )


def compute_correlation(pairs: Float[np.ndarray, "taxel 2"]) -> float:
    """Return Pearson's correlation of two pressures; NaN if one is constant."""
    if np.ptp(pairs, axis=0).min() == 0:
        return np.nan
    return float(np.corrcoef(pairs.T)[0, 1])
