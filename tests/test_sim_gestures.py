"""These tests check what each gesture does: its forces, places and peaks in time."""

import numpy as np
import pytest

from eskin.sim.contact.press import ContactSite
from eskin.sim.people.perform import PERFORMABLE
from helpers.simulation import CONSTANTS, SITE, draw_people, perform_many

STEP = CONSTANTS.value("time.step")
KINDS = [
    (gesture, kind)
    for gesture in PERFORMABLE
    for kind in (CONSTANTS.weights("none.kinds") if gesture == "none" else [None])
]


def count_peaks(force, share):
    """Return how often a force rises above a share of its largest value."""
    above = force > share * force.max()
    return int(np.sum(above[1:] & ~above[:-1]))


def get_force(touch):
    return sum(press.force for press in touch.presses)


@pytest.mark.slow
@pytest.mark.parametrize(("gesture", "kind"), KINDS)
@pytest.mark.parametrize("difficulty", [0.0, 2.0])
def test_forces_are_positive_between_zeros_and_all_that_varies_is_recorded(
    gesture, kind, difficulty
):
    for touch in perform_many(gesture, kind, difficulty, None, 20):
        for press in touch.presses:
            assert press.first == 0
            assert press.force[0] == 0 == press.force[-1]
            assert press.force.min() >= 0 < press.force.max()
            assert press.centre.shape == (press.steps, 2)
            assert press.angle.shape == (press.steps,)
            assert np.isfinite(press.centre).all()
        assert touch.drawn["regime"] in ("paper", "cost")
        assert all(isinstance(value, float | str) for value in touch.drawn.values())
        touches_nothing = kind in ("idle", "electrical")
        assert (not touch.presses) == touches_nothing
        assert touch.subject == "" or not touches_nothing


@pytest.mark.parametrize("gesture", ["poke", "grab", "stroke"])
def test_recorded_force_is_the_largest_of_the_touch(gesture):
    for touch in perform_many(gesture, count=100):
        assert get_force(touch).max() == pytest.approx(touch.drawn["force"])


@pytest.mark.parametrize("gesture", ["poke", "double_pat", "grab"])
def test_touch_begins_on_its_target(gesture):
    for touch in perform_many(gesture, None, 1.5, count=100):
        np.testing.assert_allclose(touch.presses[0].centre[0], SITE.centre)


def find_middle(force):
    """Return the middle of the steps in which a force is above half its maximum."""
    return np.flatnonzero(force > force.max() / 2)[[0, -1]].mean()


def test_double_pat_has_two_peaks_at_the_recorded_interval():
    left = []
    for touch in perform_many("double_pat", None, 1.0):
        if touch.drawn["more"]:
            continue
        force = get_force(touch)
        half = len(force) // 2
        first = np.argmax(force[:half])
        second = half + np.argmax(force[half:])
        weaker = min(force[first], force[second])
        assert force[first : second + 1].min() <= weaker / 2 * (1 + 1e-9)
        left.append(np.any(force[1:-1] == 0))
        # A push that rises faster than it falls has its middle earlier than its mate.
        apart = 0.02 + 0.15 * touch.drawn["contact"]
        between = half + find_middle(force[half:]) - find_middle(force[:half])
        assert between * STEP == pytest.approx(touch.drawn["interval"], abs=apart)
        assert 0.15 <= touch.drawn["interval"] <= 0.7
    assert np.mean(left) == pytest.approx(0.85, abs=0.06)


@pytest.mark.parametrize(("radius", "share"), [(0.0375, 1.02), (0.0505, 0.6)])
def test_grab_wraps_across_the_tube_and_is_weaker_on_wider_tubes(radius, share):
    site = ContactSite(0, (0.1, 0.15), radius, (-0.12, 0.1), 0.4)
    touches = perform_many("grab", None, 2.0, count=100, site=site)
    for touch, person in zip(touches, draw_people(), strict=False):
        assert touch.drawn["largest"] <= share * person.grip
        assert get_force(touch).max() <= touch.drawn["largest"] * (1 + 1e-9)
        press = touch.presses[0]
        assert press.tissue.conformity >= 0.95
        assert abs(np.cos(press.angle[0])) <= np.sin(np.deg2rad(17.3))
        assert np.sin(press.angle[0]) > 0


