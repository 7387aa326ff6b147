"""Laws of the live simulated world: a skin that goes on, and hands that touch it."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.sim.dataset.clip import get_session, simulate_clip
from eskin.sim.dataset.plan import Origin
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.sim.interactive.touches import PerformedTouch
from eskin.sim.people.perform import perform
from eskin.sim.scene.motion import follow_late, hang_still
from eskin.sim.scene.scene import TouchScene, compute_touch_presses
from eskin.sim.sensor.build import draw_build
from eskin.sim.sensor.model import SensorStages
from eskin.sim.sensor.noise import NOISE_BLOCK, ReadingLosses, ReadingNoise
from eskin.sim.sensor.sensor import Sensor, sense
from eskin.touch import Calibrator, ContactConfig
from eskin.transforms import apply
from helpers.sensors import CONSTANTS
from helpers.touch import build_grid_skin

Q = np.array([0.3, -1.2, 1.0, -1.0, -1.5, 0.2])
SWAY = np.array([0.1, 0.05, -0.1, 0.2, 0.0, 0.1])
PERIOD = 20_000_000
CALM = SensorStages(faults=False)


def still(_):
    return Q


def swaying(reading):
    return Q + SWAY * np.sin(0.05 * reading)


def place_of(live, patch, number=40):
    skin = live.mounted.skin
    taxel = skin.find_taxels(patch)[number]
    link = skin.patches[skin.patch_index[taxel]].link
    return LinkPoint(link, skin.positions[taxel].astype(float))


def run(live, readings, q=still):
    """Scans and what truly pressed during each."""
    found = []
    for reading in range(readings):
        scan = live.scan(PERIOD * (reading + 1), q(reading))
        found.append((scan, live.hand.truths()))
    return found


def in_link(live, truth, q):
    """Where the force acts, in its link's frame [m]."""
    poses = live.mounted.kinematics.poses(q)
    T = np.linalg.inv(poses[live.mounted.robot.link_index(truth.link)])
    return apply(T, np.array(truth.p_world)[None])[0]


def forces(found):
    return np.array([sum(truth.force for truth in truths) for _, truths in found])


@pytest.mark.parametrize("shape", [(6, 6, 2), (5, 5, 1)])
@pytest.mark.parametrize("kind", ["fresh", "shifted"])
def test_pressures_pushed_bit_by_bit_count_the_same_as_at_once(shape, kind):
    skin = build_grid_skin(*shape[:2], patches=shape[2])
    build = draw_build("b", kind, skin, CONSTANTS, np.random.default_rng(5))
    taxels, steps = np.array([7, 8, 13]), 2 * NOISE_BLOCK + 60
    push = np.clip(np.sin(np.linspace(-1, 40, steps)), 0, 1)[:, None]
    pressure = push * np.array([4.0, 12.0, 60.0])
    whole, _ = sense(pressure, taxels, build, skin, np.random.default_rng(3), CALM)
    sensor = Sensor(build, skin, np.random.default_rng(3), CALM)
    counts, step = [], 0
    for reading in range(len(whole)):
        # A patch may be scanned a little after the reading, up to a step or two.
        while step < min(2 * reading + 4, steps):
            size = 1 + step % 3
            sensor.push(pressure[step : step + size], taxels)
            step = min(step + size, steps)
        counts.append(sensor.read(np.array([2.0 * reading]))[0])
    np.testing.assert_array_equal(np.array(counts), whole)
    assert len(sensor.conductance) < 20
    with pytest.raises(ValueError, match="read more often"):
        sensor.read(np.array([steps - 20.0]))


def test_readings_get_lost_by_the_same_draws_but_for_the_first_state():
    skin = build_grid_skin(6, 6, patches=2)
    build = draw_build("b", "shifted", skin, CONSTANTS, np.random.default_rng(5))
    often = replace(build.defects, dropped=0.2)
    one, two = (
        ReadingLosses(often, 2, np.random.default_rng(seed), SensorStages())
        for seed in (4, 4)
    )
    at_once = one.draw_all(4000)
    one_by_one = np.concatenate([two.draw_next() for _ in range(4000)])
    assert one_by_one.mean() == pytest.approx(0.2, abs=0.03)
    met = np.flatnonzero((at_once == one_by_one).all(axis=1))[0]
    np.testing.assert_array_equal(at_once[met:], one_by_one[met:])


