"""These tests check recorded touches of people that are placed on a simulated skin."""

from collections import Counter

import numpy as np
import pytest

from eskin.errors import GenerationError
from eskin.recording import find_recordings, read_recording
from eskin.sets.socialtouch import (
    GESTURES,
    GROUP_NUMBERS,
    Repetition,
    classify_repetition,
)
from eskin.sim import load_constants
from eskin.sim.contact.press import ContactSite, MoviePress
from eskin.sim.contact.pressure import compute_movie_field, compute_movie_force
from eskin.sim.dataset import GenerationSettings, generate, read_index
from eskin.sim.people.recorded import (
    RecordedTouch,
    draw_recorded_touch,
    find_recorded_people,
    play_recorded_touch,
    read_recorded_touches,
)
from eskin.sim.sensor import FAMILIES
from helpers.contacts import CHARTS, force_on
from helpers.simulation import read_files
from helpers.socialtouch import pressed, text_of, write_socialtouch

CONSTANTS = load_constants()
SITE = ContactSite(0, (0.01, 0.02), np.inf, (0.0, 0.0), 0.0)


def repeat(gesture, counts, person=0, period=0.1):
    seconds = np.arange(len(counts)) * period
    return Repetition(person, GESTURES[gesture], seconds, counts)


def presses(*strengths, between=0.0):
    """Return the counts of presses in turn, of two readings each."""
    series = [0.0]
    for strength in strengths:
        series += [strength, strength, between]
    return np.outer(np.array([*series, 0.0]), pressed((0, 1), 1)[0]).astype(int)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with two repetitions of one gesture of each class and person."""
    found = tmp_path_factory.mktemp("socialtouch")
    counts = {0: pressed((3, 30), 40), 6: pressed(), 8: presses(1, 1), 18: pressed()}
    for person in (0, 1):
        for gesture, one in counts.items():
            text = text_of([one, one + 5 * person], person, gesture)
            name = f"touch_p{person}_g{gesture}-20_4_17h_5m_2{person}s.csv"
            write_socialtouch(found, name, text)
    return found


def test_classes_are_the_groups_of_gestures_where_that_is_wanted(tmp_path):
    for numbers in GROUP_NUMBERS.values():
        name = f"touch_p0_g{numbers[-1]}-20_4_17h_5m_20s.csv"
        write_socialtouch(tmp_path, name, text_of([pressed()], 0, numbers[-1]))
    people = find_recorded_people(tmp_path, grouped=True)
    settings = GenerationSettings("recorded-groups", "post", clips=12, recorded=people)
    generate(tmp_path / "set", settings, 0)
    found = Counter(row.gesture for row in read_index(tmp_path / "set"))
    assert found == dict.fromkeys(GROUP_NUMBERS, 1)
    with pytest.raises(GenerationError, match="no .*of participant 0"):
        find_recorded_people(tmp_path)


def build_movie_press(centre, angle, pitch=0.008):
    """Build a press of a small movie with a bright spot that moves."""
    rng = np.random.default_rng(0)
    pressure = rng.uniform(0.0, 5.0, (3, 5, 6))
    pressure[[0, 1, 2], [1, 2, 3], [1, 3, 4]] = 80.0
    return MoviePress(
        chart=0,
        first=0,
        pressure=pressure,
        pitch=pitch,
        middle=(2.2, 2.6),
        force=compute_movie_force(pressure, pitch),
        centre=np.tile(np.array(centre), (3, 1)),
        angle=np.full(3, angle),
    )


@pytest.mark.parametrize("name", ["flat", "tube", "wide tube", "dome"])
@pytest.mark.parametrize("angle", [0.0, 0.7, -2.0])
def test_movie_keeps_its_force_and_its_place_on_dense_skin(name, angle):
    """The pressure is sampled at taxels, so a spot of one pixel is known to 5 %."""
    chart = CHARTS[name]
    field = compute_movie_field(
        build_movie_press((0.012, 0.01), angle), chart, CONSTANTS
    )
    np.testing.assert_allclose(force_on(field, chart), field.force, rtol=0.05)
    places = chart.unrolled[np.searchsorted(chart.taxels, field.taxels)]
    weights = field.pressure / field.pressure.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(weights @ places, field.centroid, atol=0.7e-3)


@pytest.mark.parametrize(
    ("gesture", "counts", "wanted"),
    [
        (6, pressed(), "poke"),
        (7, 0 * pressed(), None),
        (27, pressed(), "stroke"),
        (25, pressed(), "none"),
        (3, pressed((1, 15), 17), "none"),
        (3, pressed((1, 13), 15), None),
        (8, presses(1.0), "none"),
        (8, presses(1.0, 0.5), "double_pat"),
        (9, presses(1.0, 0.6, between=0.4), "none"),
        (12, pressed(), None),
        (31, pressed(), None),
    ],
)
def test_class_is_that_of_the_gesture_its_duration_and_its_presses(
    gesture, counts, wanted
):
    assert classify_repetition(repeat(gesture, counts)) == wanted


def play(counts, seed=0):
    touch = RecordedTouch("poke", "poke", 0, repeat(6, counts))
    return play_recorded_touch(touch, SITE, CONSTANTS, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(8))
def test_played_touch_is_the_recorded_one_in_the_drawn_size_and_speed(seed):
    counts = pressed((9, 12), 30)
    touch = play(counts, seed)
    (press,) = touch.presses
    drawn = touch.drawn
    assert isinstance(press, MoviePress)
    assert (touch.gesture, touch.kind, touch.subject) == ("poke", "poke_short", "P0")
    share = 200 / 255 - drawn["threshold"]
    force = 4 * share * drawn["full_scale"] * drawn["pitch"] ** 2 * 1e3
    assert press.force.max() == pytest.approx(force, rel=0.15)
    in_contact = 0.01 * np.count_nonzero(press.force) * drawn["speed"]
    assert 0.25 < in_contact < 0.42
    # Three tenths of a second are kept on both sides, and a reading in which it rises.
    assert press.steps * 0.01 * drawn["speed"] == pytest.approx(1.0, abs=0.13)
    assert not press.pressure[0].any()
    np.testing.assert_array_equal(press.centre[0], SITE.centre)


def test_none_is_drawn_evenly_over_its_groups():
    groups = {"arm": 100, "contact": 30, "pat": 2}
    held = repeat(0, pressed())
    names = [name for name, count in groups.items() for _ in range(count)]
    touches = [RecordedTouch("none", name, n, held) for n, name in enumerate(names)]
    rng = np.random.default_rng(0)
    drawn = Counter(
        draw_recorded_touch(touches, "P0", "none", rng).group for _ in range(800)
    )
    assert abs(drawn["arm"] - drawn["contact"]) < 100
    assert 10 < drawn["pat"] < 80


def test_set_has_the_people_asked_for_and_builds_of_all_kinds(folder):
    recorded = find_recorded_people(folder, [1])
    settings = GenerationSettings("recorded", clips=250, recorded=recorded)
    kinds = {session.build.kind for session in settings.sessions}
    assert kinds == {"fresh", *FAMILIES}
    plans = [p for s in settings.sessions for p in settings.plan_clips(s)[1:]]
    assert {plan.person.name for plan in plans} == {"P1"}
    assert set(Counter(plan.gesture for plan in plans).values()) == {62, 63}
    assert not any(plan.concurrent or plan.company for plan in plans)


def test_digest_is_of_the_touches_of_the_people_asked_for(folder):
    digests = [
        find_recorded_people(folder, people).digest
        for people in ([0], [1], None, [1, 0, 1])
    ]
    assert len(set(digests)) == 3
    assert digests[2] == digests[3]


@pytest.mark.slow
def test_generation_goes_on_with_the_same_touches(folder, tmp_path):
    settings = GenerationSettings(
        "recorded", "post", clips=4, recorded=find_recorded_people(folder)
    )
    generate(tmp_path / "a", settings, 0)
    files = read_files(tmp_path / "a")
    (tmp_path / "a" / "recorded-0001.mcap").unlink()
    generate(tmp_path / "a", settings, 0)
    assert files == read_files(tmp_path / "a")
    other = GenerationSettings(
        "recorded", "post", clips=4, recorded=find_recorded_people(folder, [0])
    )
    with pytest.raises(GenerationError, match="was generated with"):
        generate(tmp_path / "a", other)
    recordings = [read_recording(path) for path in find_recordings([tmp_path / "a"])]
    assert [r.metadata.subject for r in recordings] == ["P0", "P1"]
    touches = read_recorded_touches(folder)
    for row in read_index(tmp_path / "a"):
        (touch,) = row.touches
        assert touch.gesture == row.gesture
        assert (
            touch.kind == touches[int(row.drawn["touch0.recorded"])].repetition.gesture
        )
    labels = [x for r in recordings for x in r.labels if x.source == "true"]
    assert len(labels) == 4
