"""Measure untouched skins and touches with every flaw of the sensor.

    python -m benchmarks.flaws touches --keep FILE              # the long form
    python -m benchmarks.flaws touches --builds 2 --minutes 1   # a quick look
    python -m benchmarks.flaws touches --rows none "all typical" "noise high" fresh

Each row of the tables is a flaw of the sensor: alone at a level, all of them typical,
`none`, or builds that are drawn from the laws of a kind. Families of sensors take turns
in a row. Every build is drawn anew, with a person and a pose of its own; builds of the
same number have the same person, pose and touches in every row, so rows are compared in
pairs. The recogniser is handed the nominal calibration. An arm at rest is untouched for
some minutes, then the person touches it: pokes, double pats, grabs and strokes, with
pauses between them.

The first table counts what is said of the untouched skin after the first 5 s, and how
many touches open in these. The second scores touches of at least 1 N: onset and end of
the touch that covers the true contact (true force on taxels above 0.2 N), and how many
double pats are one touch with as many contacts. The third has the answers: forced
choice 0.3 s after the true end, and the first gesture detected live, with the points
lost to builds without flaw (`shifted` to `fresh`).

With `--keep` results are appended to a file, and what is there already is not run
again; with `--before` the figures of another such file stand in brackets.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import tyro

from benchmarks.flaws.kept import append_result, read_results
from benchmarks.flaws.rows import REFERENCES, ROWS
from benchmarks.flaws.scoring import STRONG_FORCE, TouchScore
from benchmarks.flaws.stream import BuildPlan, BuildResult, run_build
from benchmarks.flaws.watch import RestCount
from benchmarks.tables import format_head, format_row
from eskin.learn.metrics import bootstrap_difference


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
    before: Path | None = None
    """Such a file of another commit, whose figures stand in brackets."""
    workers: int = 2
    """Number of processes."""

    def __post_init__(self) -> None:
        """Raise if a row is not known."""
        unknown = [row for row in self.rows if row not in ROWS]
        if unknown:
            raise ValueError(
                f"--rows has '{unknown[0]}'; allowed are {', '.join(ROWS)}; take those"
            )

    @property
    def plans(self) -> list[BuildPlan]:
        """Plans of all builds, build by build, so that rows fill evenly."""
        return [
            BuildPlan(row, number, self.minutes, self.touches, self.model)
            for number in range(self.first, self.first + self.builds)
            for row in self.rows or ROWS
        ]


Results = dict[str, list[BuildResult]]
"""Results of each row, by build."""


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


def add_up(counts: Iterable[RestCount]) -> RestCount:
    """Return the sum of counts."""
    total = RestCount()
    for count in counts:
        total.add(count)
    return total


def list_scores(results: Sequence[BuildResult]) -> list[TouchScore]:
    """Return the scores of all touches."""
    return [score for result in results for score in result.touches]


def format_share(hits: Iterable[bool]) -> str:
    """Format a share of true values; empty without values."""
    values = list(hits)
    return f"{100 * np.mean(values):.1f} %" if values else ""


def describe_rest(results: Sequence[BuildResult]) -> list[str]:
    """Return the cells of a row about untouched skins."""
    rest = add_up(result.rest for result in results)
    start = add_up(result.start for result in results)
    return [
        f"{rest.rate(rest.detections):.1f}",
        f"{rest.rate(rest.openings):.1f}",
        f"{100 * rest.open_seconds / rest.seconds:.1f} %" if rest.seconds else "",
        f"{start.openings / len(results):.2f}",
        f"{rest.seconds / 60:.0f}",
    ]


def describe_touches(results: Sequence[BuildResult]) -> list[str]:
    """Return the cells of a row about when touches were found."""
    scores = list_scores(results)
    strong = [score for score in scores if score.peak >= STRONG_FORCE]
    pats = [s for s in strong if s.gesture == "double_pat" and s.presses > 1]
    return [
        format_share(score.is_onset_found for score in strong),
        format_share(score.is_end_found for score in strong),
        format_share(score.is_one_touch for score in pats),
        f"{np.mean([score.extra for score in scores]):.2f}" if scores else "",
        str(len(strong)),
    ]


def describe_answers(
    results: Sequence[BuildResult], reference: Sequence[BuildResult] | None
) -> list[str]:
    """Return the cells of a row about answers, and the points lost to another row."""
    scores = list_scores(results)
    forced = np.array([score.forced == score.gesture for score in scores])
    live = np.array([score.live == score.gesture for score in scores])
    cells = [format_share(forced), format_share(live), "", "", str(len(scores))]
    others = {
        (result.number, place): score
        for result in reference or ()
        for place, score in enumerate(result.touches)
    }
    pairs = [
        (others[result.number, place], score)
        for result in results
        for place, score in enumerate(result.touches)
        if (result.number, place) in others
    ]
    if pairs:
        cells[2] = format_lost(
            [other.forced == other.gesture for other, _ in pairs],
            [score.forced == score.gesture for _, score in pairs],
        )
        cells[3] = format_lost(
            [other.live == other.gesture for other, _ in pairs],
            [score.live == score.gesture for _, score in pairs],
        )
    return cells


def format_lost(before: Sequence[bool], after: Sequence[bool]) -> str:
    """Format the points that a share of right answers lost, with their interval."""
    ours, theirs = np.array(before), np.array(after)
    low, high = bootstrap_difference(ours, theirs)
    lost = ours.mean() - theirs.mean()
    return f"{100 * lost:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"


REST_HEAD = (
    "untouched",
    "detections an hour",
    "openings an hour",
    "time with an open touch",
    "openings in the first 5 s, a build",
    "minutes",
)
TOUCH_HEAD = (
    "touches from 1 N",
    "onset within 0.1 s",
    "end within 0.3 s",
    "double pats that are one touch",
    "other touches beside, each",
    "touches",
)
ANSWER_HEAD = (
    "answers",
    "forced choice right",
    "live right",
    "points lost, forced",
    "points lost, live",
    "touches",
)


def print_table(
    head: Sequence[str],
    found: Results,
    before: Results,
    describe: Callable[[str, Results], list[str]],
) -> None:
    """Print a table of all rows, with the figures of before in brackets."""
    print("\n" + format_head(head))
    for row in found:
        cells = describe(row, found)
        if row in before:
            olds = describe(row, before)
            cells = [
                f"{new} ({old})" if old and number < len(cells) - 1 else new
                for number, (new, old) in enumerate(zip(cells, olds, strict=True))
            ]
        print(format_row([row, *cells]))


def find_reference(row: str) -> str:
    """Return the row to which points are lost; empty where it is the row itself."""
    return "" if REFERENCES[row] == row else REFERENCES[row]


def group_by_row(path: Path | None) -> Results:
    """Return the results of a file by row."""
    found: Results = {}
    for plan, result in read_results(path):
        found.setdefault(plan.row, []).append(result)
    return found


def main(args: list[str] | None = None) -> None:
    """Run the builds and print the tables."""
    command = tyro.cli(Command, args=args)
    found, before = run_builds(command), group_by_row(command.before)
    print_table(
        REST_HEAD, found, before, lambda row, results: describe_rest(results[row])
    )
    print_table(
        TOUCH_HEAD, found, before, lambda row, results: describe_touches(results[row])
    )
    print_table(
        ANSWER_HEAD,
        found,
        before,
        lambda row, results: describe_answers(
            results[row], results.get(find_reference(row))
        ),
    )
