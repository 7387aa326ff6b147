import numpy as np
import pytest

from eskin.sim.constants import load_constants
from eskin.sim.contact.press import ContactSite
from eskin.sim.people.perform import PERFORMABLE, perform
from eskin.sim.people.person import draw_person

CONSTANTS = load_constants()
STEP = CONSTANTS.value("time.step")
SITE = ContactSite(0, (0.1, 0.15), 0.0375, (-0.12, 0.1), 0.4)
KINDS = [
    (gesture, kind)
    for gesture in PERFORMABLE
    for kind in (CONSTANTS.weights("none.kinds") if gesture == "none" else [None])
]


@pytest.fixture(scope="module")
def people():
    rng = np.random.default_rng(5)
    return [draw_person(f"p{index}", CONSTANTS, rng) for index in range(300)]


def many(people, gesture, kind=None, difficulty=0.0, regime="paper", site=SITE):
    rng = np.random.default_rng(11)
    return [
        perform(gesture, kind, person, site, CONSTANTS, rng, difficulty, regime)
        for person in people
    ]


@pytest.mark.parametrize(("gesture", "kind"), KINDS)
@pytest.mark.parametrize("difficulty", [0.0, 2.0])
def test_forces_are_never_negative_and_end_at_zero(people, gesture, kind, difficulty):
    touches = many(people[:40], gesture, kind, difficulty, None)
    for touch in touches:
        for press in touch.presses:
            assert press.first == 0
            assert press.force[0] == 0 == press.force[-1]
            assert press.force.min() >= 0 < press.force.max()
            assert press.centre.shape == (press.steps, 2)
            assert press.angle.shape == (press.steps,)
            assert np.isfinite(press.centre).all()


@pytest.mark.parametrize(("gesture", "kind"), KINDS)
def test_the_same_seed_does_the_same(people, gesture, kind):
    one, two = (many(people[:5], gesture, kind, 1.5, None) for _ in "ab")
    for first, second in zip(one, two, strict=True):
        assert first.drawn == second.drawn
        for a, b in zip(first.presses, second.presses, strict=True):
            assert a.force.tobytes() == b.force.tobytes()
            assert a.centre.tobytes() == b.centre.tobytes()
            assert a.pads.centres.tobytes() == b.pads.centres.tobytes()


def count_peaks(force, share):
    """Times that a force rises above a share of its largest value."""
    above = force > share * force.max()
    return int(np.sum(above[1:] & ~above[:-1]))


def two_pats(touches):
    """Those that are not of more pats."""
    return [touch for touch in touches if not touch.drawn["more"]]


def test_a_double_pat_has_two_peaks_and_mostly_leaves_between_them(people):
    left = []
    for touch in two_pats(many(people, "double_pat", None, 1.0)):
        force = touch.presses[0].force
        half = len(force) // 2
        first, second = np.argmax(force[:half]), half + np.argmax(force[half:])
        weaker = min(force[first], force[second])
        assert force[first : second + 1].min() <= weaker / 2 * (1 + 1e-9)
        left.append(np.any(force[1:-1] == 0))
    assert np.mean(left) == pytest.approx(0.85, abs=0.05)


def middle_of(force):
    """Middle of the time in which a force is above half of its largest value."""
    return np.flatnonzero(force > force.max() / 2)[[0, -1]].mean()


def test_pats_are_apart_by_what_was_drawn(people):
    for touch in two_pats(many(people[:200], "double_pat", None, 1.5, None)):
        force = touch.presses[0].force
        half = len(force) // 2
        first, second = middle_of(force[:half]), half + middle_of(force[half:])
        # A push that rises faster than it falls has its middle earlier than its mate.
        apart = 0.02 + 0.15 * touch.drawn["contact"]
        found = (second - first) * STEP
        assert found == pytest.approx(touch.drawn["interval"], abs=apart)
        assert 0.15 <= touch.drawn["interval"] <= 0.7


def test_many_taps_count_as_a_double_pat_with_more_peaks(people):
    for touch in many(people[:100], "tap_many"):
        assert (touch.gesture, touch.kind) == ("double_pat", "tap_many")
        taps = int(touch.drawn["unknown.taps"])
        assert taps >= 3 and count_peaks(touch.presses[0].force, 0.02) == taps


def test_a_single_pat_has_one_peak(people):
    for touch in many(people[:100], "none", "single_pat"):
        assert count_peaks(touch.presses[0].force, 0.3) == 1


def test_no_grab_is_firmer_than_the_person_can_and_wider_tubes_take_strength(people):
    wide = ContactSite(0, (0.0, 0.1), 0.0505, (-0.1, 0.1), 0.0)
    for site, weaker in ((SITE, 1.02), (wide, 0.6)):
        for touch in many(people[:500], "grab", None, 2.0, "paper", site):
            person = people[int(touch.subject[1:])]
            assert touch.drawn["largest"] <= weaker * person.grip
            assert touch.presses[0].force.max() <= touch.drawn["largest"] * (1 + 1e-9)


def test_grabs_wrap_and_lie_across_the_tube(people):
    for touch in many(people[:300], "grab", None, 1.5):
        press = touch.presses[0]
        assert press.tissue.conformity >= 0.95
        assert abs(np.cos(press.angle[0])) <= np.sin(np.deg2rad(17.3))
        assert np.sin(press.angle[0]) > 0


