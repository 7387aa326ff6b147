"""Tests that no line of a matrix is lost, at any rate."""

import pytest

from lab.csv_rates import WAYS, measure_simulated


@pytest.mark.parametrize("rate", [2, 8, 12, 20, 100])
@pytest.mark.parametrize("way", WAYS)
def test_every_line_is_used_in_time_and_the_rate_is_told(rate, way):
    found = measure_simulated(rate, way, seed=0)
    assert found.is_right, found
