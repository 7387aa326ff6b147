"""These tests check the constants: sources, limits, draws and sweeps."""

import re

import numpy as np
import pytest
from pydantic import ValidationError

from eskin.sim import load_constants
from eskin.sim.constants import CONSTANTS_FILE, Constant

CONSTANTS = load_constants()
CODE = "\n".join(path.read_text() for path in CONSTANTS_FILE.parent.rglob("*.py"))


def test_every_constant_has_a_known_source_or_is_an_estimate_with_a_range():
    for name, entry in CONSTANTS.entries.items():
        least, most = entry.estimate or (1, 1)
        assert entry.estimate or entry.source in CONSTANTS.sources, name
        assert 0 < least <= 1 <= most, name
    used = {entry.source for entry in CONSTANTS.entries.values()} - {None}
    assert used == set(CONSTANTS.sources)
    assert all(len(citation) > 20 for citation in CONSTANTS.sources.values())


def test_every_constant_is_used():
    def is_used(name):
        # Names are written out, or put together at their last dot.
        parts = name.split(".")
        wholes = [name, *(".".join(parts[:n]) + "." for n in range(1, len(parts)))]
        return any(re.search(re.escape(f'"{whole}'), CODE) for whole in wholes)

    assert not [name for name in CONSTANTS.entries if not is_used(name)]


@pytest.mark.parametrize(
    "entry",
    [
        {"value": 1.0, "unit": "m"},
        {"value": 1.0, "unit": "m", "source": "a", "estimate": [0.5, 2.0]},
        {"value": 1.0, "weights": {"a": 1.0}, "unit": "m", "source": "a"},
        {"value": 1.0, "source": "a"},
        {"value": 1.0, "unit": "m", "source": "a", "colour": "red"},
        {"spread": {"law": "normal", "mean": 1.0}, "unit": "m", "source": "a"},
    ],
)
def test_constant_without_one_number_and_one_source_is_refused(entry):
    with pytest.raises(ValidationError):
        Constant.model_validate(entry)


@pytest.mark.parametrize("widen", [1.0, 1.5])
def test_draws_follow_their_law_within_its_limits(widen):
    rng = np.random.default_rng(0)
    drawn = np.array([CONSTANTS.draw("poke.force", rng, widen) for _ in range(2000)])
    law = CONSTANTS.get_constant("poke.force").spread
    assert law and law.median and law.gsd
    assert law.low <= drawn.min() and drawn.max() <= law.high
    assert np.median(drawn) == pytest.approx(law.median, rel=0.08)
    # Limits cut a wide law more.
    assert np.log(drawn).std() == pytest.approx(widen * np.log(law.gsd), rel=0.2)


def test_range_is_typical_in_the_middle_and_ends_where_it_says():
    rng = np.random.default_rng(0)
    for name in ("flaw.creep", "flaw.lost", "flaw.row_leak", "flaw.repeated"):
        low, typical, high = (
            CONSTANTS.at_level(name, level) for level in ("low", "typical", "high")
        )
        drawn = np.array([CONSTANTS.draw(name, rng) for _ in range(1000)])
        assert low <= drawn.min() and drawn.max() <= high
        assert np.median(drawn) == pytest.approx(typical, rel=0.1, abs=1e-4 * high)
        assert drawn.max() > 0.5 * high


def test_scaling_multiplies_the_named_constants_only():
    twice = CONSTANTS.scaled({"poke.force": 2.0, "time.step": 0.5})

    def draw(constants, name):
        return constants.draw(name, np.random.default_rng(1))

    assert draw(twice, "poke.force") == 2 * draw(CONSTANTS, "poke.force")
    assert draw(twice, "grab.force") == draw(CONSTANTS, "grab.force")
    assert twice.value("time.step") == 0.5 * CONSTANTS.value("time.step")