def test_noise_is_the_same_however_much_is_drawn_at_a_time_and_never_repeats():
    def noise():
        streams = [np.random.default_rng(seed) for seed in range(3)]
        return ReadingNoise(2, 25, (streams[0], streams[1], streams[2]))

    whole, single = noise(), noise()
    blocks = [whole.draw_rows(NOISE_BLOCK).chances for _ in range(2)]
    rows = [single.draw_rows(1).chances for _ in range(2 * NOISE_BLOCK)]
    np.testing.assert_array_equal(np.concatenate(blocks), np.concatenate(rows))
    assert (blocks[0] != blocks[1]).mean() > 0.99


def test_a_hand_lands_on_its_target_though_the_arm_moves_and_then_falls_behind():
    live = InteractiveSkin()
    run(live, 50, swaying)
    place = place_of(live, "forearm_back", 300)
    site = live.hand.find_site("poke", None, place, live.hand.person)
    rng, asked = np.random.default_rng(0), {"force": 5.0, "duration": 0.6}
    touch = perform(
        *("poke", "one_tip", live.hand.person, site, CONSTANTS, rng, 0.0),
        *("paper", asked),
    )
    live.hand.add(PerformedTouch(touch, 0.2, live.env))
    away = []
    for _, truths in run(live, 20, lambda reading: swaying(50 + reading)):
        for truth in truths:
            at = in_link(live, truth, swaying(50 + len(away)))
            away.append(np.linalg.norm(at - place.p_link))
    assert away[0] < 0.008
    assert max(away) > 0.015


