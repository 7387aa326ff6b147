"""Drawing a robot in its skin: shaded polygons, the far ones first."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from eskin.robot import Kinematics, Robot, body_mesh
from eskin.skin.mount import MountedSkin
from eskin.transforms import apply

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_robot"]

BODY = "#d8dade"
LIFT = 0.004
FINE = 0.02
AROUND = 0.25
CORNERS = 0.46 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def draw_robot(
    panel: "Axes",
    mounted: MountedSkin,
    q: Float[np.ndarray, "joint"],
    colours: list[str],
    view: tuple[float, float],
) -> None:
    """Draw the robot at q with its taxels in the colours of their patches.

    Args:
        panel: where to.
        mounted: the skin on the robot.
        q: joint values [rad].
        colours: one for each patch.
        view: where the eye is: azimuth from x and elevation [deg]; z is up.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    eye = eye_frame(*view)
    bodies = robot_triangles(mounted.robot, q)
    quads = taxel_quads(mounted, q)
    patch_colours = np.array([to_rgb(colour) for colour in colours])
    drawn = [
        *shaded(bodies, np.tile(to_rgb(BODY), (len(bodies), 1)), eye, 0.0),
        *shaded(quads, patch_colours[mounted.skin.patch_index], eye, LIFT),
    ]
    drawn.sort(key=lambda item: item[0])
    panel.add_collection(
        PolyCollection(
            [polygon for _, polygon, _ in drawn],
            facecolors=[colour for _, _, colour in drawn],
            edgecolors=[colour for _, _, colour in drawn],
            linewidths=0.2,
            snap=False,
        )
    )
    seen = np.array([corner for _, polygon, _ in drawn for corner in polygon])
    near = quads.reshape(-1, 3) @ eye[:2].T
    low = np.maximum(seen.min(axis=0), near.min(axis=0) - AROUND)
    high = np.minimum(seen.max(axis=0), near.max(axis=0) + AROUND)
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    panel.axis("off")


def eye_frame(azimuth: float, elevation: float) -> Float[np.ndarray, "3 3"]:
    """Rows: right, up and toward the eye, in the world."""
    a, e = np.deg2rad([azimuth, elevation])
    toward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(toward, right), toward])


def robot_triangles(
    robot: Robot, q: Float[np.ndarray, "joint"]
) -> Float[np.ndarray, "face 3 3"]:
    """Every body's surface in the world, in small triangles."""
    parts = [np.zeros((0, 3, 3))]
    for T_world_link, link in zip(Kinematics(robot).poses(q), robot.links, strict=True):
        for body in link.bodies:
            mesh = body_mesh(body)
            corners = split(mesh.vertices[mesh.faces])
            parts.append(apply(T_world_link, corners.reshape(-1, 3)).reshape(-1, 3, 3))
    return np.concatenate(parts)


def split(triangles: Float[np.ndarray, "face 3 3"]) -> Float[np.ndarray, "piece 3 3"]:
    """Halve triangles across their longest edge until all edges are short.

    Polygons are sorted by their middle, which is only right for small ones.
    """
    done = []
    while len(triangles):
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        longest = np.argmax(edges, axis=1)
        long = edges.max(axis=1) > FINE
        done.append(triangles[~long])
        triangles, longest = triangles[long], longest[long]
        each = np.arange(len(triangles))
        a, b, c = (triangles[each, (longest + step) % 3] for step in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate(
            [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        )
    return np.concatenate(done)


def taxel_quads(
    mounted: MountedSkin, q: Float[np.ndarray, "joint"]
) -> Float[np.ndarray, "taxel 4 3"]:
    """A square of each taxel's area, where it is in the world."""
    p_world, _ = mounted.poses(q)
    x_axis, y_axis, _ = np.moveaxis(mounted.frames(q), -1, 0)
    side = np.sqrt(mounted.skin.areas)[:, None, None]
    spread = (
        CORNERS[:, 0, None] * x_axis[:, None] + CORNERS[:, 1, None] * y_axis[:, None]
    )
    return p_world[:, None] + side * spread


def shaded(
    polygons: Float[np.ndarray, "face corner 3"],
    colours: Float[np.ndarray, "face 3"],
    eye: Float[np.ndarray, "3 3"],
    lift: float,
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Depth, flat outline and colour of the polygons that face the eye."""
    normals = np.cross(polygons[:, 1] - polygons[:, 0], polygons[:, 2] - polygons[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    facing = normals @ eye[2]
    light = 0.55 + 0.45 * np.clip(normals @ (eye.T @ [-0.35, 0.6, 0.72]), 0.0, 1.0)
    seen = polygons @ eye.T
    depth = seen[..., 2].mean(axis=1) + lift
    return [
        (depth[i], seen[i, :, :2], colours[i] * light[i])
        for i in np.flatnonzero(facing > 0.02)
    ]
