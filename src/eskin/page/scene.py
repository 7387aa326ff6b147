"""This module draws the robot, its taxels, its gripper and the marks of touches."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Float32, UInt8
from viser import (
    BatchedMeshHandle,
    CameraHandle,
    ClientHandle,
    CommandEvent,
    GuiEvent,
    ViserServer,
)

from eskin.page.messages import (
    SceneDescription,
    ViewUpdate,
)
from eskin.skin.colours import ColourScale
from eskin.transforms import apply, invert, matrix_to_quaternion, rotate

# Discs and pads of taxels.
CORNERS = 12
"""Number of corners of a disc."""
LIFT = 0.0012
"""Distance of the discs from the surface [m]."""
DISC_SHARE = 0.86
"""Radius of a disc as a share of the radius of a circle of the taxel's area."""
PAD_SHARE = 1.26
"""Radius of a pad as such a share: of the circle around a square of that area."""
PAD = (196, 200, 206)
"""Colour of the surface under the taxels: red, green and blue, each to 255."""
DEPTH = 0.5
"""Depth of the cone under a disc or pad, by its radius."""
LINEAR = np.round(255 * (np.arange(256) / 255) ** 2.2).astype(np.uint8)
"""Linear intensity of each sRGB step: viser expects linear colours for instances."""
SCALE = 60.0
"""Initial pressure of the lightest colour [kPa]; the user can change it."""

# Camera and mouse.
FIELD_OF_VIEW = 0.7
"""Vertical field of view of the camera [rad]."""
PICTURE_HEIGHT = 720
"""Height of the picture before a browser has told its own [px]."""
NARROW = 1.0
"""Width of a window by its height below which the camera is further away."""
MAX_RAY_DISTANCE = 0.015
"""Greatest distance from a ray to the centre of a taxel that it hits [m]."""

# Panel.
WIDTH = 320
WIDER = 400
"""Width of the panel, and of a panel with two columns [px]."""
BOTTOM = 1e9
"""Order of what is below all else in the panel."""
BRAND = (31, 120, 137)

# Place of work, and the robot in it.
TABLE = (203, 190, 168)
"""Colour of a table under a place of the task."""
PART = 0.045
"""Length of the edge of a part [m]."""
GRID = (150, 158, 170)
"""Colour of the lines on the ground."""
MIN_POSE_CHANGE = 1e-5
"""Change of a pose below which a frame is not moved, per component [1 or m]."""


Mesh = tuple[Float32[np.ndarray, "vertex 3"], np.ndarray]
"""Vertices of a mesh, and their indices in each face."""


@dataclass(frozen=True, eq=False)
class SurfacePoint:
    """Describes a point on the skin."""

    taxel: int
    """Index of the nearest taxel."""
    link: int
    """Index of the link of that taxel."""
    p_link: Float[np.ndarray, "3"]
    """Position of the point in the frame of the link [m]."""


class PagePart(ABC):
    """A part of the page shows updates."""

    @abstractmethod
    def update(self, update: ViewUpdate) -> None:
        """Show an update, of which there are up to 25 a second."""


