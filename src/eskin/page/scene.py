"""This module draws the robot, its taxels, its gripper and the marks of touches."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Float32, UInt8
from viser import (
    BatchedMeshHandle,
    ClientHandle,
    CommandEvent,
    GuiEvent,
    LabelHandle,
    MeshHandle,
    ViserServer,
)

from eskin.page.html import ColourScale, to_words
from eskin.page.messages import (
    ContactMarker,
    LogEntry,
    PressPlace,
    SceneDescription,
    ViewUpdate,
)
from eskin.transforms import apply, invert, matrix_to_quaternion, rotate

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
LINEAR = np.round(255 * (np.arange(256) / 255) ** 2.2).astype(np.uint8)
"""Linear intensity of each sRGB step: viser expects linear colours for instances."""
FIELD_OF_VIEW = 0.7
"""Vertical field of view of the camera [rad]."""
CAMERA_DIRECTION = np.array([0.82, -0.80, 0.42])
"""Direction in the world frame to the camera from its target, of about unit length."""
NARROW = 1.0
"""Width of a window by its height below which the camera is further away."""
RAISED = 0.6
"""Height of the scene over the middle of such a window, by half of the window."""
MAX_RAY_DISTANCE = 0.015
"""Greatest distance from a ray to the centre of a taxel that it hits [m]."""
SCALE = 60.0
"""Initial pressure of the lightest colour [kPa]; the user can change it."""
WIDTH, WIDER = 320, 400
"""Width of the panel, and of a panel with two columns [px]."""
GRID = (150, 158, 170)
"""Colour of the lines on the ground."""
BOTTOM = 1e9
"""Order of what is below all else in the panel."""
BRAND = (31, 120, 137)
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
    """

    def __init__(
        self, server: ViserServer, setup: SceneDescription, scale: ColourScale
    ) -> None:
        """Draw the parts that do not change."""
        self.server = server
        self.setup = setup
        self.scale = scale
        self.T_world_link = np.tile(np.eye(4), (len(setup.links), 1, 1))
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

    def set_camera(
        self,
        middle: Float[np.ndarray, "3"],
        distance: float,
        direction: Float[np.ndarray, "3"] = CAMERA_DIRECTION,
    ) -> None:
        """Set the camera of the page, in every browser that has opened it and later.

        Args:
            middle: point that the camera looks at, in the world frame [m].
            distance: distance of the camera from that point [m].
            direction: direction in the world frame from that point to the camera, of
                about unit length.
        """
        self.camera = middle, distance, direction
        first = self.server.initial_camera
        first.fov = FIELD_OF_VIEW
        first.position, first.look_at = middle + distance * direction, middle
        for client in self.server.get_clients().values():
            self.turn(client)

    def turn(self, client: ClientHandle) -> None:
        """Turn the camera of a browser to the scene, by the shape of its window."""
        position, look_at = place_camera(*self.camera, client.camera.aspect)
        client.camera.position, client.camera.look_at = position, look_at

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

        Args:
            name: name of the discs in the scene.
            link: index of the link.
            lift: distance of the discs from the surface [m].
            share: radius as a share of the radius of a circle of the taxel's area.
            colour: colour of all discs at first.
        """
        setup, taxels = self.setup, self.taxels[link]
        normals = setup.normals[taxels]
        return self.add_instances(
            f"{setup.links[link]}/{name}",
            build_disc(),
            (compute_rotations_to(normals), setup.positions[taxels] + lift * normals),
            share * np.sqrt(setup.areas[taxels] / np.pi),
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

    def add_mark(self, place: PressPlace, text: str) -> tuple[MeshHandle, LabelHandle]:
        """Add a ring around a place, and a label that is seen through the robot."""
        scene, normal = self.server.scene, np.array(place.n_link)
        at = f"/robot/{self.setup.links[place.link]}"
        middle = place.p_link + RING_LIFT * normal
        ring = scene.add_mesh_simple(
            f"{at}/target",
            *revolve(RING_PROFILE, SEGMENTS),
            color=TARGET,
            side="double",
            scale=TARGET_RADIUS,
            wxyz=compute_rotations_to(normal[None])[0],
            position=middle,
            cast_shadow=False,
            receive_shadow=False,
        )
        label = scene.add_label("/target_label", text, anchor="bottom-center")
        return ring, label

    def measure_facing(self) -> Float[np.ndarray, "taxel"]:
        """Return the cosine between each normal and the way to the first camera."""
        middle, distance, direction = self.camera
        positions, normals = self.place_taxels()
        rays = middle + distance * direction - positions
        return np.einsum("ti,ti->t", rays, normals) / np.linalg.norm(rays, axis=1)

    def find_facing_taxel(self) -> int:
        """Return the taxel that faces the camera most, of the patch seen most."""
        facing, patches = self.measure_facing(), self.setup.patch_index
        seen = np.bincount(patches, np.maximum(facing, 0.0))
        return int(np.argmax(np.where(patches == seen.argmax(), facing, -1.0)))

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
    scene.set_camera(np.array(setup.middle), setup.distance)
    server.on_client_connect(scene.turn)

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

    In a narrow window, as of a phone, it is further away, and the scene is above the
    panel, which covers the lower half.

    Args:
        middle: middle of the scene, in the world frame [m].
        distance: distance of the camera in a wide window [m].
        direction: direction from there to the camera, of about unit length.
        aspect: width of the window by its height.
    """
    if aspect >= NARROW:
        return middle + distance * direction, middle
    distance *= NARROW / max(aspect, 0.1)
    lower = np.array([0.0, 0.0, -RAISED * distance * np.tan(FIELD_OF_VIEW / 2)])
    return middle + lower + distance * direction, middle + lower


