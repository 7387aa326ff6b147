"""Report untouched skins and touches as tables."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from eskin.learn.metrics import bootstrap_difference
from lab.flaws.rows import REFERENCES
from lab.flaws.scoring import STRONG_FORCE, TouchScore
from lab.flaws.stream import BuildResult
from lab.flaws.watch import RestCount
from lab.tables import format_head, format_row

Results = dict[str, list[BuildResult]]
"""Results of each row, by build."""


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


def pair_right(
    results: Sequence[BuildResult],
    reference: Sequence[BuildResult],
    is_right: Callable[[TouchScore], bool],
) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
    """Tell which answers are right in a reference and in results; return the builds."""
    others = {
        (result.number, place): score
        for result in reference
        for place, score in enumerate(result.touches)
    }
    pairs = [
        (is_right(others[result.number, place]), is_right(score), result.number)
        for result in results
        for place, score in enumerate(result.touches)
        if (result.number, place) in others
    ]
    before, after, builds = np.array(pairs, int).reshape(-1, 3).T
    return before > 0, after > 0, tuple(builds.tolist())


def is_forced_right(score: TouchScore) -> bool:
    """Tell whether the forced choice is right."""
    return score.forced == score.gesture


def is_live_right(score: TouchScore) -> bool:
    """Tell whether the live answer is right."""
    return score.live == score.gesture


def list_strong(results: Sequence[BuildResult]) -> list[TouchScore]:
    """Return the scores of touches that must be found."""
    return [one for one in list_scores(results) if one.peak >= STRONG_FORCE]


def describe_figures(
    results: Sequence[BuildResult], reference: Sequence[BuildResult]
) -> list[str]:
    """Return the cells of a row of the first table."""
    rest = add_up(result.rest for result in results)
    strong = list_strong(results)
    return [
        f"{rest.rate(rest.detections):.1f}",
        f"{rest.rate(rest.openings):.1f}",
        format_share(score.is_onset_found for score in strong),
        format_share(score.is_end_found for score in strong),
        format_lost(*pair_right(results, reference, is_forced_right)),
        format_lost(*pair_right(results, reference, is_live_right)),
    ]


def describe_details(results: Sequence[BuildResult]) -> list[str]:
    """Return the cells of a row of the second table."""
    rest = add_up(result.rest for result in results)
    start = add_up(result.start for result in results)
    scores, strong = list_scores(results), list_strong(results)
    pats = [s for s in strong if s.gesture == "double_pat" and s.presses > 1]
    return [
        format_share(map(is_forced_right, scores)),
        format_share(map(is_live_right, scores)),
        format_share(score.is_one_touch for score in pats),
        f"{np.mean([score.extra for score in scores]):.2f}" if scores else "",
        f"{100 * rest.open_seconds / rest.seconds:.1f} %" if rest.seconds else "",
        f"{start.openings / len(results):.2f}",
    ]


def describe_extent(results: Sequence[BuildResult]) -> list[str]:
    """Return how much the figures of a row are from."""
    rest = add_up(result.rest for result in results)
    scores = list_scores(results)
    return [f"{rest.seconds / 60:.0f}", f"{len(list_strong(results))}/{len(scores)}"]


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
    "points lost, live",
)
DETAILS_HEAD = (
    "flaw",
    "forced choice right",
    "live right",
    "double pats that are one touch",
    "other touches beside each",
    "time with an open touch, untouched",
    "openings in the first 5 s, a build",
    "untouched [min]",
    "touches from 1 N / all",
)


def find_reference(row: str, found: Results) -> list[BuildResult]:
    """Return the results that a row is compared to; none where it is that row."""
    return [] if REFERENCES[row] == row else found.get(REFERENCES[row], [])


def print_report(found: Results) -> None:
    """Print the two tables."""
    print(format_head(FIGURES_HEAD))
    for row, results in found.items():
        cells = describe_figures(results, find_reference(row, found))
        print(format_row([row, *cells]))
    print("\n" + format_head(DETAILS_HEAD))
    for row, results in found.items():
        cells = [*describe_details(results), *describe_extent(results)]
        print(format_row([row, *cells]))
