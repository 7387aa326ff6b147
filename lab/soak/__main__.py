"""Run for long, and kill processes at random moments.

python -m lab.soak PART, where PART is kill (recordings of killed processes) or
stream (memory and losses of an hour over serial ports).
"""

from dataclasses import dataclass
from typing import Literal

import tyro

from lab.soak.kill import kill_line
from lab.soak.stream import stream_line


@dataclass(frozen=True)
class Command:
    """Run a test and print one line of results."""

    part: tyro.conf.Positional[Literal["kill", "stream"]]
    """Test to run."""
    times: int = 50
    """Number of processes that are killed."""
    seconds: float | None = None
    """Duration of the stream: 60 s, or an hour on the simulated clock."""
    real: bool = False
    """Stream in real time, not on a simulated clock."""
    seed: int = 0
    """Seed of the moments at which processes are killed."""


def main() -> None:
    """Run the test and print its line."""
    command = tyro.cli(Command)
    if command.part == "kill":
        print(kill_line(command.times, command.seed))
    else:
        seconds = command.seconds or (60.0 if command.real else 3600.0)
        print(stream_line(seconds, command.real))


if __name__ == "__main__":
    main()
