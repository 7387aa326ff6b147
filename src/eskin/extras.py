"""This module imports optional packages when they are needed."""

from importlib import import_module
from types import ModuleType
from typing import Any

from eskin.errors import ExtraError


def find_mujoco(what: str) -> ModuleType:
    """Import the simulator MuJoCo, of the extra `sim`.

    Args:
        what: feature that needs it, for the message.

    Raises:
        ExtraError: MuJoCo is not installed.
    """
    return find_package("mujoco", "MuJoCo", "sim", what)


def find_package(module: str, name: str, extra: str, what: str) -> Any:  # noqa: ANN401
    """Import a module of an optional package, without its types.

    Args:
        module: module to import.
        name: name of the package, for the message.
        extra: extra of eskin that installs it.
        what: feature that needs it, for the message.

    Raises:
        ExtraError: The package is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise ExtraError(
            f"{what} needs {name}, which is not installed; allowed is with it "
            f"installed; pip install '.[{extra}]'"
        ) from error
