"""Run for long, and kill processes at random moments.

python -m lab.soak PART, where PART is kill (recordings of killed processes),
record (the cost of recording) or stream (memory and losses of an hour over serial
ports).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import tyro

from lab.soak.kill import kill_line
from lab.soak.record import record_line
from lab.soak.stream import stream_line

Part = Literal["kill", "record", "stream"]


@dataclass(frozen=True)
class Command:
    """Run a test and print one line of results."""

    part: tyro.conf.Positional[Part]
    """Test to run."""
    times: int = 50
    """Number of processes that are killed."""
    seconds: float | None = None
    """Duration of recording or stream: 60 s, or an hour on the simulated clock."""
    real: bool = False
    """Stream in real time, not on a simulated clock."""
    rate: float = 50.0
    """Rate of recorded scans [1/s]."""
    seed: int = 0
    """Seed of the moments at which processes are killed."""


PARTS: dict[Part, Callable[[Command], str]] = {
    "kill": lambda command: kill_line(command.times, command.seed),
    "record": lambda command: record_line(command.seconds or 60.0, command.rate),
    "stream": lambda command: stream_line(
        command.seconds or (60.0 if command.real else 3600.0), command.real
    ),
}


def main() -> None:
    """Run the test and print its line."""
    command = tyro.cli(Command)
    print(PARTS[command.part](command))


if __name__ == "__main__":
    main()
