from dataclasses import asdict

import numpy as np
import pytest

from eskin.sim.constants import load_constants
from eskin.sim.contact.press import Press
from eskin.sim.contact.pressure import compute_pad_offsets
from eskin.sim.people.hand import HAND_PADS
from eskin.sim.people.person import STYLE_CONSTANTS, draw_person
from eskin.skin import Tube

CONSTANTS = load_constants()


@pytest.fixture(scope="module")
def people():
    rng = np.random.default_rng(7)
    return [draw_person(f"p{index}", CONSTANTS, rng) for index in range(2000)]


def column(people, name):
    return np.array([getattr(person, name) for person in people])


def test_hands_are_as_large_as_those_measured(people):
    men = [person for person in people if person.sex == "man"]
    women = [person for person in people if person.sex == "woman"]
    assert len(women) == pytest.approx(1000, abs=80)
    for group, length, breadth, palm, acromion in (
        (men, 0.1933, 0.0883, 0.1165, 1.441),
        (women, 0.1811, 0.0782, 0.1087, 1.335),
    ):
        assert column(group, "hand_length").mean() == pytest.approx(length, rel=0.006)
        assert column(group, "hand_breadth").mean() == pytest.approx(breadth, rel=0.006)
        assert column(group, "palm_length").mean() == pytest.approx(palm, rel=0.006)
        height = column(group, "acromion_height")
        assert height.mean() == pytest.approx(acromion, rel=0.006)
    assert column(men, "hand_length").std() == pytest.approx(0.0099, rel=0.08)


def test_sizes_of_a_hand_go_together_as_measured(people):
    men = [person for person in people if person.sex == "man"]
    length = column(men, "hand_length")
    for name, expected in (
        ("hand_breadth", 0.58),
        ("palm_length", 0.79),
        ("acromion_height", 0.67),
    ):
        found = np.corrcoef(length, column(men, name))[0, 1]
        assert found == pytest.approx(expected, abs=0.06)


def test_scales_have_their_medians_and_spreads(people):
    for name, median, gsd in (
        ("force_scale", 1.0, 1.45),
        ("tempo_scale", 1.0, 1.22),
        ("pat_interval", 0.28, 1.2),
    ):
        drawn = column(people, name)
        assert np.median(drawn) == pytest.approx(median, rel=0.04)
        assert np.exp(np.log(drawn).std()) == pytest.approx(gsd, rel=0.03)
    kappa = np.array([person.tissue.conformity for person in people])
    assert kappa.min() >= 0.1 and kappa.max() <= 0.98
    assert kappa.mean() == pytest.approx(0.51, abs=0.02)
    assert kappa.std() == pytest.approx(0.2, abs=0.02)


def test_flesh_is_in_newton_and_metre(people):
    stiffness = np.median([person.tissue.b for person in people])
    growth = np.median([person.tissue.m for person in people])
    assert stiffness == pytest.approx(190, rel=0.05)
    assert growth == pytest.approx(2100, rel=0.05)


def test_styles_are_weights_that_average_to_everybodys_and_differ_widely(people):
    for name in STYLE_CONSTANTS:
        usual = CONSTANTS.weights(name)
        own = np.array([[*person.styles[name].values()] for person in people])
        np.testing.assert_allclose(own.sum(axis=1), 1)
        np.testing.assert_allclose(own.mean(axis=0), [*usual.values()], atol=0.02)
        assert own.std(axis=0).max() > 0.15


def test_nine_in_ten_touch_with_the_right_hand(people):
    right = np.mean([person.right_handed for person in people])
    assert right == pytest.approx(0.9, abs=0.02)


def test_the_thumb_of_a_right_hand_lies_left_of_it_seen_from_outside(people):
    tube = Tube(0.04, np.eye(4))
    thumb, little, middle, palm = (
        HAND_PADS.index(f"{name}")
        for name in ("thumb_tip", "little_head", "middle_tip", "palm")
    )
    for person in people[:100]:
        force, still = np.ones(1), np.zeros((1, 2))
        press = Press(0, 0, person.hand, person.tissue, force, still, np.array([0.7]))
        laid = tube.wrap(compute_pad_offsets(press)[0])
        across = laid.positions[thumb] - laid.positions[little]
        along = laid.positions[middle] - laid.positions[palm]
        upward = np.cross(across, along) @ laid.normals[palm]
        assert (upward < 0) == person.right_handed


def test_parts_are_picked_by_name(people):
    assert people[0].select_pads("tips").count == 4
    with pytest.raises(ValueError, match="no parts 'tail'"):
        people[0].select_pads("tail")


def test_the_same_seed_draws_the_same_person():
    one, two = (draw_person("a", CONSTANTS, np.random.default_rng(3)) for _ in "ab")
    np.testing.assert_equal(asdict(one), asdict(two))