def compute_arrow_length(force: float) -> float:
    """Return the length of the arrow of a force [N], in metres."""
    return min(ARROW_BASE + ARROW_PER_NEWTON * force, ARROW_LONGEST)


def build_disc() -> Mesh:
    """Return vertices and faces of a flat disc of radius 1 that faces z."""
    vertices, faces = revolve([(1.0, 0.0), (0.0, 0.0)], CORNERS)
    # The rim, then one vertex in the middle.
    return vertices[: CORNERS + 1], np.minimum(faces[CORNERS:], CORNERS)


def revolve(profile: Sequence[tuple[float, float]], corners: int) -> Mesh:
    """Return vertices and faces of a surface of revolution about z.

    Args:
        profile: radius and z of its rings, one after the other.
        corners: number of corners of a ring.
    """
    angle = np.arange(corners) * 2 * np.pi / corners
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    vertices = [radius * circle + (0.0, 0.0, z) for radius, z in profile]
    near, far = np.arange(corners), (np.arange(corners) + 1) % corners
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


METAL, RUBBER = (206, 209, 214), (52, 56, 64)
TABLE, PART_COLOUR = (203, 190, 168), (0, 114, 178)
PART = 0.045
"""Length of the edge of a part [m]."""
FINGER_OFFSETS = {"open": 0.042, "closed": 0.011}
"""Distance of a finger from the middle of the gripper, by state [m]."""


@final
class GripperModel(PagePart):
    """Draws a gripper on the last link of the robot; only its fingers move."""

    def __init__(self, server: ViserServer, setup: SceneDescription) -> None:
        """Draw the gripper open."""
        at = f"/robot/{setup.links[-1]}/gripper"
        scene = server.scene
        scene.add_cylinder(
            f"{at}/flange", 0.034, 0.02, color=METAL, position=(0, 0, 0.01)
        )
        scene.add_box(
            f"{at}/palm",
            dimensions=(0.105, 0.045, 0.035),
            color=METAL,
            position=(0, 0, 0.037),
        )
        self.fingers = {
            side: scene.add_box(
                f"{at}/finger_{side}",
                dimensions=(0.014, 0.026, 0.06),
                color=RUBBER,
                position=(side * FINGER_OFFSETS["open"], 0, 0.084),
            )
            for side in (-1, 1)
        }
        self.part = scene.add_box(
            f"{at}/part",
            dimensions=(0.02, PART, PART),
            color=PART_COLOUR,
            position=(0.0, 0.0, 0.1),
            visible=False,
        )
        self.shown = "open"

    def update(self, update: ViewUpdate) -> None:
        """Open or close the gripper, and show the part in it."""
        if update.arm is None:
            return
        state, carrying = update.arm.gripper, update.arm.carrying
        if self.part.visible != carrying:
            self.part.visible = carrying
        if state != self.shown and state in FINGER_OFFSETS:
            self.shown = state
            for side, finger in self.fingers.items():
                finger.position = (side * FINGER_OFFSETS[state], 0.0, 0.084)


