"""Tests of the walks: the tutorial as it stands, and what the engineer counts."""

import re
import shlex
import socket
import tempfile
from pathlib import Path

import pytest

from eskin.cli.main import load_command, parse, run, split_command
from eskin.robot import load_robot
from lab.first_hour.engineer import FULL, PRESS, REQUEST, TAKEN, Walk, write_arm
from lab.first_hour.page import (
    PAGE,
    Step,
    find_detections,
    find_made,
    read_steps,
    run_step,
)

STEPS = read_steps()


def find_commands(steps=STEPS):
    """Return the words of every `eskin` command of steps, by default of the page."""
    script = "".join(step.script for step in steps).replace("\\\n", " ")
    lines = re.findall(r"^eskin (.*?)&?$", script, re.MULTILINE)
    return [shlex.split(line) for line in lines]


def test_steps_are_numbered_and_all_blocks_of_commands_are_in_one():
    titles = [step.title.split(".")[0] for step in STEPS]
    assert titles == [str(number + 1) for number in range(len(STEPS))]
    blocks = PAGE.read_text().count("```bash")
    assert sum(bool(step.script) for step in STEPS) == blocks > 5


@pytest.mark.slow
@pytest.mark.parametrize("words", find_commands(), ids=" ".join)
def test_commands_of_the_page_are_those_of_eskin(words):
    name, rest = split_command(words)
    parse(load_command(name)[1], f"eskin {name}", rest)


@pytest.mark.slow
def test_robot_and_skin_are_made_as_the_page_says(tmp_path, monkeypatch, capsys):
    robot, skin = (step for step in STEPS if re.match("[23]", step.title))
    run_step(robot, tmp_path)
    monkeypatch.chdir(tmp_path)
    assert [run(words) for words in find_commands([skin])] == [0, 0]
    assert "no problems, checked on robot arm" in capsys.readouterr().out
    assert len((tmp_path / "my_skin" / "taxels.csv").read_text().split()) == 257


def test_failing_step_is_named_with_what_it_printed(tmp_path):
    step = Step("9. Wrong", "echo so far\nfalse\n")
    with pytest.raises(RuntimeError, match=r"9\. Wrong failed: so far"):
        run_step(step, tmp_path)


@pytest.mark.long
def test_page_leads_from_an_empty_folder_to_live_detections():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    with tempfile.TemporaryDirectory() as folder:
        steps = read_steps(port)
        printed = [run_step(step, Path(folder)) for step in steps]
    assert find_detections(printed[-1]) == find_made(steps)


def test_arm_of_the_engineer_has_seven_joints_that_turn(tmp_path):
    write_arm(tmp_path / "arm7.urdf")
    robot = load_robot(tmp_path / "arm7.urdf")
    assert [joint.kind for joint in robot.actuated_joints] == ["revolute"] * 7


def test_walk_counts_what_was_taken_at_once_and_answered_rightly_alone(tmp_path):
    walk = Walk(tmp_path, FULL, show=False)
    walk.tries = {"knock 1": [True], "knock 2": [False, True], "none 1": [False]}
    assert walk.taken == 1
    walk.made = ["knock", "circle", "none", "none"]
    walk.answered = [["knock"], ["knock"], [], ["none", "none"]]
    assert walk.right == 1


def test_hand_understands_what_the_guides_print():
    (step,) = (each for each in STEPS if each.title.startswith("5."))
    printed = PAGE.read_text().partition(step.title)[2]
    found = PRESS.search(printed)
    assert found and (found["row"], found["column"]) == ("7", "7")
    found = REQUEST.search(printed)
    assert found and (found["gesture"], found["number"]) == ("knock", "1")
    assert TAKEN.search(printed)
