"""Tests of scoring streams: what counts as recognised, and what each mistake costs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.learn.events import (
    GROUPS,
    MatchConfig,
    NonGestureTally,
    Tally,
    TouchGroup,
    match_events,
    read_true_events,
    score_events,
)
from eskin.learn.events.event_scoring import OTHER_NAMES
from eskin.learn.events.matching import GESTURE_ALIASES
from eskin.sim.constants import load_constants
from eskin.sim.people.perform import (
    GESTURE_PROGRAMS,
    NONE_PROGRAMS,
    UNKNOWN_PROGRAMS,
)
from helpers.events import (
    VOCABULARY,
    detect_each,
    make_detection,
    make_event,
    make_stream,
    make_truth,
    record_events,
    stamp,
)
from helpers.learning import label

GESTURES = VOCABULARY[1:]
POKE = make_event(1.0, 1.6)
SHORT = make_event(1.0, 1.2)
STROKE = make_event(0.0, 4.0, "stroke", 0.0, 0.8)
UNPLACED = replace(POKE, stamps=POKE.stamps[:0], path=POKE.path[:0])
BUMP = make_event(1.0, 1.6, "none", kind="bump")


def score(events, detections, **options):
    return score_events([make_stream(events, detections, **options)], VOCABULARY)


def count_confusions(result, true, detected):
    return result.confusion[result.names.index(true), result.names.index(detected)]


def make_sequence(gestures, kinds=None):
    """Return events two seconds apart, each at its own place."""
    return [
        make_event(2 * n, 2 * n + 0.8, g, 0.05 * n, kind=kinds[n] if kinds else "")
        for n, g in enumerate(gestures)
    ]


def test_detecting_every_event_gives_an_f1_of_1():
    events = make_sequence(["poke", "stroke", "grab", "none", "poke"])
    result = score(events, detect_each(events))
    assert result.total == Tally(4, 0, 0)
    assert result.total.f1 == result.total.precision == result.total.recall == 1.0
    assert result.per_gesture["poke"] == Tally(2, 0, 0)
    assert result.false_per_hour == 0.0
    assert np.trace(result.confusion) == result.confusion.sum() == 5
    assert result.correct.all()
    tally = Tally(6, 2, 4)
    assert (tally.precision, tally.recall) == (0.6, 0.75)
    assert tally.f1 == pytest.approx(2 / (1 / 0.6 + 1 / 0.75))


@pytest.mark.parametrize(
    ("detected", "false"), [("grab", 1), ("none", 0), ("unknown", 0), ("nothing", 0)]
)
def test_wrong_gesture_is_false_but_abstention_and_silence_only_miss(detected, false):
    events = make_sequence(["poke"])
    result = score(
        events, [] if detected == "nothing" else detect_each(events, [detected])
    )
    assert result.total == Tally(0, 1, false)
    assert result.total.f1 == 0.0
    assert math.isnan(result.total.precision) == (not false)
    assert math.isnan(result.all_delays.latency(50))
    assert result.per_gesture["poke"] == Tally(0, 1, 0)
    assert result.per_gesture["grab"] == Tally(0, 0, false)
    assert count_confusions(result, "poke", detected) == 1


@pytest.mark.parametrize(
    ("event", "detection", "matched"),
    [
        # From the onset until a second after the end.
        (POKE, make_detection(0.99), 0),
        (POKE, make_detection(1.0), 1),
        (POKE, make_detection(2.6), 1),
        (POKE, make_detection(2.61), 0),
        # Within 10 cm of the path.
        (POKE, make_detection(1.5, x=0.099), 1),
        (POKE, make_detection(1.5, x=0.101), 0),
        (POKE, make_detection(1.5, x=-0.099), 1),
        # Where the touch was at that time, not seconds ago.
        (STROKE, make_detection(0.5, "stroke", 0.1), 1),
        (STROKE, make_detection(3.5, "stroke", 0.7), 1),
        (STROKE, make_detection(3.5, "stroke", 0.1), 0),
        # The end of the path, where the touch was detected for longer.
        (SHORT, make_detection(2.1, end=2.0, x=0.05), 1),
        (SHORT, make_detection(2.1, end=2.0, x=0.15), 0),
        # Anywhere, if the path is unknown.
        (UNPLACED, make_detection(1.5, x=7.0), 1),
    ],
)
def test_detection_matches_event_near_it_in_time_and_place(event, detection, matched):
    total = score([event], [detection]).total
    assert total == Tally(matched, 1 - matched, 1 - matched)


@pytest.mark.parametrize(
    ("events", "detections", "matched"),
    [
        ([POKE], [(1.3, 0.2), (1.9, 1.02)], {0: 1}),
        ([POKE, make_event(2.0, 2.5)], [(1.5, 1.4), (2.4, 1.0)], {0: 0, 1: 1}),
        ([POKE, make_event(2.0, 2.5)], [(2.4, 1.0), (2.5, 1.1)], {0: 0, 1: 1}),
    ],
    ids=["nearest onset", "most pairs", "both events"],
)
def test_matching_has_most_pairs_and_then_the_nearest_onsets(
    events, detections, matched
):
    made = [make_detection(at, onset=onset) for at, onset in detections]
    assert match_events(events, made).matched == matched
    assert score(events, made).total.false == len(made) - len(matched)


def test_detections_of_no_event_are_counted_by_the_hour():
    detected = [(5.0, "poke"), (9.0, "grab"), (11.0, "none")]
    result = score([], [make_detection(*one) for one in detected], seconds=1800.0)
    assert result.total == Tally(0, 0, 2)
    assert result.false_per_hour == pytest.approx(4.0)
    assert result.confusion[-1].sum() == 3
    assert not result.correct.any() and len(result.correct) == 2


def test_latency_is_from_the_true_end_and_may_be_negative():
    events = [POKE, make_event(4.0, 4.5), make_event(8.0, 9.0, "grab")]
    detected = [(1.4, "poke"), (4.8, "poke"), (9.1, "grab")]
    result = score(events, [make_detection(*one) for one in detected])
    assert result.delays["poke"].after_end == pytest.approx([-0.2, 0.3])
    assert result.delays["poke"].after_onset == pytest.approx([0.4, 0.8])
    assert result.all_delays.latency(50) == pytest.approx(0.1)
    assert result.delays["grab"].from_onset(95) == pytest.approx(1.1)
    assert math.isnan(result.delays["stroke"].latency(50))


def test_gestures_detected_in_accidents_and_unknown_gestures_are_false():
    names = ["rub", "rub", "tickle", "none", "none", "none", "none"]
    kinds = ["", "", "", "bump", "bump", "lean", "single_pat"]
    detected = ["unknown", "grab", "none", "poke", "none", "none", "poke"]
    events = make_sequence(names, kinds)
    result = score(events, detect_each(events, detected))
    assert (result.unknown["rub"].count, result.unknown["rub"].mistaken) == (2, 1)
    assert result.unknown_total.share == pytest.approx(1 / 3)
    assert (result.none["bump"].count, result.none["bump"].mistaken) == (2, 1)
    assert (result.accidents.count, result.accidents.mistaken) == (3, 1)
    assert result.none["single_pat"].share == 1.0
    assert result.total == Tally(0, 0, 3)
    assert count_confusions(result, "unknown", "unknown") == 1


def test_every_kind_that_is_simulated_has_a_group():
    """A grab of what is too wide for a hand is `none` of the kind of the grab."""
    grabs = load_constants().weights("grab.kinds")
    made = {*NONE_PROGRAMS, *UNKNOWN_PROGRAMS, *grabs} - {"idle", *GESTURE_ALIASES}
    assert set(GROUPS) == made
    others = {kind for kind, group in GROUPS.items() if group is TouchGroup.OTHER_NAME}
    assert set(OTHER_NAMES) == others
    assert set(OTHER_NAMES.values()) <= set(GESTURE_PROGRAMS)


def make_kind(kind, at=0.0):
    """Return a touch that is no gesture of the vocabulary, by its kind."""
    gesture = kind if kind in UNKNOWN_PROGRAMS else "none"
    return make_event(at, at + 0.8, gesture, kind=kind)


@pytest.mark.parametrize("kind", sorted(GROUPS))
def test_detection_in_each_kind_is_an_accident_or_a_near_word(kind):
    event = make_kind(kind)
    result = score([event], detect_each([event], ["poke"]))
    errors = result.total_errors
    is_accident = GROUPS[kind] is TouchGroup.ACCIDENT
    assert (errors.accidents, errors.near_words) == (is_accident, not is_accident)
    near = {} if is_accident else {kind: NonGestureTally(1, 1)}
    assert result.near_words == near
    assert result.accidents == NonGestureTally(int(is_accident), int(is_accident))
    assert result.total.false == 1, "F1 counts both as false"


@pytest.mark.parametrize(
    ("detected", "taken", "no_errors"), [("grab", 0, 1), ("poke", 1, 0), ("none", 0, 0)]
)
def test_firm_grab_without_a_name_may_be_called_a_grab(detected, taken, no_errors):
    event = make_kind("squeeze")
    result = score([event], detect_each([event], [detected]))
    errors = result.total_errors
    assert result.near_words == {"squeeze": NonGestureTally(1, taken)}
    assert (errors.near_words, errors.no_errors) == (taken, no_errors)
    assert (errors.accidents, errors.wrong_names, errors.duplicates) == (0, 0, 0)


def test_touches_that_nobody_listed_are_accidents_if_none_and_else_near_words():
    events = [make_kind(""), make_event(4.0, 4.8, "hug")]
    result = score(events, detect_each(events, ["poke", "grab"]))
    errors = result.total_errors
    assert (errors.accidents, errors.near_words) == (1, 1)
    assert result.near_words == {"hug": NonGestureTally(1, 1)}


def test_second_detection_is_a_duplicate_except_in_accidents():
    """Each detection in an accident could start a command."""
    twice = [make_detection(1.2), make_detection(1.7)]
    for event, accidents, duplicates in (
        (POKE, 0, 1),
        (make_event(1.0, 1.6, "grab"), 0, 1),
        (make_event(1.0, 1.6, "rub"), 0, 1),
        (BUMP, 2, 0),
    ):
        errors = score([event], twice).total_errors
        assert (errors.accidents, errors.duplicates) == (accidents, duplicates)


def test_near_words_do_not_change_accidents_an_hour():
    events = [BUMP, make_event(4.0, 4.8)]
    found = detect_each(events, ["poke", "poke"])
    near = [make_kind(kind, 10.0 + 4 * n) for n, kind in enumerate(["press", "rub"])]
    before = score(events, found).total_errors
    after = score(
        [*events, *near], [*found, *detect_each(near, ["poke", "stroke"])]
    ).total_errors
    assert before.accidents_per_hour == after.accidents_per_hour == 1.0
    assert before.accidents_interval == after.accidents_interval
    assert before.accidents_interval == pytest.approx((0.0253, 5.572), abs=1e-3)
    assert (before.near_words, after.near_words) == (0, 2)


def test_accident_is_mistaken_if_any_detection_of_its_touch_is_a_gesture():
    """Others match an event or are assigned to the one they share most time with."""
    right = make_detection(1.6, "none", onset=1.0)
    wrong = make_detection(1.9, "poke", onset=1.3)
    for detected in ([right, wrong], [wrong, right]):
        assert score([BUMP], detected).none["bump"].mistaken == 1
    result = score([POKE, BUMP], [make_detection(1.5)])
    assert (result.none["bump"].mistaken, result.total) == (0, Tally(1, 0, 0))
    events = [make_event(1.0, 1.2, "none", kind="bump"), make_event(1.6, 2.0)]
    wrong = make_detection(1.9, "grab", onset=1.6)
    result = score(events, [wrong, make_detection(1.7, "none", onset=1.0, end=1.2)])
    assert result.none["bump"].mistaken == 0
    assert count_confusions(result, "poke", "grab") == 1
    assert count_confusions(result, "none", "none") == 1


def test_overlapping_events_are_simultaneous():
    grab = make_event(1.5, 2.5, "grab", 1.0)
    events = [make_event(1.0, 2.0), grab, make_event(6.0, 6.5)]
    detected = [(1.9, "poke"), (2.2, "stroke", 1.0), (6.4, "stroke")]
    result = score(events, [make_detection(*one) for one in detected])
    assert result.simultaneous == Tally(1, 1, 1)
    assert result.total == Tally(1, 2, 2)
    lean = replace(grab, gesture="none", kind="lean")
    result = score([events[0], lean], [make_detection(1.9)])
    assert result.simultaneous == Tally(1, 0, 0)


def test_people_have_tallies_and_f1_an_interval_over_them():
    events = make_sequence(["poke", "grab"])
    good = detect_each(events)
    bad = detect_each(events, ["poke", "poke"])
    streams = [make_stream(events, good), make_stream(events, bad, subject="bob")]
    result = score_events(streams, VOCABULARY)
    assert result.hours == pytest.approx(2.0)
    assert result.per_subject == {"ann": Tally(2, 0, 0), "bob": Tally(1, 1, 1)}
    assert result.f1_interval == pytest.approx((0.5, 1.0))
    alike = [make_stream(events, bad, subject=name) for name in "abcde"]
    assert score_events(alike, VOCABULARY).f1_interval == pytest.approx((0.5, 0.5))
    empty = [make_stream([], [], subject=name) for name in "ab"]
    for unknown in (streams[:1], empty):
        assert np.isnan(score_events(unknown, VOCABULARY).f1_interval).all()


@st.composite
def scenes(draw):
    """Draw events and detections within 8 s and 30 cm."""
    times = st.floats(0, 8)
    places = st.floats(0, 0.3)
    gestures = st.sampled_from([*VOCABULARY, "rub", "squeeze"])
    kinds = st.sampled_from(["bump", "press", ""])
    answers = st.sampled_from([*VOCABULARY, "unknown"])
    touches = st.tuples(times, st.floats(0.1, 2), gestures, places, kinds)
    made = st.lists(touches, max_size=6)
    detected = st.lists(st.tuples(times, answers, places), max_size=6)
    events = [
        make_event(t, t + seconds, gesture, x, kind=kind)
        for t, seconds, gesture, x, kind in draw(made)
    ]
    return events, [make_detection(*one) for one in draw(detected)]


@settings(deadline=None, max_examples=30)
@given(scenes(), st.randoms(use_true_random=False))
def test_order_of_events_and_detections_does_not_matter(scene, random):
    events, detections = scene
    first = score(events, detections)
    random.shuffle(events)
    random.shuffle(detections)
    again = score(events, detections)
    assert again.per_gesture == first.per_gesture


@settings(deadline=None, max_examples=30)
@given(scenes())
def test_every_event_and_detection_is_counted_once(scene):
    events, detections = scene
    result = score(events, detections)
    total = result.total
    place = result.names.index
    assert total.matched + total.missed == sum(e.gesture in GESTURES for e in events)
    assert total.matched + total.false == sum(d.gesture in GESTURES for d in detections)
    assert result.confusion[:-1].sum() == len(events)
    assert result.confusion[:, : place("nothing")].sum() == len(detections)
    accidents = sum(left.count for left in result.none.values())
    assert result.confusion[place("none")].sum() == accidents
    inside = [place(name) for name in GESTURES]
    assert np.diag(result.confusion)[inside].sum() == total.matched
    wide = match_events(events, detections, MatchConfig(late=2.0, near=0.2))
    assert len(wide.matched) >= total.matched


@settings(deadline=None, max_examples=100)
@given(scenes())
def test_every_gesture_made_and_every_detection_has_one_outcome(scene):
    events, detections = scene
    result = score(events, detections)
    errors = result.total_errors
    assert errors.found + errors.missed + errors.wrong_names == errors.made
    assert errors.missed >= 0
    assert (errors.made, errors.found) == (
        result.total.matched + result.total.missed,
        result.total.matched,
    )
    false = (
        errors.wrong_names,
        errors.accidents,
        errors.near_words,
        errors.duplicates,
        errors.no_errors,
    )
    assert sum(false) == result.total.false
    assert errors.near_words == result.total_near_words.mistaken
    inside = [result.names.index(name) for name in GESTURES]
    named = result.confusion[np.ix_(inside, inside)]
    assert errors.wrong_names == named.sum() - np.trace(named)


def test_true_events_are_the_touches_sorted_by_onset(tmp_path):
    """Pauses within a touch and touches at once do not matter."""
    places = [(x, 0.0, 0.0) for x in (0.0, 0.01, 0.02)]
    truths = [
        make_truth(1.0, 0, "tap_many", places[0]),
        make_truth(1.02, 0, "tap_many", places[1]),
        make_truth(1.02, 1, "rub"),
        make_truth(1.4, 0, "tap_many", places[2]),
    ]
    pats, rub = read_true_events(record_events(tmp_path / "a.mcap", truths))
    assert (pats.gesture, pats.kind, rub.gesture) == ("double_pat", "tip", "rub")
    assert (pats.onset, pats.end) == (stamp(1.0), stamp(1.4))
    assert (rub.onset, rub.end) == (stamp(1.02), stamp(1.02))
    assert pats.path.tolist() == [list(place) for place in places]


def test_label_is_a_true_event_at_no_known_place(tmp_path):
    labels = [label(1.0, 2.0, "tap_many")]
    [event] = read_true_events(record_events(tmp_path / "a.mcap", labels=labels))
    assert (event.onset, event.end) == (stamp(1.0), stamp(2.0))
    assert event.gesture == "double_pat"
    assert event.compute_distance(np.ones(3), stamp(1.0), 0.5) == 0.0
