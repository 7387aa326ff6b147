"""That nothing tells the answer but the touch, and that it would be noticed."""

import numpy as np
import pytest
from benchmarks.leaks import check_chance, onsets, windows_before_contact

from eskin.learn.baselines.interface import TOUCHED
from eskin.learn.comparison import find_examples
from eskin.sim.files.generate import generate
from eskin.sim.files.settings import Settings


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Eight clips of the simulator."""
    place = tmp_path_factory.mktemp("leaks")
    generate(place / "a", Settings("paper", clips=8, subjects=1))
    return find_examples([place / "a"], place / "pack")


def test_nothing_is_felt_before_the_first_contact(examples):
    cut, chosen = windows_before_contact(examples)
    assert 0 < len(chosen) <= len(examples.every)
    assert cut.pressure.max() < TOUCHED
    assert (examples.windows.pressure[chosen] >= TOUCHED).any(axis=(1, 2)).all()


def test_what_was_read_before_the_contact_stays_and_nothing_else(examples):
    cut, chosen = windows_before_contact(examples)
    for row, n, onset in zip(
        cut.pressure, chosen, onsets(examples)[chosen], strict=True
    ):
        first = int(onset)
        np.testing.assert_array_equal(row[:first], examples.windows.pressure[n, :first])
        assert (row[first:] == row[first - 1]).all()


def test_a_clip_that_begins_in_contact_has_nothing_before_it(examples, monkeypatch):
    since = onsets(examples)
    since[0] = 0.0
    monkeypatch.setattr("benchmarks.leaks.onsets", lambda examples: since)
    assert 0 not in windows_before_contact(examples)[1]


def test_more_right_than_chance_ends_the_command_with_a_line():
    check_chance("a fair one", np.arange(400) % 4 == 0)
    with pytest.raises(SystemExit, match="one who knows: 40.0% of 400 right; allowed"):
        check_chance("one who knows", np.arange(400) % 5 < 2)
