"""A skin on its robot, each given or by name."""

from pathlib import Path

from eskin.errors import SkinMismatchError
from eskin.model import ModelCard
from eskin.robot import Robot, load_robot
from eskin.skin import MountedSkin, Skin, load_skin, robot_for


def mount(skin: str | Path | Skin, robot: str | Path | Robot | None) -> MountedSkin:
    """Mount a skin.

    Args:
        skin: a preset's name, a skin's folder, or a skin.
        robot: a preset's name, a URDF, or a robot; None for that of a preset skin.

    Raises:
        SkinMismatchError: if nothing tells what robot the skin is on.
    """
    known = robot_for(str(skin)) if isinstance(skin, str) and robot is None else None
    found = skin if isinstance(skin, Skin) else load_skin(skin)
    if isinstance(robot, str | Path):
        robot = load_robot(robot)
    robot = robot or known
    if robot is None:
        raise SkinMismatchError(
            f"skin '{found.name}' is given without a robot; allowed are a robot's "
            "name, a URDF or a Robot; give the robot that it is on"
        )
    return MountedSkin(found, robot)


def check_kind(card: ModelCard, skin: Skin) -> None:
    """Refuse a skin that does not measure what a model needs.

    Raises:
        SkinMismatchError: saying what is missing.
    """
    if card.kind == "shear" and not skin.has_shear:
        raise SkinMismatchError(
            f"model needs shear, skin '{skin.name}' measures only pressure; allowed is "
            "a skin with a patch of kind shear; use a model for pressure alone"
        )