MAX_RINGS = 4
"""Greatest number of rings on one link."""
HIDDEN_RADIUS = 1e-6
"""Radius of a ring that is not in use [m]."""
RING_LIFT = 0.006
"""Distance of the rings from the skin [m]."""
SEGMENTS = 40
"""Number of segments of a ring."""
RING_PROFILE = ((0.84, 0.0), (1.0, 0.0))
ARROW_PROFILE = ((0.0, 0.0), (0.12, 0.3), (0.04, 0.3), (0.04, 1.0), (0.0, 1.0))
"""Profiles of a flat ring of radius 1 across z, and of an arrow of length 1 down z with
its tip at zero: the head, its underside, the shaft, and the end."""
RING = (0, 90, 181)
"""Blue, distinct from the whole colour scale for people of any colour vision."""
ARROW_BASE, ARROW_PER_NEWTON, ARROW_LONGEST = 0.03, 0.006, 0.15
"""Length of the arrow of a force: without force, for each newton, at most [m]."""
NAMED = 3
"""Greatest number of contacts with their name."""
RING_MARGIN = 0.008
"""Difference between the radii of a ring and its contact [m]."""
LABEL_SECONDS = 2.0
"""Time that a floating label is shown [s]."""


@final
class Marks(PagePart):
    """Draws rings around contacts and labels at detections."""

    def __init__(self, server: ViserServer, scene: Scene) -> None:
        """Start without touches."""
        self.server = server
        self.scene = scene
        self.ringed: set[int] = set()
        self.count = 0
        self.labels: deque[tuple[float, LabelHandle, int]] = deque()
        ring, arrow = revolve(RING_PROFILE, SEGMENTS), revolve(ARROW_PROFILE, CORNERS)
        self.rings = {n: self.add_marks("contacts", n, ring) for n in scene.discs}
        self.arrows = {n: self.add_marks("forces", n, arrow) for n in scene.discs}
        self.names = [
            server.scene.add_label(f"/contact_{number}", "", visible=False)
            for number in range(NAMED)
        ]

    def add_marks(self, name: str, link: int, mesh: Mesh) -> BatchedMeshHandle:
        """Add marks of a shape to a link, too small to see until they are used."""
        return self.scene.add_instances(
            f"{self.scene.setup.links[link]}/{name}",
            mesh,
            (np.tile([1.0, 0.0, 0.0, 0.0], (MAX_RINGS, 1)), np.zeros((MAX_RINGS, 3))),
            np.full(MAX_RINGS, HIDDEN_RADIUS),
            tuple(LINEAR[list(RING)].tolist()),
            side="double",
        )

    def update(self, update: ViewUpdate) -> None:
        """Draw the contacts and detections of an update, and remove old labels."""
        self.draw_marks(update.contacts)
        self.draw_names(update.contacts)
        for entry in update.log_entries:
            if entry.kind == "detection":
                self.add_label(entry)
        while self.labels and update.seconds - self.labels[0][0] > LABEL_SECONDS:
            self.labels.popleft()[1].remove()

    def draw_marks(self, contacts: tuple[ContactMarker, ...]) -> None:
        """Draw a ring and the force of each contact; unused marks are too small."""
        for link in self.ringed | {contact.link for contact in contacts}:
            here = [contact for contact in contacts if contact.link == link][:MAX_RINGS]
            wxyz = np.tile(np.array([1, 0, 0, 0], np.float32), (MAX_RINGS, 1))
            places = np.zeros((MAX_RINGS, 3), np.float32)
            radii = np.full(MAX_RINGS, HIDDEN_RADIUS, np.float32)
            lengths = np.full(MAX_RINGS, HIDDEN_RADIUS, np.float32)
            for row, contact in enumerate(here):
                places[row] = contact.p_link + RING_LIFT * contact.n_link
                wxyz[row] = compute_rotations_to(contact.n_link[None])[0]
                radii[row] = contact.radius + RING_MARGIN
                lengths[row] = compute_arrow_length(contact.force)
            for marks, scales in ((self.rings, radii), (self.arrows, lengths)):
                marks[link].batched_positions = places
                marks[link].batched_wxyzs = wxyz
                marks[link].batched_scales = scales
        self.ringed = {contact.link for contact in contacts}

    def draw_names(self, contacts: tuple[ContactMarker, ...]) -> None:
        """Write patch and force beside the arrows of the strongest contacts."""
        for label in self.names[len(contacts) :]:
            if label.visible:
                label.visible = False
        for label, contact in zip(self.names, contacts, strict=False):
            length = compute_arrow_length(contact.force) + 0.01
            end = contact.p_link + length * contact.n_link
            text = f"{to_words(contact.patch)} {contact.force:.0f} N"
            if label.text != text:
                label.text = text
            label.position = apply(self.scene.T_world_link[contact.link], end)
            if not label.visible:
                label.visible = True

    def add_label(self, entry: LogEntry) -> None:
        """Add a floating label where a touch was recognised."""
        if entry.link < 0:
            return
        self.count += 1
        link = self.scene.setup.links[entry.link]
        for previous in [found for found in self.labels if found[2] == entry.link]:
            previous[1].remove()
            self.labels.remove(previous)
        label = self.server.scene.add_label(
            f"/robot/{link}/detection_{self.count}",
            entry.text.partition(",")[0],
            position=entry.p_link,
            font_screen_scale=1.25,
            anchor="bottom-center",
        )
        self.labels.append((entry.seconds, label, entry.link))


