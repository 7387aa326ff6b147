"""What the page is told once, before the first picture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class Solid:
    """A part of the robot as it looks: a closed mesh in the frame of its link."""

    link: int
    """Index of its link."""

    vertices: Float[np.ndarray, "vertex 3"]
    """[m]"""

    faces: Int[np.ndarray, "face 3"]
    """Counter-clockwise when seen from outside."""

    colour: tuple[int, int, int]
    """Red, green and blue, each to 255."""


@dataclass(frozen=True, eq=False)
class Setup:
    """A skin on its robot, and what people may do with it."""

    title: str
    """What is seen: robot, skin and source."""

    links: tuple[str, ...]
    """Of the robot."""

    solids: tuple[Solid, ...]
    """What the robot looks like."""

    taxel_link: Int[np.ndarray, "taxel"]
    """Index of each taxel's link."""

    positions: Float[np.ndarray, "taxel 3"]
    """Of the taxels in the frames of their links [m]."""

    normals: Float[np.ndarray, "taxel 3"]
    """Outward, unit, in the same frames."""

    areas: Float[np.ndarray, "taxel"]
    """[m2]"""

    patches: tuple[str, ...]
    """Names."""

    patch_index: Int[np.ndarray, "taxel"]
    """The patch of each taxel."""

    gestures: tuple[str, ...]
    """The vocabulary, in the order of the probabilities."""

    touchable: bool
    """Whether touches and other orders are taken from the page."""

    skins: tuple[str, ...] = ()
    """Skins that can be chosen instead; the first is on."""

    is_arm: bool = False
    """Whether an arm's state is told."""

    compares: bool = False
    """Whether recognisers are compared, in place of all else beside the scene."""
