"""Pairs: the same counts twice, and only the shape or the pose tells what was done."""

import json
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.distance import pdist

import eskin.cli.generate as command
from eskin.cli.main import run
from eskin.errors import GenerationError
from eskin.recording import find_recordings, read_recording
from eskin.robot import load_robot
from eskin.sim.constants import load_constants
from eskin.sim.dataset import (
    GenerationSettings,
    Simulator,
    generate,
    make_pair,
    plan_single_pair,
    read_index,
    remake_clip,
)
from eskin.sim.dataset.pairs import draw_meeting_poses, draw_shared_pat
from eskin.sim.dataset.plan import PAIR_SIDES, SIDES
from eskin.sim.people.person import draw_person
from eskin.sim.scene import load_environment
from eskin.skin import SKIN_PRESETS, MountedSkin, load_skin
from eskin.touch import TouchPipeline
from helpers.worlds import world

SECOND = 1_000_000_000
SEEDS = range(8)
SET = GenerationSettings("pairs", seed=5, clips=6, subjects=1)
CONSTANTS = load_constants()


@lru_cache(maxsize=4)
def small(skin):
    """The simulator with the small pool of poses of the tests."""
    simulator = Simulator.__new__(Simulator)
    simulator.robot_name = SKIN_PRESETS[skin].robot
    simulator.mounted = MountedSkin(load_skin(skin), load_robot(simulator.robot_name))
    simulator.env = world() if skin == "ur5" else load_environment("bent")
    return simulator


@lru_cache(maxsize=2)
def pairs(kind):
    own = world() if kind == "merging" else load_environment("bent")
    return [make_pair(kind, seed, env=own) for seed in SEEDS]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pairs")
    generate(folder, SET, factory=small)
    return folder


def rows_of(folder):
    return {
        (row.plan.pair.side, row.plan.pair.number): row for row in read_index(folder)
    }


def touches_of(folder, side):
    """Number of touches that the pipeline finds in each clip, by pair."""
    rows = [row for row in read_index(folder) if row.plan.pair.side == side]
    found = {}
    for file in sorted({row.file for row in rows}):
        recording = read_recording(folder / file)
        mounted = MountedSkin(recording.skin, load_robot(recording.robot_name))
        pipeline = TouchPipeline(mounted, recording.calibration)
        closed = [
            t for scan in recording.scans() for t in pipeline.push(scan).closed_touches
        ]
        closed += pipeline.finish()
        onsets = np.array([t.onset for t in closed if t.merged_into is None])
        for row in rows:
            if row.file == file:
                inside = (row.start <= onsets) & (onsets < row.start + 2 * SECOND)
                found[row.plan.pair.number] = int(inside.sum())
    return found


@pytest.mark.parametrize("kind", PAIR_SIDES)
def test_both_clips_of_a_pair_have_the_same_bytes_and_not_the_same_label(kind):
    for pair in pairs(kind):
        assert pair.first.counts.tobytes() == pair.second.counts.tobytes()
        assert pair.first.received.tobytes() == pair.second.received.tobytes()
        assert pair.labels[0] in ("grab", "double_pat") and pair.labels[1] == "none"
        for clip, label in zip((pair.first, pair.second), pair.labels, strict=True):
            assert {truth.gesture for truth in clip.truths} == {label}


@pytest.mark.parametrize("kind", PAIR_SIDES)
def test_a_pair_is_the_same_every_time_and_another_with_another_seed(kind):
    first, *others = pairs(kind)
    again = make_pair(kind, 0, env=world() if kind == "merging" else None)
    assert again.first.counts.tobytes() == first.first.counts.tobytes()
    assert again.second.drawn == first.second.drawn
    for other in others:
        assert not np.array_equal(other.first.counts, first.first.counts)


def test_pairs_are_of_several_ways_and_strengths_of_touching():
    for kind in PAIR_SIDES:
        kinds = {pair.first.truths[0].kind for pair in pairs(kind)}
        forces = {pair.first.truths[0].force.max() for pair in pairs(kind)}
        assert len(kinds) >= 2 and len(forces) == len(SEEDS)
    assert {pair.labels[0] for pair in pairs("merging")} == {"grab", "double_pat"}