@pytest.mark.parametrize("gesture", ["grab", "stroke", "cable"])
@pytest.mark.parametrize("way", [still, swaying])
def test_a_touch_is_what_it_is_in_a_clip(gesture, way):
    live, seed = InteractiveSkin(seed=2), 8
    world, steps, delay = live.env, 200, 0.2
    session = get_session(Origin("s", (1,)), live.build)
    stages = SensorStages(skew=False, faults=False)
    rng, skin = np.random.default_rng(seed), live.mounted.skin
    live.sensor = Sensor(live.build, skin, rng, stages, session)
    site = live.hand.find_site(
        "stroke", None, place_of(live, "forearm_back"), live.hand.person
    )
    what = ("none", "cable") if gesture == "cable" else (gesture, None)
    rng = np.random.default_rng(0)
    touch = perform(*what, live.hand.person, site, world.constants, rng, 1.5, None)
    live.hand.add(PerformedTouch(touch, delay, world))
    found = run(live, steps // 2, way)
    at = np.arange(-1, steps // 2)
    q = np.array([way(max(reading, 0)) for reading in at])
    between = np.arange(steps) / 2 - 0.5
    q = np.stack([np.interp(between, at, each) for each in q.T], axis=1)
    carry = hang_still if gesture == "cable" else lambda *a: follow_late(*a, delay)
    presses = tuple(carry(press, world, q) for press in touch.presses)
    scene = TouchScene(q, (replace(touch, presses=presses),))
    rng = np.random.default_rng(seed)
    clip = simulate_clip(scene, 1, live.build, session, world, rng, stages)
    counts = np.array([scan.counts for scan, _ in found[: len(clip.counts)]])
    assert np.abs(counts - clip.counts).max() <= 1
    assert (counts != clip.counts).mean() < 1e-5
    truth = simulate_clip(scene, 0, live.build, session, world, rng, stages).truths[0]
    np.testing.assert_allclose(forces(found), truth.force, atol=1e-9)
    assert any((clip.counts != clip.counts[0]).ravel())


@pytest.mark.parametrize(("what", "force"), [("poke", 6.0), ("double_pat", 8.0)])
def test_the_true_force_of_a_touch_is_what_was_asked_and_lasts_as_long(what, force):
    live = InteractiveSkin()
    getattr(live.hand, what)(place_of(live, "forearm_back", 90), force, 0.6)
    found = run(live, 60)
    assert all(truth.force > 0 for _, truths in found for truth in truths)
    felt = forces(found)
    assert felt.max() == pytest.approx(force, rel=0.03)
    assert np.ptp(np.flatnonzero(felt)) * 0.02 == pytest.approx(0.6, abs=0.05)


def test_a_grab_has_the_force_asked_for_unless_nobody_can():
    live = InteractiveSkin()
    live.hand.grab(place_of(live, "forearm_back", 90), 30.0, 0.8)
    assert forces(run(live, 60)).max() == pytest.approx(30.0, rel=0.03)
    live.hand.grab(place_of(live, "forearm_back", 90), 900.0, 0.8)
    assert 40.0 < forces(run(live, 60)).max() < 400.0


def test_taxels_bear_the_whole_force_inside_a_patch():
    live = InteractiveSkin()
    world, skin = live.env, live.mounted.skin
    asked = {"force": 5.0, "duration": 0.4}
    rng = np.random.default_rng(0)
    on_a_taxel = live.hand.find_site(
        "poke", None, place_of(live, "upper_arm_back", 200), live.hand.person
    )
    borne = []
    for off in rng.uniform(-0.005, 0.005, (20, 2)):
        s, t = np.array(on_a_taxel.centre) + off
        site = replace(on_a_taxel, centre=(float(s), float(t)))
        touch = perform(
            *("poke", "one_tip", live.hand.person, site, world.constants, rng, 0.0),
            *("paper", asked),
        )
        (part,) = compute_touch_presses(
            TouchScene(np.tile(Q, (60, 1)), (touch,)), world
        )[0]
        forces = part.field.pressure @ skin.areas[part.field.taxels] * 1e3
        borne.append(forces.max())
    # Few points of a taxel lie under a fingertip: one place is off by up to 20 %.
    assert np.median(borne) == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize("patch", ["forearm_back", "upper_arm_back", "wrist_1"])
@pytest.mark.parametrize("way", [still, swaying])
def test_a_poke_is_felt_where_it_is(patch, way):
    live = InteractiveSkin()
    calibrator = Calibrator(live.mounted.skin, live.calibration)
    for scan, _ in run(live, 100, way):
        calibrator.push(scan)
    place = place_of(live, patch, 30)
    live.hand.poke(place, 8.0, 0.4)
    links, skin = live.mounted.taxel_link_index, live.mounted.skin
    here = links == live.mounted.robot.link_index(place.link)
    most, where = 0.0, None
    for reading in range(40):
        scan = live.scan(PERIOD * (200 + reading), way(100 + reading))
        made = calibrator.push(scan)
        kpa = np.where(made.valid, made.pressure, 0.0)
        if kpa.max() > most:
            most, where = float(kpa.max()), int(kpa.argmax())
    assert most > ContactConfig().on
    assert here[where]
    assert np.linalg.norm(skin.positions[where] - place.p_link) < 0.03


def test_nothing_is_felt_when_nothing_touches_however_the_arm_moves():
    live = InteractiveSkin()
    calibrator = Calibrator(live.mounted.skin, live.calibration)
    for reading, (scan, truths) in enumerate(run(live, 400, swaying)):
        made = calibrator.push(scan)
        assert truths == ()
        if reading > 100:
            assert made.pressure[made.valid].max() < ContactConfig().on
        np.testing.assert_array_equal(scan.q, swaying(reading))


def test_what_is_left_of_a_touch_fades():
    live = InteractiveSkin()
    live.hand.grab(place_of(live, "forearm_back", 90), 30.0, 0.8)
    run(live, 60)
    assert live.hand.touching == ()
    assert forces(run(live, 5)).max() == 0.0
    assert max(live.sensor.state.creep.max(), 0.0) <= 1.0


def ends_of(live):
    """Two places of the forearm, far apart along it [m]."""
    skin = live.mounted.skin
    row = skin.find_taxels("forearm_back")
    low, high = row[skin.columns[row] == 8][[3, -4]]
    return skin.positions[[low, high]].astype(float)


def test_a_dragged_finger_follows_the_places_at_limited_speed():
    live = InteractiveSkin()
    ends = ends_of(live)
    touch = live.hand.begin(LinkPoint("forearm_link", ends[0]), 4.0)
    places, q = [], swaying
    for reading in range(120):
        share = np.clip((reading - 20) / 80, 0, 1)
        live.hand.move(
            touch, LinkPoint("forearm_link", ends[0] + share * (ends[1] - ends[0]))
        )
        live.scan(PERIOD * (reading + 1), q(reading))
        (truth,) = live.hand.truths()
        assert truth.touch == touch
        places.append(in_link(live, truth, q(reading)))
    places = np.array(places)
    # A hand of several parts bears its load about its middle.
    assert np.linalg.norm(places[10] - ends[0]) < 0.025
    assert np.linalg.norm(places[-1] - ends[1]) < 0.025
    steps = np.linalg.norm(np.diff(places[5:], axis=0), axis=1)
    assert steps.max() < 1.3 * 0.4 * 0.02
    assert truth.force == pytest.approx(4.0, rel=0.5)
    live.hand.move(touch, LinkPoint("forearm_link", ends[0]))
    jumped = [in_link(live, truths[0], Q) for _, truths in run(live, 4)]
    assert 0.01 < np.linalg.norm(jumped[-1] - jumped[0]) < 4 * 1.3 * 0.4 * 0.02
    live.hand.end(touch)
    run(live, 40)
    assert live.hand.touching == ()
    live.hand.move(touch, LinkPoint("forearm_link", ends[1]))
    live.hand.end(touch)


def test_a_finger_told_to_leave_at_once_lands_and_goes_where_it_was_led_first():
    live = InteractiveSkin()
    begin, end = ends_of(live)
    touch = live.hand.begin(LinkPoint("forearm_link", begin), 4.0)
    live.hand.move(touch, LinkPoint("forearm_link", end))
    live.hand.end(touch)
    felt = [truths[0] for _, truths in run(live, 60) if truths]
    assert live.hand.touching == ()
    assert max(truth.force for truth in felt) == pytest.approx(4.0, rel=0.5)
    places = np.array([in_link(live, truth, Q) for truth in felt])
    assert np.linalg.norm(places[0] - begin) < 0.03
    assert np.linalg.norm(places[-1] - end) < 0.03


def test_a_dragged_finger_goes_from_link_to_link():
    live = InteractiveSkin()
    touch = live.hand.begin(place_of(live, "forearm_back"), 4.0)
    run(live, 10)
    live.hand.move(touch, place_of(live, "wrist_1", 20))
    assert [truths[0].link for _, truths in run(live, 3)][-1] == "wrist_1_link"


def test_an_unplugged_patch_is_not_received_and_the_others_feel_no_difference():
    one, other = InteractiveSkin(seed=1), InteractiveSkin(seed=1)
    out = one.mounted.skin.patch_index == one.find_patch("forearm_back")
    for live in (one, other):
        live.hand.grab(place_of(live, "forearm_back", 90), 20.0, 0.5)
    one.unplug("forearm_back")
    for (scan, _), (whole, _) in zip(run(one, 30), run(other, 30), strict=True):
        assert not scan.received[out].any()
        assert not scan.counts[out].any()
        np.testing.assert_array_equal(scan.counts[~out], whole.counts[~out])
        np.testing.assert_array_equal(scan.received[~out], whole.received[~out])
    one.plug("forearm_back")
    (scan, _), (whole, _) = run(one, 1)[0], run(other, 1)[0]
    np.testing.assert_array_equal(scan.counts, whole.counts)


def test_killed_taxels_feel_nothing():
    live, whole = InteractiveSkin(seed=1), InteractiveSkin(seed=1)
    killed = np.array(live.kill(0.5))
    assert len(killed) == round(0.5 * live.mounted.skin.count)
    rest = [scan.counts[killed] for scan, _ in run(live, 20)]
    run(whole, 20)
    for each in (live, whole):
        each.hand.grab(place_of(each, "forearm_back", 90), 60.0, 0.6)
    felt, there = (
        np.array([scan.counts[killed] for scan, _ in run(each, 40)])
        for each in (live, whole)
    )
    high = np.max(rest, axis=0) + 20
    assert (there > high).any()
    assert not (felt > high).any()
    assert not set(live.kill(0.2)) & set(killed.tolist())


def test_a_seed_gives_the_same_world_every_time_and_another_a_different_one():
    def scans(seed):
        live = InteractiveSkin(seed=seed)
        live.hand.perform("poke")
        return np.array([scan.counts for scan, _ in run(live, 40)])

    once = scans(3)
    np.testing.assert_array_equal(once, scans(3))
    assert (once != scans(4)).any()


@pytest.mark.parametrize(
    "what", ["poke", "stroke", "rub", "bump", "lean", "cable", "guiding", "none"]
)
def test_people_do_what_they_are_asked_where_there_is_room(what):
    live = InteractiveSkin()
    run(live, 1)
    number = live.hand.perform(what)
    assert live.hand.touching == (number,)
    found = [truths for _, truths in run(live, 50, swaying) if truths]
    gesture = what if what in ("poke", "stroke", "rub") else "none"
    assert {truth.gesture for truths in found for truth in truths} == {gesture}
    assert {truth.touch for truths in found for truth in truths} == {number}


def test_touches_at_once_are_told_apart():
    live = InteractiveSkin()
    first = live.hand.grab(place_of(live, "forearm_back", 90), 20.0, 0.5)
    second = live.hand.poke(place_of(live, "upper_arm_back", 90), 4.0, 0.3)
    (_, truths) = run(live, 8)[-1]
    links = {truth.touch: truth.link for truth in truths}
    assert links == {first: "forearm_link", second: "upper_arm_link"}


def test_what_cannot_be_is_refused_in_one_line():
    live = InteractiveSkin()
    hand, place = live.hand, place_of(live, "forearm_back")
    with pytest.raises(ValueError, match="no skin on link 'tool0'"):
        hand.poke(LinkPoint("tool0", np.zeros(3)))
    with pytest.raises(ValueError, match="force is -1.0"):
        hand.poke(place, -1.0)
    with pytest.raises(ValueError, match="no gesture or contact 'electrical'"):
        hand.perform("electrical")
    with pytest.raises(ValueError, match="fold the arm first"):
        hand.perform("self_contact")
    with pytest.raises(ValueError, match="touch 9 has not begun"):
        hand.end(9)
    with pytest.raises(ValueError, match="touch 0 is not dragged"):
        hand.move(hand.poke(place), place)
    with pytest.raises(ValueError, match="6 finite numbers"):
        live.scan(1, np.zeros(5))
    with pytest.raises(ValueError, match="no patch 'x'"):
        live.unplug("x")
    with pytest.raises(ValueError, match="share is 2"):
        live.kill(2.0)
    with pytest.raises(ValueError, match="no skin 'x'"):
        InteractiveSkin("x")


def test_patches_of_a_skin_that_loses_nothing_are_silent_where_they_are_unplugged():
    heard = []
    for loses in (True, False):
        live = InteractiveSkin(seed=0, loses=loses)
        q = np.zeros(len(live.mounted.robot.joint_names))
        silent = np.ones((1, len(live.unplugged)), dtype=bool)
        live.sensor.losses.draw_next = lambda silent=silent: silent
        heard.append(live.scan(1_000_000_000, q).received)
        live.unplug(live.mounted.skin.patches[0].id)
        first = live.mounted.skin.patch_index == 0
        assert not live.scan(2_000_000_000, q).received[first].any()
    assert not heard[0].any() and heard[1].all()
