"""These tests check pairs: equal counts, where only shape or pose tells the label."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from eskin.errors import GenerationError
from eskin.recording import find_recordings, read_recording
from eskin.robot import load_robot
from eskin.sim import load_constants
from eskin.sim.dataset import (
    GenerationSettings,
    generate,
    make_pair,
    read_index,
    remake_clip,
)
from eskin.sim.dataset.sets import PAIR_SIDES, SIDES
from eskin.sim.scene import load_environment
from eskin.skin import MountedSkin, load_skin
from eskin.touch import TouchPipeline
from eskin.units import NS_PER_S
from helpers.simulation import build_small_simulator
from helpers.worlds import world

pytestmark = pytest.mark.slow

SEEDS = range(4)
SETTINGS = GenerationSettings("pairs", seed=5, clips=6, subjects=1)
CONSTANTS = load_constants()


@lru_cache
def make_pairs(kind):
    env = world() if kind == "merging" else load_environment("bent")
    return [make_pair(kind, seed, env=env) for seed in SEEDS]


@pytest.fixture(scope="module")
def pair_set(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pairs")
    generate(folder, SETTINGS, factory=build_small_simulator)
    return folder


def read_rows(folder):
    """Return the rows of the index by side and number of the pair."""
    rows = {}
    for row in read_index(folder):
        assert row.plan.pair is not None
        rows[row.plan.pair.side, row.plan.pair.number] = row
    return rows


@pytest.mark.parametrize("kind", PAIR_SIDES)
def test_clips_of_a_pair_have_equal_bytes_and_different_labels(kind):
    for pair in make_pairs(kind):
        assert pair.first.counts.tobytes() == pair.second.counts.tobytes()
        assert pair.first.received.tobytes() == pair.second.received.tobytes()
        assert pair.labels[0] in ("grab", "double_pat") and pair.labels[1] == "none"
        for clip, label in zip((pair.first, pair.second), pair.labels, strict=True):
            assert {truth.gesture for truth in clip.truths} == {label}


@pytest.mark.parametrize("kind", PAIR_SIDES)
def test_seed_decides_the_pair(kind):
    first, *others = make_pairs(kind)
    again = make_pair(kind, 0, env=world() if kind == "merging" else None)
    assert again.first.counts.tobytes() == first.first.counts.tobytes()
    assert again.second.drawn == first.second.drawn
    for other in others:
        assert not np.array_equal(other.first.counts, first.first.counts)


def test_bending_brings_taxels_closer_in_space_but_not_along_the_skin():
    pair = make_pairs("bending")[0]
    bent, flat = (mounted.skin for mounted in pair.mounted)
    assert bent.count == flat.count == 360
    np.testing.assert_array_equal(bent.rows, flat.rows)
    np.testing.assert_array_equal(bent.columns, flat.columns)
    np.testing.assert_allclose(bent.areas, flat.areas)
    on_tube = pdist(bent.positions)
    on_plane = pdist(flat.positions)
    assert np.all(on_tube <= on_plane + 1e-9)
    assert np.max(on_plane - on_tube) > 0.1
    around = np.arctan2(bent.positions[:, 1], bent.positions[:, 0]) * 0.0375
    np.testing.assert_allclose(around, flat.positions[:, 0], atol=1e-9)
    np.testing.assert_allclose(np.hypot(*bent.positions[:, :2].T), 0.0375)


def test_flat_press_has_force_area_and_place_of_the_grab():
    for pair in make_pairs("bending"):
        [grab] = pair.first.truths
        [press] = pair.second.truths
        assert (press.kind, press.link) == ("press", "table")
        np.testing.assert_array_equal(grab.force, press.force)
        np.testing.assert_array_equal(grab.area, press.area)
        assert grab.force.max() > 3.0
        touched = press.force > 0
        assert np.all(press.centroid[touched, 2] == 0)
        np.testing.assert_allclose(
            press.centroid[touched, 1], grab.centroid[touched, 2], atol=1e-9
        )


def measure_gap(pair, clip):
    """Return the distance of both places of a pair in the pose of a clip [m]."""
    mounted = pair.mounted[0]
    places = []
    for truth in pair.second.truths:
        index = mounted.robot.link_index(truth.link)
        there, here = (
            mounted.kinematics.poses(each.q[0])[index] for each in (pair.second, clip)
        )
        p_world = np.append(truth.centroid[np.argmax(truth.force)], 1.0)
        places.append(here @ np.linalg.solve(there, p_world))
    return float(np.linalg.norm(places[0] - places[1]))


def test_merging_patches_meet_in_one_pose_only():
    for pair in make_pairs("merging"):
        first, second = pair.second.truths
        assert first.link != second.link
        assert measure_gap(pair, pair.first) < 0.08
        assert measure_gap(pair, pair.second) > 0.3
        for clip in (pair.first, pair.second):
            assert np.all(clip.q == clip.q[0])


def test_two_touches_far_apart_share_the_gesture_on_merged_patches():
    low, high = CONSTANTS.array("pairs.interval")
    for pair in make_pairs("merging"):
        [both] = pair.first.truths
        first, second = pair.second.truths
        np.testing.assert_allclose(first.force + second.force, both.force)
        if pair.labels[0] == "double_pat":
            assert {first.kind, second.kind} == {"single_pat"}
            assert low - 0.03 <= second.onset - first.onset <= high + 0.03
            assert first.end < second.onset
        else:
            np.testing.assert_allclose(first.force, second.force)


def test_set_of_pairs_has_a_folder_for_each_side(pair_set):
    rows = read_rows(pair_set)
    assert set(rows) == {(side, number) for side in SIDES for number in range(3)}
    touches = {"bent": 1, "flat": 1, "folded": 1, "apart": 2}
    for (side, number), row in rows.items():
        assert row.file.startswith(f"{side}/")
        assert row.drawn["pair"] == number
        assert len(row.touches) == touches[side]
        truths = read_recording(pair_set / row.file).truths()
        inside = {t.touch for t in truths if 0 <= t.stamp - row.start < 2 * NS_PER_S}
        assert inside == {touch.touch for touch in row.touches}
    assert len(find_recordings([pair_set])) == 4


@pytest.mark.parametrize(("first", "second"), PAIR_SIDES.values())
def test_files_of_both_sides_hold_equal_bytes_and_their_own_labels(
    pair_set, first, second
):
    rows = read_rows(pair_set)
    files = {(rows[first, n].file, rows[second, n].file) for n in range(3)}
    for names in files:
        one, other = (read_recording(pair_set / name) for name in names)
        for name in ("counts", "received"):
            left, right = (getattr(x.arrays(), name) for x in (one, other))
            assert left.tobytes() == right.tobytes()
        np.testing.assert_array_equal(one.calibration.gain, other.calibration.gain)
        assert one.metadata.subject == other.metadata.subject
        spans = []
        for recording in (one, other):
            true = [label for label in recording.labels if label.source == "true"]
            assert {label.gesture == "none" for label in true} == {recording is other}
            start = recording.start
            spans.append([(label.start - start, label.end - start) for label in true])
        assert spans[0] == spans[1]


@pytest.mark.parametrize(
    ("side", "touches"), [("bent", 1), ("flat", 1), ("folded", 1), ("apart", 2)]
)
def test_pipeline_merges_contacts_where_patches_meet(pair_set, side, touches):
    rows = [read_rows(pair_set)[side, number] for number in range(3)]
    counts = []
    for file in {row.file for row in rows}:
        recording = read_recording(pair_set / file)
        mounted = MountedSkin(recording.skin, load_robot(recording.robot_name))
        pipeline = TouchPipeline(mounted, recording.calibration)
        closed = [
            t
            for scan in recording.scans()
            for t in pipeline.push_scan(scan).closed_touches
        ]
        closed += pipeline.finish()
        onsets = np.array([t.onset for t in closed if t.merged_into is None])
        for start in (row.start for row in rows if row.file == file):
            inside = (start <= onsets) & (onsets < start + 2 * NS_PER_S)
            counts.append(np.count_nonzero(inside))
        if side in ("bent", "flat"):
            expected = load_skin(side).positions
            np.testing.assert_array_equal(recording.skin.positions, expected)
    assert np.median(counts) == touches


def test_clip_of_a_pair_can_be_made_again_alone(pair_set):
    row = read_rows(pair_set)["flat", 2]
    arrays = read_recording(pair_set / row.file).arrays()
    inside = (row.start <= arrays.stamps) & (arrays.stamps < row.start + 2 * NS_PER_S)
    clip = remake_clip(row, build_small_simulator("flat"))
    assert clip.counts.tobytes() == arrays.counts[inside].tobytes()
    with pytest.raises(GenerationError, match="skin 'flat'.* 'bent'"):
        remake_clip(row, build_small_simulator("bent"))
