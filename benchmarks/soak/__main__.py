"""Run for long, and break things on the way.

python -m benchmarks.soak PART, where PART is kill (recordings whose process is killed),
record (what recording costs) or stream (what an hour over serial ports leaves behind).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import tyro

from benchmarks.soak.kill import kill_line
from benchmarks.soak.record import record_line
from benchmarks.soak.stream import stream_line

Part = Literal["kill", "record", "stream"]


@dataclass(frozen=True)
class Command:
    """Print one line of figures."""

    part: tyro.conf.Positional[Part]
    """What is done."""
    times: int = 50
    """How often a process is killed."""
    seconds: float | None = None
    """How long is recorded, or streamed: 60 s; an hour on the simulated clock."""
    real: bool = False
    """Stream in real time, not on a simulated clock."""
    rate: float = 50.0
    """Scans a second that are recorded."""
    seed: int = 0
    """Of the moments at which processes are killed."""


PARTS: dict[Part, Callable[[Command], str]] = {
    "kill": lambda command: kill_line(command.times, command.seed),
    "record": lambda command: record_line(command.seconds or 60.0, command.rate),
    "stream": lambda command: stream_line(
        command.seconds or (60.0 if command.real else 3600.0), command.real
    ),
}


def main() -> None:
    """Do it and print."""
    command = tyro.cli(Command)
    print(PARTS[command.part](command))


if __name__ == "__main__":
    main()
