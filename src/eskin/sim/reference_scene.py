"""The parts of a body as ellipsoids over a surface in MuJoCo (extra `sim`)."""

from dataclasses import replace
from typing import Any, final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from eskin.sim.chart import Chart
from eskin.sim.dents import long_axes, placed
from eskin.sim.press import Press
from eskin.skin.round import Dome, Tube

__all__ = ["Scene"]

AWAY = -1.0
"""Where a part is put that is not asked for: off the surface [m]."""
LARGE = 2.0
"""Half length of planes and tubes [m]."""


@final
class Scene:
    """A sheet of sensing points on a surface, and parts that are pushed into it.

    The body lies on the surface at the press's centre, bent as far as it conforms;
    each part then moves along its own normal. MuJoCo's `tactile` sensor measures how
    deep the points lie in the parts.

    Attributes:
        unrolled: places of the points on the chart (point, 2) [m].
        areas: area that each point stands for [m2].
    """

    def __init__(
        self, press: Press, chart: Chart, grid: tuple[np.ndarray, np.ndarray]
    ) -> None:
        """Set the scene of the first step of a press.

        Args:
            press: whose first step is posed.
            chart: where.
            grid: evenly spaced coordinates along s and t about the press's centre.
        """
        import mujoco

        surface = replace(chart.surface, T_link_surface=np.eye(4))
        self.unrolled = press.centre[0] + np.stack(
            np.meshgrid(*grid, indexing="ij"), axis=2
        ).reshape(-1, 2)
        wrapped = surface.wrap(self.unrolled)
        cell = np.prod([np.ptp(axis) / (len(axis) - 1) for axis in grid])
        self.areas = wrapped.stretch * cell
        spec = mujoco.MjSpec()
        add_surface(spec, surface)
        add_sheet(spec, wrapped.positions, (len(grid[0]), len(grid[1])))
        add_parts(spec, press, chart, surface)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

    def depths(self, part: int, depth: float) -> Float[np.ndarray, "point"]:
        """How deep every point lies in one part that has moved by a depth [m]."""
        import mujoco

        self.data.qpos[:] = AWAY
        self.data.qpos[part] = depth
        mujoco.mj_forward(self.model, self.data)
        return self.data.sensordata[: len(self.areas)].copy()


def add_surface(spec: Any, surface: Any) -> None:
    """The solid that the parts run into."""
    import mujoco

    kinds = mujoco.mjtGeom
    if isinstance(surface, Tube):
        kind, size = kinds.mjGEOM_CYLINDER, [surface.radius, LARGE, 0.0]
    elif isinstance(surface, Dome):
        kind, size = kinds.mjGEOM_SPHERE, [surface.radius, 0.0, 0.0]
    else:
        kind, size = kinds.mjGEOM_PLANE, [LARGE, LARGE, LARGE]
    spec.worldbody.add_geom(type=kind, size=size)


def add_sheet(
    spec: Any, points: Float[np.ndarray, "point 3"], shape: tuple[int, int]
) -> None:
    """A mesh that nothing runs into, with the sensor at its vertices."""
    import mujoco

    index = np.arange(len(points)).reshape(shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=2)
    mesh = spec.add_mesh(name="sheet")
    mesh.uservert = points.ravel().tolist()
    mesh.userface = faces.ravel().tolist()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(
        name="sheet",
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname="sheet",
        contype=0,
        conaffinity=0,
    )
    spec.add_sensor(
        name="touch",
        type=mujoco.mjtSensor.mjSENS_TACTILE,
        objtype=mujoco.mjtObj.mjOBJ_MESH,
        objname="sheet",
        reftype=mujoco.mjtObj.mjOBJ_GEOM,
        refname="sheet",
    )


def add_parts(spec: Any, press: Press, chart: Chart, surface: Any) -> None:
    """One ellipsoid for each part, free to move along its normal."""
    import mujoco

    kinds = mujoco.mjtGeom
    positions, rotations = poses(press, chart, surface)
    for radii, position, rotation in zip(
        press.stamps.radii, positions, rotations, strict=True
    ):
        quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
        body = spec.worldbody.add_body(pos=position, quat=quaternion)
        body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, -1.0])
        across, along = radii
        body.add_geom(
            type=kinds.mjGEOM_ELLIPSOID,
            pos=[0.0, 0.0, across],
            size=[across, np.sqrt(across * along), across],
            mass=1.0,
            conaffinity=0,
        )


def poses(
    press: Press, chart: Chart, surface: Any
) -> tuple[Float[np.ndarray, "part 3"], Float[np.ndarray, "part 3 3"]]:
    """Where the parts touch down, and their axes: across, along, outward.

    On a round surface the body is bent to an arc of its curvature times conformity.
    """
    at = surface.wrap(press.centre[:1])
    s_axis, normal = at.tangents[0], at.normals[0]
    axes = np.stack([s_axis, np.cross(normal, s_axis)])
    bent = {Tube: [1.0, 0.0], Dome: [1.0, 1.0]}.get(type(surface), [0.0, 0.0])
    offsets = placed(press)[0]
    curvature = press.flesh.conformity / chart.radius
    turns = Rotation.from_rotvec(
        np.cross(normal, (offsets * bent) @ axes) * curvature
    ).as_matrix()
    normals = turns @ normal
    straight = (offsets * np.subtract(1.0, bent)) @ axes
    arc = (offsets * bent) @ axes
    if curvature > 0.0:
        arc = (normals - normal) / curvature
    long = np.einsum("kij,kj->ki", turns, long_axes(press)[0] @ axes)
    rotations = np.stack([np.cross(long, normals), long, normals], axis=2)
    return at.positions[0] + straight + arc, rotations
