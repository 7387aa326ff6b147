"""Holding settings to their limits."""

from collections.abc import Mapping

import numpy as np

Limits = Mapping[str, tuple[int | float, int | float]]
"""Smallest and largest value of each setting; infinite where there is no largest."""


def check_limits(settings: object, limits: Limits) -> None:
    """Refuse numbers that mean nothing.

    Raises:
        ValueError: naming the first setting that is not finite or not within.
    """
    for name, (low, high) in limits.items():
        value = getattr(settings, name)
        if not (np.isfinite(value) and low <= value <= high):
            allowed = f"{low:g} to {high:g}" if high < np.inf else f"from {low:g}"
            raise ValueError(f"{name} is {value}; allowed is {allowed}; change it")