def test_stroke_passes_its_target_within_its_room_at_the_speed_of_a_hand():
    speeds = []
    returns = []
    slow = []
    for touch in perform_many("stroke", count=300):
        drawn = touch.drawn
        press = touch.presses[0]
        slip = 8 * drawn["hand.wander"]
        for each in touch.presses:
            along = each.centre[:, 1] - SITE.centre[1]
            assert along.min() >= SITE.free_run[0] - slip
            assert along.max() <= SITE.free_run[1] + slip
        away = np.mean([each.centre for each in touch.presses], axis=0) - SITE.centre
        assert np.ptp(away[:, 0]) <= np.pi * SITE.radius + 2 * slip
        assert np.linalg.norm(away, axis=1).min() <= slip + drawn["length"] / 4
        speeds.append(drawn["speed"])
        returns.append(drawn["return"])
        first, last = np.flatnonzero(press.force > press.force.max() / 2)[[0, -1]]
        if press.steps > 40 and drawn["stroke.fall"] > 0.3:
            slow.append(press.steps - last > first)
    assert max(speeds) <= 0.4 and min(speeds) > 0.01
    assert np.median(speeds) == pytest.approx(0.08, abs=0.02)
    # Three standard errors of 300 touches.
    assert np.mean(returns) == pytest.approx(0.3, abs=0.08)
    # The hand lifts off slowly, but for a ripple that raises the end of a few.
    assert np.mean(slow) > 0.9


def test_bump_is_a_mass_on_a_spring_or_a_short_push():
    makes = set()
    for touch in perform_many("none", "bump", count=100):
        drawn = touch.drawn
        make = drawn["none.bump.makes"]
        makes.add(make)
        force = get_force(touch)
        assert force.max() == pytest.approx(drawn["force"])
        if make == "impact":
            mass = drawn["none.bump.mass"]
            stiffness = drawn["none.bump.stiffness"] * 1e3
            top = drawn["none.bump.speed"] * np.sqrt(mass * stiffness)
            assert drawn["force"] == pytest.approx(top)
            seconds = np.pi * np.sqrt(mass / stiffness)
            assert drawn["duration"] == pytest.approx(seconds)
    assert makes == {"impact", "push"}


def test_bump_that_bounces_hits_again_more_weakly_and_sooner():
    hits = set()
    for touch in perform_many("none", "bump", count=100):
        force = get_force(touch)
        pressed = np.concatenate([[False], force > 0, [False]]).astype(int)
        firsts = np.flatnonzero(np.diff(pressed) == 1)
        ends = np.flatnonzero(np.diff(pressed) == -1)
        peaks = [force[a:b].max() for a, b in zip(firsts, ends, strict=True)]
        assert len(peaks) == int(touch.drawn["none.bump.hits"])
        share = touch.drawn["none.bump.restitution"]
        np.testing.assert_allclose(np.divide(peaks[1:], peaks[:-1]), share)
        pauses = firsts[1:] - ends[:-1]
        assert (np.diff(pauses) <= 0).all()
        hits.add(len(peaks))
    assert hits == {1, 2, 3}


@pytest.mark.parametrize(
    ("radius", "free_run"), [(np.inf, (-0.1, 0.1)), (0.05, (0.0, 0.0))]
)
@pytest.mark.parametrize(
    ("gesture", "kind"),
    [
        ("poke", None),
        ("stroke", None),
        ("rub", None),
        ("none", "guiding"),
        ("none", "brush"),
    ],
)
def test_gestures_fit_a_plane_and_a_site_without_room(gesture, kind, radius, free_run):
    site = ContactSite(2, (0.0, 0.0), radius, free_run, -2.0)
    for touch in perform_many(gesture, kind, 1.5, None, 20, site):
        for press in touch.presses:
            assert press.chart == 2
            assert np.abs(press.centre).max() < 0.5
            assert np.isfinite(press.force).all()


def test_cable_lies_still_but_for_its_swing_of_millimetres():
    for touch in perform_many("none", "cable", count=50):
        (press,) = touch.bodies
        away = np.hypot(*(press.centre - SITE.centre).T)
        assert 0.0 < np.ptp(away) and away.max() <= 0.004
        assert press.anchor is not None and press.anchor.centre == SITE.centre


@pytest.mark.parametrize(
    ("gesture", "kind", "stands"),
    [("none", "brush", True), ("none", "lean", False), ("stroke", None, False)],
)
def test_only_what_stands_has_an_anchor(gesture, kind, stands):
    for touch in perform_many(gesture, kind, count=10):
        assert all((press.anchor is not None) == stands for press in touch.bodies)
