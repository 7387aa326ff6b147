"""Play the same counts on the skin in two poses of the arm, to two recognisers.

    python -m lab.same_touch --headless

In the two poses the counts mean different gestures. The answers of a recogniser that
uses the pose stand beside those of one that does not.
"""

import json
from dataclasses import dataclass

import tyro

from eskin.errors import DeviceError
from eskin.sim.commands.demo import print_line
from eskin.sim.demo import DemoConfig
from eskin.units import format_count
from lab.same_touch.board import serve_same_touch
from lab.same_touch.touches import compare_models


@dataclass(frozen=True)
class Command:
    """Compare two recognisers on the same touches, in the browser or headless."""

    headless: bool = False
    """Print the answers in place of a page."""

    seconds: float | None = None
    """Duration in the browser [s]; without end by default."""

    seed: int = 0
    """Seed of the touches."""

    port: int = 8080
    """TCP port of the page on this computer; 0 takes any free one."""

    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""

    pairs: int = 6
    """Number of touches that are played in turn."""

    json: bool = False
    """Print the result as one JSON object on the last line of stdout."""


def main(command: Command) -> None:
    """Play the touches, and print what both recognisers say."""
    if command.pairs < 1:
        raise DeviceError(
            f"--pairs is {command.pairs}; allowed is 1 and above; change it"
        )
    config = DemoConfig(model=command.model, seed=command.seed)
    result = run_same_touch(command, config)
    if command.json:
        print(json.dumps(result))


def run_same_touch(command: Command, config: DemoConfig) -> dict[str, object]:
    """Play the same counts in two poses to two recognisers."""
    if not command.headless:
        return dict(
            serve_same_touch(
                config, command.pairs, command.port, command.seconds, print_line
            )
        )
    found = compare_models(command.pairs, config)
    for number, each in enumerate(found):
        print(f"touch {number + 1}: {each.labels[0]}, then {each.labels[1]}")
        for pose, (one, other) in (("with", each.posed), ("without", each.blind)):
            answers = "; then ".join(", ".join(answer.texts) for answer in (one, other))
            print(f"  {pose} the pose: {answers}")
    counts = {
        "playings": 2 * len(found),
        "posed_right": sum(each.count_correct(each.posed) for each in found),
        "blind_right": sum(each.count_correct(each.blind) for each in found),
        "blind_same": sum(each.blind_is_equal for each in found),
    }
    print(
        f"with the pose {counts['posed_right']} of {counts['playings']} are correct, "
        f"without it {counts['blind_right']}, and both answers are the same for "
        f"{counts['blind_same']} of {format_count(len(found), 'touch')}"
    )
    rows = [
        {
            "labels": each.labels,
            "posed": [answer.detected for answer in each.posed],
            "blind": [answer.detected for answer in each.blind],
        }
        for each in found
    ]
    return {**counts, "pairs": rows}


if __name__ == "__main__":
    main(tyro.cli(Command))
