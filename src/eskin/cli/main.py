"""The `eskin` command imports the module of the command called and runs it.

Every command keeps this contract: `--json` makes the last line of stdout one JSON
object; bad input gives one line on stderr and exit code 2, a stream that had to stop
one line and exit code 1; nothing is left half-written.
"""

import contextlib
import importlib
import inspect
import io
import json
import os
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import tyro

from eskin.cli.checks import check_files
from eskin.errors import EskinError, StreamError

COMMANDS = {
    "convert": "recordings:run_convert",
    "label": "recordings:run_label",
    "train": "train:run",
    "evaluate": "evaluate:run",
    "compare": "compare:run_compare",
    "study": "compare:run_study",
    "run": "run:run",
    "replay": "recordings:run_replay",
    "view": "recordings:run_view",
    "generate": "generate:run",
    "demo": "demo:run",
    "device": "device:run",
    "calibrate": "calibrate:run",
    "skin show": "skin:run_show",
    "skin check": "skin:run_check",
    "skin design": "design:run",
    "bench latency": "bench_latency:run",
    "bench throughput": "bench_throughput:run",
    "doctor": "doctor:run",
}
"""Module and function of each command; the function takes the command's dataclass."""

CHECKED_FIRST = ("compare", "demo", "evaluate", "run", "study", "train")
"""Commands that take a second or more before they read their files."""

FAILED = 1
BAD_INPUT = 2
STOPPED = 130


@dataclass(frozen=True)
class Output:
    """Options that set how the result is printed."""

    json: bool = False
    """Print the result as one JSON object on the last line of stdout."""


def main() -> None:
    """Run the command in `sys.argv` and exit with its code."""
    sys.exit(run(sys.argv[1:]))


def run(argv: list[str]) -> int:
    """Run one command line and return its exit code."""
    if not argv or argv[0] in ("-h", "--help"):
        print(format_overview())
        return 0
    try:
        name, rest = split_command(argv)
        if name in CHECKED_FIRST:
            check_files(rest)
        function, command_type = load_command(name)
        command, output = parse(command_type, name, rest)
        result = function(command)
        if output.json:
            print(json.dumps(result))
        sys.stdout.flush()
    except ModuleNotFoundError as error:
        return print_error(
            f"{error.name} is missing; install it: pip install '.[train]'"
        )
    except StreamError as error:
        print_error(str(error))
        return FAILED
    except BrokenPipeError:
        # The reader of the output, such as `head`, has closed it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return STOPPED
    except (EskinError, ValueError, OSError) as error:
        return print_error(str(error))
    except KeyboardInterrupt:
        print_error("stopped")
        return STOPPED
    return 0


def load_command(name: str) -> tuple[Callable[[Any], dict[str, object]], type]:
    """Import a command's module; return its function and the dataclass it takes."""
    module, function_name = COMMANDS[name].split(":")
    function = getattr(importlib.import_module(f"eskin.cli.{module}"), function_name)
    return function, inspect.signature(function).parameters["command"].annotation


def split_command(argv: list[str]) -> tuple[str, list[str]]:
    """Split the command's one- or two-word name from its arguments."""
    for words in (2, 1):
        name = " ".join(argv[:words])
        if name in COMMANDS:
            return name, argv[words:]
    begun = [name for name in COMMANDS if name.split()[0] == argv[0]]
    known = ", ".join(begun or COMMANDS)
    raise ValueError(f"no command '{argv[0]}'; commands: {known}; see eskin --help")


def parse(command_type: type, name: str, argv: list[str]) -> tuple[object, Output]:
    """Parse the arguments of one command; reduce tyro's error to one line."""
    both = tuple[
        Annotated[command_type, tyro.conf.arg(name="")],
        Annotated[Output, tyro.conf.arg(name="")],
    ]
    tyro_error = io.StringIO()
    try:
        with contextlib.redirect_stderr(tyro_error):
            return tyro.cli(
                both,
                prog=f"eskin {name}",
                description=command_type.__doc__,
                args=argv,
                config=(tyro.conf.FlagCreatePairsOff,),
            )
    except SystemExit as stop:
        if stop.code == 0:
            raise
        raise ValueError(format_one_line(tyro_error.getvalue(), name)) from None


def format_one_line(message: str, name: str) -> str:
    """Reduce an error of tyro to its words, without the box drawn around them."""
    words = message.translate({ord(c): " " for c in "╭╮╰╯│─├┤"}).split()
    text = " ".join(word for word in words if not re.fullmatch("[-+|]{3,}", word))
    # tyro calls the command and its output `0` and `1`.
    text = re.sub(r"(?<![\w.])[01]\.(?=[a-z])", "", text)
    for title in ("Parsing error ", "Unrecognized options "):
        text = text.removeprefix(title)
    return f"eskin {name}: {text}"


def print_error(message: str) -> int:
    """Print one line on stderr and return the exit code of bad input."""
    print("error: " + " ".join(message.split()), file=sys.stderr)
    return BAD_INPUT


def format_overview() -> str:
    """List the commands, one on each line."""
    rows = ["eskin: touch gestures from a robot's electronic skin", ""]
    rows += [f"  eskin {name}" for name in COMMANDS]
    return "\n".join([*rows, "", "eskin COMMAND --help explains one."])


if __name__ == "__main__":
    main()
