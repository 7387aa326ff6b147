"""Measure accuracy on textbook touches, with one factor swept at a time.

    python -m lab.textbook [--model MODEL] [--picture FILE] [--json FILE]

Pokes, double pats, strokes, grabs round a tube and three kinds of `none` (a resting
hand, one pat, a long press) follow plain formulas, on an ideal sensor with white noise.
Nothing of `eskin.sim` is used, and nothing here is used for training.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from lab.textbook.report import draw, summary, table, to_json
from lab.textbook.sweeps import SWEPT, Point, run


@dataclass(frozen=True)
class Command:
    """Recognise textbook touches."""

    model: str = "ur5"
    """Weights that come with eskin, or a model file."""
    form: Literal["short", "long"] = "long"
    """Extent; `short` is a smoke test with one touch at three values of each sweep."""
    draws: int | None = None
    """Number of touches at each value; 16 in the long form."""
    seed: int = 0
    """Random seed."""
    factors: tuple[str, ...] = ()
    """Factors to sweep; all unless given."""
    picture: Path | None = None
    """Path of a picture of the sweeps."""
    json: Path | None = None
    """Path of a JSON file with all answers."""

    def __post_init__(self) -> None:
        """Raise if a number is out of range."""
        if self.draws is not None and self.draws < 1:
            raise ValueError(
                f"--draws is {self.draws}; allowed are 1 and above; change it"
            )


def main(command: Command) -> None:
    """Sweep the factors, print each table, and write and draw the results."""
    long = command.form == "long"
    draws, values = command.draws or (16 if long else 1), 9 if long else 3
    begun = time.monotonic()
    points: list[Point] = []
    for factor in command.factors or SWEPT:
        found = list(run(command.model, draws, values, command.seed, (factor,)))
        points += found
        print(table(found, factor), end="\n\n", flush=True)
    print(summary(points))
    clips, seconds = sum(one.count for one in points), time.monotonic() - begun
    print(f"{clips} clips in {seconds:.0f} s, model {command.model}")
    if command.json is not None:
        command.json.write_text(to_json(points), encoding="utf-8")
    if command.picture is not None:
        draw(points, f"Textbook touches, model {command.model}", command.picture)


if __name__ == "__main__":
    main(tyro.cli(Command))