@final
class Scene(PagePart):
    """Draws the robot, its taxels and the ground; sends only what has changed.

    Attributes:
        discs: discs of the taxels of each link that has any, by index of the link.
        taxels: indices of those taxels, by index of the link.
        view: position of the camera that was turned last, and the point that it looks
            at, in the world frame [m].
        picture_height: height of what that camera shows [px].
    """

    def __init__(
        self, server: ViserServer, setup: SceneDescription, scale: ColourScale
    ) -> None:
        """Draw the parts that do not change."""
        self.server = server
        self.setup = setup
        self.scale = scale
        self.T_world_link = np.tile(np.eye(4), (len(setup.links), 1, 1))
        self.picture_height = PICTURE_HEIGHT
        self.add_surroundings()
        self.add_places()
        self.frames = [
            server.scene.add_frame(f"/robot/{name}", show_axes=False)
            for name in setup.links
        ]
        for number, solid in enumerate(setup.solids):
            server.scene.add_mesh_simple(
                f"/robot/{setup.links[solid.link]}/solid_{number}",
                solid.vertices,
                solid.faces,
                color=solid.colour,
                receive_shadow=False,
            )
        links = np.unique(setup.taxel_link).tolist()
        self.taxels = {link: np.flatnonzero(setup.taxel_link == link) for link in links}
        at_rest = scale.colours(np.zeros(1), np.ones(1, bool))
        self.discs = {
            link: self.add_discs("taxels", link, LIFT, DISC_SHARE, LINEAR[at_rest])
            for link in links
        }

    def add_surroundings(self) -> None:
        """Add a grid as ground, and lights that preserve the colours."""
        scene = self.server.scene
        scene.add_grid(
            "/ground",
            infinite_grid=True,
            fade_distance=7.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=GRID,
            section_color=GRID,
            cell_thickness=0.5,
            shadow_opacity=0.22,
            position=(0.0, 0.0, self.setup.ground - 0.001),
        )
        scene.configure_environment_map(None)
        scene.configure_default_lights(False)
        scene.add_light_ambient("/light/all", intensity=1.0)
        scene.add_light_hemisphere(
            "/light/sky",
            sky_color=(255, 255, 255),
            ground_color=(190, 195, 205),
            intensity=0.9,
        )
        scene.add_light_directional(
            "/light/sun",
            intensity=2.4,
            position=(1.0, -2.2, 2.6),
            cast_shadow=True,
        )

    def add_places(self) -> None:
        """Add a table under each place of the task, with its name."""
        for name, place in self.setup.places:
            x, y, z = place
            height = max(z - PART / 2, 0.02)
            self.server.scene.add_box(
                f"/places/{name}",
                dimensions=(0.2, 0.2, height),
                color=TABLE,
                position=(x, y, height / 2),
            )
            self.server.scene.add_label(
                f"/places/{name}/name", name, position=(0.0, 0.0, -0.3 * height)
            )

    def face_skin(self) -> None:
        """Set the camera as the description of the scene says."""
        setup = self.setup
        middle = np.array(setup.middle)
        direction = np.array(setup.direction)
        self.set_camera(middle, setup.distance, direction)

    def set_camera(
        self,
        middle: Float[np.ndarray, "3"],
        distance: float,
        direction: Float[np.ndarray, "3"],
    ) -> None:
        """Set the camera of the page, in every browser that has opened it and later.

        Args:
            middle: point that the camera looks at, in the world frame [m].
            distance: distance of the camera from that point [m].
            direction: direction in the world frame from that point to the camera, of
                about unit length.
        """
        self.camera = middle, distance, direction
        self.view = middle + distance * direction, middle
        first = self.server.initial_camera
        first.fov = FIELD_OF_VIEW
        first.position = middle + distance * direction
        first.look_at = middle
        for client in self.server.get_clients().values():
            self.turn(client)

    async def watch(self, client: ClientHandle) -> None:
        """Turn the camera of a browser first, and when its window becomes narrow."""
        was_narrow = None

        @client.camera.on_update
        async def _(camera: CameraHandle) -> None:
            nonlocal was_narrow
            self.view = camera.position, camera.look_at
            self.picture_height = camera.image_height
            before = was_narrow
            was_narrow = camera.aspect < NARROW
            if was_narrow != before:
                self.turn(client)

    def turn(self, client: ClientHandle) -> None:
        """Turn the camera of a browser to the scene, by the shape of its window."""
        position, look_at = place_camera(*self.camera, client.camera.aspect)
        client.camera.position = position
        client.camera.look_at = look_at

    def project(self, p_world: Float[np.ndarray, "*_ 3"]) -> Float[np.ndarray, "*_ 2"]:
        """Return where points are drawn, from the middle to the right and down [px].

        The picture comes from the browser whose camera was turned last.
        """
        position, look_at = self.view
        ahead = (look_at - position) / np.linalg.norm(look_at - position)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(ahead, right), ahead])
        across, down, depth = np.moveaxis((p_world - position) @ axes.T, -1, 0)
        scale = self.picture_height / 2 / np.tan(FIELD_OF_VIEW / 2) / depth
        return np.stack([scale * across, scale * down], axis=-1)

    def add_pads(self, link: int) -> BatchedMeshHandle:
        """Add pads under and beside the discs, where a touch counts too."""
        return self.add_discs("pads", link, LIFT / 2, PAD_SHARE, LINEAR[[PAD]])

    def add_discs(
        self,
        name: str,
        link: int,
        lift: float,
        share: float,
        colour: UInt8[np.ndarray, "1 3"],
    ) -> BatchedMeshHandle:
        """Add a disc of a colour on each taxel of a link.

        The browser outlines the disc under the pointer by a copy of the mesh, which
        lies at the origin of the link before, takes clicks too, and tells them without
        an index. So the mesh is of the size of a taxel, and its scales are near 1.

        Args:
            name: name of the discs in the scene.
            link: index of the link.
            lift: distance of the discs from the surface [m].
            share: radius as a share of the radius of a circle of the taxel's area.
            colour: colour of all discs at first.
        """
        setup = self.setup
        taxels = self.taxels[link]
        normals = setup.normals[taxels]
        radii = share * np.sqrt(setup.areas[taxels] / np.pi)
        size = np.float32(radii.max())
        vertices, faces = build_disc()
        return self.add_instances(
            f"{setup.links[link]}/{name}",
            (size * vertices, faces),
            (compute_rotations_to(normals), setup.positions[taxels] + lift * normals),
            radii / size,
            np.repeat(colour, len(taxels), axis=0),
        )

    def add_instances(
        self,
        name: str,
        mesh: Mesh,
        poses: tuple[Float[np.ndarray, "one 4"], Float[np.ndarray, "one 3"]],
        scales: Float[np.ndarray, "one"],
        colours: UInt8[np.ndarray, "one 3"] | tuple[int, int, int],
        side: Literal["front", "double"] = "front",
    ) -> BatchedMeshHandle:
        """Add several instances of a mesh.

        Args:
            name: name of the link, and of the instances on it.
            mesh: vertices and faces.
            poses: quaternion wxyz and position [m] of each, in the frame of the link.
            scales: scale of each.
            colours: colour of each, or of all.
            side: side of the faces that is seen.
        """
        return self.server.scene.add_batched_meshes_simple(
            f"/robot/{name}",
            *mesh,
            *poses,
            batched_scales=scales,
            batched_colors=colours,
            lod="off",
            side=side,
            cast_shadow=False,
            receive_shadow=False,
        )

    def update(self, update: ViewUpdate) -> None:
        """Move the links and colour the taxels that have changed."""
        for link, frame in enumerate(self.frames):
            T = update.T_world_link[link]
            if np.abs(self.T_world_link[link] - T).max() > MIN_POSE_CHANGE:
                self.T_world_link[link] = T
                frame.wxyz = matrix_to_quaternion(T[:3, :3])
                frame.position = T[:3, 3]
        pressure = update.pressure.astype(np.float64)
        colours = LINEAR[self.scale.colours(pressure, update.valid)]
        for link, discs in self.discs.items():
            discs.batched_colors = colours[self.taxels[link]]

    def place_taxels(
        self,
    ) -> tuple[Float[np.ndarray, "taxel 3"], Float[np.ndarray, "taxel 3"]]:
        """Return positions [m] and normals of the taxels in the world, as shown."""
        T = self.T_world_link[self.setup.taxel_link]
        return apply(T, self.setup.positions), rotate(T, self.setup.normals)

    def pick_taxel(self, taxel: int) -> SurfacePoint:
        """Return the centre of a taxel."""
        link = int(self.setup.taxel_link[taxel])
        return SurfacePoint(taxel, link, self.setup.positions[taxel])

    def pick_along_ray(
        self, origin: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]
    ) -> SurfacePoint | None:
        """Return the foremost point that a ray hits; None if it misses the skin.

        Args:
            origin: origin of the ray in the world frame [m].
            direction: direction of the ray in the world frame, of any length.
        """
        direction = direction / np.linalg.norm(direction)
        positions, normals = self.place_taxels()
        depth = (positions - origin) @ direction
        aside = np.linalg.norm(positions - origin - depth[:, None] * direction, axis=-1)
        met = (normals @ direction < 0) & (depth > 0) & (aside < MAX_RAY_DISTANCE)
        if not met.any():
            return None
        front = met & (depth < depth[met].min() + 2 * MAX_RAY_DISTANCE)
        taxel = int(np.argmin(np.where(front, aside, np.inf)))
        normal = normals[taxel]
        # The ray meets the plane of the taxel here; the point stays within its radius.
        step = ((positions[taxel] - origin) @ normal) / (direction @ normal)
        offset = origin + step * direction - positions[taxel]
        radius = float(np.sqrt(self.setup.areas[taxel] / np.pi))
        offset *= min(1.0, radius / max(float(np.linalg.norm(offset)), 1e-9))
        link = int(self.setup.taxel_link[taxel])
        T_link_world = invert(self.T_world_link[link])
        return SurfacePoint(taxel, link, apply(T_link_world, positions[taxel] + offset))


