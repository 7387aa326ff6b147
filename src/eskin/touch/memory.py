"""What following touches needs to know of every taxel: where it is, how it was."""

from typing import NamedTuple

import numpy as np

from eskin.skin.mount import MountedSkin
from eskin.touch.adjacency import Adjacency

SITE = np.dtype(
    [
        ("position", "f8", 3),
        ("normal", "f8", 3),
        ("area", "f8"),
        ("reach", "f8"),
        ("link", "i8"),
        ("patch", "i8"),
        ("rank", "i8"),
        ("neighbours", "i8", 2),
    ]
)
"""A taxel in the frame of its link: position [m], outward normal, area [m2], how far it
connects [m], its link in `robot.links`, its patch, its place by patch, row and column,
and the span of its neighbours on the same link."""

TAXEL = np.dtype(
    [
        ("active_at", "f8"),
        ("peak", "f8"),
        ("onset", "i8"),
        ("held", "i8"),
        ("place", "i8"),
    ]
)
"""How a taxel was: when it was last active [s], its recent peak then [kPa], since when
it was active [ns], whether it has not been released since; and -1, which kernels use
to find the taxel among others."""

HELD, NEXT_TRACK, NEXT_TOUCH = 0, 1, 2
"""What is counted: taxels that are held, and the ids to be given next."""


class Memory(NamedTuple):
    """What is written to at every reading; its cost follows the touch."""

    taxels: np.ndarray
    """(taxel) TAXEL."""
    held: np.ndarray
    """(taxel) those that are held, in front."""
    counts: np.ndarray
    """(3) see `HELD`, `NEXT_TRACK`, `NEXT_TOUCH`."""


def sites_of(mounted: MountedSkin, adjacency: Adjacency) -> np.ndarray:
    """Every taxel of a skin as a SITE."""
    skin = mounted.skin
    sites = np.empty(skin.count, SITE)
    sites["position"], sites["normal"] = skin.positions, skin.normals
    sites["area"], sites["reach"] = skin.areas, adjacency.reach
    sites["link"], sites["patch"] = mounted.skin_link_index, skin.patch_index
    order = np.lexsort((skin.columns, skin.rows, skin.patch_index))
    sites["rank"][order] = np.arange(skin.count)
    sites["neighbours"][:, 0] = adjacency.starts[:-1]
    sites["neighbours"][:, 1] = adjacency.starts[1:]
    return sites


def fresh_memory(count: int) -> Memory:
    """The memory of a skin that was never touched."""
    taxels = np.zeros(count, TAXEL)
    taxels["active_at"] = -np.inf
    taxels["place"] = -1
    return Memory(taxels, np.empty(count, np.int64), np.array([0, 1, 1]))
