"""Neighbours and pooling of the contact graph: what is varied, and what came."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

from eskin.graph import GraphConfig
from eskin.learn.baselines import Pooling
from eskin.learn.comparison.method import Method
from eskin.learn.comparison.methods import (
    FITS,
    FOR_SMALL_SETS,
    RecogniserMethod,
    paper_method,
)
from eskin.learn.comparison.results import Result
from eskin.learn.comparison.table import (
    LEGEND,
    Ahead,
    Place,
    accuracies_of,
    ahead,
    margin,
    mean_of,
    spread,
    spread_of,
)

Network = Literal["eskin", "paper"]


@dataclass(frozen=True)
class Variant:
    """A network with a number of neighbours and a way of pooling."""

    network: Network
    """Whose."""

    k: int
    """Neighbours of a taxel inside its patch."""

    pool: Pooling
    """Over the nodes of a reading."""

    def method(self, epochs: int) -> Method:
        """What learns."""
        if self.network == "paper":
            fit = replace(FITS["paper"], epochs=epochs)
            return paper_method(fit, self.k, self.pool)
        config = replace(FOR_SMALL_SETS, graph=GraphConfig(fixed=self.k))
        return RecogniserMethod(config, self.pool)


@dataclass(frozen=True)
class VariantRow(Variant):
    """What a variant is worth."""

    runs: int
    """How often it was trained."""

    val_accuracy: float | None
    """Mean over these; None where nothing could be held out."""

    val_std: float
    """Standard deviation; 0 of a single run."""

    val_ahead: Ahead | None
    """How far the first variant of this network is ahead; None of itself, and where
    nothing could be held out."""

    test_accuracy: float | None
    """Mean over these; None where there is no test."""

    test_std: float
    """Standard deviation; 0 of a single run."""

    test_ahead: Ahead | None
    """As on validation."""


def study_rows(found: Mapping[Variant, Mapping[Place, Result]]) -> list[VariantRow]:
    """What variants came to, where the first one of their network was trained as well.

    Args:
        found: results by what learned and by what from.
    """
    firsts: dict[Network, Variant] = {}
    rows = []
    for variant, results in found.items():
        first = firsts.setdefault(variant.network, variant)
        shared = {place: r for place, r in results.items() if place in found[first]}
        if shared:
            held = None if variant == first else found[first]
            rows.append(study_row(variant, shared, held))
    return rows


def study_row(
    variant: Variant,
    results: Mapping[Place, Result],
    first: Mapping[Place, Result] | None,
) -> VariantRow:
    """What a variant came to, held against the first one of its network if other."""
    val, test = (
        accuracies_of(list(results.values()), each) for each in ("val", "test")
    )
    return VariantRow(
        **asdict(variant),
        runs=len(results),
        val_accuracy=mean_of(val),
        val_std=spread_of(val),
        val_ahead=ahead(results, first, "val") if first and val else None,
        test_accuracy=mean_of(test),
        test_std=spread_of(test),
        test_ahead=ahead(results, first, "test") if first and test else None,
    )


def study_table(rows: Sequence[VariantRow]) -> str:
    """The rows as a table."""
    lead = f"K {rows[0].k}, {rows[0].pool} ahead"
    heads = (
        "network",
        "K",
        "pooling",
        "runs",
        "validation (SD)",
        lead,
        "test (SD)",
        lead,
    )
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for row in rows:
        cells = (
            row.network,
            str(row.k),
            row.pool,
            str(row.runs),
            spread(row.val_accuracy, row.val_std),
            margin(row.val_ahead),
            spread(row.test_accuracy, row.test_std),
            margin(row.test_ahead),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, "", LEGEND])