def test_bending_moves_taxels_nearer_to_each_other_in_space_but_not_along_the_skin():
    pair = pairs("bending")[0]
    bent, flat = (mounted.skin for mounted in pair.mounted)
    assert bent.count == flat.count == 360
    np.testing.assert_array_equal(bent.rows, flat.rows)
    np.testing.assert_array_equal(bent.columns, flat.columns)
    np.testing.assert_allclose(bent.areas, flat.areas)
    round_it, straight = pdist(bent.positions), pdist(flat.positions)
    assert np.all(round_it <= straight + 1e-9)
    assert np.max(straight - round_it) > 0.1
    around = np.arctan2(bent.positions[:, 1], bent.positions[:, 0]) * 0.0375
    np.testing.assert_allclose(around, flat.positions[:, 0], atol=1e-9)
    np.testing.assert_allclose(np.hypot(*bent.positions[:, :2].T), 0.0375)


def test_a_hand_pressed_flat_has_the_force_and_area_of_the_grab_and_its_place():
    for pair in pairs("bending"):
        (grab,), (press,) = pair.first.truths, pair.second.truths
        assert (grab.gesture, press.gesture) == ("grab", "none")
        assert press.kind == "press" and press.link == "table"
        np.testing.assert_array_equal(grab.force, press.force)
        np.testing.assert_array_equal(grab.area, press.area)
        assert grab.force.max() > 3.0
        touched = press.force > 0
        assert np.all(press.centroid[touched, 2] == 0)
        np.testing.assert_allclose(
            press.centroid[touched, 1], grab.centroid[touched, 2], atol=1e-9
        )


def gaps(pair, clip):
    """Least distance of both places of a pair in the pose of a clip [m]."""
    one, other = (
        truth.centroid[np.argmax(truth.force)] for truth in pair.second.truths
    )
    links = [truth.link for truth in pair.second.truths]
    kinematics = pair.mounted[0].kinematics
    robot = pair.mounted[0].robot
    places = []
    for link, p_world in zip(links, (one, other), strict=True):
        index = robot.link_index(link)
        there, here = (kinematics.poses(c.q[0])[index] for c in (pair.second, clip))
        p_link = np.linalg.solve(there, np.append(p_world, 1.0))
        places.append((here @ p_link)[:3])
    return float(np.linalg.norm(places[0] - places[1]))


def test_merging_patches_meet_in_one_pose_and_are_far_apart_in_the_other():
    for pair in pairs("merging"):
        first, second = pair.second.truths
        assert first.link != second.link
        assert gaps(pair, pair.first) < 0.08
        assert gaps(pair, pair.second) > 0.3
        assert not np.allclose(pair.first.q, pair.second.q)
        for clip in (pair.first, pair.second):
            assert np.all(clip.q == clip.q[0])


def test_pats_on_two_links_follow_each_other_as_those_of_a_double_pat():
    low, high = CONSTANTS.array("pairs.interval")
    found = [pair for pair in pairs("merging") if pair.labels[0] == "double_pat"]
    for pair in found:
        (both,), (first, second) = pair.first.truths, pair.second.truths
        assert {truth.kind for truth in (first, second)} == {"single_pat"}
        assert low - 0.03 <= second.onset - first.onset <= high + 0.03
        assert first.end < second.onset
        np.testing.assert_allclose(first.force + second.force, both.force)


def test_pats_that_are_too_soon_or_too_late_for_two_links_are_not_taken():
    rng, plan = np.random.default_rng(0), plan_single_pair("merging", 0, 1.5, CONSTANTS)
    groups = frozenset(plan.groups)
    low, high = CONSTANTS.array("pairs.interval")
    taken = []
    for number in range(20):
        person = draw_person(f"p{number}", CONSTANTS, rng)
        *_, sites = draw_meeting_poses(world(), groups, person, rng)
        taken += [draw_shared_pat(plan, world(), person, sites, rng) for _ in range(10)]
    intervals = [touch.drawn["interval"] for touch in taken if touch is not None]
    assert 20 < len(intervals) < len(taken)
    assert low <= min(intervals) and max(intervals) <= high


def test_a_hooked_hand_presses_either_patch_alike():
    found = [pair for pair in pairs("merging") if pair.labels[0] == "grab"]
    for pair in found:
        fingers, back = pair.second.truths
        np.testing.assert_allclose(fingers.force, back.force)
        np.testing.assert_allclose(
            pair.first.truths[0].force, fingers.force + back.force
        )


@pytest.mark.parametrize("kind", PAIR_SIDES)
def test_the_nearest_pressure_image_is_right_for_exactly_half_of_the_clips(kind):
    *known, one, two, three = pairs(kind)
    images = np.array([p.first.counts.ravel() for p in known for _ in p.labels])
    labels = [label for pair in known for label in pair.labels]
    images = images.astype(np.float64)
    right = []
    for pair in (one, two, three):
        for clip, label in zip((pair.first, pair.second), pair.labels, strict=True):
            away = np.linalg.norm(images - clip.counts.ravel(), axis=1)
            said = labels[int(np.argmin(away))]
            right.append((said == "none") == (label == "none"))
    assert np.mean(right) == 0.5