TARGET = (231, 41, 138)
"""Pink, distinct from skin at rest, lids and rings around contacts (Brewer's Dark2)."""
TARGET_RADIUS = 0.02
"""Radius of the ring around the place to press [m]."""
LABEL_HEIGHT = 0.06
"""Height of the label of that place over the skin [m]."""
HINT_FACING = 0.4
"""Cosine to the camera below which another place is hinted at."""
TARGET_DISTANCE = 0.9
"""Distance of the camera from the place to press [m]."""
SLANT = 0.4
"""Share of `CAMERA_DIRECTION` that is added to the normal there, so that the camera
never looks straight down."""
CAMERA_HEIGHT = 0.05
"""Least height of the camera over the ground, where the place is higher [m]."""


@final
class TargetMark(PagePart):
    """Marks the place to press next, and turns the camera to it.

    Attributes:
        hints: whether it marks where to click while no place is to be pressed.
    """

    def __init__(self, server: ViserServer, scene: Scene, hints: bool = False) -> None:
        """Start without a place."""
        self.server, self.scene, self.hints = server, scene, hints
        self.place: PressPlace | None = None
        self.hinted: int | None = None
        self.handles: tuple[MeshHandle, LabelHandle] | None = None

    def update(self, update: ViewUpdate) -> None:
        """Mark the place of the guide, or where to click, if there is one."""
        place = None if update.guide is None else update.guide.place
        if place is None and self.hints:
            place = self.find_hint()
        if place != self.place:
            for handle in self.handles or ():
                handle.remove()
            self.place, self.handles = place, None
            if place is not None:
                text = "click here" if update.guide is None else "press here"
                self.handles = self.scene.add_mark(place, text)
                if update.guide is not None:
                    self.turn_camera(place)
        if place is not None and self.handles is not None:
            above = place.p_link + LABEL_HEIGHT * np.array(place.n_link)
            T = self.scene.T_world_link[place.link]
            self.handles[1].position = apply(T, above)

    def find_hint(self) -> PressPlace:
        """Return a place on the skin that faces the camera, the same while it does."""
        setup, facing = self.scene.setup, self.scene.measure_facing()
        if self.hinted is None or facing[self.hinted] < HINT_FACING:
            self.hinted = self.scene.find_facing_taxel()
        taxel = self.hinted
        p_link, n_link = (
            (float(x), float(y), float(z))
            for x, y, z in (setup.positions[taxel], setup.normals[taxel])
        )
        patch = setup.patches[setup.patch_index[taxel]]
        return PressPlace(patch, int(setup.taxel_link[taxel]), p_link, n_link)

    def turn_camera(self, place: PressPlace) -> None:
        """Look at a place from outside, and from above the ground."""
        T = self.scene.T_world_link[place.link]
        p_world = apply(T, np.array(place.p_link))
        direction = rotate(T, np.array(place.n_link)) + SLANT * CAMERA_DIRECTION
        direction /= np.linalg.norm(direction)
        room = max(p_world[2] - CAMERA_HEIGHT, CAMERA_HEIGHT)
        distance = min(TARGET_DISTANCE, room / max(-direction[2], 1e-9))
        self.scene.set_camera(p_world, distance, direction)
