"""This module loads robots by the name of a preset or the path of a URDF file."""

from functools import lru_cache
from importlib import resources
from pathlib import Path

from eskin.errors import RobotError
from eskin.robot.robot import Robot
from eskin.robot.urdf import URDF_SUFFIX, load_urdf

ROBOT_PRESETS = ("ur5", "ur10", "base", "post", "table", "tube")
"""Names of the robots that come with eskin."""


def load_robot(name_or_path: str | Path, *, mimics: bool = True) -> Robot:
    """Load a robot that comes with eskin, or one from a URDF file.

    Args:
        name_or_path: one of `ROBOT_PRESETS`, or the path of a `.urdf` file.
        mimics: whether to read mimic rules; without them every joint has a value.

    Raises:
        RobotError: There is no such robot or file, or the file cannot be used.
    """
    if str(name_or_path) in ROBOT_PRESETS:
        return load_preset(str(name_or_path), mimics)
    path = Path(name_or_path)
    if path.suffix != URDF_SUFFIX and not path.is_file():
        raise RobotError(
            f"no robot '{name_or_path}'; allowed: {', '.join(ROBOT_PRESETS)}, "
            "or the path of a .urdf file"
        )
    return load_urdf(path, mimics=mimics)


@lru_cache
def load_preset(name: str, mimics: bool) -> Robot:
    """Load a robot that comes with eskin, once in a process."""
    package = resources.files("eskin.robot") / "presets" / f"{name}{URDF_SUFFIX}"
    with resources.as_file(package) as path:
        return load_urdf(path, mimics=mimics)


def read_preset_urdf(name: str) -> str:
    """Return the URDF of a robot that comes with eskin.

    Raises:
        RobotError: There is no such robot.
    """
    if name not in ROBOT_PRESETS:
        raise RobotError(
            f"no robot '{name}' comes with eskin; allowed: {', '.join(ROBOT_PRESETS)}"
        )
    return (
        resources.files("eskin.robot") / "presets" / f"{name}{URDF_SUFFIX}"
    ).read_text()
