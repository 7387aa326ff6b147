"""Fuzz the readers with mutated inputs.

    python -m lab.fuzz READER [--inputs N] [--seed N]

READER is decoder, skin, recording, commands, model or urdf.

Every input must be read, or refused with the documented error of the reader in one
line. Anything else is a finding: it is printed with the command that reproduces it, and
the exit code is 1.
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab.fuzz.decoder import DecoderTarget
from lab.fuzz.models import ModelTarget
from lab.fuzz.recordings import RecordingTarget
from lab.fuzz.robots import CommandsTarget, RobotTarget
from lab.fuzz.run import Outcome, Target, fuzz
from lab.fuzz.skin_files import SkinTarget

Name = Literal["decoder", "skin", "recording", "commands", "model", "urdf"]
TARGETS: dict[Name, type[Target]] = {
    "decoder": DecoderTarget,
    "skin": SkinTarget,
    "recording": RecordingTarget,
    "commands": CommandsTarget,
    "model": ModelTarget,
    "urdf": RobotTarget,
}


@dataclass(frozen=True)
class Command:
    """Fuzz a reader with mutated inputs."""

    target: tyro.conf.Positional[Name]
    """Reader to fuzz."""
    inputs: int = 20_000
    """Number of inputs."""
    seed: int = 0
    """Seed of the mutations."""
    first: int = 0
    """Number of the first input."""


def main() -> None:
    """Fuzz the reader and print the outcome."""
    command = tyro.cli(Command)
    with tempfile.TemporaryDirectory() as folder:
        target = TARGETS[command.target](Path(folder))
        outcome = fuzz(target, command.first, command.inputs, command.seed)
    print(format_outcome(command, outcome))
    sys.exit(bool(outcome.findings))


def format_outcome(command: Command, outcome: Outcome) -> str:
    """Format the outcome."""
    lines = [
        f"{command.target}: {outcome.inputs} inputs of seed {command.seed} in "
        f"{outcome.seconds:.0f} s, {outcome.accepted} accepted, at most "
        f"{outcome.grown / 1e6:.0f} MB more memory, {len(outcome.findings)} findings"
    ]
    for place, first in outcome.findings.items():
        number = first.split(":")[0].removeprefix("input ")
        lines.append(f"{place}\n  {first:.300}")
        lines.append(
            f"  python -m lab.fuzz {command.target} --seed {command.seed} "
            f"--first {number} --inputs 1"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
