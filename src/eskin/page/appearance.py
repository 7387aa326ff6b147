"""This module builds the meshes that show a robot."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.page.messages import CAMERA_DIRECTION, LinkMesh, SceneDescription
from eskin.robot import (
    Cylinder,
    Geom,
    Robot,
    TriangleMesh,
    build_geom_mesh,
    compute_surface_distance,
    revolve_profile,
)
from eskin.skin import MountedSkin
from eskin.transforms import apply, invert

SEGMENTS = 48
"""Number of segments around a solid of revolution."""
EDGE_RADIUS = 0.007
"""Radius of the rounded edge of a cylinder [m]."""
ANGLES = np.linspace(0.0, np.pi / 2, 5)
ARC = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)
"""Points on the profile of a rounded edge of radius 1."""
SLENDER = 3.5
"""Length of a cylinder by its radius above which it is a tube, and no housing."""
COVER_DISTANCE = 0.006
"""Greatest distance between an end and the part or taxel that covers it [m]."""
VIEW_SHARE = 1.6
"""Distance of the camera over the diagonal of the box around a robot."""
FACING = 2.0
"""Share of the mean normal of the taxels in the direction to the camera."""
AT_WORK = "ur5"
"""Robot whose place of work the camera faces by default."""
LID_HEIGHT = 0.005
"""Height of a lid [m]."""
BODY = (214, 217, 221)
TUBE = (196, 200, 206)
COVER = (96, 143, 178)
"""Colours of aluminium, of its tubes, and of lids in the blue-grey of a UR."""
logger = logging.getLogger(__name__)


def describe_scene(
    mounted: MountedSkin,
    gestures: tuple[str, ...],
    q: Float[np.ndarray, "joint"] | None = None,
) -> SceneDescription:
    """Return the description of a skin on its robot, on a page that offers nothing.

    Its other fields are set by `dataclasses.replace`.

    Args:
        mounted: skin on its robot.
        gestures: vocabulary.
        q: joint positions that are shown [rad]; None where they are not known: the
            camera then faces the place of work of a UR5, and others with joints at 0.
    """
    skin = mounted.skin
    solids = build_link_meshes(mounted)
    at_work = q is None and mounted.robot.name == AT_WORK
    view = {} if at_work else frame_robot(mounted, solids, q)
    return SceneDescription(
        title=f"{mounted.robot.name} in skin '{skin.name}', {skin.count} taxels",
        links=mounted.robot.link_names,
        solids=solids,
        taxel_link=mounted.taxel_link_index,
        positions=skin.positions,
        normals=skin.normals,
        areas=skin.areas,
        patches=tuple(patch.id for patch in skin.patches),
        patch_index=skin.patch_index,
        rows=skin.rows,
        columns=skin.columns,
        gestures=gestures,
        **view,
    )


def frame_robot(
    mounted: MountedSkin,
    solids: tuple[LinkMesh, ...],
    q: Float[np.ndarray, "joint"] | None,
) -> dict[str, Any]:
    """Return the view that shows a whole robot from the side of its skin.

    The result holds `middle`, `distance`, `direction` and `ground` of
    `SceneDescription`.
    """
    q = np.zeros(len(mounted.robot.joint_names)) if q is None else q
    T = mounted.kinematics.poses(q)
    (places, normals) = mounted.place_taxels(q)
    points = [apply(T[solid.link], solid.vertices) for solid in solids]
    points = np.concatenate([*points, places])
    low, high = points.min(axis=0), points.max(axis=0)
    # The mean normal of skin that faces all sides is short.
    direction = CAMERA_DIRECTION + FACING * normals.mean(axis=0)
    direction[2] = max(direction[2], 0.0)
    return {
        "middle": tuple(((low + high) / 2).tolist()),
        "distance": VIEW_SHARE * float(np.linalg.norm(high - low)),
        "direction": tuple((direction / np.linalg.norm(direction)).tolist()),
        "ground": min(0.0, float(low[2])),
    }


def build_link_meshes(mounted: MountedSkin) -> tuple[LinkMesh, ...]:
    """Return the meshes of the robot under its skin, part by part.

    Cylinders get rounded edges, and a lid on each bare end. Other shapes stay
    unchanged.
    """
    mounted = MountedSkin(mounted.skin, leave_out_unreadable(mounted.robot))
    robot = mounted.robot
    T_world_link = mounted.kinematics.poses(np.zeros(len(robot.joint_names)))
    solids = []
    for index, link in enumerate(robot.links):
        for body in link.geoms:
            shape = body.shape
            parts = [(build_geom_mesh(body), BODY)]
            if isinstance(shape, Cylinder):
                is_upright = abs(body.T_link_shape[2, 2]) > 0.9
                is_tube = is_upright and shape.length > SLENDER * shape.radius
                parts = [(build_rounded_cylinder(body), TUBE if is_tube else BODY)]
                parts += [
                    (build_lid(body, end), COVER)
                    for end in (-1, 1)
                    if is_bare_end(mounted, T_world_link, index, body, end)
                ]
            solids += [
                LinkMesh(index, mesh.vertices, mesh.faces, colour)
                for mesh, colour in parts
            ]
    return tuple(solids)


def leave_out_unreadable(robot: Robot) -> Robot:
    """Return a robot without the shapes that cannot be read, of which a warning tells.

    A page shows touches without the robot under them too.
    """
    links = []
    problems = []
    for link in robot.links:
        kept = []
        for geom in link.geoms:
            try:
                _ = geom.shape
                kept.append(geom)
            except RobotError as error:
                problems.append(error)
        links.append(replace(link, geoms=tuple(kept)))
    if problems:
        logger.warning("%d shapes are not drawn: %s", len(problems), problems[0])
    return replace(robot, links=tuple(links))


def build_rounded_cylinder(body: Geom) -> TriangleMesh:
    """Return a cylinder with rounded edges, in the frame of its link."""
    shape = body.shape
    assert isinstance(shape, Cylinder)
    height = shape.length / 2
    edge = min(EDGE_RADIUS, shape.radius / 3, height / 2)
    inner = shape.radius - edge
    arc = np.array([inner, height - edge]) + edge * ARC
    upper = np.concatenate([arc, [[inner - 0.001, height]]])
    profile = np.concatenate([upper[::-1] * (1, -1), upper])
    return revolve(profile, height, body.T_link_shape)


def build_lid(body: Geom, end: int) -> TriangleMesh:
    """Return a low dome on an end of a cylinder, in the frame of its link.

    Args:
        body: cylinder.
        end: 1 for the end at its greatest z, -1 for the other.
    """
    shape = body.shape
    assert isinstance(shape, Cylinder)
    radius = shape.radius - min(EDGE_RADIUS, shape.radius / 3)
    dome = np.array([radius - 0.006, 0.0]) + ARC * (0.006, LID_HEIGHT)
    ends = [[radius, -LID_HEIGHT]], [[radius / 2, LID_HEIGHT]]
    T_shape_end = np.diag([1.0, end, end, 1.0])
    T_shape_end[2, 3] = end * shape.length / 2
    profile = np.concatenate([ends[0], dome, ends[1]])
    return revolve(profile, LID_HEIGHT, body.T_link_shape @ T_shape_end)


def revolve(
    profile: Float[np.ndarray, "ring 2"], height: float, T: Float[np.ndarray, "4 4"]
) -> TriangleMesh:
    """Return a solid of revolution by its profile and half its height, transformed."""
    mesh = revolve_profile(profile, height, SEGMENTS)
    return TriangleMesh(apply(T, mesh.vertices), mesh.faces)


def is_bare_end(
    mounted: MountedSkin,
    T_world_link: Float[np.ndarray, "link 4 4"],
    link: int,
    body: Geom,
    end: int,
) -> bool:
    """Return whether no part and no taxel covers the end of a cylinder, 1 or -1."""
    shape = body.shape
    assert isinstance(shape, Cylinder)
    height = end * shape.length / 2
    beyond = np.array([0.0, 0.0, height + end * COVER_DISTANCE])
    p_world = apply(T_world_link[link], apply(body.T_link_shape, beyond))
    for part, T in zip(mounted.robot.links, T_world_link, strict=True):
        p_part = apply(invert(T), p_world)[None]
        if part.geoms and compute_surface_distance(part, p_part)[0][0] < 0:
            return False
    on_link = mounted.skin.positions[mounted.taxel_link_index == link]
    local = apply(invert(body.T_link_shape), on_link)
    aside = np.linalg.norm(local[:, :2], axis=-1)
    near = abs(local[:, 2] - height) < COVER_DISTANCE
    return not (near & (aside < 0.9 * shape.radius)).any()
