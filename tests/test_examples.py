"""Tests of the examples: each runs on a tiny budget and refuses missing data."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from importlib.machinery import SourceFileLoader
from types import ModuleType

import pytest
from cyclonedds.core import DDSException

from eskin.bus import Publisher
from eskin.bus.ros2 import Ros2Bus, Ros2Node
from eskin.live import Recognizer
from eskin.recording.messages import DETECTION
from eskin.stream import Recognition, Stream
from helpers.examples import EXAMPLES
from helpers.live import VOCABULARY, Press, calibration_of, mounted, say_always, scans
from helpers.ros2 import PATIENCE, start_when_heard
from helpers.socialtouch import pressed, text_of, write_socialtouch
from helpers.streams import INFO, played

pytestmark = pytest.mark.slow

REAL_TOUCHES = "01_real_touches.py"
ROS2_SUBSCRIBER = "06_ros2_subscriber.py"
ONNX_STEP = "07_onnx_step.py"  # run by `test_cli_export.py`, which exports a network


def prepare_people(folder):
    """Write a poke and a resting hand of each of two people of the SocialTouch set."""
    for person, gesture in ((0, 6), (0, 0), (1, 6), (1, 0)):
        name = f"touch_p{person}_g{gesture}-20_4_17h_5m_23s.csv"
        touch = pressed() if gesture else pressed((2, 20), 22, slice(0, 12))
        write_socialtouch(folder, name, text_of([touch], person, gesture))
    return "--data", folder


RUNS = {
    REAL_TOUCHES: (
        prepare_people,
        r"  P0 poke_short +poke +taken for (?s:.*)"
        r"\n\d+% of 4 touches; 50% by chance, 50% by always \w+, 100% by duration",
    ),
    "02_simulated_touches.py": (
        lambda _: ("--seconds", 6),
        r"grab +9\d%  forearm_link",
    ),
    "03_own_skin.py": (
        lambda folder: ("--out", folder, "--seconds", 9),
        r"320 taxels, problems: none\n\w+ +\d+% on sleeve",
    ),
    "04_own_gestures.py": (
        lambda _: (
            "--train.epochs 1 --train.steps 2 --train.batch 8 "
            "--train.encoded 2 --train.ridge 0".split()
        ),
        r"made: +circle none knock .*\nrecognised: +\w+ \w+",
    ),
    "05_command_function.py": (
        lambda _: ("--seconds", 7),
        r"stroke +\d+%(?s:.*)function +(not )?done",  # in real time: busy cores refuse
    ),
}
"""Arguments of each example on a tiny budget, and a pattern in what it prints."""


def test_examples_are_seven_numbered_and_say_how_they_are_run():
    paths = sorted(EXAMPLES.glob("*.py"))
    assert [path.name for path in paths] == sorted([*RUNS, ROS2_SUBSCRIBER, ONNX_STEP])
    for number, path in enumerate(paths, 1):
        title, *lines = path.read_text().splitlines()
        assert path.name.startswith(f"{number:02}_"), path
        assert title.startswith('"""') and title.endswith(".")
        assert any(
            line.startswith(f"    python examples/{path.name}") for line in lines
        )
    assert len(paths) == 7


def test_cells_of_the_notebook_run_in_order():
    notebook = json.loads((EXAMPLES / "touches.ipynb").read_text())
    cells = [c for c in notebook["cells"] if c["cell_type"] == "code"]
    assert not any(cell["outputs"] or cell["execution_count"] for cell in cells)
    space: dict = {}
    code = ["".join(cell["source"]) for cell in cells]
    assert "clips=2" in code[0]
    for text in code:
        short = text.replace("clips=2", "clips=1")
        exec(compile(short, "touches.ipynb", "exec"), space)
    assert len(space["touches"]) >= 1 and space["found"]


def test_examples_are_named_in_the_table_of_the_documentation():
    table = (EXAMPLES.parent / "docs" / "examples.md").read_text()
    for path in EXAMPLES.glob("*.py"):
        title = path.read_text().splitlines()[0].strip('".')
        assert f"| `examples/{path.name}` | {title} |" in table


@pytest.mark.parametrize("name", RUNS)
def test_example_runs_without_hardware(name, tmp_path, run_example):
    prepare, pattern = RUNS[name]
    code, out, _ = run_example(name, *prepare(tmp_path))
    assert code == 0 and re.search(pattern, out.strip()), out


@pytest.mark.parametrize("content", ["nothing", "folder", "other"])
def test_real_touches_refuses_missing_data_in_one_line(content, tmp_path, run_example):
    data = tmp_path / "data"
    if content != "nothing":
        data.mkdir()
    if content == "other":
        (data / "notes.txt").write_text("no recordings here")
    code, out, err = run_example(REAL_TOUCHES, "--data", data)
    assert code == 2 and len(err.splitlines()) == 1
    assert out == "" and str(data) in err
    assert "github.com/yliess86/SocialTouch" in err
    assert "make touches SOCIALTOUCH=" in err


def test_ros2_subscriber_prints_the_detections_of_a_running_stream(domain):
    on = mounted()
    source = played(scans(on, [Press(2.3, 2.7, 65, 65)], 50, 3.5))
    source.info = replace(INFO, mounted=on)
    recognizer = Recognizer(say_always("poke"), on, calibration_of(on.skin))
    bus = Ros2Bus(Ros2Node())
    publisher = Publisher(bus, on, VOCABULARY, drop="never")
    publisher.start = start_when_heard(publisher.start, bus, (DETECTION,))
    words = [sys.executable, str(EXAMPLES / ROS2_SUBSCRIBER), "--count", "1"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as subscriber:
        listeners = [Recognition(recognizer, drop="never"), publisher]
        with Stream(source, listeners, patience=PATIENCE) as stream:
            stream.wait()
        out, _ = subscriber.communicate(timeout=PATIENCE)
    assert subscriber.returncode == 0
    assert re.fullmatch(r"poke \d+% on table\n", out), out


def test_ros2_subscriber_asks_again_for_a_type_that_does_not_come_in_time(domain):
    example = SourceFileLoader("subscriber", str(EXAMPLES / ROS2_SUBSCRIBER))
    module = ModuleType("subscriber")
    example.exec_module(module)
    answer = module.get_types_for_typeid
    asked = []

    def answer_late(*arguments):
        asked.append(arguments)
        if len(asked) == 1:
            raise DDSException(DDSException.DDS_RETCODE_TIMEOUT)
        return answer(*arguments)

    module.get_types_for_typeid = answer_late
    bus = Ros2Bus(Ros2Node())
    node = Ros2Node()
    bus.open((DETECTION,))
    found = module.discover_type(node.participant)
    assert "Detection_" in found.__name__ and len(asked) == 2
