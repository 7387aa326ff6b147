"""Neighbours and pooling of the contact graph: what is varied, and what came."""

from collections.abc import Sequence
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
from eskin.learn.comparison.table import accuracies_of, mean_of, spread, spread_of

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

    test_accuracy: float | None
    """Mean over these; None where there is no test."""

    test_std: float
    """Standard deviation; 0 of a single run."""


def study_row(variant: Variant, results: Sequence[Result]) -> VariantRow:
    """What a variant came to."""
    val, test = accuracies_of(results, "val"), accuracies_of(results, "test")
    return VariantRow(
        **asdict(variant),
        runs=len(results),
        val_accuracy=mean_of(val),
        val_std=spread_of(val),
        test_accuracy=mean_of(test),
        test_std=spread_of(test),
    )


def study_table(rows: Sequence[VariantRow]) -> str:
    """The rows as a table."""
    lines = ["| network | K | pooling | runs | validation | test |", "|---" * 6 + "|"]
    for row in rows:
        shares = (
            spread(row.val_accuracy, row.val_std),
            spread(row.test_accuracy, row.test_std),
        )
        cells = row.network, str(row.k), row.pool, str(row.runs), *shares
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
