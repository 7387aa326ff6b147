"""This module imports optional packages when they are needed."""

from importlib import import_module
from types import ModuleType

from eskin.errors import ExtraError


def find_mujoco(what: str) -> ModuleType:
    """Import the simulator MuJoCo, of the extra `sim`.

    Args:
        what: feature that needs it, for the message.

    Raises:
        ExtraError: MuJoCo is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise ExtraError(
            f"{what} needs MuJoCo, which is not installed; allowed is with it "
            "installed; pip install '.[sim]'"
        ) from error
