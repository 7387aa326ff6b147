"""What is drawn around touches: rings, and words where something was recognised."""

from collections import deque
from typing import final

import numpy as np
from jaxtyping import Float32
from viser import BatchedMeshHandle, LabelHandle, ViserServer

from eskin.page.picture import ContactMark, Picture, Saying
from eskin.page.scene import LINEAR, Scene, turned_to

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

    def show(self, picture: Picture) -> None:
        """Draw what a picture tells, and take away words that are old."""
        self.outline(picture.contacts)
        for saying in picture.sayings:
            if saying.kind == "detection":
                self.say(saying)
        while self.words and picture.seconds - self.words[0][0] > LASTS:
            self.words.popleft()[1].remove()

    def outline(self, contacts: tuple[ContactMark, ...]) -> None:
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

    def say(self, saying: Saying) -> None:
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
