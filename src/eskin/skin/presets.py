"""Skins that come with eskin."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from eskin.robot import Robot, load_robot
from eskin.skin.bending import bent_skin, flat_skin
from eskin.skin.drum import drum_skin
from eskin.skin.grids import grid_skin
from eskin.skin.skin import Skin
from eskin.skin.ur5 import ur5_skin
from eskin.skin.ur5_shapes import shapes_skin
from eskin.skin.ur10 import ur10_skin

__all__ = ["PRESETS", "Preset", "robot_for"]


@dataclass(frozen=True)
class Preset:
    """A skin that comes with eskin, and the robot it is made for."""

    build: Callable[[], Skin]
    """Makes the skin."""

    robot: str
    """What `load_robot` calls the robot."""


PRESETS = {
    "ur5": Preset(ur5_skin, "ur5"),
    "ur5-half": Preset(partial(ur5_skin, "ur5-half", density=0.5), "ur5"),
    "ur5-double": Preset(partial(ur5_skin, "ur5-double", density=2.0), "ur5"),
    "ur5-sparse": Preset(partial(ur5_skin, "ur5-sparse", density=0.7), "ur5"),
    "ur5-dense": Preset(partial(ur5_skin, "ur5-dense", density=1.4), "ur5"),
    "ur5-shapes": Preset(shapes_skin, "ur5"),
    "ur5-missing": Preset(
        partial(ur5_skin, "ur5-missing", missing=("forearm_back",)), "ur5"
    ),
    "ur10": Preset(ur10_skin, "ur10"),
    "base": Preset(partial(drum_skin, "base", "base_link", 0.25, 0.5, ring=6), "base"),
    "post": Preset(partial(drum_skin, "post", "post_link", 0.17, 0.6, ring=4), "post"),
    "sleeve": Preset(partial(grid_skin, 19, 27, name="sleeve"), "table"),
    "shearsense": Preset(
        partial(grid_skin, 6, 6, kind="shear", name="shearsense"), "table"
    ),
    "socialtouch": Preset(partial(grid_skin, 19, 24, name="socialtouch"), "table"),
    "bent": Preset(bent_skin, "tube"),
    "flat": Preset(flat_skin, "table"),
}
"""The skins that `load_skin` knows by name; public sets' have a nominal pitch."""


def robot_for(skin_name: str, robot_name: str | None = None) -> Robot | None:
    """The robot of that name, else the one a preset skin is made for, else None."""
    if robot_name is not None:
        return load_robot(robot_name)
    return load_robot(PRESETS[skin_name].robot) if skin_name in PRESETS else None
