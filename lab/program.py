"""This module runs functions of the laboratory as programs, as `eskin` does."""

import inspect
import json
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import tyro

from eskin.cli.main import parse, print_error
from eskin.errors import EskinError


def run_program(
    function: Callable[[Any], dict[str, object]], argv: list[str] | None = None
) -> int:
    """Parse arguments, run a function, and return the exit code.

    `--json` prints the result as the last line; bad input gives one line on stderr.

    Args:
        function: takes the dataclass `command`, whose fields are the options.
        argv: arguments; the process's own unless given.
    """
    kind = inspect.signature(function).parameters["command"].annotation
    spec = sys.modules[function.__module__].__spec__
    name = f"python -m {spec.name if spec else function.__module__}"
    try:
        command, output = parse(kind, name, sys.argv[1:] if argv is None else argv)
        result = function(command)
        if output.json:
            print(json.dumps(result))
    except (EskinError, ValueError) as error:
        return print_error(str(error))
    return 0


def run_part(package: str, parts: Sequence[str]) -> None:
    """Run `main` of the module that the first argument names, with its options.

    Args:
        package: package of the modules.
        parts: names of those that have a `main`, which takes the dataclass `command`.
    """
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in parts:
        print(f"part '{name}'; allowed are {', '.join(parts)}", file=sys.stderr)
        sys.exit(2)
    module = import_module(f"{package}.{name}")
    module.main(tyro.cli(module.Command, args=sys.argv[2:]))
