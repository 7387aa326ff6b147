"""Tests of the documentation: its blocks of commands run as they stand."""

import re
import shlex
import socket
from pathlib import Path

import pytest

from eskin.cli.main import run
from helpers.workshop import open_workshop, stand_in
from test_docs import find_lines

pytestmark = pytest.mark.slow

LEFT_OUT = {
    r"eskin demo": "runs until its page is closed; test_demo runs it",
    r".* --view": "runs until its page is closed; test_page_browser opens pages",
    r".* --ros2": "needs ROS 2; test_bus_ros2 runs it with a stand-in",
    r".* --foxglove": "runs until it is stopped; test_bus_foxglove runs it",
    r".* ur://": "needs the controller of a UR; lab.ur_stop runs it with a stand-in",
    r".* xela://": "needs a server of modules; test_drivers_devices runs it with one",
    r"eskin skin paint": "waits for a person in a browser",
    r"eskin train": "takes minutes; lab.first_hour runs it",
    r"eskin generate": "makes sets for hours; test_docs generates a small one",
    r"eskin bench": "measures for minutes; test_bench_command runs it",
    r"eskin convert table": "needs files of others; test_sets_readings converts some",
    r"eskin label SETS": "needs a set; test_recording_labels labels one",
    r"eskin (replay|evaluate) .*paper": "needs the weights of its first line",
    r"eskin evaluate mine": "needs 16 touches; test_cli_evaluate evaluates",
    r".*(presses|practice|unseen)\.mcap": "lab.first_hour runs it",
    r"eskin (calibrate|record|run) .*(--bits 10|--times 5|--record session)": (
        "lab.first_hour runs it"
    ),
}
"""Commands that are not run here, by how they begin, with the reason."""
LONG = (
    r"eskin (record|calibrate|doctor|device|skin (pose|check .*(--live|panda)|design))|"
    r"eskin skin .*(--picture|--out ur5)"
)
"""Commands that wait for a person, or compute for seconds."""
SECONDS = r"eskin (run|device) "
"""Commands that go on until they are stopped."""
NEW = r"eskin skin (?:points .*--out|convert skin\.csv) (\S+)"
"""Commands that write what others of the workshop read, and replace nothing."""


def find_commands():
    """Return the commands of `eskin` that are run, those that take long marked."""
    lines = [line for line in find_lines() if line.startswith("eskin ")]
    runs = [line for line in lines if not any(re.match(p, line) for p in LEFT_OUT)]
    return [
        pytest.param(line, marks=[pytest.mark.long] * bool(re.match(LONG, line)))
        for line in runs
    ]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    """Return a folder with a robot and a skin of one's own."""
    folder = tmp_path_factory.mktemp("workshop")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        open_workshop(folder)
    return folder


def test_every_reason_to_leave_a_command_out_is_needed():
    lines = find_lines()
    for pattern in LEFT_OUT:
        assert any(re.match(pattern, line) for line in lines), pattern


@pytest.mark.parametrize("line", find_commands())
def test_command_of_a_block_runs_as_it_stands(line, workshop, monkeypatch, capsys):
    monkeypatch.chdir(workshop)
    words = shlex.split(line.replace(":9750", f":{find_free_port()}"))[1:]
    if re.match(SECONDS, line):
        words += ["--seconds", "1"]
    if written := re.match(NEW, line):
        Path(written[1]).rename(f"{written[1]}.before")
    with stand_in(workshop, words) as given:
        assert run(given) == 0, capsys.readouterr().err


def find_free_port():
    """Return a UDP port that nobody listens at."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]
