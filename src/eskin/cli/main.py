"""The `eskin` command imports the module of the command called and runs it.

Every command keeps this contract: `--json` makes the last line of stdout one JSON
object; bad input gives one line on stderr and exit code 2, a stream that had to stop
one line and exit code 1; nothing is left half-written.
"""

import contextlib
import errno
import importlib
import inspect
import io
import json
import logging
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from typing import Annotated, Any

import tyro

from eskin.cli.checks import check_files
from eskin.cli.parse_errors import rewrite_parse_error
from eskin.errors import EskinError, StreamError


@dataclass(frozen=True)
class Entry:
    """An entry describes one command."""

    function: str
    """Module and name of its function, which takes the command's dataclass."""
    summary: str
    """What the command does, for the overview."""


COMMANDS = {
    "run": Entry("run:run", "recognise live: devices, a recording, a simulation"),
    "demo": Entry("demo:run", "touch a simulated arm at work in the browser"),
    "record": Entry("record:run", "record and label gestures of your own"),
    "replay": Entry("recordings:run_replay", "recognise a recording as if live"),
    "view": Entry("recordings:run_view", "play and label a recording in the browser"),
    "label": Entry("recordings:run_label", "label touches by their pressure"),
    "train": Entry("train:run", "train the recogniser on recordings"),
    "evaluate": Entry("evaluate:run", "score a model on labelled recordings"),
    "compare": Entry("compare:run_compare", "compare methods on the same recordings"),
    "study": Entry("compare:run_study", "compare neighbours and pooling"),
    "generate": Entry("generate:run", "generate recordings of simulated people"),
    "convert": Entry("recordings:run_convert", "convert a public data set"),
    "export": Entry("export:run", "write a model as ONNX, recordings as bag or tables"),
    "calibrate": Entry("calibrate:run", "measure rest, noise and gain of a skin"),
    "device": Entry("device:run", "act as a skin: send simulated or recorded touches"),
    "skin show": Entry("skin:run_show", "describe and draw a skin, or what it feels"),
    "skin check": Entry("skin:run_check", "check a skin's files"),
    "skin design": Entry("design:run", "lay a skin on a robot, and draw its patches"),
    "skin convert": Entry("exchange:run", "from and to URDF, iCub, GenTact"),
    "skin pose": Entry("pose:run", "measure where patches are mounted"),
    "skin points": Entry("pose:run_points", "choose where to press for that"),
    "skin paint": Entry("paint:run", "paint in the browser where skin is to lie"),
    "bench latency": Entry("bench_latency:run", "time one step of the recogniser"),
    "bench throughput": Entry("bench_throughput:run", "recognise at a rate"),
    "doctor": Entry("doctor:run", "check the installation, compile all code"),
}
"""Entries of the commands, by name."""

CHECKED_FIRST = ("compare", "demo", "evaluate", "export", "run", "study", "train")
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
    """Run the command in `sys.argv` and exit with its code.

    What takes long before anything is printed, such as compiling, is said on stderr.
    """
    compiling = logging.getLogger("eskin.compiled")
    compiling.addHandler(logging.StreamHandler())
    compiling.setLevel(logging.INFO)
    sys.exit(run(sys.argv[1:]))


def run(argv: list[str]) -> int:
    """Run one command line and return its exit code."""
    if not argv or argv[0] in ("-h", "--help"):
        print(format_overview())
        return 0
    if argv == ["--version"]:
        print(f"eskin {version('eskin')}")
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
    except OSError as error:
        return print_error(describe_os_error(error))
    except (EskinError, ValueError) as error:
        return print_error(str(error))
    except KeyboardInterrupt:
        print_error("stopped")
        return STOPPED
    return 0


def describe_os_error(error: OSError) -> str:
    """Describe an error of the system: what failed, with which file, and the remedy."""
    if isinstance(error, EskinError) or error.errno is None:
        return str(error)
    where = f" ({error.filename})" if error.filename else ""
    remedy = "see that the file can be used"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        remedy = "free some space, or write to another disk"
    return f"{(error.strerror or str(error)).lower()}{where}; {remedy}"


def load_command(name: str) -> tuple[Callable[[Any], dict[str, object]], type]:
    """Import a command's module; return its function and the dataclass it takes."""
    module, function_name = COMMANDS[name].function.split(":")
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
        raise ValueError(rewrite_parse_error(tyro_error.getvalue(), name)) from None


def print_error(message: str) -> int:
    """Print one line on stderr and return the exit code of bad input."""
    print("error: " + " ".join(message.split()), file=sys.stderr)
    return BAD_INPUT


def format_overview() -> str:
    """List the commands, one on each line."""
    rows = ["eskin: touch gestures from a robot's electronic skin", ""]
    width = max(map(len, COMMANDS))
    rows += [
        f"  eskin {name:{width}}  {entry.summary}" for name, entry in COMMANDS.items()
    ]
    return "\n".join([*rows, "", "eskin COMMAND --help explains one."])


if __name__ == "__main__":
    main()
