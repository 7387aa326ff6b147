"""Run a walk of a new user, as a person would make it, and fail where it fails.

python -m lab.first_hour: every block of commands of docs/first_hour.md as it stands.
python -m lab.first_hour engineer: another robot and another matrix, on a serial line.
python -m lab.first_hour engineer --short: the same with fewer touches.
"""

import sys
from dataclasses import dataclass
from typing import Literal

import tyro

from lab.first_hour import engineer, page


@dataclass(frozen=True)
class FirstHour:
    """Walk as a new user does, time it, and count what fails."""

    who: tyro.conf.Positional[Literal["page", "engineer"]] = "page"
    """Who walks: a reader of the page, or an engineer with her own robot and matrix."""

    port: int = int(page.PORT)
    """UDP port for the packets of the matrix of the page."""

    short: bool = False
    """Let the engineer make few touches."""

    show: bool = False
    """Print what the commands print, too."""


def main(options: FirstHour) -> int:
    """Make the walk; return its exit code."""
    if options.who == "engineer":
        return engineer.walk(options.short, options.show)
    return page.walk(options.port, options.show)


if __name__ == "__main__":
    sys.exit(main(tyro.cli(FirstHour)))
