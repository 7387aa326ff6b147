"""This module imports the functions of command maps from files beside the map."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType
from typing import cast

from eskin.command.actions import COMMAND_FUNCTIONS, CommandFunction
from eskin.errors import CommandError

FUNCTION_NAME = re.compile(r"([A-Za-z_]\w*):([A-Za-z_]\w*)", re.ASCII)
"""A function of a module beside the map: `module:function`."""


def import_functions(names: list[str], folder: Path) -> None:
    """Import functions `module:function`, and register each under that name.

    Other names, and those that are registered already, are left alone. The code of the
    modules runs.

    Args:
        names: names of functions.
        folder: folder that each `module.py` lies in; modules elsewhere are not found.

    Raises:
        CommandError: a module is missing or fails, or has no such function.
    """
    modules: dict[str, ModuleType] = {}
    for name in names:
        match = FUNCTION_NAME.fullmatch(name)
        if match is None or name in COMMAND_FUNCTIONS:
            continue
        stem, function = match.groups()
        path = folder / f"{stem}.py"
        if stem not in modules:
            modules[stem] = import_module(path)
        found = getattr(modules[stem], function, None)
        if not callable(found):
            raise CommandError(
                f"{path}: got no function '{function}', allowed is one that is called "
                "with the arm and the detection; define it, or correct the map"
            )
        COMMAND_FUNCTIONS[name] = cast(CommandFunction, found)


def import_module(path: Path) -> ModuleType:
    """Import the module in a file.

    Raises:
        CommandError: there is no such file, or its code fails.
    """
    if not path.is_file():
        raise CommandError(
            f"{path}: got no file, allowed is a Python module beside the map; add it, "
            "or correct the map"
        )
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        text = " ".join(str(error).split())
        raise CommandError(
            f"{path}: {type(error).__name__}: {text}; allowed is a module that can be "
            "imported; correct it"
        ) from error
    return module
