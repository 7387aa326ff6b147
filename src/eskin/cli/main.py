"""The `eskin` command imports the module of the command called and runs it.

Every command keeps this contract: `--json` makes the last line of stdout one JSON
object; bad input gives one line on stderr and exit code 2, a stream that had to stop
one line and exit code 1; nothing is left half-written.
"""

import contextlib
import errno
import inspect
import io
import json
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from types import FrameType
from typing import Annotated, Any, final

import tyro

from eskin.cli.checks import check_files, check_options
from eskin.cli.options import insert_description, list_options, registry
from eskin.cli.parse_errors import rewrite_parse_error
from eskin.errors import EskinError, PlatformError, StreamError, check_platform
from eskin.registry import COMMANDS, advise_install, load_function

CHECKED_FIRST = ("demo", "evaluate", "export", "run", "train")
"""Commands that take a second or more before they read their files."""

FAILED = 1
BAD_INPUT = 2
STOPPED = 130
HASTE = 1.0
"""Time from the first Ctrl-C on for which others are no wish of their own [s]."""


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
    # What stops a stream is raised, and printed once.
    logging.getLogger("eskin.stream.stream").disabled = True
    signal.signal(signal.SIGINT, Interrupt())
    sys.exit(run(sys.argv[1:]))


@final
class Interrupt:
    """Handles Ctrl-C: the first stops a command, one while it stops kills it.

    Those that follow at once, as from a hasty hand, count as the first.
    """

    def __init__(self) -> None:
        """Wait for the first."""
        self.first: float | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        if self.first is None:
            self.first = time.monotonic()
            raise KeyboardInterrupt
        if time.monotonic() - self.first > HASTE:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)


def run(argv: list[str]) -> int:
    """Run one command line and return its exit code."""
    if None in (sys.stdout, sys.stderr):
        return print_error(
            "stdout or stderr is closed; allowed are a terminal, a file, a pipe or "
            "/dev/null; redirect it"
        )
    try:
        check_platform()
    except PlatformError as error:
        return print_error(str(error))
    *group, last = argv or ["--help"]
    begun = [name for name in COMMANDS if name.split()[:-1] == group]
    extra = None
    try:
        if last in ("-h", "--help") and begun:
            print(format_overview(begun if group else list(COMMANDS)))
        elif argv == ["--version"]:
            from importlib.metadata import version

            print(f"eskin {version('eskin')}")
        else:
            name, rest = split_command(argv)
            extra = COMMANDS[name].extra
            run_command(name, rest)
        sys.stdout.flush()
    except ModuleNotFoundError as error:
        remedy = advise_install(extra or "")
        return print_error(f"{error.name} is missing; install it: {remedy}")
    except (BrokenPipeError, StreamError) as error:
        if not isinstance(error.__cause__ or error, BrokenPipeError):
            print_error(str(error))
            return FAILED
        drop_output()
        return STOPPED
    except OSError as error:
        return print_error(describe_os_error(error))
    except (EskinError, ValueError) as error:
        return print_error(str(error))
    except MemoryError as error:
        return print_error(
            f"too little memory ({error or 'none is left'}); end other programs, or "
            "use a smaller file"
        )
    except (KeyboardInterrupt, SystemError) as error:
        # Compiled code that is interrupted raises a SystemError from it.
        if not isinstance(error.__cause__ or error, KeyboardInterrupt):
            raise
        print_error("stopped")
        return STOPPED
    return 0


def run_command(name: str, rest: list[str]) -> None:
    """Run one command with its arguments, and print its result if that is asked for."""
    if name in CHECKED_FIRST:
        check_files(rest)
    function, command_type = load_command(name)
    command, output = parse(command_type, f"eskin {name}", rest)
    result = function(command)
    if output.json:
        print(json.dumps(result))


def drop_output() -> None:
    """Drop output still to be printed: its reader, such as `head`, has closed it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


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
    function = load_function(COMMANDS[name].target)
    return function, inspect.signature(function).parameters["command"].annotation


def split_command(argv: list[str]) -> tuple[str, list[str]]:
    """Split the command's one- or two-word name from its arguments."""
    for words in (2, 1):
        name = " ".join(argv[:words])
        if name in COMMANDS:
            return name, argv[words:]
    begun = [name for name in COMMANDS if name.split()[0] == argv[0]]
    given = " ".join(argv[: 2 if begun else 1])
    known = ", ".join(begun or COMMANDS)
    like = get_close_matches(given, COMMANDS, 1)
    meant = f"; did you mean {like[0]}?" if like else ""
    raise ValueError(
        f"no command '{given}'; commands: {known}{meant}; see eskin --help"
    )


def parse(command_type: type, name: str, argv: list[str]) -> tuple[object, Output]:
    """Parse and check the arguments of a command; reduce tyro's error to one line.

    Args:
        command_type: dataclass of the options.
        name: name of the program with its command, such as `eskin run`.
        argv: arguments.

    Raises:
        ValueError: they are none of the command.
    """
    both = tuple[
        Annotated[command_type, tyro.conf.arg(name="")],
        Annotated[Output, tyro.conf.arg(name="")],
    ]
    tyro_error = io.StringIO()
    try:
        with contextlib.redirect_stderr(tyro_error), insert_description(command_type):
            command, output = tyro.cli(
                both,
                prog=name,
                description="",
                args=argv,
                config=(tyro.conf.FlagCreatePairsOff,),
                registry=registry,
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        options = list_options(command_type)
        text = rewrite_parse_error(tyro_error.getvalue(), name, options)
        raise ValueError(text) from None
    check_options(command)
    return command, output


def print_error(message: str) -> int:
    """Print one line on stderr and return the exit code of bad input."""
    print("error: " + " ".join(message.split()), file=sys.stderr)
    return BAD_INPUT


def format_overview(names: Sequence[str]) -> str:
    """List some commands, one on each line."""
    rows = ["eskin: touch gestures from a robot's electronic skin", ""]
    width = max(map(len, names))
    rows += [f"  eskin {name:{width}}  {COMMANDS[name].summary}" for name in names]
    return "\n".join([*rows, "", "eskin COMMAND --help explains one."])


if __name__ == "__main__":
    main()
