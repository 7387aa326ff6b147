"""This module draws marks on the robot: its gripper, and its touches."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float
from viser import BatchedMeshHandle, LabelHandle, ViserServer

from eskin.page.html import render_question, to_words
from eskin.page.messages import (
    CAMERA_DIRECTION,
    ContactMarker,
    LogEntry,
    PressPlace,
    SceneDescription,
    ViewUpdate,
)
from eskin.page.scene import (
    BOTTOM,
    CORNERS,
    LINEAR,
    PART,
    Mesh,
    PagePart,
    Scene,
    compute_rotations_to,
    revolve,
)
from eskin.transforms import apply, rotate

METAL = (206, 209, 214)
RUBBER = (52, 56, 64)
PART_COLOUR = (0, 114, 178)
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
        state = update.arm.gripper
        carrying = update.arm.carrying
        if self.part.visible != carrying:
            self.part.visible = carrying
        if state != self.shown and state in FINGER_OFFSETS:
            self.shown = state
            for side, finger in self.fingers.items():
                finger.position = (side * FINGER_OFFSETS[state], 0.0, 0.084)


# Rings around contacts.
MAX_RINGS = 4
"""Greatest number of rings on one link."""
HIDDEN_RADIUS = 1e-6
"""Radius of a ring that is not in use [m]."""
RING_LIFT = 0.006
"""Distance of the rings from the skin [m]."""
RING_MARGIN = 0.008
"""Difference between the radii of a ring and its contact [m]."""
SEGMENTS = 40
"""Number of segments of a ring."""
RING_PROFILE = ((0.84, 0.0), (1.0, 0.0))
ARROW_PROFILE = ((0.0, 0.0), (0.12, 0.3), (0.04, 0.3), (0.04, 1.0), (0.0, 1.0))
"""Profiles of a flat ring of radius 1 across z, and of an arrow of length 1 down z with
its tip at zero: the head, its underside, the shaft, and the end."""
RING = (0, 90, 181)
"""Blue, distinct from the whole colour scale for people of any colour vision."""

# Arrows of forces.
ARROW_BASE = 0.03
ARROW_PER_NEWTON = 0.006
ARROW_LONGEST = 0.15
"""Length of the arrow of a force: without force, for each newton, at most [m]."""

# Labels.
NAMED = 3
"""Greatest number of contacts with their name."""
LETTER_WIDTH = 6.0
"""Width of a letter of a label at a scale of 1 [px]."""
LINE_HEIGHT = 18.0
"""Height of a label at a scale of 1 [px]."""
DETECTION_SCALE = 1.25
"""Scale of the label of a detection."""
LABEL_SECONDS = 2.0
"""Time that a floating label is shown [s]."""


@dataclass(frozen=True, eq=False)
class FloatingLabel:
    """A floating label names a detection at its place, for a time."""

    seconds: float
    """Time of the detection since the stream began [s]."""
    handle: LabelHandle
    """Label in the scene."""
    link: int
    """Index of the link that it moves with."""
    p_link: Float[np.ndarray, "3"]
    """Middle of its lower edge in the frame of that link [m]."""


@final
class Marks(PagePart):
    """Draws rings around contacts and labels at detections."""

    def __init__(self, server: ViserServer, scene: Scene) -> None:
        """Start without touches."""
        self.server = server
        self.scene = scene
        self.ringed: set[int] = set()
        self.count = 0
        self.labels: deque[FloatingLabel] = deque()
        ring = revolve(RING_PROFILE, SEGMENTS)
        arrow = revolve(ARROW_PROFILE, CORNERS)
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
        for entry in update.log_entries:
            if entry.kind == "detection":
                self.add_label(entry)
        while self.labels and update.seconds - self.labels[0].seconds > LABEL_SECONDS:
            self.labels.popleft().handle.remove()
        self.draw_names(update.contacts)

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
        """Write patch and force beside the arrows of the strongest contacts.

        A name that would overlap the label of a detection, or of a stronger contact, is
        not shown.
        """
        named = contacts[:NAMED]
        texts = [
            f"{to_words(contact.patch)} {contact.force:.0f} N" for contact in named
        ]
        ends = [self.find_arrow_end(contact) for contact in named]
        first = [self.measure_label(label) for label in self.labels]
        boxes = [
            measure_box(self.scene.project(p), t)
            for p, t in zip(ends, texts, strict=True)
        ]
        shown = find_clear(np.array([*first, *boxes]).reshape(-1, 4))[len(first) :]
        for number, label in enumerate(self.names):
            is_shown = number < len(named) and bool(shown[number])
            if is_shown:
                if label.text != texts[number]:
                    label.text = texts[number]
                label.position = ends[number]
            if label.visible != is_shown:
                label.visible = is_shown

    def find_arrow_end(self, contact: ContactMarker) -> Float[np.ndarray, "3"]:
        """Return the end of the arrow of a contact in the world frame [m]."""
        length = compute_arrow_length(contact.force) + 0.01
        end = contact.p_link + length * contact.n_link
        return apply(self.scene.T_world_link[contact.link], end)

    def measure_label(self, label: FloatingLabel) -> Float[np.ndarray, "4"]:
        """Return the box of the label of a detection in the picture [px]."""
        p_world = apply(self.scene.T_world_link[label.link], label.p_link)
        at = self.scene.project(p_world)
        box = measure_box(at, label.handle.text, DETECTION_SCALE)
        width, height = box[2:] - box[:2]
        return box - np.array([width / 2, height, width / 2, height])

    def add_label(self, entry: LogEntry) -> None:
        """Add a floating label where a touch was recognised."""
        if entry.link < 0:
            return
        self.count += 1
        link = self.scene.setup.links[entry.link]
        for previous in [found for found in self.labels if found.link == entry.link]:
            previous.handle.remove()
            self.labels.remove(previous)
        label = self.server.scene.add_label(
            f"/robot/{link}/detection_{self.count}",
            entry.label,
            position=entry.p_link,
            font_screen_scale=DETECTION_SCALE,
            anchor="bottom-center",
        )
        self.labels.append(
            FloatingLabel(entry.seconds, label, entry.link, np.array(entry.p_link))
        )


def measure_box(
    corner: Float[np.ndarray, "2"], text: str, scale: float = 1.0
) -> Float[np.ndarray, "4"]:
    """Return the box of a label: left, top, right and bottom [px].

    Args:
        corner: its left upper corner [px].
        text: its text.
        scale: its scale.
    """
    size = scale * np.array([LETTER_WIDTH * (len(text) + 1), LINE_HEIGHT])
    return np.concatenate([corner, corner + size])


def find_clear(boxes: Float[np.ndarray, "box 4"]) -> Bool[np.ndarray, "box"]:
    """Return which boxes are shown: those that overlap no earlier one that is.

    Args:
        boxes: left, top, right and bottom of each.
    """
    clear = np.zeros(len(boxes), bool)
    for number, (left, top, right, bottom) in enumerate(boxes):
        others = boxes[clear]
        across = (others[:, 0] < right) & (left < others[:, 2])
        down = (others[:, 1] < bottom) & (top < others[:, 3])
        clear[number] = not np.any(across & down)
    return clear


def compute_arrow_length(force: float) -> float:
    """Return the length of the arrow of a force [N], in metres."""
    return min(ARROW_BASE + ARROW_PER_NEWTON * force, ARROW_LONGEST)


TARGET = (231, 41, 138)
"""Pink, distinct from skin at rest, lids and rings around contacts (Brewer's Dark2)."""
TARGET_RADIUS = 0.02
"""Radius of the ring around the place to press [m]."""
LABEL_HEIGHT = 0.03
"""Height of the label over that place [m]."""
HINT_FACING = 0.6
"""Cosine to the camera below which another place is hinted at."""
ASIDE = 0.03
BEFORE = 0.06
SOME = 4
"""Distance from the ray to the camera, and along it, at which a part of the robot hides
a place [m]; one of so many points is looked at."""
TARGET_DISTANCE = 0.9
"""Distance of the camera from the place to press [m]."""
SLANT = 0.5
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
        self.server = server
        self.scene = scene
        self.hints = hints
        self.place: PressPlace | None = None
        self.hinted: int | None = None
        self.ring = server.scene.add_mesh_simple(
            "/target",
            *revolve(RING_PROFILE, SEGMENTS),
            color=TARGET,
            side="double",
            scale=TARGET_RADIUS,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        # A label is seen through the robot.
        self.label = server.scene.add_label(
            "/target_label", "", anchor="bottom-center", visible=False
        )

    def update(self, update: ViewUpdate) -> None:
        """Mark the place of the guide, or where to click, if there is one."""
        place = None if update.guide is None else update.guide.place
        if place is None and self.hints:
            place = self.find_hint()
        if place != self.place:
            self.place = place
            self.ring.visible = self.label.visible = place is not None
            self.label.text = "click here" if update.guide is None else "press here"
            if place is not None and update.guide is not None:
                self.turn_camera(place)
        if place is not None:
            T = self.scene.T_world_link[place.link]
            normal = rotate(T, np.array(place.n_link))
            middle = apply(T, np.array(place.p_link)) + RING_LIFT * normal
            self.ring.position = middle
            self.ring.wxyz = compute_rotations_to(normal[None])[0]
            # Above the ring in the picture, which it would else cover.
            self.label.position = middle + np.array([0.0, 0.0, LABEL_HEIGHT])

    def find_hint(self) -> PressPlace:
        """Return a place on the skin that the camera sees, the same while it does."""
        setup = self.scene.setup
        facing = self.measure_facing()
        last = self.hinted
        if last is None or facing[last] < HINT_FACING or self.find_hidden([last])[0]:
            # The middle of what is seen of the patch that is seen most.
            some = np.flatnonzero(facing >= HINT_FACING)[::SOME]
            seen = some[~self.find_hidden(some)]
            if len(seen):
                patches = setup.patch_index[seen]
                seen = seen[patches == np.bincount(patches).argmax()]
                places = self.scene.place_taxels()[0][seen]
                away = np.linalg.norm(places - places.mean(axis=0), axis=1)
                self.hinted = int(seen[away.argmin()])
            elif last is None:
                self.hinted = int(facing.argmax())
        taxel = self.hinted or 0
        p_link, n_link = (
            (float(x), float(y), float(z))
            for x, y, z in (setup.positions[taxel], setup.normals[taxel])
        )
        patch = setup.patches[setup.patch_index[taxel]]
        return PressPlace(patch, int(setup.taxel_link[taxel]), p_link, n_link)

    def measure_facing(self) -> Float[np.ndarray, "taxel"]:
        """Return the cosine between each normal and the way to the first camera."""
        positions, normals = self.scene.place_taxels()
        rays = self.eye - positions
        return np.einsum("ti,ti->t", rays, normals) / np.linalg.norm(rays, axis=1)

    @property
    def eye(self) -> Float[np.ndarray, "3"]:
        """Position of the first camera [m]."""
        middle, distance, direction = self.scene.camera
        return middle + distance * direction

    def find_hidden(self, taxels: Sequence[int] | np.ndarray) -> Bool[np.ndarray, "_"]:
        """Return which taxels have a part of the robot before them."""
        scene = self.scene
        (positions, _) = self.scene.place_taxels()
        parts = [
            apply(scene.T_world_link[solid.link], solid.vertices[::SOME])
            for solid in scene.setup.solids
        ]
        bodies = np.concatenate([*parts, positions[::SOME]])
        places = positions[taxels]
        rays = (self.eye - places) / np.linalg.norm(self.eye - places, axis=1)[:, None]
        away = bodies - places[:, None]
        along = np.einsum("tpi,ti->tp", away, rays)
        aside = np.linalg.norm(away - along[..., None] * rays[:, None], axis=2)
        return np.any((along > BEFORE) & (aside < ASIDE), axis=1)

    def turn_camera(self, place: PressPlace) -> None:
        """Look at a place from outside, and from above the ground."""
        T = self.scene.T_world_link[place.link]
        p_world = apply(T, np.array(place.p_link))
        direction = rotate(T, np.array(place.n_link))
        direction += np.multiply(SLANT, CAMERA_DIRECTION)
        direction /= np.linalg.norm(direction)
        room = max(p_world[2] - CAMERA_HEIGHT, CAMERA_HEIGHT)
        distance = min(TARGET_DISTANCE, room / max(-direction[2], 1e-9))
        self.scene.set_camera(p_world, distance, direction)


@final
class QuestionBanner(PagePart):
    """Shows across the scene what the arm asks.

    The script of the page draws it, with a sound when it comes, from what the panel
    holds.

    Attributes:
        shown: what the script reads, as HTML.
    """

    def __init__(self, server: ViserServer, setup: SceneDescription) -> None:
        """Start without a question."""
        self.setup = setup
        self.shown = render_question(None, setup)
        self.html = server.gui.add_html(self.shown, order=BOTTOM)

    def update(self, update: ViewUpdate) -> None:
        """Show the question of an update, or none."""
        shown = render_question(update.question, self.setup)
        if shown != self.shown:
            self.shown = shown
            self.html.content = shown