@pytest.mark.parametrize("gesture", ["poke", "double_pat", "grab"])
def test_a_touch_begins_on_its_target(people, gesture):
    for touch in many(people[:100], gesture, None, 1.5):
        np.testing.assert_allclose(touch.presses[0].centre[0], SITE.centre)


def test_a_stroke_passes_its_target_within_its_room_at_a_hands_speed(people):
    speeds, returns = [], []
    for touch in many(people, "stroke"):
        drawn, press = touch.drawn, touch.presses[0]
        slip = 8 * drawn["hand.wander"]
        away = press.centre - SITE.centre
        assert away[:, 1].min() >= SITE.free_run[0] - slip
        assert away[:, 1].max() <= SITE.free_run[1] + slip
        assert np.ptp(away[:, 0]) <= np.pi * SITE.radius + 2 * slip
        assert np.linalg.norm(away, axis=1).min() <= slip + drawn["length"] / 4
        speeds.append(drawn["speed"])
        returns.append(drawn["return"])
    assert max(speeds) <= 0.4 and min(speeds) > 0.01
    assert np.median(speeds) == pytest.approx(0.11, abs=0.02)
    # Three standard errors of 300 touches.
    assert np.mean(returns) == pytest.approx(0.2, abs=0.07)


def test_a_stroke_starts_and_ends_at_rest_and_lifts_off_slowly(people):
    slowly = []
    for touch in many(people[:200], "stroke"):
        force = touch.presses[0].force
        first, last = np.flatnonzero(force > force.max() / 2)[[0, -1]]
        if len(force) > 40 and touch.drawn["stroke.fall"] > 0.3:
            slowly.append(len(force) - last > first)
    # A ripple may raise the end of a few.
    assert np.mean(slowly) > 0.9


def test_a_bump_is_a_mass_on_a_spring(people):
    for touch in many(people[:300], "none", "bump"):
        drawn = touch.drawn
        mass, stiffness = drawn["none.bump.mass"], drawn["none.bump.stiffness"] * 1e3
        speed = drawn["none.bump.speed"]
        top = touch.presses[0].force.max()
        assert top == pytest.approx(speed * np.sqrt(mass * stiffness))
        assert drawn["duration"] == pytest.approx(np.pi * np.sqrt(mass / stiffness))
        tops = count_peaks(touch.presses[0].force, 0.1)
        assert tops == 1 + drawn["rebound"]


def test_idle_and_electrical_clips_press_nothing(people):
    for kind in ("idle", "electrical"):
        touch = many(people[:1], "none", kind)[0]
        assert touch.presses == () and touch.subject == ""


def test_two_hands_guide_and_share_the_force(people):
    for touch in many(people[:50], "none", "guiding"):
        first, second = touch.presses
        assert second.centre[0, 1] > first.centre[0, 1]
        total = first.force.max() + second.force.max()
        assert total == pytest.approx(touch.drawn["none.guiding.force"])


def test_what_was_drawn_is_all_there_and_plain(people):
    for gesture, kind in KINDS:
        touch = many(people[:1], gesture, kind)[0]
        assert touch.drawn["regime"] == "paper"
        assert all(isinstance(value, float | str) for value in touch.drawn.values())


def test_a_multiplied_constant_multiplies_the_force(people):
    firmer = CONSTANTS.scaled({"poke.force": 2.0})
    person, rng = people[0], np.random.default_rng
    one, two = (
        perform("poke", "one_tip", person, SITE, numbers, rng(1), 0.0, "paper")
        for numbers in (CONSTANTS, firmer)
    )
    top = [touch.presses[0].force.max() for touch in (one, two)]
    assert top[1] == pytest.approx(2 * top[0])


@pytest.mark.parametrize(
    ("gesture", "kind", "difficulty", "message"),
    [
        ("wave", None, 0.0, "no gesture 'wave'"),
        ("poke", "elbow", 0.0, "no kind 'elbow' of poke"),
        ("rub", "elbow", 0.0, "no kind 'elbow' of rub"),
        ("poke", None, -1.0, "give 0 or more"),
    ],
)
def test_what_is_not_known_is_refused(people, gesture, kind, difficulty, message):
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=message):
        perform(gesture, kind, people[0], SITE, CONSTANTS, rng, difficulty, None)


@pytest.mark.parametrize("gesture", ["poke", "stroke", "rub", "none"])
def test_gestures_work_on_a_plane_and_where_there_is_no_room(people, gesture):
    for radius, clear in ((np.inf, (-0.1, 0.1)), (0.05, (0.0, 0.0))):
        site = ContactSite(2, (0.0, 0.0), radius, clear, -2.0)
        kinds = ["guiding", "brush"] if gesture == "none" else [None]
        for kind in kinds:
            for touch in many(people[:40], gesture, kind, 1.5, None, site):
                for press in touch.presses:
                    assert press.chart == 2
                    assert np.abs(press.centre).max() < 0.5
                    assert np.isfinite(press.force).all()


def test_a_site_must_hold_its_own_centre():
    with pytest.raises(ValueError, match="does not contain the centre"):
        ContactSite(0, (0.0, 0.0), 0.04, (0.05, 0.1), 0.0)
