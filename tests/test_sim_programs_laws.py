from functools import cache

import numpy as np
import pytest

from eskin.sim.constants import load_constants
from eskin.sim.contact.press import ContactSite
from eskin.sim.people.gesture_sample import GestureSample, draw_duration, draw_force
from eskin.sim.people.perform import choose_kind, perform
from eskin.sim.people.person import draw_person

CONSTANTS = load_constants()
STEP = CONSTANTS.value("time.step")
SITE = ContactSite(0, (0.1, 0.15), 0.0375, (-0.12, 0.1), 0.4)


@cache
def people(count=2000):
    rng = np.random.default_rng(5)
    return [draw_person(f"p{index}", CONSTANTS, rng) for index in range(count)]


def acts(difficulty=0.0, regime="paper", same=False):
    """One act of each person, or as many of one person."""
    rng = np.random.default_rng(11)
    for person in people()[:1] * 2000 if same else people():
        yield GestureSample("", person, SITE, CONSTANTS, rng, difficulty, regime)


def forces(gesture, difficulty=0.0, same=False):
    name = f"{gesture}.force"
    return np.array(
        [draw_force(act, name, gesture) for act in acts(difficulty, same=same)]
    )


@cache
def many(gesture, kind=None, difficulty=0.0, regime="paper", count=500):
    rng = np.random.default_rng(11)
    return [
        perform(gesture, kind, person, SITE, CONSTANTS, rng, difficulty, regime)
        for person in people()[:count]
    ]


def durations(touches):
    return np.array([(each.presses[0].steps - 1) * STEP for each in touches])


def gsd(numbers):
    return np.exp(np.log(numbers).std())


@pytest.mark.parametrize(
    ("gesture", "median", "spread"),
    [
        ("poke", 4.0, 1.8),
        ("double_pat", 5.0, 1.7),
        ("grab", 40.0, 1.8),
        ("stroke", 3.0, 2.0),
    ],
)
def test_forces_have_the_law_of_their_constant(gesture, median, spread):
    found = forces(gesture)
    assert np.median(found) == pytest.approx(median, rel=0.06)
    assert gsd(found) == pytest.approx(spread, rel=0.05)


@pytest.mark.parametrize("gesture", ["poke", "grab", "stroke"])
def test_the_force_drawn_is_the_largest_of_the_touch(gesture):
    for touch in many(gesture, count=100):
        top = touch.presses[0].force.max()
        assert top == pytest.approx(touch.drawn["force"])


def test_difficulty_spreads_the_touches_of_one_person_and_of_all():
    easy, hard = (forces("poke", level, same=True) for level in (0.0, 2.0))
    assert gsd(easy) == pytest.approx(1.3, rel=0.03)
    assert gsd(hard) == pytest.approx(1.6, rel=0.03)
    assert gsd(forces("poke", 2.0)) > 1.08 * gsd(forces("poke"))


@pytest.mark.parametrize("difficulty", [0.0, 1.5])
def test_touches_are_as_short_as_published(difficulty):
    short = {
        gesture: np.mean([draw_duration(act, gesture) < 1 for act in acts(difficulty)])
        for gesture in ("poke", "grab", "stroke")
    }
    assert 0.60 <= (short["grab"] + short["stroke"]) / 2 <= 0.66
    assert short["poke"] == 1.0
    pats = many("double_pat", None, difficulty)
    two = [touch for touch in pats if not touch.drawn["more"]]
    assert np.mean(durations(two) < 1) >= 0.98


@pytest.mark.parametrize("gesture", ["grab", "stroke"])
def test_nearly_all_gestures_fit_a_window_however_difficult(gesture):
    lasting = [draw_duration(act, gesture) for act in acts(2.0)]
    assert np.mean(np.array(lasting) < 2) >= 0.965


def test_touches_last_as_long_as_what_was_drawn_for_them():
    for touch in many("stroke", count=100):
        assert durations([touch])[0] == pytest.approx(
            touch.drawn["duration"], abs=STEP / 2 + 1e-9
        )


def test_gestures_last_longer_in_the_order_of_jung_et_al_2017():
    lasting = {
        name: np.median(durations(many(gesture, kind, 0.0, "cost", 400)))
        for name, gesture, kind in (
            ("tap", "none", "single_pat"),
            ("poke", "poke", None),
            ("pat", "double_pat", None),
            ("press", "none", "press"),
            ("grab", "grab", None),
            ("stroke", "stroke", None),
        )
    }
    assert lasting["poke"] == pytest.approx(lasting["pat"], rel=0.1)
    for shorter, longer in (
        ("tap", "poke"),
        ("tap", "pat"),
        ("poke", "press"),
        ("press", "grab"),
        ("grab", "stroke"),
    ):
        assert lasting[shorter] < lasting[longer]


def test_strokes_go_along_round_and_oblique_as_often_as_published():
    paths = [touch.drawn["stroke.path"] for touch in many("stroke")]
    for name, weight in CONSTANTS.weights("stroke.path").items():
        assert paths.count(name) / len(paths) == pytest.approx(weight, abs=0.05)


def ways(person, gesture, difficulty, rng):
    return choose_kind(gesture, None, person, CONSTANTS, rng, difficulty)


def test_harder_tasks_take_rarer_ways():
    rng = np.random.default_rng(2)
    rare = [
        np.mean([ways(person, "poke", hard, rng) != "one_tip" for person in people()])
        for hard in (0.0, 2.0)
    ]
    usual = 1 - CONSTANTS.weights("poke.kinds")["one_tip"]
    assert rare[0] == pytest.approx(usual, abs=0.03)
    assert rare[1] == pytest.approx(usual * 0.7 + 0.3, abs=0.03)


def test_kinds_of_nothing_come_as_often_as_they_should():
    rng = np.random.default_rng(2)
    kinds = [ways(person, "none", 0.0, rng) for person in people()]
    for name, weight in CONSTANTS.weights("none.kinds").items():
        assert kinds.count(name) / len(kinds) == pytest.approx(weight, abs=0.03)


def test_a_finger_that_presses_longer_than_any_poke_is_no_gesture():
    longest = durations(many("poke", difficulty=1.5, regime="cost")).max()
    presses = many("none", "press", 1.5, "paper")
    fingers = [each for each in presses if len(each.presses[0].pads.centres) <= 2]
    assert longest <= 0.8 + STEP < durations(fingers).min()


def test_a_single_pat_is_of_more_than_two_fingers():
    for touch in many("none", "single_pat", 1.5, "paper"):
        assert len(touch.presses[0].pads.centres) > 2
