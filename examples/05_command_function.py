"""Let touches command an arm, by actions and by a Python function of your own.

    python examples/05_command_function.py

A simulated person touches a simulated UR5 at its task: a poke pauses it, a stroke
calls the function below. After a grab the arm asks whether it is to go on, and a poke
would answer; this person never answers, those of `eskin demo --headless` do. Before
`ur://HOST` in place of `sim:ur5`, read docs/commands.md: nothing here is a safety
function.
"""

from dataclasses import dataclass

import tyro

import eskin
from eskin.app import open_arm
from eskin.cli.terminal import TerminalPrinter
from eskin.command import (
    Arm,
    CommandMap,
    Policy,
    Rule,
    command_function,
    moves_nothing,
)
from eskin.live import warm_up
from eskin.stream import Recognition, Stream

COMMANDS = CommandMap(
    commands=[
        Rule(gesture="poke", action="pause"),
        Rule(gesture="grab", action="go_on"),
        Rule(gesture="stroke", function="half_speed", confidence=0.9),
    ]
)
"""The same can be a file, see docs/commands.md."""


@command_function("half_speed")
@moves_nothing  # It only slows the arm, so the arm need not ask first.
def half_speed(arm: Arm, detection: eskin.Detection) -> None:
    """Let the arm go at no more than half of its speed."""
    arm.set_speed(min(arm.state().speed, 0.5))
    print(f"{arm.name} is at half speed since a stroke of {detection.peak_force:.0f} N")


@dataclass(frozen=True)
class Example:
    """Let touches command an arm."""

    seconds: float = 30.0
    """Time for which the person touches the arm [s]."""


def main(example: Example) -> None:
    """Print touches and what they command."""
    config = eskin.SourceConfig(seed=5)
    with (
        open_arm("sim:ur5") as arm,
        eskin.open_source("sim:ur5", config=config) as skin,
    ):
        calibration = skin.info.calibration
        recognizer = eskin.Recognizer.load("ur5", calibration=calibration)
        warm_up(recognizer)  # compiled code is loaded before the first touch
        policy = Policy(arm, COMMANDS, recognizer.model.card.vocabulary)
        listeners = [Recognition(recognizer), policy, TerminalPrinter()]
        with Stream(skin, listeners) as stream:
            stream.wait(example.seconds)


if __name__ == "__main__":
    main(tyro.cli(Example))
