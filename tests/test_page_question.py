"""Tests of what the page tells of a question: by the policy, in updates, as HTML."""

import re
from dataclasses import replace
from html import unescape

import pytest

from eskin.page import QuestionBoard
from eskin.page.__main__ import find_answer
from eskin.page.html import render_question
from eskin.page.viewer import describe_question
from helpers.commands import PAPER, PATCH, Scene, make_paused_scene
from helpers.viewer import make_setup

ASKED = QuestionBoard("poke", 0.0, "next_waypoint", "forearm_link", 0.75)


def describe(scene):
    return describe_question(scene.policy, scene.clock.now())


def test_board_tells_the_question_until_it_is_answered():
    scene = make_paused_scene()
    assert describe(scene) == QuestionBoard("poke")
    scene.touch("grab")
    first = describe(scene)
    assert (first.action, first.answer, first.is_answering) == ("resume", "poke", False)
    assert first.link == PATCH.link
    scene.wait(0.4)
    later = describe(scene)
    assert later.left == pytest.approx(first.left - 0.4, abs=0.021)
    number = scene.begin_detected("poke")
    assert describe(scene).is_answering
    scene.lift(number)
    scene.wait(0.5)
    scene.close(number)
    scene.wait(1.0)
    assert "resume" in scene.arm.orders and describe(scene) == QuestionBoard("poke")


def test_board_tells_to_rest_until_the_skin_was_quiet_for_long_enough():
    scene = make_paused_scene()
    scene.touch("grab")
    scene.wait(1.5)
    assert describe(scene) == QuestionBoard("poke", rest=5.0)
    scene.wait(3.0)
    scene.touch("poke")
    scene.wait(4.0)
    assert describe(scene).rest == 5.0
    scene.wait(1.5)
    assert describe(scene) == QuestionBoard("poke")


def test_arm_that_never_asks_names_no_answer():
    assert describe(Scene(PAPER)) == QuestionBoard("")


def read(html):
    return {k: unescape(v) for k, v in re.findall(r'data-(\w+)="([^"]*)"', html)}


@pytest.mark.parametrize(
    ("changes", "touchable", "question", "hint"),
    [
        ({}, False, "Next waypoint?", "Poke the forearm link"),
        ({}, True, "Next waypoint?", "Poke the forearm link (click)"),
        ({"action": "normal"}, False, "Full speed?", "Poke the forearm link"),
        ({"action": '<b>"x'}, False, '<b>"x?', "Poke the forearm link"),
        (
            {"answer": "double_pat"},
            False,
            "Next waypoint?",
            "Double pat the forearm link",
        ),
        ({"answer": "my_knock"}, True, "Next waypoint?", "My knock the forearm link"),
        ({"is_answering": True}, True, "Next waypoint?", "Let go and wait"),
        ({"action": ""}, True, "", ""),
    ],
)
def test_page_holds_question_how_to_answer_and_time_left(
    changes, touchable, question, hint
):
    html = render_question(replace(ASKED, **changes), make_setup(touchable))
    assert "<b>" not in html and html.startswith("<div hidden ")
    left = "0.75" if question else "0.00"
    assert read(html) == {"question": question, "hint": hint, "left": left}


def test_page_without_an_arm_asks_nothing():
    assert read(render_question(None, make_setup()))["question"] == ""


@pytest.mark.parametrize(
    ("board", "mode"),
    [
        (ASKED, "poke"),
        (replace(ASKED, answer="double_pat"), "double pat"),
        (replace(ASKED, answer="my_knock"), None),
        (QuestionBoard("poke", rest=5.0), None),
        (None, None),
    ],
)
def test_mouse_answers_by_the_gesture_that_is_asked_for(board, mode):
    assert find_answer(board) == mode
