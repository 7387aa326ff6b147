"""This module bounds every number of a model's card, which may come from a stranger.

Some numbers are sizes of memory, others become indices in compiled code, which has no
bounds checks. The limits leave room for every setting that makes sense.
"""

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from eskin.files import shorten
from eskin.live.graph_builder import GraphConfig
from eskin.live.model_config import (
    DecisionConfig,
    ModelCard,
    NetworkConfig,
)
from eskin.touch import (
    CalibrationConfig,
    ContactConfig,
    TouchConfig,
    TrackConfig,
)

Range = tuple[float, float]
"""Smallest and largest value of a number, both allowed."""

SHARE: Range = (0.0, 1.0)
DURATION: Range = (0.001, 86_400.0)  # [s] a millisecond to a day
PAUSE: Range = (0.0, 60.0)  # [s]
PRESSURE: Range = (0.001, 10_000.0)  # [kPa]
DISTANCE: Range = (0.0, 1.0)  # [m]
FACTOR: Range = (0.0, 1000.0)
THRESHOLD: Range = (0.0, math.inf)  # above 1 means never

CARD_LIMITS: dict[type, dict[str, Range]] = {
    CalibrationConfig: {
        "tare_seconds": DURATION,
        "tare_samples": (1, 1000),
        "tare_rank": (0.0, 0.99),
        "margin": PRESSURE,
        "drift_seconds": DURATION,
        "low_seconds": DURATION,
        "freeze_seconds": DURATION,
        "longest_seconds": DURATION,
        "stale_seconds": DURATION,
        "after_fraction": SHARE,
        "fade_seconds": DURATION,
        "steady_seconds": DURATION,
        "residual": SHARE,
        "alone_seconds": DURATION,
        "dip_seconds": PAUSE,
        "dip_share": SHARE,
        "still": FACTOR,
        "kept": FACTOR,
        "settle_seconds": DURATION,
        "relearn_seconds": DURATION,
        "silence_seconds": DURATION,
    },
    ContactConfig: {
        "on": PRESSURE,
        "off": PRESSURE,
        "on_share": SHARE,
        "off_share": SHARE,
        "peak_share": SHARE,
        "fade_seconds": DURATION,
        "hold_seconds": PAUSE,
        "reach": (0.0, 4.0),  # pairs of taxels grow with its square
        "least_reach": (0.0, 0.05),  # [m] likewise
    },
    TrackConfig: {
        "gate": DISTANCE,
        "speed": (0.0, 100.0),  # [m/s]
        "coast_seconds": PAUSE,
        "gap_seconds": PAUSE,
    },
    TouchConfig: {
        "near": DISTANCE,
        "pause_seconds": PAUSE,
        "beside": DISTANCE,
        "restart": (1.0, math.inf),
        "settle_seconds": PAUSE,
        "enough": FACTOR,
        "least_evidence": FACTOR,
        "most": FACTOR,
        "moves": SHARE,
        "doubt_seconds": PAUSE,
    },
    GraphConfig: {
        "fixed": (0, 64),
        "live": (0, 64),
        "live_reach": DISTANCE,
        "shear_on": (0.0, math.inf),  # [kPa] infinite where shear is not used
    },
    NetworkConfig: {
        "width": (0, 256),
        "layers": (0, 16),
        "channels": (1, 256),
        "dropout": (0.0, 0.9),
        "slots": (25, 1000),
    },
    DecisionConfig: {
        "threshold": THRESHOLD,
        "thresholds": THRESHOLD,
        "lifted": THRESHOLD,
        "lift_seconds": PAUSE,
        "hold_seconds": PAUSE,
        "least": THRESHOLD,
        "still": (0.0, 10.0),  # [m]
    },
    ModelCard: {
        "temperature": (0.01, 100.0),
        # Only shown, never computed with.
        "metrics": (-math.inf, math.inf),
    },
}
"""Limits of the numbers of each part of a card; those of a mapping hold for each."""

MAX_ENTRIES = 1000
"""Largest number of classes, thresholds, metrics or settings of a training."""


def find_limit_problem(part: Any, path: str = "") -> str | None:  # noqa: ANN401
    """Return the first thing that is wrong with the numbers of a card, if any.

    Args:
        part: the card, or a part of it.
        path: place of the part in the card.
    """
    for field in fields(part):
        value, place = getattr(part, field.name), f"{path}{field.name}"
        if is_dataclass(value):
            problem = find_limit_problem(value, f"{place}.")
            if problem is not None:
                return problem
            continue
        if isinstance(value, dict | tuple) and len(value) > MAX_ENTRIES:
            return f"'{place}' has {len(value)} entries; allowed are {MAX_ENTRIES}"
        for name, number in iterate_numbers(value):
            low, high = CARD_LIMITS[type(part)][field.name]
            # Metrics may be NaN, which is not within any limits.
            if not low <= number <= high and not math.isinf(low):
                entry = place + (f".{shorten(name)}" if name else "")
                most = f"to {high:g}" if math.isfinite(high) else "and more"
                return f"'{entry}' is {shorten(number)}; allowed is {low:g} {most}"
    return None


def iterate_numbers(value: object) -> Iterator[tuple[str, float]]:
    """Yield a number, or the numbers of a mapping with their names."""
    if isinstance(value, dict):
        for name, item in value.items():
            if isinstance(item, int | float):
                yield str(name), item
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield "", value
