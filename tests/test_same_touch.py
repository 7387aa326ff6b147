"""The same counts in two poses: what tells them apart, and who cannot."""

import json
from itertools import islice

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.demo import same_touch
from eskin.demo.comparison import ComparisonListener, play_touches
from eskin.demo.same_touch import (
    RecognitionResult,
    draw_touches,
    load_both_models,
    recognise_touch,
)
from eskin.page import Answer as Shown
from eskin.page import ComparisonBoard
from eskin.page.board import board
from eskin.sim.scene import are_collision_free
from helpers.worlds import world


@pytest.fixture(scope="module", autouse=True)
def small_world():
    """The small pool of poses of the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(same_touch, "load_environment", lambda skin: world())
        yield


@pytest.fixture(scope="module")
def touches(small_world):
    return draw_touches(2, seed=4)


@pytest.fixture(scope="module")
def answers(touches):
    """Of who sees the pose, and of who does not, to the first touch in both poses."""
    models = load_both_models("ur5")
    return [[recognise_touch(touches[0], side, m) for side in (0, 1)] for m in models]


def test_both_playings_have_the_same_counts_and_not_the_same_pose(touches):
    for touch in touches:
        one, other = (list(touch.scans(side, 0, None)) for side in (0, 1))
        for a, b in zip(one, other, strict=True):
            assert a.counts.tobytes() == b.counts.tobytes()
            assert a.received.tobytes() == b.received.tobytes()
            assert a.stamp == b.stamp and not np.allclose(a.q, b.q)
        assert touch.labels[0] != "none" and touch.labels[1] == "none"
        assert touch.counts.tobytes() != touches[touch is touches[0]].counts.tobytes()


def test_who_sees_no_pose_says_the_same_twice_and_who_does_another_thing(answers):
    posed, blind = answers
    assert blind[0].detected == blind[1].detected and blind[0].detected
    assert np.array_equal(blind[0].probabilities, blind[1].probabilities)
    assert len(posed[0].detected) == 1 and len(posed[1].detected) == 2
    for answer in (*posed, *blind):
        assert max(answer.probabilities) in [sure for _, sure in answer.detected]


def test_touches_are_the_same_every_time_and_others_with_another_seed(touches):
    again, other = draw_touches(1, seed=0), draw_touches(1, seed=1)
    assert not np.array_equal(other[0].counts, again[0].counts)
    assert np.array_equal(draw_touches(1, seed=1)[0].poses, other[0].poses)


def test_the_arm_goes_from_pose_to_pose_without_a_jump_or_a_collision(touches):
    period, length = touches[0].period, len(touches[0].counts)
    scans = list(islice(play_touches(touches), 5 * length))
    assert set(np.diff([scan.stamp for scan in scans])) == {period}
    q = np.array([scan.q for scan in scans])
    assert np.abs(np.diff(q, axis=0)).max() < 0.15
    np.testing.assert_allclose(q[length - 1], touches[0].poses[0])
    np.testing.assert_allclose(q[2 * length - 1], touches[0].poses[1])
    np.testing.assert_allclose(q[4 * length - 1], touches[1].poses[1])
    assert are_collision_free(world(), world().poses(q)).all()


def test_the_page_is_told_what_is_said_without_it(touches, answers):
    heard, touch = ComparisonListener(touches, load_both_models("ur5")), touches[0]
    length = len(touch.counts)
    for scan in islice(play_touches(touches), 2 * length - 1):
        heard.on_message(scan)
    told = heard.board
    assert told is not None and told.done == touch.labels and told.playing == 1
    for (_, row), known in zip(told.rows, answers, strict=True):
        for shown, answer, label in zip(row, known, touch.labels, strict=True):
            assert shown.texts == answer.texts
            assert shown.right == answer.is_correct(label)
            np.testing.assert_allclose(
                shown.probabilities, answer.probabilities, rtol=1e-6
            )
    for scan in islice(play_touches(touches), 2 * length, 2 * length + 1):
        heard.on_message(scan)
    told = heard.board
    assert told is not None and told.playing == 0 and told.title.endswith("touch 2")
    assert all(not answer.texts for _, row in told.rows for answer in row)


def test_an_answer_is_right_that_says_what_is_done_once_and_nothing_else():
    nothing = np.zeros(3)

    def right(label, *said):
        return RecognitionResult(
            tuple((each, 0.9) for each in said), nothing
        ).is_correct(label)

    assert right("grab", "grab") and right("grab", "none", "grab")
    assert right("none", "none", "unknown") and right("none")
    assert not right("grab", "none") and not right("grab", "grab", "grab")
    assert not right("none", "none", "poke")


def test_the_board_shows_every_answer_and_no_markup_of_others():
    chances = np.array([0.25, 0.75], np.float32)
    rows = (
        ("<b>who</b>", (Shown(("grab 75%",), True, chances), Shown((), None, chances))),
    )
    html = board(
        ComparisonBoard("title", ("one", "two"), ("grab", "none"), 0, rows), ("a", "b")
    )
    for text in ("title", "one", "two", "truly: grab", "grab 75%", "75%", "25%"):
        assert text in html
    assert "<b>who</b>" not in html and "first pose" in board(None, ("a",))


def test_the_command_prints_the_answers(capsys):
    assert run(["demo", "--same-touch", "--headless", "--pairs", "1", "--json"]) == 0
    out = capsys.readouterr().out.splitlines()
    told = json.loads(out[-1])
    assert (told["playings"], told["blind_same"]) == (2, 1)
    [pair] = told["pairs"]
    assert pair["labels"][1] == "none" and pair["blind"][0] == pair["blind"][1]
    assert out[0].startswith("touch 1: ")


@pytest.mark.parametrize(
    "words",
    [["--pairs", "0"], ["--commands", "a.yaml"], ["--skin", "none"], ["--seed", "-1"]],
)
def test_what_cannot_be_played_is_refused(words, capsys):
    assert run(["demo", "--same-touch", "--headless", *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
