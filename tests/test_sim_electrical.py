"""Laws of electrical events."""

import numpy as np
import pytest

from eskin.sim.constants import load_constants
from eskin.sim.sensor.build import draw_build, find_line_taxels
from eskin.sim.sensor.electrical import ELECTRICAL_EVENTS, add_electrical_event
from helpers.touch import build_grid_skin

CONSTANTS = load_constants()
SKIN = build_grid_skin(6, 6, patches=2)
BUILD = draw_build("b", "fresh", SKIN, CONSTANTS, np.random.default_rng(1))
REST = np.full((100, SKIN.count), 200, np.int32)
ALL = np.ones(REST.shape, bool)


def event(kind, seed):
    return add_electrical_event(
        kind, REST, ALL, SKIN, BUILD, np.random.default_rng(seed)
    )


@pytest.mark.parametrize("kind", ELECTRICAL_EVENTS)
@pytest.mark.parametrize("seed", range(5))
def test_an_event_changes_only_its_place_and_time(kind, seed):
    counts, received, drawn = event(kind, seed)
    place, onset = str(drawn["place"]), int(drawn["onset"])
    inside = (
        find_line_taxels(place, SKIN)
        if ":" in place
        else SKIN.patch_index == int(place[1:])
    )
    during = np.zeros(100, bool)
    during[onset : onset + int(drawn["readings"])] = True
    changed = (counts != REST) | ~received
    assert changed.any()
    assert not changed[~during].any()
    assert not changed[:, ~inside].any()
    assert (counts >= 0).all() and (counts <= BUILD.electronics.full_scale).all()
    assert (REST == 200).all() and ALL.all()


def test_events_are_what_they_are_called():
    assert (event("stuck_line", 1)[0].max()) == BUILD.electronics.full_scale
    counts, received, _ = event("dropout", 1)
    assert not counts[~received].any()
    lengths = [int(event("dropout", seed)[2]["readings"]) for seed in range(60)]
    assert min(lengths) >= 1 and max(lengths) <= 60
    noisy = event("burst", 2)[0] - REST
    assert noisy.min() < 0 < noisy.max()
    assert len(np.unique(event("line_step", 3)[0])) == 2


def test_the_kinds_are_those_that_can_be_drawn():
    assert set(CONSTANTS.weights("sensor.electrical.kinds")) == set(ELECTRICAL_EVENTS)


def test_the_same_seed_makes_the_same_event():
    for kind in ELECTRICAL_EVENTS:
        one, two = event(kind, 4), event(kind, 4)
        assert one[0].tobytes() == two[0].tobytes() and one[2] == two[2]


def test_an_unknown_event_is_refused():
    with pytest.raises(ValueError, match="allowed are line_step"):
        add_electrical_event("spark", REST, ALL, SKIN, BUILD, np.random.default_rng(1))
