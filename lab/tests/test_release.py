"""These tests check how ends of touches are scored, and what creep leaves."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eskin.learn.events import ScoredStream, TrueEvent
from eskin.live import Detection
from eskin.sim.dataset import GenerationSettings
from eskin.sim.dataset.clip import make_clip
from eskin.sim.dataset.clip_generator import Simulator
from eskin.sim.sensor import FAMILIES, draw_build
from eskin.skin import build_grid_skin
from eskin.touch import Calibration
from eskin.units import NS_PER_S
from lab.release.__main__ import compare, main, measure_release
from lab.release.scoring import Followed, Follower, score_stream
from lab.release.streams import (
    DRAWS,
    CreepSimulator,
    change_constants,
    decay,
    leave_creep,
)

HERE = np.zeros(3)
GESTURES = ("poke", "double_pat", "none")


def at(scan):
    """Return the stamp of a scan, 50 of which make a second."""
    return round(scan * NS_PER_S / 50)


def make_event(*spans, gesture="poke"):
    """Return a true touch with force in spans of scans, ends included."""
    scans = [scan for first, last in spans for scan in range(first, last + 1)]
    stamps = np.array([at(scan) for scan in scans])
    path = np.zeros((len(scans), 3))
    return TrueEvent(at(scans[0]), at(scans[-1]), gesture, "", stamps, path)


def make_touch(first, last, number=1, place=HERE):
    """Return a touch of the front end, which closes half a second after its end."""
    contacts = [(at(scan), place, 2.0) for scan in range(first, last + 1)]
    return Followed(
        number, at(first), at(last), at(last + 25), 0, {number}, list(contacts)
    )


def score(events, touches, detections=()):
    """Return the figures of a stream of ten seconds."""
    stream = ScoredStream(events, list(detections), 10.0, "p")
    found = score_stream(stream, touches, GESTURES)
    return {name: values[0] if values else None for name, values in found.items()}


def detect(touch, stamp, gesture="poke"):
    """Return a detection of a touch."""
    return Detection(
        stamp=stamp,
        touch=touch.id,
        gesture=gesture,
        confidence=1.0,
        onset=touch.shown,
        end=touch.last,
        link="forearm",
        patch="forearm",
        p_world=HERE,
        n_world=HERE,
        direction_world=HERE,
        peak_force=2.0,
    )


def test_touch_with_the_true_times_is_whole_and_not_late():
    found = score([make_event((10, 40))], [make_touch(10, 40)])
    assert (found["touches"], found["felt"]) == (1, 1)
    assert (found["cut"], found["parted"], found["joined"]) == (0, 0, 0)
    assert found["late"] == 0.0 and found["closed"] == 0.5


def test_touch_that_ends_late_is_late_by_so_much():
    found = score([make_event((10, 40))], [make_touch(10, 55)])
    assert found["late"] == pytest.approx(0.3)
    assert found["closed"] == pytest.approx(0.8)


def test_two_touches_within_one_contact_are_cut():
    found = score([make_event((10, 60))], [make_touch(10, 30), make_touch(33, 60, 2)])
    assert (found["cut"], found["parted"]) == (1, 0)


def test_two_touches_of_two_pats_are_parted():
    event = make_event((10, 20), (30, 40), gesture="double_pat")
    found = score([event], [make_touch(10, 20), make_touch(30, 40, 2)])
    assert (found["cut"], found["parted"]) == (0, 1)


def test_touches_side_by_side_at_one_time_are_not_cut():
    found = score([make_event((10, 60))], [make_touch(10, 60), make_touch(15, 60, 2)])
    assert (found["cut"], found["opened beside"], found["opened after"]) == (0, 1, 0)


def test_one_touch_over_two_gestures_joins_them():
    events = [make_event((10, 40)), make_event((60, 90))]
    found = score(events, [make_touch(10, 90)])
    assert found["joined"] == 1 and found["late"] == 0.0
    apart = score(events, [make_touch(10, 55), make_touch(60, 90, 2)])
    assert apart["joined"] == 0


def test_touches_that_overlap_in_time_are_not_joined():
    events = [make_event((10, 60)), make_event((40, 90))]
    assert score(events, [make_touch(10, 90)])["joined"] == 0


def test_detection_of_a_touch_after_the_true_one_is_of_no_true_touch():
    event = make_event((10, 40))
    true = make_touch(10, 40)
    after = make_touch(45, 60, 2)
    found = score([event], [true, after], [detect(true, at(50)), detect(after, at(70))])
    assert (found["matched"], found["false"], found["opened after"]) == (1, 1, 1)
    assert found["false, of no true touch"] == 1
    assert found["poke"] == pytest.approx(0.2)


def test_wrong_answer_of_the_right_touch_is_false_but_of_a_true_touch():
    true = make_touch(10, 40)
    wrong = detect(true, at(50), "double_pat")
    found = score([make_event((10, 40))], [true], [wrong])
    assert (found["missed"], found["false"]) == (1, 1)
    assert found["false, of no true touch"] == 0


def test_contact_far_away_belongs_to_no_true_touch():
    away = make_touch(10, 40, place=np.array([0.5, 0.0, 0.0]))
    found = score([make_event((10, 40))], [away])
    assert found["felt"] == 0 and found["opened beside"] == 1


def make_state(stamp, *touches) -> Any:
    """Return the state of a reading with touches, given as ids and where they went."""
    contact = SimpleNamespace(p_world=HERE, force=1.0)
    every = tuple(
        SimpleNamespace(
            id=number,
            last=stamp,
            merged_into=into,
            closed=into is not None,
            contact=contact,
        )
        for number, into in touches
    )
    reading = SimpleNamespace(stamp=stamp)
    return SimpleNamespace(
        reading=reading,
        touches=[touch for touch in every if not touch.closed],
        closed_touches=[touch for touch in every if touch.closed],
    )


def test_merged_touch_is_part_of_the_one_that_took_it():
    follower = Follower()
    follower.push(make_state(at(1), (1, None), (2, None)))
    follower.push(make_state(at(2), (1, None), (2, 1)))
    [touch] = follower.finish(at(9))
    assert touch.id == 1 and touch.members == {1, 2}
    assert len(touch.contacts) == 4 and touch.closed == at(9)


def test_decay_is_the_largest_of_what_is_left_of_earlier_values():
    rng = np.random.default_rng(0)
    most = rng.uniform(0.1, 1.0, 50)
    passed = np.cumsum(rng.uniform(0.0, 0.2, 50))
    expected = [
        max(most[k] * np.exp(passed[k] - passed[t]) for k in range(t + 1))
        for t in range(50)
    ]
    np.testing.assert_allclose(decay(most, passed), expected)


def test_creep_stays_on_a_taxel_and_less_on_those_around_and_never_lowers_signal():
    skin = build_grid_skin(3, 3, 0.008)
    signal = np.zeros((300, 9), np.float32)
    signal[:100, 4] = 2.0
    sensor = SimpleNamespace(conductance=signal.copy(), live=np.arange(9))
    passed = np.arange(300) * 0.01
    leave_creep(sensor, skin, np.full(300, 0.1), passed)  # type: ignore[arg-type]
    left = sensor.conductance
    assert (left >= signal).all()
    np.testing.assert_allclose(left[:100, 4], 2.0)
    expected = 0.2 * np.exp(-0.01 * np.arange(1, 201))
    np.testing.assert_allclose(left[100:, 4], expected, rtol=1e-5)
    assert (left[150, [1, 3, 5, 7]] < left[150, 4]).all()
    assert (left[150, [1, 3, 5, 7]] > left[150, [0, 2, 6, 8]]).all()
    assert (left[150] > 0.0).all()


@pytest.mark.parametrize("name", ["slow", "slower"])
def test_builds_of_slow_draws_release_in_their_range(name):
    draw = DRAWS[name]
    assert draw.fall is not None
    low, high = draw.fall
    constants = change_constants(draw)
    skin = build_grid_skin(2, 2, 0.01)
    rng = np.random.default_rng(0)
    for family in FAMILIES:
        build = draw_build("b", family, skin, constants, rng)
        assert build.flaws is not None
        assert low <= build.flaws.fall * np.log(9.0) <= high
        assert 0.6 <= constants.draw("stream.pause", rng) <= 0.8


@pytest.mark.slow
def test_stream_of_the_control_is_that_of_the_published_set_and_creep_adds_to_it():
    settings = GenerationSettings("streams-fresh", seed=1, clips=1)
    plan = replace(settings.plan_clips(settings.sessions[0])[1], seconds=12.0)
    simulator = Simulator()
    clip = make_clip(plan, simulator.env)
    control = CreepSimulator(simulator, False).make(plan)
    np.testing.assert_array_equal(control.counts, clip.counts)
    creeping = CreepSimulator(simulator, True).make(plan)
    assert creeping.counts.sum() > clip.counts.sum()
    assert [t.onset for t in creeping.truths] == [t.onset for t in clip.truths]


def test_figures_differ_by_nothing_from_themselves():
    events = [make_event((10, 40)), make_event((60, 90))]
    stream = ScoredStream(events, [], 9.0, "")
    joined = score_stream(stream, [make_touch(10, 90)], GESTURES)
    apart = score_stream(stream, [make_touch(10, 40)], GESTURES)
    streams = {"linear a": joined, "linear b": apart}
    table = compare({"old": {"slow": streams}, "new": {"slow": streams}})
    [row] = [line for line in table.splitlines() if "joined" in line]
    assert "0.250 (0.000 to 0.500)" in row and "+0.000 (+0.000 to +0.000)" in row


def test_presses_measure_the_release_of_the_pressure_with_a_small_error():
    nominal = Calibration.uniform(4, 4095, 100.0)
    square = replace(nominal, curve="divider", exponent=2.0)
    for calibration, true in ((nominal, 0.2), (square, 0.4)):
        names = (f"stream {number}" for number in range(200))
        found = [measure_release(calibration, 0.2, name) for name in names]
        errors = np.log([one.release_seconds for one in found]) - np.log(true)
        assert abs(errors.mean()) < 0.05 and 0.1 < errors.std() < 0.2


def test_builds_of_a_kind_are_compared_by_themselves():
    one = score_stream(ScoredStream([make_event((1, 9))], [], 9.0, ""), [], GESTURES)
    streams = {"linear a": one, "linear b": one, "divider c": one}
    rows = compare({"old": {"slow": streams}}, by_kind=True).splitlines()
    assert any("| slow, linear | 2 streams, 2 touches" in row for row in rows)
    assert any("| slow, divider | 1 streams, 1 touches" in row for row in rows)


def test_unknown_draw_is_refused():
    with pytest.raises(SystemExit, match="--only has 'old'; allowed are slow"):
        main(["compare", "a.json", "--only", "old"])
