"""Test of the table of counts that rise and that fall."""

import sys

import pytest

from lab import polarity

pytestmark = pytest.mark.slow


def test_every_family_is_calibrated_either_way(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["polarity", "--builds", "1"])
    polarity.main()
    head, _, *rows = capsys.readouterr().out.splitlines()
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert len(cells) == 2 * len(polarity.FAMILIES) and head.count("|") == 6
    for _, counts, told, felt, force in cells:
        assert (told == "-") == (counts == "rise")
        assert felt.endswith(" 100%") and force.endswith("none in 0")
