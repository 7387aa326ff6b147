"""Every number of the simulated world says where it comes from."""

import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from eskin.sim import load_constants
from eskin.sim.constants import CONSTANTS_FILE, Constant, Distribution

CONSTANTS = load_constants()
CODE = "\n".join(path.read_text() for path in CONSTANTS_FILE.parent.rglob("*.py"))


def test_every_constant_has_a_source_or_is_an_estimate_with_a_range():
    for name, entry in CONSTANTS.entries.items():
        if entry.source is not None:
            assert entry.source in CONSTANTS.sources, name
        else:
            assert entry.estimate is not None, name
            least, most = entry.estimate
            assert 0 < least <= 1 <= most, name


def test_every_source_is_used_and_says_enough_to_be_found():
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
def test_a_constant_without_one_number_from_one_place_is_refused(entry):
    with pytest.raises(ValidationError):
        Constant.model_validate(entry)


def test_draws_follow_their_law_and_stay_within_their_limits():
    rng = np.random.default_rng(0)
    drawn = np.array([CONSTANTS.draw("poke.force", rng) for _ in range(3000)])
    law = CONSTANTS.get_constant("poke.force").spread
    assert law.low <= drawn.min() and drawn.max() <= law.high
    assert np.median(drawn) == pytest.approx(law.median, rel=0.05)
    assert np.exp(np.log(drawn).std()) == pytest.approx(law.gsd, rel=0.1)


def test_a_wider_law_is_wider_about_the_same_middle():
    rng = np.random.default_rng(0)
    law = Distribution(law="lognormal", median=2.0, gsd=1.5)
    assert law.low == -np.inf
    wide = [np.log(CONSTANTS.draw("poke.force", rng, 1.5)) for _ in range(2000)]
    plain = [np.log(CONSTANTS.draw("poke.force", rng)) for _ in range(2000)]
    assert np.std(wide) > 1.2 * np.std(plain)
    assert np.median(wide) == pytest.approx(np.median(plain), abs=0.1)


def test_a_sweep_multiplies_what_it_names_and_nothing_else():
    twice = CONSTANTS.scaled({"poke.force": 2.0, "time.step": 0.5})
    one, other = (np.random.default_rng(1) for _ in range(2))
    assert twice.draw("poke.force", one) == 2 * CONSTANTS.draw("poke.force", other)
    assert twice.value("time.step") == 0.5 * CONSTANTS.value("time.step")
    same = CONSTANTS.draw("grab.force", np.random.default_rng(2))
    assert twice.draw("grab.force", np.random.default_rng(2)) == same


def test_asking_for_what_is_not_there_says_so():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="no constant 'poke.colour'"):
        CONSTANTS.value("poke.colour")
    with pytest.raises(ValueError, match="not one number"):
        CONSTANTS.value("poke.force")
    with pytest.raises(ValueError, match="take its value"):
        CONSTANTS.draw("time.step", rng)
    with pytest.raises(ValueError, match="has no weights"):
        CONSTANTS.choose("time.step", rng)
    with pytest.raises(ValueError, match="no constant 'x'"):
        CONSTANTS.scaled({"x": 2.0})


def test_the_constants_are_part_of_the_package():
    assert Path(CONSTANTS_FILE).name == "constants.yaml"