def test_a_set_of_pairs_has_a_folder_for_each_side(whole):
    rows = rows_of(whole)
    assert set(rows) == {(side, number) for side in SIDES for number in range(3)}
    for (side, number), row in rows.items():
        assert row.file.startswith(f"{side}/")
        assert row.drawn["pair"] == number
    assert len(find_recordings([whole])) == 4


def test_files_of_either_side_hold_the_same_bytes_with_their_own_labels(whole):
    rows = rows_of(whole)
    for first, second in PAIR_SIDES.values():
        files = {rows[first, n].file: rows[second, n].file for n in range(3)}
        for one, other in files.items():
            a, b = (read_recording(whole / file) for file in (one, other))
            for name in ("counts", "received"):
                left, right = (getattr(x.arrays(), name) for x in (a, b))
                assert left.tobytes() == right.tobytes()
            np.testing.assert_array_equal(a.calibration.gain, b.calibration.gain)
            assert a.metadata.subject == b.metadata.subject
            for x, y in zip(true_labels(a), true_labels(b), strict=True):
                assert x.gesture != "none" and y.gesture == "none"
                assert (x.start - a.start, x.end - a.start) == (
                    y.start - b.start,
                    y.end - b.start,
                )


def true_labels(recording):
    return [label for label in recording.labels if label.source == "true"]


def test_every_touch_of_a_pair_is_in_the_truth(whole):
    rows = rows_of(whole)
    counts = {"bent": 1, "flat": 1, "folded": 1, "apart": 2}
    for (side, number), row in rows.items():
        assert len(row.touches) == counts[side]
        truths = read_recording(whole / row.file).truths()
        inside = {t.touch for t in truths if 0 <= t.stamp - row.start < 2 * SECOND}
        assert inside == {touch.touch for touch in row.touches}, number


def test_recordings_of_bent_and_flat_skins_are_one_touch_each(whole):
    for side in ("bent", "flat"):
        assert set(touches_of(whole, side).values()) == {1}
        row = rows_of(whole)[side, 0]
        skin = read_recording(whole / row.file).skin
        np.testing.assert_array_equal(skin.positions, load_skin(side).positions)


def test_contacts_are_one_touch_where_patches_meet_and_two_where_they_are_apart(whole):
    for side, touches in (("folded", 1), ("apart", 2)):
        assert np.median(list(touches_of(whole, side).values())) == touches


def test_a_set_of_pairs_is_made_again_with_the_same_bytes(whole, tmp_path):
    generate(tmp_path, SET, factory=small)
    for path in sorted(whole.rglob("*.*")):
        assert (tmp_path / path.relative_to(whole)).read_bytes() == path.read_bytes()


def test_a_clip_of_a_pair_can_be_made_again_alone(whole):
    row = rows_of(whole)["flat", 2]
    recording = read_recording(whole / row.file)
    arrays = recording.arrays()
    inside = (row.start <= arrays.stamps) & (arrays.stamps < row.start + 2 * SECOND)
    clip = remake_clip(row, small("flat"))
    assert clip.counts.tobytes() == arrays.counts[inside].tobytes()
    with pytest.raises(
        GenerationError, match="is of skin 'flat', the generator of 'bent'"
    ):
        remake_clip(row, small("bent"))


@pytest.mark.parametrize("clips", [0, 3])
def test_clips_that_are_no_pairs_are_refused(clips):
    with pytest.raises(ValueError, match="allowed are 2, 4 and so on"):
        GenerationSettings("pairs", clips=clips)


def test_a_kind_of_pair_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="allowed are bending, merging"):
        make_pair("stretching", 0)


def test_pairs_cannot_be_merged_on_a_patch_that_meets_no_other():
    with pytest.raises(ValueError, match="no joint 'elbow_joint'"):
        make_pair("merging", 0, env=load_environment("bent"))


def test_pairs_can_be_asked_for_on_the_command_line(monkeypatch, tmp_path, capsys):
    def in_this_process(folder, settings, workers, on_progress):
        return generate(folder, settings, 0, small, on_progress)

    monkeypatch.setattr(command, "generate", in_this_process)
    argv = ["generate", str(tmp_path), "--set", "pairs", "--clips", "2", "--json"]
    assert run(argv) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["clips"] == 4
    assert {row.plan.pair.side for row in read_index(tmp_path)} == set(SIDES)
