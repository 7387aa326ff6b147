"""Without the pose the same counts are the same touch; with it they need not be."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.graph import GraphConfig
from eskin.learn.prepared_recording import prepare_recording
from eskin.live import Recognizer
from eskin.model import load_model
from eskin.model.file import read_card
from eskin.recording import read_recording
from eskin.touch import PipelineConfig
from helpers.graphs import FOLDED, assert_same
from helpers.live import Press, calibration_of, mounted, record, scans

BLIND = GraphConfig(posed=False)
OPEN = np.array([0.4, -1.3, 1.1, -0.7, 0.9, 0.2])


def hand():
    """Counts on the arm and the wrist, which meet where the arm is folded."""
    on = mounted("ur5")
    skin = on.skin
    links = np.array(skin.link_names)[skin.patch_index]
    wrist = np.flatnonzero(links == "wrist_3_link")
    arm = np.flatnonzero(links == "upper_arm_link")
    p_world, _ = on.place_taxels(FOLDED)
    gap = np.linalg.norm(p_world[wrist][:, None] - p_world[arm][None], axis=2)
    i, j = np.unravel_index(gap.argmin(), gap.shape)
    presses = [
        Press(2.2, 3.2, wrist[i], wrist[i]),
        Press(2.3, 3.2, arm[j], arm[j - 6], 40.0),
    ]
    return on, scans(on, presses, 25, 4.5)


def answers(model, on, stream):
    """Probabilities of every reading, and what was said."""
    recognizer = Recognizer(model, on, calibration_of(on.skin))
    found, chances = [], []
    for scan in stream:
        found += recognizer.push(scan)
        chances.append(recognizer.probabilities)
    return chances, [*found, *recognizer.finish()]


def in_poses(stream):
    """The same counts folded, open, and while the arm moves."""
    still = [[replace(scan, q=q) for scan in stream] for q in (FOLDED, OPEN)]
    return *still, stream


@pytest.fixture(scope="module")
def blind():
    model = load_model("ur5")
    return replace(model, card=replace(model.card, graph=BLIND))


def test_without_the_pose_the_same_counts_have_the_same_answers(blind):
    on, stream = hand()
    first, *others = (answers(blind, on, counts) for counts in in_poses(stream))
    assert any(first[0]) and first[1]
    for other in others:
        for one, two in zip(first[0], other[0], strict=True):
            assert one.keys() == two.keys()
            assert all(np.array_equal(one[touch], two[touch]) for touch in one)
        for one, two in zip(first[1], other[1], strict=True):
            told = ("stamp", "touch", "gesture", "confidence", "onset", "end", "link")
            assert [getattr(one, n) for n in told] == [getattr(two, n) for n in told]


def test_with_the_pose_they_do_not():
    on, stream = hand()
    folded, apart, _ = in_poses(stream)
    one, two = (answers(load_model("ur5"), on, counts)[0] for counts in (folded, apart))
    assert max(map(len, one)) == 1 and max(map(len, two)) == 2


def test_without_the_pose_the_same_counts_are_learned_alike(tmp_path):
    on, stream = hand()
    parts = []
    for name, counts in zip("abc", in_poses(stream), strict=True):
        path = record(tmp_path / f"{name}.mcap", on, counts)
        parts.append(prepare_recording(read_recording(path), PipelineConfig(), BLIND))
    for other in parts[1:]:
        assert_same(parts[0].graphs, other.graphs)
        assert np.array_equal(parts[0].sequence, other.sequence)


def test_a_touch_found_without_the_pose_is_told_where_it_is_in_the_pose(blind):
    on = mounted("ur5")
    taxels = on.skin.find_taxels(on.skin.patches[0].id)
    press = Press(2.4, 3.2, taxels[0], taxels[len(taxels) // 2], 40.0)
    stream = [replace(scan, q=OPEN) for scan in scans(on, [press], 25, 4.5)]
    [one] = answers(load_model("ur5"), on, stream)[1]
    [two] = answers(blind, on, stream)[1]
    for name in ("p_world", "n_world", "direction_world"):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name), atol=1e-6)


def test_models_that_say_nothing_of_it_see_the_pose(tmp_path):
    assert load_model("ur5").card.graph.posed
    assert read_card('{"vocabulary": ["none"], "graph": {}}', tmp_path).graph.posed
