"""The `eskin` command: finds the module of the command called and runs it.

Contract of every command: `--json` makes the last line of stdout one JSON object; bad
input gives one line on stderr and exit code 2, a stream that had to stop one line and
exit code 1; nothing is left half-written.
"""

import contextlib
import importlib
import io
import json
import re
import sys
from dataclasses import dataclass
from types import ModuleType
from typing import Annotated

import tyro

from eskin.errors import EskinError, StreamError

COMMANDS = {
    "convert": "convert",
    "label": "label",
    "train": "train",
    "evaluate": "evaluate",
    "compare": "compare",
    "study": "study",
    "run": "run",
    "replay": "replay",
    "view": "view",
    "generate": "generate",
    "demo": "demo",
    "device": "device",
    "skin show": "skin_show",
    "skin check": "skin_check",
    "bench latency": "bench_latency",
    "bench throughput": "bench_throughput",
    "doctor": "doctor",
}
FAILED = 1
BAD_INPUT = 2
STOPPED = 130


@dataclass(frozen=True)
class Output:
    """How the result is printed."""

    json: bool = False
    """Print the result as one JSON object on the last line of stdout."""


def main() -> None:
    """Run the command in `sys.argv` and exit with its code."""
    sys.exit(run(sys.argv[1:]))


def run(argv: list[str]) -> int:
    """Run one command line and return its exit code."""
    if not argv or argv[0] in ("-h", "--help"):
        print(overview())
        return 0
    try:
        name, rest = split_command(argv)
        module = importlib.import_module(f"eskin.cli.{COMMANDS[name]}")
        command, output = parse(module, name, rest)
        result = module.run(command)
    except ModuleNotFoundError as error:
        return complain(
            f"{error.name} is missing; install it: pip install 'eskin[train]'"
        )
    except StreamError as error:
        complain(str(error))
        return FAILED
    except (EskinError, ValueError, OSError) as error:
        return complain(str(error))
    except KeyboardInterrupt:
        complain("stopped")
        return STOPPED
    if output.json:
        print(json.dumps(result))
    return 0


def split_command(argv: list[str]) -> tuple[str, list[str]]:
    """Split the command's one- or two-word name from its arguments."""
    for words in (2, 1):
        name = " ".join(argv[:words])
        if name in COMMANDS:
            return name, argv[words:]
    begun = [name for name in COMMANDS if name.split()[0] == argv[0]]
    known = ", ".join(begun or COMMANDS)
    raise ValueError(f"no command '{argv[0]}'; commands: {known}; see eskin --help")


def parse(module: ModuleType, name: str, argv: list[str]) -> tuple[object, Output]:
    """Parse the arguments of one command; tyro's own complaint becomes one line."""
    both = tuple[
        Annotated[module.Command, tyro.conf.arg(name="")],
        Annotated[Output, tyro.conf.arg(name="")],
    ]
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                both,
                prog=f"eskin {name}",
                description=module.Command.__doc__,
                args=argv,
                config=(tyro.conf.FlagCreatePairsOff,),
            )
    except SystemExit as stop:
        if stop.code == 0:
            raise
        raise ValueError(one_line(complaint.getvalue(), name)) from None


def one_line(complaint: str, name: str) -> str:
    """Reduce a complaint to its words, leaving out the box drawn around them."""
    words = complaint.translate({ord(c): " " for c in "╭╮╰╯│─├┤"}).split()
    text = " ".join(word for word in words if not re.fullmatch("[-+|]{3,}", word))
    # tyro calls the command and its output `0` and `1`.
    text = re.sub(r"(?<![\w.])[01]\.(?=[a-z])", "", text)
    for title in ("Parsing error ", "Unrecognized options "):
        text = text.removeprefix(title)
    return f"eskin {name}: {text}"


def complain(message: str) -> int:
    """Print one line on stderr and return the exit code of bad input."""
    print("error: " + " ".join(message.split()), file=sys.stderr)
    return BAD_INPUT


def overview() -> str:
    """List the commands, one a line, with the first line of their help."""
    rows = ["eskin: touch gestures from a robot's electronic skin", ""]
    rows += [f"  eskin {name}" for name in COMMANDS]
    return "\n".join([*rows, "", "eskin COMMAND --help explains one."])


if __name__ == "__main__":
    main()
