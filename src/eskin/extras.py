"""Packages that not everybody needs, imported only when they are asked for."""

from importlib import import_module
from types import ModuleType

from eskin.errors import ExtraError


def find_mujoco(what: str) -> ModuleType:
    """The simulator MuJoCo, of the extra `sim`.

    Args:
        what: needs it.

    Raises:
        ExtraError: it is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise ExtraError(
            f"{what} needs MuJoCo, which is not installed; allowed is with it "
            "installed; pip install 'eskin[sim]'"
        ) from error
