"""Tests of the operating curve: what a threshold changes, and what intervals hold."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.learn.events import ErrorCount, interpolate_missed, measure_curve
from eskin.learn.events.curve import (
    CurvePoint,
    bound_missed,
    bound_person_rate,
    raise_threshold,
)
from eskin.live import DecisionConfig
from helpers.events import (
    VOCABULARY,
    detect_each,
    make_detection,
    make_event,
    make_stream,
)

DECISION = DecisionConfig(threshold=0.8, thresholds={"poke": 0.9}, least=0.5)
CONFIDENCES = (0.35, 0.55, 0.75, 0.92, 0.985)


def decide(decision):
    """Detect pokes of several confidences, half of them where nobody touches."""
    found = []
    for number, confidence in enumerate(CONFIDENCES):
        if confidence >= decision.least:
            for at in (4 * number + 0.5, 4 * number + 2.5):
                found.append(make_detection(at, confidence=confidence))
    events = [make_event(4 * n, 4 * n + 0.5) for n in range(len(CONFIDENCES))]
    return [make_stream(events, found)]


def test_fewer_accidents_cost_more_missed_gestures():
    points = measure_curve(decide, DECISION, VOCABULARY)
    assert [p.threshold for p in points] == sorted(p.threshold for p in points)
    assert [p.accidents_per_hour for p in points] == sorted(
        (p.accidents_per_hour for p in points), reverse=True
    )
    assert [p.missed for p in points] == sorted(p.missed for p in points)
    assert (points[0].missed, points[0].accidents_per_hour) == (0.0, 5.0)
    assert (points[-1].missed, points[-1].accidents_per_hour) == (1.0, 0.0)


def test_one_point_is_the_model_as_it_is_shipped():
    points = measure_curve(decide, DECISION, VOCABULARY)
    [shipped] = [point for point in points if point.is_shipped]
    assert shipped.threshold == DECISION.least
    assert raise_threshold(DECISION, DECISION.least) == DECISION
    assert (shipped.accidents_per_hour, shipped.missed) == (4.0, pytest.approx(0.2))


@pytest.mark.parametrize("threshold", [0.0, 0.5, 0.85, 0.95])
def test_raised_thresholds_never_fall_below_those_of_the_model(threshold):
    raised = raise_threshold(DECISION, threshold)
    assert raised.least == threshold
    assert raised.threshold == max(0.8, threshold)
    assert raised.thresholds == {"poke": max(0.9, threshold)}
    assert replace(raised, least=0, threshold=0, thresholds={}, lifted=0) == replace(
        DECISION, least=0, threshold=0, thresholds={}, lifted=0
    )


def make_point(threshold, accidents, missed):
    nothing = (0.0, 0.0)
    return CurvePoint(
        threshold, False, accidents, nothing, missed, nothing, 0.0, 0.0, nothing
    )


def test_misses_are_interpolated_between_thresholds_or_not_reached():
    points = [
        make_point(0.0, 8.0, 0.1),
        make_point(0.5, 4.0, 0.2),
        make_point(0.9, 1.0, 0.5),
    ]
    assert interpolate_missed(points, 5.0) == pytest.approx(0.175)
    assert interpolate_missed(points, 4.0) == pytest.approx(0.2)
    assert interpolate_missed(points, 2.0) == pytest.approx(0.4)
    assert interpolate_missed(points, 9.0) == pytest.approx(0.1), "fewer than asked for"
    assert np.isnan(interpolate_missed(points, 0.5))


def test_near_words_and_wrong_names_are_on_the_curve_but_no_accidents():
    events = [
        make_event(0.0, 0.5, "none", kind="press"),
        make_event(4.0, 4.5, "grab"),
        make_event(8.0, 8.5),
    ]
    stream = make_stream(events, detect_each(events, ["poke", "poke", "poke"]))
    points = measure_curve(lambda _: [stream], DECISION, VOCABULARY)
    assert {point.accidents_per_hour for point in points} == {0.0}
    assert {(point.missed, point.wrong_names) for point in points} == {(0.0, 0.5)}
    assert {point.false_per_hour for point in points} == {2.0}


def test_intervals_of_no_errors_still_have_a_width():
    """The rule of three: none in an hour leaves up to 3.7, none of 20 up to 17 %."""
    assert bound_person_rate([0], [1.0]) == (0.0, pytest.approx(3.689, abs=0.01))
    missed = bound_missed([ErrorCount(1.0, made=20, found=20)])
    assert missed == (0.0, pytest.approx(0.168, abs=0.001))


def test_intervals_hold_the_truth_of_people_who_differ():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(100):
        rates = rng.gamma(2.0, 2.0, 12)
        accidents = rng.poisson(rates).tolist()
        low, high = bound_person_rate(accidents, [1.0] * 12)
        inside += low <= 4.0 <= high
    assert inside >= 88


def test_streams_without_gestures_have_no_share_of_missed_ones():
    low, high = bound_person_rate([3], [2.0])
    assert low < 1.5 < high
    assert np.isnan(bound_missed([ErrorCount(2.0, accidents=3)])).all()