def lay_out(server: ViserServer, setup: SceneDescription, width: int = WIDTH) -> Scene:
    """Lay out a page with its panel on the right, and draw its scene."""
    gui = server.gui
    gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
    gui.main_panel.dock_right()
    gui.main_panel.set_width(width)
    gui.set_panel_label(setup.title)
    scene = Scene(server, setup, ColourScale(SCALE))
    scene.face_skin()
    server.on_client_connect(scene.watch)

    async def face(event: CommandEvent | GuiEvent) -> None:
        if event.client is not None:
            scene.turn(event.client)

    gui.add_command("face the skin", hotkey="R").on_trigger(face)
    gui.add_button_group("view", ("face the skin (R)",), order=BOTTOM).on_click(face)
    return scene


def place_camera(
    middle: Float[np.ndarray, "3"],
    distance: float,
    direction: Float[np.ndarray, "3"],
    aspect: float,
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return the position of a camera and the point that it looks at [m].

    In a narrow window the scene fills a square at the top: the panel covers the lower
    half of a phone.

    Args:
        middle: middle of the scene, in the world frame [m].
        distance: distance of the camera in a wide window [m].
        direction: direction from there to the camera, of about unit length.
        aspect: width of the window by its height.
    """
    if aspect >= NARROW:
        return middle + distance * direction, middle
    distance *= NARROW / max(aspect, 0.1)
    up = np.array([0.0, 0.0, 1.0]) - direction[2] * direction
    raised = (NARROW - aspect) * distance * np.tan(FIELD_OF_VIEW / 2)
    lower = -raised * up / np.linalg.norm(up)
    return middle + lower + distance * direction, middle + lower


def build_disc() -> Mesh:
    """Return vertices and faces of a flat disc of radius 1 that faces z.

    The cone under it is all that is seen of its outline.
    """
    vertices, faces = revolve([(1.0, 0.0), (0.0, 0.0)], CORNERS)
    # The rim, then one vertex in the middle.
    vertices = vertices[: CORNERS + 1]
    faces = np.minimum(faces[CORNERS:], CORNERS)
    lower = vertices.copy()
    lower[CORNERS, 2] = -DEPTH
    faces = np.concatenate([faces, faces[:, ::-1] + np.uint32(CORNERS + 1)])
    return np.concatenate([vertices, lower]), faces


def revolve(profile: Sequence[tuple[float, float]], corners: int) -> Mesh:
    """Return vertices and faces of a surface of revolution about z.

    Args:
        profile: radius and z of its rings, one after the other.
        corners: number of corners of a ring.
    """
    angle = np.arange(corners) * 2 * np.pi / corners
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    vertices = [radius * circle + (0.0, 0.0, z) for radius, z in profile]
    near = np.arange(corners)
    far = (np.arange(corners) + 1) % corners
    faces = []
    for low in range(0, corners * (len(profile) - 1), corners):
        high = low + corners
        faces.append(np.stack([low + near, high + far, high + near], axis=-1))
        faces.append(np.stack([low + near, low + far, high + far], axis=-1))
    vertices = np.concatenate(vertices).astype(np.float32)
    return vertices, np.concatenate(faces).astype(np.uint32)


def compute_rotations_to(
    normals: Float[np.ndarray, "point 3"],
) -> Float[np.ndarray, "point 4"]:
    """Return the quaternions wxyz of the shortest rotations from z to each normal."""
    x, y, z = np.asarray(normals, np.float64).T
    wxyz = np.stack([1.0 + z, -y, x, np.zeros(len(x))], axis=-1)
    wxyz[1.0 + z < 1e-9] = (0.0, 1.0, 0.0, 0.0)
    return wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True)
