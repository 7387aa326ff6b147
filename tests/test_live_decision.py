"""Tests of decisions: one for each touch, at closing at the latest, never withdrawn."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.live import UNKNOWN, DecisionConfig, DecisionFilter
from eskin.touch import Contact, Touch

VOCABULARY = ("none", "poke", "stroke")
MS = 1_000_000
STEP = 20 * MS
ZERO = np.zeros(3)
CONTACT = Contact(np.array([0]), 1.0, 1e-4, 10.0, ZERO, np.eye(3)[2], ZERO, "l", "p")


def touch_at(stamp, id=1) -> Touch:
    """Return a touch whose last contact is at `stamp`."""
    return Touch(id, 0, stamp, (id,), 0.0, 1.0, 10.0, "l", ZERO, ZERO, CONTACT)


def share(name, p):
    """Give one class the probability `p`, and the others equal shares of the rest."""
    shares = np.full(len(VOCABULARY), (1 - p) / (len(VOCABULARY) - 1))
    shares[VOCABULARY.index(name)] = p
    return shares


def decide(runs, config=None, step=STEP, change_ends=False, close=True):
    """Return the decisions about one touch, each with its reading and last contact.

    Runs of readings such as "3 poke 0.9, 2 none 0.8 lifted" have a class with its
    probability, and perhaps no contact.
    """
    decisions = DecisionFilter(VOCABULARY, config, change_ends)
    found = []
    stamp = 0
    touch = touch_at(0)
    for run in runs.split(", "):
        readings, name, p, *lifted = run.split()
        for _ in range(int(readings)):
            touch = touch if lifted else touch_at(stamp)
            made = decisions.make_decisions(
                stamp, (touch,), (), {1: share(name, float(p))}
            )
            found += [(each, stamp // step, touch.last // step) for each in made]
            stamp += step
    if close:
        found += [(d, "end", touch.last // step) for d in decisions.close((touch,))]
    return found


AT_ONCE = {"brief_seconds": 0.0}
LIFTED = {"lifted": 0.5, "lift_seconds": 0.2}
EARLY = {"threshold": 0.99, "thresholds": {"poke": 0.85}}
LATE = {"thresholds": {"poke": 1.1}}
# Runs, settings, and the reading and gesture of the decision.
DECISIONS = {
    "after 60 ms": ("3 poke 0.5, 9 poke 0.9", {}, "6 poke"),
    "60 ms after doubt": ("3 poke 0.9, 1 poke 0.7, 4 poke 0.9", {}, "7 poke"),
    "60 ms after another gesture": ("3 poke 0.9, 4 stroke 0.9", {}, "6 stroke"),
    "only once": ("6 poke 0.95, 14 stroke 0.99", {}, "3 poke"),
    "none at closing": ("50 none 0.99", {}, "end none"),
    "latest at closing": ("2 stroke 0.6, 18 poke 0.7 lifted", {}, "end poke"),
    "below least": ("5 poke 0.4", {"least": 0.5}, "end unknown"),
    "without least": ("5 poke 0.4", {"least": 0.0}, "end poke"),
    "hardly deliberate": ("5 poke 0.4", {"deliberate": 0.8}, "end unknown"),
    "deliberate, of any kind": ("5 poke 0.4", {"deliberate": 0.6}, "end poke"),
    "none, not deliberate": ("5 none 0.9", {"deliberate": 0.8}, "end none"),
    "own threshold": ("9 poke 0.9", EARLY, "3 poke"),
    "own threshold above 1": ("9 poke 0.9", LATE, "end poke"),
    "lifted": ("6 poke 0.6, 19 poke 0.6 lifted", LIFTED, "18 poke"),
    "lifted, none": ("6 none 0.6, 19 none 0.6 lifted", LIFTED, "end none"),
    "lifted, higher threshold": (
        "1 poke 0.5, 14 poke 0.5 lifted, 10 poke 0.85 lifted",
        {"lifted": 0.9},
        "18 poke",
    ),
    "lifted, contact again": (
        "1 poke 0.6, 12 poke 0.6 lifted, 7 poke 0.6",
        LIFTED,
        "end poke",
    ),
}


@pytest.mark.parametrize("case", DECISIONS)
def test_touch_has_one_decision(case):
    runs, config, want = DECISIONS[case]
    [(decision, when, _)] = decide(runs, DecisionConfig(**AT_ONCE | config))
    assert f"{when} {decision.gesture}" == want


# Runs, and the reading and gesture of the decision; 0.3 s are 15 readings.
BRIEF = {
    "press that lasts": ("20 poke 0.99", "15 poke"),
    "one pat": ("5 poke 0.99, 25 poke 0.99 lifted", "end poke"),
    "second pat": ("5 poke 0.99, 5 poke 0.99 lifted, 9 stroke 0.99", "15 stroke"),
    "second pat, never certain": (
        "5 poke 0.99, 5 none 0.5 lifted, 9 stroke 0.75",
        "end stroke",
    ),
}


@pytest.mark.parametrize("case", BRIEF)
def test_touch_that_may_be_the_first_of_two_pats_waits(case):
    runs, want = BRIEF[case]
    [(decision, when, _)] = decide(runs)
    assert f"{when} {decision.gesture}" == want


def test_two_slow_readings_suffice():
    config = DecisionConfig(**AT_ONCE)
    [(decision, when, _)] = decide("2 poke 0.9", config, step=100 * MS)
    assert (when, decision.gesture) == (1, "poke")


RUN = st.tuples(st.integers(1, 6), st.sampled_from(VOCABULARY), st.floats(0.4, 1.0))


@settings(deadline=None, max_examples=30)
@given(st.lists(RUN, min_size=1, max_size=15), st.integers(1, 120))
def test_every_touch_has_exactly_one_decision(runs, step):
    text = ", ".join(" ".join(map(str, run)) for run in runs)
    early, found = (
        [decision.gesture for decision, *_ in decide(text, step=step * MS, close=close)]
        for close in (False, True)
    )
    assert len(found) == 1
    assert early in ([], found)


@given(st.sampled_from(VOCABULARY), st.floats(0.4, 1.0), st.floats(0.0, 1.0))
def test_unknown_touch_has_a_likeliest_gesture(name, p, least):
    [(decision, *_)] = decide(f"1 {name} {p}", DecisionConfig(1.1, least=least))
    want = (name, "") if p >= least else (UNKNOWN, name)
    assert (decision.gesture, decision.likeliest) == want


def test_threshold_of_an_unknown_gesture_is_refused():
    with pytest.raises(ValueError, match="'wave'.*none, poke, stroke"):
        DecisionFilter(VOCABULARY, DecisionConfig(thresholds={"wave": 0.5}))


@pytest.mark.parametrize("old", [0.5, 0.95])
@pytest.mark.parametrize(("young", "want"), [(0.5, (1, "poke")), (0.95, (2, "stroke"))])
def test_merged_touches_have_one_decision(young, old, want):
    """Touch 2 may be decided before it turns out to be a part of touch 1."""
    decisions = DecisionFilter(VOCABULARY, DecisionConfig(**AT_ONCE))
    found = []
    for n in range(10):
        one = touch_at(STEP * n, 1)
        two = touch_at(STEP * n, 2)
        touches = (one, two) if n < 5 else (one,)
        closed = (replace(two, closed=True, merged_into=1),) if n == 5 else ()
        p = {1: share("poke", old if n > 5 else 0.5), 2: share("stroke", young)}
        found += decisions.make_decisions(STEP * n, touches, closed, p)
    found += decisions.close((touch_at(STEP * 9, 1),))
    assert [(decision.touch, decision.gesture) for decision in found] == [want]


def test_touch_that_begins_with_a_merger_has_no_other_decision():
    decisions = DecisionFilter(VOCABULARY, DecisionConfig(**AT_ONCE))
    certain = share("poke", 0.9)
    for n in range(5):
        decisions.make_decisions(STEP * n, (touch_at(STEP * n, 2),), (), {2: certain})
    closed = (replace(touch_at(4 * STEP, 2), closed=True, merged_into=1),)
    for n in range(5, 15):
        touch = touch_at(STEP * n)
        assert not decisions.make_decisions(STEP * n, (touch,), closed, {1: certain})
        closed = ()
    assert not decisions.close((touch_at(15 * STEP),))


@pytest.mark.parametrize("change_ends", [False, True])
def test_closing_probabilities_count_when_a_touch_closes_and_never_before(change_ends):
    """On a skin that is not calibrated they are those at the last contact."""
    unsure = share("poke", 0.5)
    certain = share("stroke", 0.9)
    decisions = DecisionFilter(VOCABULARY, None, change_ends)
    found = []
    for n in range(30):
        closing = {1: certain if n < 20 else share("none", 0.9)}
        touch = touch_at(STEP * min(n, 19))
        found += decisions.make_decisions(STEP * n, (touch,), (), {1: unsure}, closing)
    assert not found
    [decision] = decisions.close((touch_at(STEP * 19),))
    assert decision.gesture == ("stroke" if change_ends else "none")
    assert decision.confidence == pytest.approx(0.9)


def test_what_is_certain_while_a_touch_is_open_does_not_wait_for_its_closing():
    decisions = DecisionFilter(VOCABULARY, DecisionConfig(**AT_ONCE))
    found = []
    for n in range(10):
        p = {1: share("poke", 0.9)}
        closing = {1: share("stroke", 0.9)}
        found += decisions.make_decisions(
            STEP * n, (touch_at(STEP * n),), (), p, closing
        )
    assert [decision.gesture for decision in found] == ["poke"]
    assert not decisions.close((touch_at(STEP * 9),))


# Runs, and gesture, onset and last contact of each decision, in readings.
CHANGES = {
    "none that lasts": (
        "6 poke 0.9, 15 none 0.9, 6 poke 0.9, 2 none 0.9, 6 poke 0.9",
        [("poke", 0, 3), ("poke", 20, 24)],
    ),
    "another gesture that lasts": (
        "6 poke 0.9, 2 stroke 0.9, 6 poke 0.9, 6 stroke 0.9",
        [("poke", 0, 3), ("stroke", 17, 17)],
    ),
    "no decision again after contact": (
        "6 poke 0.9, 6 none 0.9 lifted, 9 poke 0.9 lifted",
        [("poke", 0, 3)],
    ),
    "decision at closing from the last contact": (
        "6 poke 0.6, 4 poke 0.6 lifted, 20 none 0.9 lifted",
        [("poke", 0, 5)],
    ),
    "contact again": (
        "8 poke 0.9, 6 none 0.9, 6 stroke 0.9, 4 none 0.9 lifted",
        [("poke", 0, 3), ("stroke", 13, 17)],
    ),
}


@pytest.mark.parametrize("case", CHANGES)
def test_without_calibration_a_change_ends_a_touch(case):
    runs, want = CHANGES[case]
    found = decide(runs, change_ends=True)
    assert [(d.gesture, d.onset // STEP, last) for d, _, last in found] == want
