"""The parts of a body as ellipsoids over a surface in MuJoCo (extra `sim`)."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from eskin.extras import find_mujoco
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.dents import long_axes, placed
from eskin.sim.contact.press import Press
from eskin.skin.round import Dome, Tube
from eskin.skin.surface import Plane, Surface

__all__ = ["Scene", "Sheet"]

AWAY = -1.0
"""Where a part is put that is not asked for: off the surface [m]."""
LARGE = 2.0
"""Half length of planes and tubes [m]."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """An even grid of points on a chart, about a centre."""

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
class Scene:
    """A sheet of sensing points on a surface, and parts that are pushed into it.

    The body lies on the surface at the press's centre, bent as far as it conforms;
    each part then moves along its own normal. MuJoCo's `tactile` sensor measures how
    deep the points lie in the parts.

    Attributes:
        areas: area that each point stands for [m2].
    """

    def __init__(self, press: Press, chart: Chart, sheet: Sheet) -> None:
        """Set the scene of the first step of a press.

        Raises:
            ExtraError: MuJoCo is not installed.
        """
        self.mujoco = find_mujoco("the reference of contact")
        surface = at_origin(chart.surface)
        wrapped = surface.wrap(sheet.unrolled)
        self.areas = wrapped.stretch * sheet.spacing.prod()
        text = write_scene(
            write_mesh(wrapped.positions, len(sheet.s), len(sheet.t)),
            write_solid(surface),
            write_parts(press, *poses(press, chart, surface)),
        )
        self.model = self.mujoco.MjModel.from_xml_string(text)
        self.data = self.mujoco.MjData(self.model)

    def depths(self, part: int, depth: float) -> Float[np.ndarray, "point"]:
        """How deep every point lies in one part that has moved by a depth [m]."""
        self.data.qpos[:] = AWAY
        self.data.qpos[part] = depth
        self.mujoco.mj_forward(self.model, self.data)
        return self.data.sensordata[: len(self.areas)].copy()


def at_origin(surface: Surface) -> Plane | Tube | Dome:
    """The same surface in its own frame."""
    match surface:
        case Tube(radius=radius):
            return Tube(radius, np.eye(4))
        case Dome(radius=radius):
            return Dome(radius, np.eye(4))
        case _:
            return Plane(np.eye(4))


def write_scene(mesh: str, solid: str, parts: str) -> str:
    """A scene in MuJoCo's format; nothing runs into the sheet that senses."""
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
    """The sheet, two triangles to a cell."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=2)
    vertex = " ".join(f"{number:.9g}" for number in points.ravel())
    face = " ".join(map(str, faces.ravel()))
    return f'<mesh name="sheet" inertia="shell" vertex="{vertex}" face="{face}"/>'


def write_solid(surface: Plane | Tube | Dome) -> str:
    """What the parts run into."""
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
    """One ellipsoid for each part, of its radii where it touches, free to sink."""
    across, along = press.stamps.radii.T
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
    """Numbers as they stand in an attribute."""
    return " ".join(f"{number:.9g}" for number in numbers)


def poses(
    press: Press, chart: Chart, surface: Surface
) -> tuple[Float[np.ndarray, "part 3"], Float[np.ndarray, "part 3 3"]]:
    """Where the parts touch down, and their axes: across, along, outward.

    On a round surface the body is bent to an arc of its curvature times conformity.
    """
    at = surface.wrap(press.centre[:1])
    s_axis, normal = at.tangents[0], at.normals[0]
    axes = np.stack([s_axis, np.cross(normal, s_axis)])
    bends = np.array([isinstance(surface, Tube | Dome), isinstance(surface, Dome)])
    bent, straight = (placed(press)[0] * part @ axes for part in (bends, ~bends))
    curvature = press.flesh.conformity / chart.radius
    turns = Rotation.from_rotvec(np.cross(normal, bent) * curvature).as_matrix()
    normals = turns @ normal
    arc = (normals - normal) / curvature if curvature > 0.0 else bent
    long = np.einsum("kij,kj->ki", turns, long_axes(press)[0] @ axes)
    rotations = np.stack([np.cross(long, normals), long, normals], axis=2)
    return at.positions[0] + straight + arc, rotations
