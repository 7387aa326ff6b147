"""With what force a touched skin pushes on its robot."""

import numpy as np
from jaxtyping import Float, Int

from eskin.robot import Wrench
from eskin.skin import Skin

KILO = 1000.0


def wrenches_of(
    pressure: Float[np.ndarray, "active"], taxels: Int[np.ndarray, "active"], skin: Skin
) -> tuple[Wrench, ...]:
    """What pressure on taxels does to the links beneath them.

    It pushes along the inward normals alone: what drags along the skin, and what
    presses beside all taxels, is not counted.

    Args:
        pressure: on each of these taxels [kPa].
        taxels: that are pressed.
        skin: that they are of.
    """
    forces = KILO * pressure * skin.areas[taxels]
    forces_link = -forces[:, None] * skin.normals[taxels]
    torques_link = np.cross(skin.positions[taxels], forces_link)
    patches = skin.patch_index[taxels]
    links = np.array(skin.link_names)[patches]
    return tuple(
        Wrench(
            str(link),
            forces_link[links == link].sum(axis=0),
            torques_link[links == link].sum(axis=0),
        )
        for link in np.unique(links)
    )
