"""These tests check how the benchmark of flaws scores touches and counts openings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from eskin.sim.constants import load_constants
from eskin.sim.sensor import FAMILIES, draw_flawed_build
from eskin.skin import build_grid_skin
from eskin.touch import TouchRecord
from eskin.units import NS_PER_S
from lab.flaws.hands import Hand, set_creep
from lab.flaws.real import keep_apart
from lab.flaws.report import describe_figures
from lab.flaws.scoring import (
    RestCount,
    Sample,
    Trail,
    TrueContact,
    Watcher,
    score_touch,
)
from lab.flaws.stream import FLAWED, REFERENCES, ROWS, BuildPlan, BuildResult
from lab.flaws.touches import Command, append_result, read_results

HERE = np.zeros(3)
AWAY = np.array([0.5, 0.0, 0.0])
FIRST = 10
LAST = 30
"""First and last scan with contact."""


def at(scan):
    """Return the stamp of a scan, 50 of which make a second."""
    return round(scan * NS_PER_S / 50)


def make_truth(forces=None, gesture="poke"):
    """Return a true contact of 2 N from `FIRST` to `LAST`, unless given."""
    force = np.zeros(60)
    force[FIRST : LAST + 1] = 2.0
    for part, value in (forces or {}).items():
        force[slice(*part)] = value
    stamps = np.array([at(scan) for scan in range(60)])
    return TrueContact(gesture, stamps, force, np.zeros((60, 3)))


def make_trail(number=1, first=FIRST, last=LAST, merged_into=0, **given):
    """Return a touch that is open until half a second after its last contact."""
    sample = Sample(0, 2.0, HERE, "poke")
    samples = [
        replace(sample, stamp=at(scan), **given) for scan in range(first, last + 25)
    ]
    return Trail(number, at(first), at(last), merged_into, samples)


def score(*trails, truth=None):
    """Score touches against a true contact."""
    by_id = {trail.id: trail for trail in trails}
    return score_touch(truth or make_truth(), by_id)


def test_touch_with_the_true_times_is_found():
    found = score(make_trail())
    assert (found.onset_error, found.end_error) == (0.0, 0.0)
    assert found.is_onset_found and found.is_end_found


@pytest.mark.parametrize("scans", [-6, 6])
def test_onset_more_than_a_tenth_of_a_second_off_is_not_found(scans):
    assert not score(make_trail(first=FIRST + scans)).is_onset_found
    assert score(make_trail(first=FIRST + scans * 5 // 6)).is_onset_found


def test_end_more_than_three_tenths_of_a_second_late_is_not_found():
    assert not score(make_trail(last=LAST + 16)).is_end_found
    assert score(make_trail(last=LAST + 15)).is_end_found


def test_nothing_covers_a_contact_where_all_touches_are_elsewhere():
    found = score(make_trail(p_world=AWAY))
    assert found.onset_error is None and not found.is_onset_found
    assert found.forced == "none"


def test_stronger_touch_elsewhere_does_not_cover_a_contact():
    noise = make_trail(2, first=0, force=9.0, p_world=AWAY)
    assert score(make_trail(), noise).onset_error == 0.0


def test_touch_that_took_over_gives_its_own_onset():
    older = make_trail(1, first=0, force=0.1)
    taken = make_trail(2, last=FIRST + 5, merged_into=1)
    assert score(older, taken).onset_error == pytest.approx(-0.2)


def test_answer_is_that_shortly_after_the_end():
    trail = make_trail()
    trail.samples[-5:] = [replace(s, answer="grab") for s in trail.samples[-5:]]
    assert score(trail).forced == "poke"


def make_watcher(states):
    """Return a watcher of a recogniser that goes through states, given as open ids."""
    recognizer = SimpleNamespace(state=None)

    def push(scan):
        ids = states[scan.stamp // at(1)]
        statuses = tuple(TouchRecord(number, 0, 0) for number in ids)
        recognizer.state = SimpleNamespace(open=statuses, closed=())
        return ["unknown"] * len(ids)

    recognizer.push = push
    return Watcher(recognizer)


def test_each_touch_opens_once_and_every_word_counts():
    states = [(), (2,), (2, 1), (2, 1), ()]
    watcher = make_watcher(states)
    for scan in range(len(states)):
        watcher.push(SimpleNamespace(stamp=at(scan)))
    assert (watcher.rest.openings, watcher.rest.detections) == (2, 5)
    assert watcher.rest.seconds == pytest.approx(0.08)
    assert watcher.rest.open_seconds == pytest.approx(0.06)


def test_rates_are_of_an_hour():
    result = BuildResult("none", 0, rest=RestCount(180.0, 3, 1))
    assert describe_figures([result], [])[:2] == ["20.0", "60.0"]


def test_points_are_lost_between_builds_of_the_same_number():
    right, wrong = (replace(score(make_trail()), forced=f) for f in ("poke", "grab"))
    before = [BuildResult("none", 3, touches=[right, right])]
    after = [BuildResult("x", 3, touches=[right, wrong])]
    assert describe_figures(after, before)[4].startswith("+50.0")
    assert describe_figures(after, [replace(before[0], number=4)])[4] == ""


def test_kept_results_are_read_back(tmp_path):
    plan = BuildPlan("none", 1, 0.5, 4)
    path = tmp_path / "kept.jsonl"
    result = BuildResult("none", 1, rest=RestCount(30.0, 2), touches=[score()])
    append_result(path, plan, result)
    assert list(read_results(path)) == [(plan, result)]


def test_unknown_row_is_refused():
    with pytest.raises(ValueError, match="--rows has 'dust'; allowed are none"):
        Command(rows=("none", "dust"))


def test_every_row_is_compared_to_a_row():
    assert set(REFERENCES) == set(ROWS) >= set(REFERENCES.values()) | set(FLAWED)


def test_untouched_scans_near_a_touch_do_not_count():
    stamps = np.arange(10) * 100_000_000
    untouched = np.arange(10) != 5
    assert np.flatnonzero(keep_apart(stamps, untouched)).tolist() == [0, 1, 2, 8, 9]


@pytest.mark.parametrize("family", FAMILIES)
def test_creep_is_set_between_two_times(family):
    skin = build_grid_skin(2, 2, 0.01)
    constants = load_constants()
    rng = np.random.default_rng(0)
    drawn = draw_flawed_build("b", family, {}, skin, constants, rng)
    layer = set_creep(drawn, 0.1, 1.0, 60.0).velostat
    first, last = (
        1.0 + layer.creep @ (1.0 - np.exp(-time / layer.creep_times))
        for time in (1.0, 60.0)
    )
    np.testing.assert_allclose(last / first, 1.1)


def test_hand_lands_rests_and_lifts():
    hand = Hand(np.array([0]), 1.0, 1.0, 4.0)
    share = hand.compute_share(np.array([0.9, 1.15, 1.4, 3.9, 4.15, 4.4]))
    np.testing.assert_allclose(share, [0, 0.5, 1, 1, 0.5, 0], atol=1e-9)
