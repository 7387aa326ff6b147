"""These tests check the interactive skin, the hand that touches it, and the player."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from eskin.sim.dataset.clip import get_session, simulate_clip
from eskin.sim.dataset.plan import Origin
from eskin.sim.interactive import InteractiveSkin, LinkPoint, TouchPlayer
from eskin.sim.interactive.player import LEAD_SECONDS, SEGMENT_SECONDS
from eskin.sim.interactive.touches import PerformedTouch
from eskin.sim.people.perform import perform
from eskin.sim.scene.motion import follow_with_delay
from eskin.sim.scene.scene import TouchScene
from eskin.sim.sensor.build import draw_build
from eskin.sim.sensor.model import SensorStages
from eskin.sim.sensor.noise import ReadingLosses
from eskin.sim.sensor.sensor import Sensor
from eskin.touch import ContactConfig, FrontEnd
from eskin.transforms import apply
from helpers.sensors import CONSTANTS
from helpers.simulation import RATE, StandIn, build_small_simulator
from helpers.touch import build_grid_skin

Q = np.array([0.3, -1.2, 1.0, -1.0, -1.5, 0.2])
SWAY = np.array([0.1, 0.05, -0.1, 0.2, 0.0, 0.1])
PERIOD = 1_000_000_000 // RATE
STRETCH = round(RATE * SEGMENT_SECONDS)
LEAD = round(RATE * LEAD_SECONDS)


def stand(_):
    return Q


def sway(reading):
    return Q + SWAY * np.sin(0.05 * reading)


def find_point(live, patch, number=40):
    """Return the place of one taxel of a patch."""
    skin = live.mounted.skin
    taxel = skin.find_taxels(patch)[number]
    link = skin.patches[skin.patch_index[taxel]].link
    return LinkPoint(link, skin.positions[taxel].astype(float))


def find_forearm_ends(live):
    """Return two points on the forearm, far apart along it."""
    skin = live.mounted.skin
    row = skin.find_taxels("forearm_back")
    ends = row[skin.columns[row] == 8][[3, -4]]
    return [LinkPoint("forearm_link", skin.positions[i].astype(float)) for i in ends]


def scan_many(live, readings, motion=stand):
    """Return scans and the true touches of each."""
    found = []
    for reading in range(readings):
        scan = live.scan(PERIOD * (reading + 1), motion(reading))
        found.append((scan, live.hand.truths()))
    return found


def sum_forces(found):
    return np.array([sum(truth.force for truth in truths) for _, truths in found])


def locate_force(live, truth, q):
    """Return where the force of a touch acts, in its link's frame [m]."""
    T = live.mounted.kinematics.poses(q)[live.mounted.robot.link_index(truth.link)]
    return apply(np.linalg.inv(T), np.array(truth.p_world)[None])[0]


def test_losses_are_the_same_one_by_one_as_at_once_but_for_the_first_state():
    skin = build_grid_skin(6, 6, patches=2)
    build = draw_build("b", "shifted", skin, CONSTANTS, np.random.default_rng(5))
    defects = replace(build.defects, dropped=0.2)
    one, two = (
        ReadingLosses(defects, 2, np.random.default_rng(4), SensorStages())
        for _ in range(2)
    )
    at_once = one.draw_all(4000)
    one_by_one = np.concatenate([two.draw_next() for _ in range(4000)])
    assert one_by_one.mean() == pytest.approx(0.2, abs=0.03)
    met = np.flatnonzero((at_once == one_by_one).all(axis=1))[0]
    np.testing.assert_array_equal(at_once[met:], one_by_one[met:])


