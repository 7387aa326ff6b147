"""These tests check the demonstration that plays the same counts in two poses."""

import json

import numpy as np
import pytest

from eskin.live import load_model
from helpers.worlds import world
from lab import same_touch
from lab.program import run_program
from lab.same_touch import (
    RecognitionResult,
    draw_touches,
    recognise_touch,
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def small_world():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(same_touch, "load_environment", lambda skin: world())
        yield


@pytest.fixture(scope="module")
def touches(small_world):
    return draw_touches(2, seed=4)


@pytest.fixture(scope="module")
def results(touches):
    """Return the results of the model with pose, then without, in both poses."""
    models = load_model("ur5"), load_model("ur5-blind")
    return [[recognise_touch(touches[0], side, m) for side in (0, 1)] for m in models]


def test_both_playbacks_have_equal_counts_and_different_poses(touches):
    for touch in touches:
        for one, other in zip(touch.scans(0), touch.scans(1), strict=True):
            assert one.counts.tobytes() == other.counts.tobytes()
            assert one.received.tobytes() == other.received.tobytes()
            assert one.stamp == other.stamp and not np.allclose(one.q, other.q)
        assert touch.labels[0] != "none" == touch.labels[1]
    assert touches[0].counts.tobytes() != touches[1].counts.tobytes()


def test_only_the_model_with_pose_tells_the_poses_apart(results):
    posed, blind = results
    assert blind[0].detected == blind[1].detected and blind[0].detected
    assert np.array_equal(blind[0].probabilities, blind[1].probabilities)
    assert len(posed[0].detected) == 1 and len(posed[1].detected) == 2
    for result in (*posed, *blind):
        assert max(result.probabilities) in [sure for _, sure in result.detected]


@pytest.mark.parametrize(
    ("label", "detected", "correct"),
    [
        ("grab", ["grab"], True),
        ("grab", ["none", "grab"], True),
        ("none", ["none", "unknown"], True),
        ("none", [], True),
        ("grab", ["none"], False),
        ("grab", ["grab", "grab"], False),
        ("none", ["none", "poke"], False),
    ],
)
def test_result_is_correct_if_it_is_the_label_once_and_nothing_else(
    label, detected, correct
):
    pairs = tuple((gesture, 0.9) for gesture in detected)
    assert RecognitionResult(pairs, np.zeros(3)).is_correct(label) == correct


def test_command_prints_the_results(capsys):
    assert run_program(same_touch.main, ["--pairs", "1", "--json"]) == 0
    first, *_, last = capsys.readouterr().out.splitlines()
    printed = json.loads(last)
    assert (printed["playings"], printed["blind_same"]) == (2, 1)
    [pair] = printed["pairs"]
    assert pair["labels"][1] == "none" and pair["blind"][0] == pair["blind"][1]
    assert first.startswith("touch 1: ")


@pytest.mark.parametrize("words", [["--pairs", "0"], ["--seed", "-1"]])
def test_program_refuses_numbers_out_of_range_in_one_line(words, capsys):
    assert run_program(same_touch.main, words) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
