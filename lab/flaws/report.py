"""Report untouched skins and touches as a table."""

from collections.abc import Iterable, Sequence

import numpy as np

from eskin.learn.metrics import bootstrap_difference
from lab.flaws.scoring import STRONG_FORCE, RestCount
from lab.flaws.stream import REFERENCES, BuildResult
from lab.tables import format_head, format_row

Results = dict[str, list[BuildResult]]
"""Results of each row, by build."""


def format_share(hits: Iterable[bool]) -> str:
    """Format a share of true values; empty without values."""
    values = list(hits)
    return f"{100 * np.mean(values):.1f} %" if values else ""


def pair_right(
    results: Sequence[BuildResult],
    reference: Sequence[BuildResult],
) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
    """Tell which answers are right in a reference and in results; return the builds."""
    others = {
        (result.number, place): score
        for result in reference
        for place, score in enumerate(result.touches)
    }
    pairs = [
        (
            *(
                one.forced == score.gesture
                for one in (others[result.number, place], score)
            ),
            result.number,
        )
        for result in results
        for place, score in enumerate(result.touches)
        if (result.number, place) in others
    ]
    before, after, builds = np.array(pairs, int).reshape(-1, 3).T
    return before > 0, after > 0, tuple(builds.tolist())


def describe_figures(
    results: Sequence[BuildResult], reference: Sequence[BuildResult]
) -> list[str]:
    """Return the cells of a row of the table."""
    rest = RestCount()
    for result in results:
        rest.add_counts(result.rest)
    scores = [score for result in results for score in result.touches]
    strong = [score for score in scores if score.peak >= STRONG_FORCE]
    return [
        f"{rest.rate(rest.detections):.1f}",
        f"{rest.rate(rest.openings):.1f}",
        format_share(score.is_onset_found for score in strong),
        format_share(score.is_end_found for score in strong),
        format_lost(*pair_right(results, reference)),
        f"{rest.seconds / 60:.0f}",
        f"{len(strong)}/{len(scores)}",
    ]


def format_lost(before: np.ndarray, after: np.ndarray, builds: tuple[int, ...]) -> str:
    """Format the points that right answers lost, with their interval over builds."""
    if not len(before):
        return ""
    low, high = bootstrap_difference(before, after, cluster=builds)
    lost = before.mean() - after.mean()
    return f"{100 * lost:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"


FIGURES_HEAD = (
    "flaw",
    "detections an hour",
    "openings an hour",
    "onset within 0.1 s",
    "end within 0.3 s",
    "points lost, forced choice",
    "untouched [min]",
    "touches from 1 N / all",
)


def find_reference(row: str, found: Results) -> list[BuildResult]:
    """Return the results that a row is compared to; none where it is that row."""
    return [] if REFERENCES[row] == row else found.get(REFERENCES[row], [])


def print_report(found: Results) -> None:
    """Print the table."""
    print(format_head(FIGURES_HEAD))
    for row, results in found.items():
        cells = describe_figures(results, find_reference(row, found))
        print(format_row([row, *cells]))
