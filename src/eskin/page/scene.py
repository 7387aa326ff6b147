"""This module draws the robot, its taxels, its gripper and the marks of touches."""

from collections import deque
from typing import final

import numpy as np
from jaxtyping import Float, Float32, UInt8
from viser import BatchedMeshHandle, FrameHandle, LabelHandle, ViserServer

from eskin.page.colours import ColourScale
from eskin.page.messages import ContactMarker, LogEntry, SceneDescription, ViewUpdate
from eskin.transforms import quaternion_to_matrix

CORNERS = 12
LIFT = 0.0012
"""How far discs stand off the surface [m]."""
COVER = 0.86
"""Radius of a disc, as a share of that of a circle of the taxel's area."""
WHOLE = 1.26
"""Radius of a pad, as such a share: a circle round the square of that area."""
PAD = (196, 200, 206)
"""Of what the taxels are on."""
LINEAR = np.round(255 * (np.arange(256) / 255) ** 2.2).astype(np.uint8)
"""Light of each step of a screen: viser takes colours of instances as light."""
FIELD = 0.7
"""Of view of the camera, from top to bottom [rad]."""
CAMERA = np.array([0.82, -0.80, 0.42])
"""From what the camera looks at towards it, about of length 1."""
STILL = 1e-5
"""Change of a pose that is not shown [1 or m]."""


