"""Which place of the skin is meant by a ray from the eye."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.page.scene import Scene

REACH = 0.015
"""How far from a taxel's centre a ray may pass it [m]."""


@dataclass(frozen=True, eq=False)
class Spot:
    """A place on the skin."""

    taxel: int
    """The nearest taxel."""

    link: int
    """Index of its link."""

    p_link: Float[np.ndarray, "3"]
    """The place itself, in the frame of the link [m]."""


@final
class Pointing:
    """Finds spots on the skin where it is now."""

    def __init__(self, scene: Scene) -> None:
        """Look at a scene."""
        self.scene = scene
        self.links = scene.setup.taxel_link

    def of_taxel(self, taxel: int) -> Spot:
        """The centre of a taxel."""
        link = int(self.links[taxel])
        return Spot(taxel, link, self.scene.setup.positions[taxel])

    def along(
        self, origin: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]
    ) -> Spot | None:
        """The foremost spot that a ray meets; None where it misses the skin.

        Args:
            origin: of the ray in the world [m].
            direction: of the ray, of any length.
        """
        direction = direction / np.linalg.norm(direction)
        positions, normals = self.scene.world()
        depth = (positions - origin) @ direction
        aside = np.linalg.norm(positions - origin - depth[:, None] * direction, axis=-1)
        met = (normals @ direction < 0) & (depth > 0) & (aside < REACH)
        if not met.any():
            return None
        front = met & (depth < depth[met].min() + 2 * REACH)
        taxel = int(np.argmin(np.where(front, aside, np.inf)))
        normal = normals[taxel]
        # Where the ray passes the plane of the taxel, but no further from its centre.
        step = ((positions[taxel] - origin) @ normal) / (direction @ normal)
        offset = origin + step * direction - positions[taxel]
        offset *= min(1.0, self.size(taxel) / max(float(np.linalg.norm(offset)), 1e-9))
        link = int(self.links[taxel])
        return Spot(taxel, link, self.scene.to_link(link, positions[taxel] + offset))

    def size(self, taxel: int) -> float:
        """Radius of a circle of a taxel's area [m]."""
        return float(np.sqrt(self.scene.setup.areas[taxel] / np.pi))
