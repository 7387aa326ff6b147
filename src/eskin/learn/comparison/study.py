"""Neighbours and pooling of the contact graph: what is varied, and what came."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

import numpy as np

from eskin.graph import GraphConfig
from eskin.learn.baselines import FitConfig, Pooling
from eskin.learn.comparison.methods import (
    FOR_SMALL_SETS,
    Method,
    PaperMethod,
    RecogniserMethod,
)
from eskin.learn.comparison.results import Result

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
            return PaperMethod(self.k, self.pool, FitConfig(epochs))
        config = replace(FOR_SMALL_SETS, graph=GraphConfig(fixed=self.k))
        return RecogniserMethod(config, self.pool)


@dataclass(frozen=True)
class VariantRow(Variant):
    """What a variant is worth."""

    runs: int
    """How often it was trained."""

    val_accuracy: float
    """Mean over these."""

    val_std: float
    """Standard deviation; 0 of a single run."""

    test_accuracy: float
    """Mean over these."""

    test_std: float
    """Standard deviation; 0 of a single run."""


def study_row(variant: Variant, results: Sequence[Result]) -> VariantRow:
    """What a variant came to."""
    shares = {
        asked: [r.answered[asked].right.mean() for r in results if asked in r.answered]
        for asked in ("val", "test")
    }
    means = {k: float(np.mean(v)) if v else math.nan for k, v in shares.items()}
    stds = {k: float(np.std(v, ddof=1)) if v[1:] else 0.0 for k, v in shares.items()}
    return VariantRow(
        **asdict(variant),
        runs=len(results),
        val_accuracy=means["val"],
        val_std=stds["val"],
        test_accuracy=means["test"],
        test_std=stds["test"],
    )


def study_table(rows: Sequence[VariantRow]) -> str:
    """The rows as a table."""
    lines = ["| network | K | pooling | runs | validation | test |", "|---" * 6 + "|"]
    for row in rows:
        shares = (
            f"{row.val_accuracy:.1%} ({row.val_std:.1%})",
            f"{row.test_accuracy:.1%} ({row.test_std:.1%})",
        )
        cells = row.network, str(row.k), row.pool, str(row.runs), *shares
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
