"""Measure untouched skins and touches with every flaw of the sensor.

    python -m lab.flaws touches --keep FILE              # the long form
    python -m lab.flaws touches --builds 2 --minutes 1   # a quick look
    python -m lab.flaws touches --rows none "all typical" "noise high" fresh

Each row of the tables is a flaw of the sensor: alone at a level, all of them typical,
`none`, or builds that are drawn from the laws of a kind. Families of sensors take turns
in a row. Every build is drawn anew, with a person and a pose of its own; builds of the
same number have the same person, pose and touches in every row, so rows are compared in
pairs. The recogniser is handed the nominal calibration. An arm at rest is untouched for
some minutes, then the person touches it: pokes, double pats, grabs and strokes, with
pauses between them.

The table has what is said of the untouched skin after the first 5 s, the onset
and the end of touches of at least 1 N (of the touch that covers the true contact, where
the true force on taxels is above 0.2 N), and the points of accuracy that are lost to
builds without flaw (`shifted` to `fresh`), by forced choice 0.3 s after the true end.

With `--keep` results are appended to a file, and what is there already is not run
again.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from lab.flaws.report import Results, print_report
from lab.flaws.scoring import RestCount, TouchScore
from lab.flaws.stream import ROWS, BuildPlan, BuildResult, run_build


@dataclass(frozen=True)
class Command:
    """Measure untouched skins and touches with every flaw of the sensor."""

    builds: int = 20
    """Builds of each row."""
    minutes: float = 3.0
    """Time without touch of each build [min]."""
    touches: int = 16
    """Touches of each build, equally many of each gesture."""
    rows: tuple[str, ...] = ()
    """Rows to run; all unless given. Points are lost to `none`, or to `fresh`."""
    first: int = 0
    """Number of the first build; the others follow."""
    model: str = "ur5"
    """Weights that come with eskin, or a model file."""
    keep: Path | None = None
    """File to which results are appended, and of which they are read."""
    workers: int = 2
    """Number of processes."""

    def __post_init__(self) -> None:
        """Raise if a row is not known."""
        unknown = [row for row in self.rows if row not in ROWS]
        if unknown:
            raise ValueError(
                f"--rows has '{unknown[0]}'; allowed are {', '.join(ROWS)}"
            )

    @property
    def plans(self) -> list[BuildPlan]:
        """Plans of all builds, build by build, so that rows fill evenly."""
        return [
            BuildPlan(row, number, self.minutes, self.touches, self.model)
            for number in range(self.first, self.first + self.builds)
            for row in self.rows or ROWS
        ]


def append_result(path: Path, plan: BuildPlan, result: BuildResult) -> None:
    """Append the result of a plan."""
    line = json.dumps({"plan": asdict(plan), "result": asdict(result)})
    with path.open("a", encoding="utf-8") as file:
        file.write(line + "\n")


def read_results(path: Path | None) -> Iterator[tuple[BuildPlan, BuildResult]]:
    """Yield the plans of a file and their results; nothing if there is no file."""
    if path is None or not path.exists():
        return
    for line in path.read_text(encoding="utf-8").splitlines():
        content = json.loads(line)
        yield BuildPlan(**content["plan"]), parse_result(content["result"])


def parse_result(content: Mapping[str, Any]) -> BuildResult:
    """Return the result of a line."""
    return BuildResult(
        content["row"],
        content["number"],
        RestCount(**content["rest"]),
        [TouchScore(**touch) for touch in content["touches"]],
    )


def run_builds(command: Command) -> Results:
    """Run the builds that are not kept yet; return all."""
    plans = command.plans
    done = {plan: result for plan, result in read_results(command.keep)}
    missing = [plan for plan in plans if plan not in done]
    with get_context("spawn").Pool(min(command.workers, len(missing) or 1)) as pool:
        for plan, result in zip(missing, pool.imap(run_build, missing), strict=True):
            done[plan] = result
            if command.keep is not None:
                append_result(command.keep, plan, result)
    found: Results = {}
    for plan in plans:
        found.setdefault(plan.row, []).append(done[plan])
    return found


def main(command: Command) -> None:
    """Run the builds and print the tables."""
    print_report(run_builds(command))