@pytest.mark.parametrize(
    ("gesture", "kind", "motion"),
    [("grab", None, stand), ("stroke", None, sway), ("none", "cable", sway)],
)
def test_touch_gives_the_counts_and_truth_of_a_clip(gesture, kind, motion):
    live = InteractiveSkin(seed=2)
    env = live.env
    steps = 200
    delay = 0.2
    session = get_session(Origin("s", (1,)), live.build)
    stages = SensorStages(skew=False, faults=False)
    skin = live.mounted.skin
    person = live.hand.person
    live.sensor = Sensor(live.build, skin, np.random.default_rng(8), stages, session)
    site = live.hand.find_site("stroke", None, find_point(live, "forearm_back"), person)
    rng = np.random.default_rng(0)
    touch = perform(gesture, kind, person, site, env.constants, rng, 1.5, None)
    live.hand.add_touch(PerformedTouch(touch, delay, env))
    found = scan_many(live, steps // 2, motion)
    at = np.arange(-1, steps // 2)
    q = np.array([motion(max(reading, 0)) for reading in at])
    between = np.arange(steps) / 2 - 0.5
    q = np.stack([np.interp(between, at, each) for each in q.T], axis=1)
    presses = tuple(follow_with_delay(p, env, q, delay) for p in touch.presses)
    scene = TouchScene(q, (replace(touch, presses=presses),))
    clip, exact = (
        simulate_clip(
            scene, lead, live.build, session, env, np.random.default_rng(8), stages
        )
        for lead in (1, 0)
    )
    counts = np.array([scan.counts for scan, _ in found[: len(clip.counts)]])
    assert np.abs(counts - clip.counts).max() <= 1
    assert (counts != clip.counts).mean() < 1e-5
    assert (clip.counts != clip.counts[0]).any()
    np.testing.assert_allclose(sum_forces(found), exact.truths[0].force, atol=1e-9)


@pytest.mark.parametrize(
    ("what", "force", "seconds"),
    [("poke", 6.0, 0.6), ("double_pat", 8.0, 0.6), ("grab", 30.0, 0.8)],
)
def test_touch_has_the_requested_force_and_duration(what, force, seconds):
    live = InteractiveSkin()
    getattr(live.hand, what)(find_point(live, "forearm_back", 90), force, seconds)
    forces = sum_forces(scan_many(live, 60))
    assert forces.max() == pytest.approx(force, rel=0.03)
    assert np.ptp(np.flatnonzero(forces)) * 0.02 == pytest.approx(seconds, abs=0.05)
    assert live.hand.touching == ()


def test_grab_is_no_firmer_than_the_person_can():
    live = InteractiveSkin()
    live.hand.grab(find_point(live, "forearm_back", 90), 900.0, 0.8)
    assert 40.0 < sum_forces(scan_many(live, 60)).max() < 400.0


@pytest.mark.parametrize(
    ("patch", "motion"),
    [("forearm_back", stand), ("upper_arm_back", sway), ("wrist_1", sway)],
)
def test_poke_is_felt_at_its_place_and_nothing_without_it(patch, motion):
    live = InteractiveSkin()
    front_end = FrontEnd(live.mounted.skin, live.calibration)
    for reading, (scan, truths) in enumerate(scan_many(live, 200, motion)):
        made = front_end.make_reading(scan)
        assert truths == ()
        np.testing.assert_array_equal(scan.q, motion(reading))
        assert reading < 100 or made.pressure[made.valid].max() < ContactConfig().on
    point = find_point(live, patch, 30)
    live.hand.poke(point, 8.0, 0.4)
    readings = [
        front_end.make_reading(live.scan(PERIOD * reading, motion(reading)))
        for reading in range(201, 241)
    ]
    pressure = np.array([np.where(made.valid, made.pressure, 0) for made in readings])
    taxel = pressure.max(axis=0).argmax()
    assert pressure.max() > ContactConfig().on
    link = live.mounted.robot.link_index(point.link)
    assert live.mounted.taxel_link_index[taxel] == link
    assert np.linalg.norm(live.mounted.skin.positions[taxel] - point.p_link) < 0.03


def test_taxels_bear_the_normal_part_of_the_wrenches_of_a_poke():
    live = InteractiveSkin()
    live.hand.poke(find_point(live, "forearm_back"), 8.0, 0.2)
    found = []
    for reading in range(1, 21):
        live.scan(PERIOD * reading, Q)
        pushes = [np.linalg.norm(wrench.force_link) for wrench in live.wrenches]
        found.append((live.taxel_force, sum(pushes)))
    force, push = np.array(found).T
    assert push.max() > 4.0 and force[-1] == 0.0
    np.testing.assert_allclose(force, push, rtol=0.1)
    assert np.all(force >= push - 1e-9)


@pytest.mark.slow
def test_dragged_finger_follows_its_target_at_limited_speed():
    live = InteractiveSkin()
    begin, end = find_forearm_ends(live)
    touch = live.hand.begin(begin, 4.0)
    places = []
    force = 0.0
    for reading in range(120):
        share = np.clip((reading - 20) / 80, 0, 1)
        p_link = begin.p_link + share * (end.p_link - begin.p_link)
        live.hand.move(touch, LinkPoint("forearm_link", p_link))
        live.scan(PERIOD * (reading + 1), sway(reading))
        (truth,) = live.hand.truths()
        assert truth.touch == touch
        force = truth.force
        places.append(locate_force(live, truth, sway(reading)))
    places = np.array(places)
    # A hand of several parts bears its load about its middle.
    assert np.linalg.norm(places[10] - begin.p_link) < 0.025
    assert np.linalg.norm(places[-1] - end.p_link) < 0.025
    most = 1.3 * 0.4 * 0.02
    assert np.linalg.norm(np.diff(places[5:], axis=0), axis=1).max() < most
    assert force == pytest.approx(4.0, rel=0.5)
    live.hand.move(touch, begin)
    jumped = [locate_force(live, truths[0], Q) for _, truths in scan_many(live, 4)]
    assert 0.01 < np.linalg.norm(jumped[-1] - jumped[0]) < 4 * most
    live.hand.move(touch, find_point(live, "wrist_1", 20))
    assert scan_many(live, 3)[-1][1][0].link == "wrist_1_link"
    live.hand.end(touch)
    scan_many(live, 40)
    assert live.hand.touching == ()
    live.hand.move(touch, end)
    live.hand.end(touch)


def test_unplugged_patch_is_not_received_and_the_others_are_unchanged():
    one = InteractiveSkin(seed=1)
    other = InteractiveSkin(seed=1)
    skin = one.mounted.skin
    out = skin.patch_index == skin.find_patches(("forearm_back",))[0]
    for live in (one, other):
        live.hand.grab(find_point(live, "forearm_back", 90), 20.0, 0.5)
    one.unplug("forearm_back")
    pairs = zip(scan_many(one, 30), scan_many(other, 30), strict=True)
    for (scan, _), (expected, _) in pairs:
        assert not scan.received[out].any() and not scan.counts[out].any()
        np.testing.assert_array_equal(scan.counts[~out], expected.counts[~out])
        np.testing.assert_array_equal(scan.received[~out], expected.received[~out])
    one.plug("forearm_back")
    scan, _ = scan_many(one, 1)[0]
    expected, _ = scan_many(other, 1)[0]
    np.testing.assert_array_equal(scan.counts, expected.counts)


def test_killed_taxels_feel_nothing():
    live = InteractiveSkin(seed=1)
    healthy = InteractiveSkin(seed=1)
    killed = np.array(live.kill(0.5))
    assert len(killed) == round(0.5 * live.mounted.skin.count)
    rest = [scan.counts[killed] for scan, _ in scan_many(live, 20)]
    scan_many(healthy, 20)
    high = np.max(rest, axis=0) + 20
    for skin in (live, healthy):
        skin.hand.grab(find_point(skin, "forearm_back", 90), 60.0, 0.6)
        counts = np.array([scan.counts[killed] for scan, _ in scan_many(skin, 40)])
        assert (counts > high).any() == (skin is healthy)
    assert not set(live.kill(0.2)) & set(killed.tolist())


def test_seed_decides_the_interactive_skin():
    def read_counts(seed):
        live = InteractiveSkin(seed=seed)
        live.hand.perform("poke")
        return np.array([scan.counts for scan, _ in scan_many(live, 40)])

    once = read_counts(3)
    np.testing.assert_array_equal(once, read_counts(3))
    assert (once != read_counts(4)).any()


@pytest.mark.parametrize("what", ["stroke", "rub", "cable", "guiding", "none"])
def test_hand_performs_any_touch_where_there_is_room(what):
    live = InteractiveSkin()
    scan_many(live, 1)
    number = live.hand.perform(what)
    assert live.hand.touching == (number,)
    truths = [truth for _, found in scan_many(live, 50, sway) for truth in found]
    gesture = what if what in ("poke", "stroke", "rub") else "none"
    assert {(truth.gesture, truth.touch) for truth in truths} == {(gesture, number)}


def play(generator, count, seed=0):
    return list(islice(TouchPlayer(generator, seed, start=5).scans(), count))


def test_seed_decides_the_stream_of_the_player():
    played, again, other = (play(StandIn("small"), 900, seed) for seed in (0, 0, 4))
    assert played[0].stamp == 5
    assert (np.diff([scan.stamp for scan in played]) == PERIOD).all()
    one, same, different = (
        np.array([scan.counts for scan in scans]) for scans in (played, again, other)
    )
    assert (one == same).all() and (one != different).any()


@pytest.mark.slow
def test_player_makes_no_contact_where_stretches_meet():
    simulator = build_small_simulator("ur5")
    build = TouchPlayer(simulator).build
    assert build.name.startswith("device") and build.kind == "fresh"
    front_end = FrontEnd(simulator.mounted.skin, simulator.calibration(build))
    nearby = RATE // 2
    peaks = []
    others = []
    for number, scan in enumerate(play(simulator, LEAD + STRETCH + STRETCH // 3)):
        reading = front_end.make_reading(scan)
        is_near = (number - LEAD + nearby) % STRETCH < 2 * nearby
        found = peaks if is_near and number > LEAD + nearby else others
        found.append(reading.pressure[reading.valid].max())
    assert scan.received.data.c_contiguous  # for which the kernels are compiled
    assert len(peaks) > nearby
    assert max(peaks) < ContactConfig().on < max(others[LEAD:])
