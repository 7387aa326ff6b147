"""Laws of scoring streams: what counts as recognised, and what each mistake costs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.learn.events import MatchConfig, Tally, match_events, score_events
from eskin.learn.events.event_scoring import bootstrap_f1
from eskin.learn.events.matching import build_events, build_label_event
from eskin.recording import Label, TruthRecord
from helpers.events import (
    SECOND,
    START,
    VOCABULARY,
    answers,
    event,
    nowhere,
    said,
    stamp,
    take,
)

GESTURES = VOCABULARY[1:]


def score(events, detections, **options):
    return score_events([take(events, detections, **options)], VOCABULARY)


def tally(events, detections):
    return score(events, detections).total


def in_turn(gestures):
    """Events two seconds apart, each at its own place."""
    return [event(2 * n, 2 * n + 0.8, g, 0.05 * n) for n, g in enumerate(gestures)]


def test_perfect_detections_have_an_f1_of_1():
    events = in_turn(["poke", "stroke", "grab", "none", "poke"])
    result = score(events, answers(events))
    assert result.total == Tally(4, 0, 0)
    assert result.total.f1 == result.total.precision == result.total.recall == 1.0
    assert result.per_gesture["poke"] == Tally(2, 0, 0)
    assert result.false_per_hour == 0.0
    assert np.trace(result.confusion) == result.confusion.sum() == 5
    assert result.correct.all()


def test_silence_misses_everything_and_is_never_false():
    events = in_turn(["poke", "stroke"])
    result = score(events, [])
    assert result.total == Tally(0, 2, 0)
    assert result.total.f1 == 0.0
    assert math.isnan(result.total.precision)
    assert math.isnan(result.all_delays.latency(50))
    nothing = result.names.index("nothing")
    assert result.confusion[:, nothing].sum() == 2


def test_a_wrong_gesture_is_one_miss_and_one_false_detection():
    events = in_turn(["poke"])
    result = score(events, answers(events, ["grab"]))
    assert result.total == Tally(0, 1, 1)
    assert result.per_gesture["poke"] == Tally(0, 1, 0)
    assert result.per_gesture["grab"] == Tally(0, 0, 1)
    names = result.names
    assert result.confusion[names.index("poke"), names.index("grab")] == 1


@pytest.mark.parametrize("word", ["none", "unknown"])
def test_abstention_is_a_miss_and_nothing_false(word):
    events = in_turn(["poke"])
    result = score(events, answers(events, [word]))
    assert result.total == Tally(0, 1, 0)
    place = result.names.index
    assert result.confusion[place("poke"), place(word)] == 1


@pytest.mark.parametrize(
    ("at", "matched"), [(0.99, 0), (1.0, 1), (2.6, 1), (2.61, 0), (-5.0, 0)]
)
def test_only_what_is_said_from_onset_to_a_second_after_the_end_counts(at, matched):
    found = tally([event(1.0, 1.6)], [said(at)])
    assert found == Tally(matched, 1 - matched, 1 - matched)


@pytest.mark.parametrize(("x", "matched"), [(0.099, 1), (0.101, 0), (-0.099, 1)])
def test_only_what_is_near_the_path_counts(x, matched):
    assert tally([event(1.0, 1.6)], [said(1.5, x=x)]).matched == matched


def test_the_path_is_looked_at_when_the_touch_was_there():
    moving = event(0.0, 4.0, "stroke", 0.0, 0.8)
    here = [said(0.5, "stroke", 0.1), said(3.5, "stroke", 0.7)]
    for found in here:
        assert tally([moving], [found]).matched == 1
    # It was there, but seconds ago: the link has carried the path away.
    assert tally([moving], [said(3.5, "stroke", 0.1)]).matched == 0


def test_a_touch_felt_for_longer_is_held_against_the_end_of_the_path():
    assert tally([event(1.0, 1.2)], [said(2.1, end=2.0, x=0.05)]).matched == 1
    assert tally([event(1.0, 1.2)], [said(2.1, end=2.0, x=0.15)]).matched == 0


def test_where_the_path_is_not_known_the_place_is_not_judged():
    assert tally([nowhere(1.0, 1.6)], [said(1.5, x=7.0)]) == Tally(1, 0, 0)


def test_two_detections_of_one_event_are_one_match_and_one_false_one():
    assert tally([event(1.0, 1.6)], [said(1.3), said(1.9)]) == Tally(1, 0, 1)


def test_of_two_detections_the_one_that_began_with_the_event_is_its_own():
    events = [event(1.0, 1.6)]
    late, timely = said(1.3, onset=0.2), said(1.9, onset=1.02)
    assert match_events(events, [late, timely]).matched == {0: 1}


def test_as_many_as_possible_are_matched():
    # The second detection fits both events, the first only the first one.
    events = [event(1.0, 1.6), event(2.0, 2.5)]
    detections = [said(1.5, onset=1.4), said(2.4, onset=1.0)]
    assert match_events(events, detections).matched == {0: 0, 1: 1}
    only = [said(2.4, onset=1.0), said(2.5, onset=1.1)]
    assert sorted(match_events(events, only).matched) == [0, 1]


def test_what_is_said_of_no_event_is_false_and_counted_by_the_hour():
    result = score(
        [], [said(5.0), said(9.0, "grab"), said(11.0, "none")], seconds=1800.0
    )
    assert result.total == Tally(0, 0, 2)
    assert result.false_per_hour == pytest.approx(4.0)
    assert result.confusion[-1].sum() == 3
    assert not result.correct.any() and len(result.correct) == 2


def test_latency_is_from_the_true_end_and_may_be_negative():
    events = [event(1.0, 1.6), event(4.0, 4.5), event(8.0, 9.0, "grab")]
    result = score(events, [said(1.4), said(4.8), said(9.1, "grab")])
    assert result.delays["poke"].after_end == pytest.approx([-0.2, 0.3])
    assert result.delays["poke"].after_onset == pytest.approx([0.4, 0.8])
    assert result.all_delays.latency(50) == pytest.approx(0.1)
    assert result.delays["grab"].from_onset(95) == pytest.approx(1.1)
    assert math.isnan(result.delays["stroke"].latency(50))


def test_unknown_gestures_should_be_met_with_abstention():
    events = in_turn(["rub", "rub", "tickle", "squeeze"])
    words = ["unknown", "grab", "none", "poke"]
    result = score(events, [*answers(events, words)])
    assert result.unknown["rub"].count == 2 and result.unknown["rub"].mistaken == 1
    assert result.unknown_total.share == pytest.approx(0.5)
    assert result.total == Tally(0, 0, 2)
    place = result.names.index
    assert result.confusion[place("unknown"), place("unknown")] == 1


def test_accidents_that_become_a_gesture_are_counted_by_kind():
    kinds = ["bump", "bump", "lean", "single_pat"]
    events = [event(2 * n, 2 * n + 0.5, "none", kind=k) for n, k in enumerate(kinds)]
    result = score(events, answers(events, ["poke", "none", "none", "poke"]))
    assert (result.none["bump"].count, result.none["bump"].mistaken) == (2, 1)
    assert (result.accidents.count, result.accidents.mistaken) == (3, 1)
    assert result.none["single_pat"].share == 1.0
    assert result.total == Tally(0, 0, 2)


def test_one_word_too_many_is_a_mistake_even_if_another_one_was_right():
    bump = event(1.0, 1.6, "none", kind="bump")
    right, wrong = said(1.6, "none", onset=1.0), said(1.9, "poke", onset=1.3)
    for words in ([right, wrong], [wrong, right]):
        assert score([bump], words).none["bump"].mistaken == 1


def test_f1_is_the_harmonic_mean_of_precision_and_recall():
    some = Tally(6, 2, 4)
    assert (some.precision, some.recall) == (0.6, 0.75)
    assert some.f1 == pytest.approx(2 / (1 / 0.6 + 1 / 0.75))


def test_a_match_beside_an_accident_is_no_mistake():
    events = [event(1.0, 1.6), event(1.0, 1.6, "none", 0.05, kind="bump")]
    result = score(events, [said(1.5)])
    assert result.none["bump"].mistaken == 0
    assert result.total == Tally(1, 0, 0)


def test_what_is_wrong_is_laid_on_the_event_that_the_touch_is_of():
    bump, poke = event(1.0, 1.2, "none", kind="bump"), event(1.6, 2.0)
    result = score(
        [bump, poke],
        [said(1.9, "grab", onset=1.6), said(1.7, "none", onset=1.0, end=1.2)],
    )
    assert result.none["bump"].mistaken == 0
    place = result.names.index
    assert result.confusion[place("poke"), place("grab")] == 1
    assert result.confusion[place("none"), place("none")] == 1


def test_only_events_that_overlap_are_simultaneous():
    events = [
        event(1.0, 2.0, "poke", 0.0),
        event(1.5, 2.5, "grab", 1.0),
        event(6.0, 6.5, "poke", 0.0),
    ]
    detections = [said(1.9), said(2.2, "stroke", 1.0), said(6.4, "stroke")]
    result = score(events, detections)
    assert result.simultaneous == Tally(1, 1, 1)
    assert result.total == Tally(1, 2, 2)


def test_a_touch_beside_an_accident_is_simultaneous_too():
    events = [event(1.0, 2.0), event(1.5, 2.5, "none", 1.0, kind="lean")]
    assert score(events, [said(1.9)]).simultaneous == Tally(1, 0, 0)


def test_people_have_tallies_of_their_own_and_an_interval_over_them():
    events = in_turn(["poke", "grab"])
    takes = [
        take(events, answers(events), subject="ann"),
        take(events, answers(events, ["poke", "poke"]), subject="bob"),
    ]
    result = score_events(takes, VOCABULARY)
    assert result.hours == pytest.approx(2.0)
    assert result.per_subject == {"ann": Tally(2, 0, 0), "bob": Tally(1, 1, 1)}
    assert result.f1_interval == pytest.approx((0.5, 1.0))


def test_one_person_tells_nothing_of_others():
    assert all(map(math.isnan, bootstrap_f1([Tally(5, 1, 1)])))
    assert all(map(math.isnan, bootstrap_f1([Tally(), Tally()])))
    low, high = bootstrap_f1([Tally(9, 1, 1)] * 5)
    assert low == high == pytest.approx(0.9)


@st.composite
def stories(draw):
    """Events and detections at random in 8 s and on 30 cm."""
    times, places = st.floats(0, 8), st.floats(0, 0.3)
    gestures = st.sampled_from([*VOCABULARY, "rub"])
    words = st.sampled_from([*VOCABULARY, "unknown"])
    happened = draw(
        st.lists(st.tuples(times, st.floats(0.1, 2), gestures, places), max_size=6)
    )
    told = draw(st.lists(st.tuples(times, words, places), max_size=6))
    events = [event(t, t + long, g, x) for t, long, g, x in happened]
    return events, [said(*one) for one in told]


@settings(deadline=None)
@given(stories(), st.randoms(use_true_random=False))
def test_the_order_of_events_and_detections_does_not_matter(story, random):
    events, detections = story
    first = score(events, detections)
    random.shuffle(events)
    random.shuffle(detections)
    again = score(events, detections)
    assert again.per_gesture == first.per_gesture
    assert again.total == first.total


@settings(deadline=None)
@given(stories())
def test_every_event_and_every_word_is_counted_once(story):
    events, detections = story
    result = score(events, detections)
    total, place = result.total, result.names.index
    assert total.matched + total.missed == sum(e.gesture in GESTURES for e in events)
    assert total.matched + total.false == sum(d.gesture in GESTURES for d in detections)
    assert result.confusion[:-1].sum() == len(events)
    words = result.confusion[:, : place("nothing")].sum()
    assert words == len(detections)
    assert result.confusion[place("none")].sum() == sum(
        left.count for left in result.none.values()
    )
    inside = [place(name) for name in GESTURES]
    assert np.diag(result.confusion)[inside].sum() == total.matched


@settings(deadline=None)
@given(stories())
def test_what_is_worth_more_time_or_room_matches_no_less(story):
    events, detections = story
    wide = MatchConfig(late=2.0, near=0.2)
    narrow = len(match_events(events, detections).matched)
    assert narrow <= len(match_events(events, detections, wide).matched)


def truth(seconds, touch, gesture="poke", x=0.0):
    return TruthRecord(
        stamp(seconds), touch, gesture, "one_tip", "table", 1.0, 1e-4, (x, 0.0, 0.0)
    )


def test_the_truth_has_an_event_a_touch_whatever_its_pauses_and_neighbours():
    records = [
        truth(1.0, 0, "tap_many"),
        truth(1.02, 0, "tap_many", 0.01),
        truth(1.02, 1, "rub"),
        truth(1.4, 0, "tap_many", 0.02),
    ]
    pats, rub = build_events(records)
    assert (pats.gesture, pats.kind, rub.gesture) == ("double_pat", "one_tip", "rub")
    assert (pats.onset, pats.end) == (stamp(1.0), stamp(1.4))
    assert (rub.onset, rub.end) == (stamp(1.02), stamp(1.02))
    assert pats.path[:, 0].tolist() == [0.0, 0.01, 0.02]


def test_a_label_is_an_event_without_a_place():
    found = build_label_event(Label(START, START + SECOND, "tap_many"))
    assert (found.onset, found.end) == (START, START + SECOND)
    assert found.gesture == "double_pat"
    assert found.compute_distance(np.ones(3), START, 0.5) == 0.0
