"""One word on every touch: when sure, at closing at the latest, never taken back."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eskin.live import UNKNOWN, DecisionFilter
from eskin.model import DecisionConfig
from eskin.touch import Contact, Touch

VOCABULARY = ("none", "poke", "stroke")
MS = 1_000_000
CONTACT = Contact(
    np.array([0]), 1.0, 1e-4, 10.0, np.zeros(3), np.eye(3)[2], np.zeros(3), "l", "p"
)


def touch_at(ms, number=1, onset=0) -> Touch:
    zero = np.zeros(3)
    stamp = ms * MS
    return Touch(
        number, onset, stamp, (number,), 0.0, 1.0, 10.0, "l", zero, zero, CONTACT
    )


def likely(name, p):
    """Probability `p` of one class, the rest shared by the others."""
    shares = np.full(len(VOCABULARY), (1 - p) / (len(VOCABULARY) - 1))
    shares[VOCABULARY.index(name)] = p
    return shares


def said(story, config=None, close=True):
    """(ms, gesture) of all that is said of one touch; story: ms, name, p, contact."""
    decider, words, touch = DecisionFilter(VOCABULARY, config), [], touch_at(0)
    for ms, name, p, *apart in story:
        touch = touch if apart else touch_at(ms)
        verdicts = decider.push(ms * MS, (touch,), (), {1: likely(name, p)})
        words += [(ms, verdict.gesture) for verdict in verdicts]
    if close:
        words += [("end", v.gesture) for v in decider.close((touch,))]
    return words


def test_a_gesture_is_said_once_it_has_been_sure_for_60_ms():
    story = [(20 * n, "poke", 0.5 if n < 3 else 0.9) for n in range(12)]
    assert said(story) == [(120, "poke")]


def test_a_doubt_starts_the_time_anew():
    sure = [0.9, 0.9, 0.9, 0.7, 0.9, 0.9, 0.9, 0.9]
    story = [(20 * n, "poke", p) for n, p in enumerate(sure)]
    assert said(story) == [(140, "poke")]


def test_another_gesture_starts_the_time_anew():
    names = ["poke"] * 3 + ["stroke"] * 4
    story = [(20 * n, name, 0.9) for n, name in enumerate(names)]
    assert said(story) == [(120, "stroke")]


def test_slow_readings_are_sure_with_the_second():
    assert said([(0, "poke", 0.9), (100, "poke", 0.9)]) == [(100, "poke")]


def test_what_was_said_is_never_taken_back_nor_said_again():
    story = [(20 * n, "poke", 0.95) for n in range(6)]
    story += [(20 * n, "stroke", 0.99) for n in range(6, 20)]
    assert said(story) == [(60, "poke")]


def test_less_is_enough_once_contact_has_been_lifted():
    config = DecisionConfig(lifted=0.5, lift_seconds=0.2)
    felt = [(20 * n, "poke", 0.6) for n in range(6)]  # last contact at 100 ms
    lifted = [(20 * n, "poke", 0.6, False) for n in range(6, 25)]
    assert said(felt + lifted, config) == [(360, "poke")]
    assert said(felt + lifted) == [("end", "poke")]
    nothing = [(ms, "none", *rest) for ms, _, *rest in felt + lifted]
    assert said(nothing, config) == [("end", "none")]


def test_lifting_never_asks_for_more():
    config = DecisionConfig(threshold=0.8, lifted=0.9)
    story = [(20 * n, "poke", 0.5 if n < 15 else 0.85, False) for n in range(25)]
    assert said([(0, "poke", 0.5), *story[1:]], config) == [(360, "poke")]


def test_contact_made_again_asks_for_more_again():
    config = DecisionConfig(lifted=0.5, lift_seconds=0.2)
    lifted = [(20 * n, "poke", 0.6, False) for n in range(1, 13)]  # until 240 ms
    again = [(20 * n, "poke", 0.6) for n in range(13, 20)]
    assert said([(0, "poke", 0.6), *lifted, *again], config) == [("end", "poke")]


def test_none_is_said_at_closing_only():
    story = [(20 * n, "none", 0.99) for n in range(50)]
    assert said(story, close=False) == []
    assert said(story) == [("end", "none")]


def test_at_closing_what_is_known_by_then_is_said():
    story = [(0, "stroke", 0.6), (20, "stroke", 0.5)]
    story += [(20 * n, "poke", 0.7, "apart") for n in range(2, 20)]
    assert said(story) == [("end", "poke")]


def test_what_is_like_nothing_is_unknown_unless_abstention_is_off():
    story = [(20 * n, "poke", 0.4) for n in range(5)]
    assert said(story, DecisionConfig(least=0.5)) == [("end", UNKNOWN)]
    assert said(story, DecisionConfig(least=0.0)) == [("end", "poke")]


@given(st.sampled_from(VOCABULARY), st.floats(0.4, 1.0), st.floats(0.0, 1.0))
def test_the_likeliest_is_told_of_what_is_unknown_and_of_nothing_else(name, p, least):
    decider, touch = (
        DecisionFilter(VOCABULARY, DecisionConfig(1.1, least=least)),
        touch_at(0),
    )
    decider.push(0, (touch,), (), {1: likely(name, p)})
    (verdict,) = decider.close((touch,))
    assert {verdict.gesture, verdict.likeliest} == (
        {name, ""} if p >= least else {UNKNOWN, name}
    )


def test_a_gesture_can_have_its_own_threshold():
    story = [(20 * n, "poke", 0.9) for n in range(9)]
    low = DecisionConfig(threshold=0.99, thresholds={"poke": 0.85})
    late = DecisionConfig(thresholds={"poke": 1.1})
    assert said(story, low) == [(60, "poke")]
    assert said(story, late) == [("end", "poke")]


def test_a_threshold_of_a_gesture_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="'wave'.* allowed are none, poke, stroke"):
        DecisionFilter(VOCABULARY, DecisionConfig(thresholds={"wave": 0.5}))


def merged(young_sure, old_sure):
    """What is said when touch 2 turns out to be part of touch 1, and after that."""
    decider, words = DecisionFilter(VOCABULARY), []
    for n in range(10):
        ms = 20 * n
        young, old = touch_at(ms, 2), touch_at(ms, 1)
        p = {
            1: likely("poke", 0.95 if old_sure and n > 5 else 0.5),
            2: likely("stroke", 0.95 if young_sure else 0.5),
        }
        if n < 5:
            verdicts = decider.push(ms * MS, (old, young), (), p)
        else:
            gone = (replace(young, closed=True, merged_into=1),) if n == 5 else ()
            verdicts = decider.push(ms * MS, (old,), gone, {1: p[1]})
        words += [(v.touch, v.gesture) for v in verdicts]
    words += [(v.touch, v.gesture) for v in decider.close((touch_at(180, 1),))]
    return words


def test_touches_that_become_one_are_spoken_of_once():
    assert merged(young_sure=True, old_sure=True) == [(2, "stroke")]
    assert merged(young_sure=True, old_sure=False) == [(2, "stroke")]
    assert merged(young_sure=False, old_sure=True) == [(1, "poke")]
    assert merged(young_sure=False, old_sure=False) == [(1, "poke")]


def test_a_touch_that_takes_over_one_spoken_of_as_it_begins_stays_silent():
    decider = DecisionFilter(VOCABULARY)
    for n in range(5):
        sure = {2: likely("poke", 0.9)}
        decider.push(20 * n * MS, (touch_at(20 * n, 2),), (), sure)
    gone = replace(touch_at(80, 2), closed=True, merged_into=1)
    for n in range(5, 15):
        sure = {1: likely("poke", 0.9)}
        closed = (gone,) if n == 5 else ()
        assert not decider.push(20 * n * MS, (touch_at(20 * n),), closed, sure)
    assert not decider.close((touch_at(300),))


@given(
    st.lists(
        st.tuples(
            st.integers(1, 120), st.sampled_from(VOCABULARY), st.floats(0.4, 1.0)
        ),
        min_size=1,
        max_size=60,
    )
)
def test_every_touch_gets_exactly_one_word(steps):
    times = np.cumsum([ms for ms, _, _ in steps]).tolist()
    story = [(ms, name, p) for ms, (_, name, p) in zip(times, steps, strict=True)]
    words = said(story)
    assert len(words) == 1
    assert said(story, close=False) in ([], words)


def heard_without_end(*story):
    """What is said of one touch that never ends, at 50 Hz; story: name, readings."""
    decider, verdicts = DecisionFilter(VOCABULARY, change_ends=True), []
    names = [name for name, readings in story for _ in range(readings)]
    for n, name in enumerate(names):
        shares = {1: likely(name, 0.9)}
        verdicts += decider.push(20 * n * MS, (touch_at(20 * n),), (), shares)
    return [(verdict.gesture, verdict.onset // (20 * MS)) for verdict in verdicts]


def test_where_contact_never_ends_none_that_lasts_makes_way_for_the_next_touch():
    story = [("poke", 6), ("none", 15), ("poke", 6), ("none", 2), ("poke", 6)]
    assert heard_without_end(*story) == [("poke", 0), ("poke", 20)]


def test_where_contact_never_ends_another_gesture_that_lasts_is_another_touch():
    story = [("poke", 6), ("stroke", 2), ("poke", 6), ("stroke", 6)]
    assert heard_without_end(*story) == [("poke", 0), ("stroke", 17)]


def heard_after_contact(*story, felt=6):
    """What is said, with onset and last contact [readings], of a touch that closes.

    story: name, probability, readings; `felt`: readings with contact, from the first.
    """
    decider, verdicts = DecisionFilter(VOCABULARY, change_ends=True), []
    steps = [(name, p) for name, p, readings in story for _ in range(readings)]
    touch = touch_at(0)
    for n, (name, p) in enumerate(steps):
        touch = touch_at(20 * n) if n < felt else touch
        shares = {1: likely(name, p)}
        said = decider.push(20 * n * MS, (touch,), (), shares)
        verdicts += [(verdict, touch.last) for verdict in said]
    verdicts += [(verdict, touch.last) for verdict in decider.close((touch,))]
    step = 20 * MS
    return [(v.gesture, v.onset // step, last // step) for v, last in verdicts]


def test_a_touch_that_was_spoken_of_is_not_said_again_after_its_contact():
    said = [("poke", 0, 3)]
    assert heard_after_contact(("poke", 0.9, 10), ("none", 0.9, 20)) == said
    back = [("poke", 0.9, 10), ("none", 0.9, 6), ("poke", 0.9, 9)]
    assert heard_after_contact(*back) == said


def test_a_touch_not_spoken_of_has_its_last_word_and_its_own_onset():
    story = [("poke", 0.6, 10), ("none", 0.9, 20)]
    assert heard_after_contact(*story) == [("poke", 0, 5)]


def test_contact_that_comes_back_after_a_change_is_another_touch():
    story = [("poke", 0.9, 8), ("none", 0.9, 6), ("stroke", 0.9, 10)]
    found = heard_after_contact(*story, felt=20)
    assert [gesture for gesture, _, _ in found] == ["poke", "stroke"]
    assert all(onset <= last for _, onset, last in found)