@final
class Scene:
    """Robot, taxels and ground; changes travel, what stays the same does not.

    Attributes:
        discs: the taxels of each link that has some, by the link's index.
        taxels: which taxels those are.
    """

    def __init__(
        self, server: ViserServer, setup: SceneDescription, scale: ColourScale
    ) -> None:
        """Draw what does not change."""
        self.server = server
        self.setup = setup
        self.scale = scale
        at_rest = np.array([1, 0, 0, 0, 0, 0, 0], np.float32)
        self.poses = np.tile(at_rest, (len(setup.links), 1))
        self.ground()
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
        self.discs = {link: self.add_discs(link) for link in links}

    def ground(self) -> None:
        """A grid to stand on under a pale sky, and light that keeps colours true."""
        scene = self.server.scene
        scene.add_grid(
            "/ground",
            infinite_grid=True,
            fade_distance=7.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(222, 226, 232),
            section_color=(200, 206, 215),
            shadow_opacity=0.22,
            position=(0.0, 0.0, -0.001),
        )
        sky = np.linspace((224, 231, 240), (250, 251, 253), 64).astype(np.uint8)
        scene.set_background_image(np.tile(sky[:, None], (1, 4, 1)))
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

    def look(self, middle: Float[np.ndarray, "3"], distance: float) -> None:
        """Place the camera of those who open the page.

        Args:
            middle: what it looks at [m].
            distance: from it [m].
        """
        camera = self.server.initial_camera
        camera.fov = FIELD
        camera.look_at = middle
        camera.position = middle + distance * CAMERA

    def add_discs(self, link: int) -> BatchedMeshHandle:
        """One disc a taxel, in the frame of their link."""
        count = len(self.taxels[link])
        colours = self.scale.colours(np.zeros(count), np.ones(count, dtype=bool))
        return self.add_rounds("taxels", link, LIFT, COVER, LINEAR[colours])

    def add_pads(self, link: int) -> BatchedMeshHandle:
        """What is seen between the discs of a link, so that it can be touched there."""
        colour = tuple(LINEAR[list(PAD)].tolist())
        return self.add_rounds("pads", link, LIFT / 2, WHOLE, colour)

    def add_rounds(
        self,
        name: str,
        link: int,
        lift: float,
        share: float,
        colours: UInt8[np.ndarray, "taxel 3"] | tuple[int, int, int],
    ) -> BatchedMeshHandle:
        """Something round on each taxel of a link, in the frame of the link.

        Args:
            name: of all of them in the scene.
            link: index of the link.
            lift: how far they stand off the surface [m].
            share: their radius, as a share of that of a circle of the taxel's area.
            colours: of each, or of all.
        """
        setup, taxels = self.setup, self.taxels[link]
        vertices, faces = disc()
        normals = setup.normals[taxels]
        return self.server.scene.add_batched_meshes_simple(
            f"/robot/{setup.links[link]}/{name}",
            vertices,
            faces,
            turned_to(normals),
            setup.positions[taxels] + lift * normals,
            batched_scales=share * np.sqrt(setup.areas[taxels] / np.pi),
            batched_colors=colours,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

    def show(self, picture: ViewUpdate) -> None:
        """Move the links and colour the taxels that have changed."""
        for link, frame in enumerate(self.frames):
            move(frame, self.poses[link], picture.poses[link])
        pressure = picture.pressure.astype(np.float64)
        valid = np.unpackbits(picture.valid, count=len(pressure)).astype(bool)
        colours = LINEAR[self.scale.colours(pressure, valid)]
        for link, discs in self.discs.items():
            discs.batched_colors = colours[self.taxels[link]]

    def world(
        self,
    ) -> tuple[Float[np.ndarray, "taxel 3"], Float[np.ndarray, "taxel 3"]]:
        """Positions [m] and normals of the taxels as shown."""
        rotations = quaternion_to_matrix(self.poses[:, :4].astype(np.float64))
        turn = rotations[self.setup.taxel_link]
        origin = self.poses[self.setup.taxel_link, 4:]
        positions = np.einsum("tij,tj->ti", turn, self.setup.positions) + origin
        return positions, np.einsum("tij,tj->ti", turn, self.setup.normals)

    def to_link(
        self, link: int, p_world: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "3"]:
        """A point in the frame of a link as shown [m]."""
        rotation = quaternion_to_matrix(self.poses[link, :4].astype(np.float64))
        return rotation.T @ (p_world - self.poses[link, 4:])


def move(
    frame: FrameHandle, shown: Float32[np.ndarray, "7"], pose: Float32[np.ndarray, "7"]
) -> None:
    """Move a frame, if its pose has changed; `shown` is set to it then."""
    if np.abs(shown - pose).max() > STILL:
        shown[:] = pose
        frame.wxyz = pose[:4]
        frame.position = pose[4:]


def disc() -> tuple[Float32[np.ndarray, "vertex 3"], np.ndarray]:
    """Vertices and faces of a flat disc of radius 1 that faces z."""
    angle = np.arange(CORNERS) * 2 * np.pi / CORNERS
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(CORNERS)], axis=-1)
    vertices = np.concatenate([np.zeros((1, 3)), rim]).astype(np.float32)
    corner = np.arange(CORNERS)
    faces = np.stack([0 * corner, 1 + corner, 1 + (corner + 1) % CORNERS], axis=-1)
    return vertices, faces.astype(np.uint32)


def turned_to(normals: Float[np.ndarray, "point 3"]) -> Float[np.ndarray, "point 4"]:
    """Quaternions wxyz that turn z to each normal, the short way."""
    x, y, z = np.asarray(normals, np.float64).T
    wxyz = np.stack([1.0 + z, -y, x, np.zeros(len(x))], axis=-1)
    wxyz[1.0 + z < 1e-9] = (0.0, 1.0, 0.0, 0.0)
    return wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True)


METAL, RUBBER = (206, 209, 214), (52, 56, 64)
WIDE = {"open": 0.042, "closed": 0.011}
"""Of a finger from the middle [m]."""


@final
class GripperModel:
    """Drawn on the last link of the robot; only fingers move."""

    def __init__(self, server: ViserServer, setup: SceneDescription) -> None:
        """Draw it open."""
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
                position=(side * WIDE["open"], 0, 0.084),
            )
            for side in (-1, 1)
        }
        self.shown = "open"

    def show(self, state: str) -> None:
        """Open or close it.

        Args:
            state: `open` or `closed`.
        """
        if state != self.shown and state in WIDE:
            self.shown = state
            for side, finger in self.fingers.items():
                finger.position = (side * WIDE[state], 0.0, 0.084)


