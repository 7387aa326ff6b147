"""These tests check the demonstration that plays the same counts in two poses."""

import json
from itertools import islice

import numpy as np
import pytest
from eskin.demo import same_touch

from eskin.cli.main import run
from eskin.page import Answer, ComparisonBoard
from eskin.page.boards import render_board
from eskin.sim.scene import are_collision_free
from helpers.worlds import world
from lab.same_touch.board import ComparisonListener, play_touches
from lab.same_touch.touches import (
    RecognitionResult,
    draw_touches,
    load_both_models,
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
    models = load_both_models("ur5")
    return [[recognise_touch(touches[0], side, m) for side in (0, 1)] for m in models]


def test_both_playbacks_have_equal_counts_and_different_poses(touches):
    for touch in touches:
        for one, other in zip(
            touch.scans(0, 0, None), touch.scans(1, 0, None), strict=True
        ):
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


def test_arm_moves_between_poses_without_jump_or_collision(touches):
    period, length = touches[0].period, len(touches[0].counts)
    scans = list(islice(play_touches(touches), 5 * length))
    assert set(np.diff([scan.stamp for scan in scans])) == {period}
    q = np.array([scan.q for scan in scans])
    assert np.abs(np.diff(q, axis=0)).max() < 0.15
    expected = [*touches[0].poses, *touches[1].poses, touches[0].poses[0]]
    np.testing.assert_allclose(q[length - 1 :: length], expected)
    assert are_collision_free(world(), world().poses(q)).all()


def test_listener_shows_the_results_on_its_board(touches, results):
    listener, touch = ComparisonListener(touches, load_both_models("ur5")), touches[0]
    length = len(touch.counts)
    scans = list(islice(play_touches(touches), 2 * length + 1))
    for scan in scans[: 2 * length - 1]:
        listener.on_message(scan)
    shown = listener.board
    assert shown is not None and (shown.done, shown.playing) == (touch.labels, 1)
    for (_, row), expected in zip(shown.rows, results, strict=True):
        for answer, result, label in zip(row, expected, touch.labels, strict=True):
            assert answer.texts == result.texts
            assert answer.right == result.is_correct(label)
            np.testing.assert_allclose(
                answer.probabilities, result.probabilities, rtol=1e-6
            )
    listener.on_message(scans[2 * length])
    shown = listener.board
    assert shown is not None and shown.playing == 0 and shown.title.endswith("touch 2")
    assert all(not answer.texts for _, row in shown.rows for answer in row)


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


def test_board_shows_every_answer_and_escapes_names():
    chances = np.array([0.25, 0.75], np.float32)
    answers = Answer(("grab 75%",), True, chances), Answer((), None, chances)
    rows = (("<b>who</b>", answers),)
    shown = ComparisonBoard("title", ("one", "two"), ("grab", "none"), 0, rows)
    html = render_board(shown, ("a", "b"))
    for text in ("title", "one", "two", "true label: grab", "grab 75%", "75%", "25%"):
        assert text in html
    assert "<b>who</b>" not in html and "first pose" in render_board(None, ("a",))


def test_command_prints_the_results(capsys):
    assert run(["demo", "--same-touch", "--headless", "--pairs", "1", "--json"]) == 0
    first, *_, last = capsys.readouterr().out.splitlines()
    printed = json.loads(last)
    assert (printed["playings"], printed["blind_same"]) == (2, 1)
    [pair] = printed["pairs"]
    assert pair["labels"][1] == "none" and pair["blind"][0] == pair["blind"][1]
    assert first.startswith("touch 1: ")


@pytest.mark.parametrize(
    "words", ["--pairs 0", "--commands a.yaml", "--skin none", "--seed -1"]
)
def test_command_refuses_bad_options_in_one_line(words, capsys):
    assert run(["demo", "--same-touch", "--headless", *words.split()]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