ROOM = 4
"""Contacts on one link that get a ring."""
HIDDEN = 1e-6
"""Radius of a ring that is not in use [m]."""
HIGH = 0.006
"""How far rings are above the skin [m]."""
SEGMENTS = 40
RING = (213, 94, 0)
"""Vermilion, which stands out from the whole colour scale (Okabe and Ito 2008)."""
WIDER = 0.008
"""How much a ring is wider than the contact [m]."""
LASTS = 2.0
"""How long words float [s]."""


@final
class Marks:
    """Rings around contacts and words at detections."""

    def __init__(self, server: ViserServer, scene: Scene) -> None:
        """Start without touches."""
        self.server = server
        self.scene = scene
        self.ringed: set[int] = set()
        self.count = 0
        self.words: deque[tuple[float, LabelHandle]] = deque()
        self.rings = {link: self.add_rings(link) for link in scene.discs}

    def add_rings(self, link: int) -> BatchedMeshHandle:
        """Rings on a link, too small to see until they are used."""
        vertices, faces = ring()
        return self.server.scene.add_batched_meshes_simple(
            f"/robot/{self.scene.setup.links[link]}/contacts",
            vertices,
            faces,
            np.tile([1.0, 0.0, 0.0, 0.0], (ROOM, 1)),
            np.zeros((ROOM, 3)),
            batched_scales=np.full(ROOM, HIDDEN),
            batched_colors=tuple(LINEAR[list(RING)].tolist()),
            lod="off",
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def show(self, picture: ViewUpdate) -> None:
        """Draw what a picture tells, and take away words that are old."""
        self.outline(picture.contacts)
        for saying in picture.log_entries:
            if saying.kind == "detection":
                self.say(saying)
        while self.words and picture.seconds - self.words[0][0] > LASTS:
            self.words.popleft()[1].remove()

    def outline(self, contacts: tuple[ContactMarker, ...]) -> None:
        """One ring a contact; those left over are too small to see."""
        for link in self.ringed | {contact.link for contact in contacts}:
            here = [contact for contact in contacts if contact.link == link][:ROOM]
            wxyz = np.tile(np.array([1, 0, 0, 0], np.float32), (ROOM, 1))
            places = np.zeros((ROOM, 3), np.float32)
            radii = np.full(ROOM, HIDDEN, np.float32)
            for row, contact in enumerate(here):
                places[row] = contact.p_link + HIGH * contact.n_link
                wxyz[row] = turned_to(contact.n_link[None])[0]
                radii[row] = contact.radius + WIDER
            rings = self.rings[link]
            rings.batched_positions = places
            rings.batched_wxyzs = wxyz
            rings.batched_scales = radii
        self.ringed = {contact.link for contact in contacts}

    def say(self, saying: LogEntry) -> None:
        """Let words float where a touch was recognised."""
        if saying.link < 0:
            return
        self.count += 1
        link = self.scene.setup.links[saying.link]
        label = self.server.scene.add_label(
            f"/robot/{link}/said_{self.count}",
            saying.text.partition(",")[0],
            position=saying.p_link,
            font_screen_scale=1.25,
            anchor="bottom-center",
        )
        self.words.append((saying.seconds, label))


def ring() -> tuple[Float32[np.ndarray, "vertex 3"], np.ndarray]:
    """Vertices and faces of a flat ring of radius 1 across z."""
    angle = np.arange(SEGMENTS) * 2 * np.pi / SEGMENTS
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(SEGMENTS)], axis=-1)
    vertices = np.concatenate([0.84 * circle, circle]).astype(np.float32)
    inner, right = np.arange(SEGMENTS), (np.arange(SEGMENTS) + 1) % SEGMENTS
    outer = inner + SEGMENTS
    faces = [
        np.stack([inner, outer, right + SEGMENTS], axis=-1),
        np.stack([inner, right + SEGMENTS, right], axis=-1),
    ]
    return vertices, np.concatenate(faces).astype(np.uint32)
