"""Tests of `eskin run`, from bytes or files to its last line, with and without arm."""

import os
import signal
import socket
import subprocess
import sys
import threading
from dataclasses import replace
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import eskin.app
from eskin.arms import SimulatedArm
from eskin.cli.main import STOPPED
from eskin.cli.run import (
    RunCommand,
    build_listeners,
    build_policy,
    check_options,
    describe_doubts,
    describe_forces,
    open_command_arm,
)
from eskin.cli.terminal import TerminalPrinter
from eskin.drivers import HostClock, ManualClock, PlayedSource
from eskin.errors import ArmError, CommandError, DeviceError
from eskin.live import Recognizer
from eskin.page import QuestionBoard
from eskin.page.viewer import Viewer
from eskin.recording import Metadata, RecordingWriter, read_recording, write_all
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.skin import mount_skin, save_skin
from eskin.stream import Recognition
from eskin.touch import Calibration
from helpers.cli import call, call_json
from helpers.commands import make_paused_scene
from helpers.devices import (
    RATE,
    StillSimulator,
    playing,
    scans_of,
    small_skin,
    udp_skin,
)
from helpers.live import Press, mounted, record, scans

pytestmark = pytest.mark.slow

PAUSING = "version: 1\ncommands:\n  - gesture: poke\n    action: pause\n"
SLOWING = PAUSING.replace("pause", "slow")
SECOND = 1_000_000_000
REAL = "--source csv:a --robot ur://127.0.0.1"
SIMULATED = "--source csv:a --robot sim:ur5"


UNUSED = {
    "eskin.bus",
    "eskin.design",
    "eskin.exports",
    "eskin.learn",
    "eskin.page",
    "eskin.sim",
    "matplotlib",
    "pandas",
    "rich",
    "scipy.linalg",
    "scipy.sparse",
    "scipy.spatial",
    "scipy.special",
    "sklearn",
    "torch",
    "trimesh",
    "viser",
    "websockets",
}
"""Packages that a recording is recognised without: each takes time to import."""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """The path of a recording of one press, and its number of scans."""
    path = tmp_path_factory.mktemp("run") / "touched.mcap"
    stream = scans(mounted(), [Press(2.3, 2.7, 65, 65)], 50, 3.5)
    return record(path, mounted(), stream), len(stream)


def test_recording_is_recognised_counted_and_recorded(recording, tmp_path, capsys):
    path, count = recording
    words = ["--source", f"replay:{path}", "--pace", 10]
    result, out = call_json(capsys, "run", *words, "--record", tmp_path / "kept.mcap")
    assert (result["readings"], result["dropped"], result["commands"]) == (count, 0, 0)
    assert result["detections"] == 1
    assert "where" in out and f"{count} readings, 0 dropped" in out
    assert result["source"] == {"readings": count}
    assert result["queues"]["recognition"]["taken"] == count
    kept = read_recording(tmp_path / "kept.mcap")
    assert kept.count == count and not kept.truncated
    assert len(kept.detections) == 1 and kept.metadata.session == f"replay:{path}"


@pytest.mark.parametrize(
    "words", ["run --source replay:{path} --pace inf", "replay {path}"]
)
def test_recording_is_recognised_without_packages_that_others_need(words, recording):
    code = (
        "import sys; from eskin.cli.main import run; code = run(sys.argv[1:]); "
        "print(*sys.modules); sys.exit(code)"
    )
    told = subprocess.run(
        [sys.executable, "-c", code, *words.format(path=recording[0]).split()],
        capture_output=True,
        text=True,
        check=True,
    )
    assert not UNUSED & set(told.stdout.splitlines()[-1].split())


def test_simulation_runs_for_given_time(capsys, monkeypatch):
    monkeypatch.setattr("eskin.sim.dataset.Simulator", StillSimulator)
    result, _ = call_json(capsys, "run", "--source", "sim:ur5", "--seconds", 0.5)
    assert 10 <= result["readings"] <= 60 and result["detections"] == 0


def test_patches_are_received_over_udp(capsys, tmp_path):
    skin = small_skin()
    save_skin(skin, tmp_path / "skin")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["--skin", tmp_path / "skin", "--robot-urdf", "table", "--seconds", 1]
    with playing(udp_skin(skin, port), scans_of(skin, 10_000), HostClock()):
        result, _ = call_json(
            capsys, "run", "--source", f"udp://127.0.0.1:{port}", *words
        )
    assert result["source"]["datagrams"] > RATE and result["source"]["used"] > 0


def test_interrupt_finishes_recording(recording, tmp_path, capsys, monkeypatch):
    path, count = recording
    kept = tmp_path / "kept.mcap"
    start = TerminalPrinter.start

    def start_and_interrupt(printer, context):
        start(printer, context)
        threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()

    monkeypatch.setattr(TerminalPrinter, "start", start_and_interrupt)
    words = ("--source", f"replay:{path}", "--pace", 0.5, "--record", kept)
    result, _ = call_json(capsys, "run", *words)
    assert 0 < result["readings"] < count
    finished = read_recording(kept)
    assert finished.count == result["readings"] and not finished.truncated


def test_failing_stream_is_one_line_and_exit_code_1(recording, capsys, monkeypatch):
    def fail(source, timeout=None):
        raise DeviceError("port is lost\nfor good")

    monkeypatch.setattr(PlayedSource, "read", fail)
    code, _, err = call(capsys, "run", "--source", f"replay:{recording[0]}")
    assert code == 1
    assert "port is lost for good" in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ("--source replay:nowhere.mcap", ("nowhere.mcap",)),
        ("--source udp://127.0.0.1:9750", ("without a skin",)),
        ("--source can:0", ("serial:PATH",)),
        ("--source sim:nose", ("nose",)),
        ("--source sim:ur5 --model nose", ("nose",)),
        ("--source sim:ur5 --seconds 0", ("--seconds is 0.0",)),
        ("--source sim:ur5 --pace nan", ("--pace is nan",)),
        ("--source sim:ur5 --piece-mb 1", ("--piece-mb", "--record")),
        ("--source sim:ur5 --commands a.yaml", ("--commands", "--robot")),
        ("--source sim:ur5 --port 8081", ("--port", "--view")),
        ("--source sim:ur5 --robot sim:ur5 --q 0 0 0 0 0 0", ("--q", "--robot")),
        ("--source udp://0.0.0.0:9 --robot ur://127.0.0.1", ("remote",)),
        ("--source udp://127.0.0.1:9 --robot ur://a", ("--key", "unauthenticated")),
        ("--source sim:ur5 --robot ur://a", ("--allow-simulated-touch",)),
        ("--source replay:a.mcap --robot ur://a", ("--allow-simulated-touch",)),
        ("--source csv:a --robot ur://a --commands paper", ("paper: answer",)),
        ("--source csv:a --robot ur://a --commands no.yaml", ("no.yaml", "read")),
        (f"{REAL}", ("cannot ask", "terminal, page (with --view)", "output:N")),
        (f"{REAL} --ask terminal horn", ("'horn'", "terminal, page (with --view)")),
        (f"{REAL} --ask output:x", ("'output:x'", "output:N")),
        (f"{REAL} --ask page", ("--ask page", "--view")),
        (f"{REAL} --ask terminal ros2", ("--ask ros2", "--ros2")),
        (f"{REAL} --ask foxglove", ("--ask foxglove", "--foxglove")),
        (f"{REAL} --ask output:0", ("output 0", "0 to 7 except 0")),
        (f"{REAL} --ask output:8", ("output 8", "0 to 7 except 0")),
        (f"{REAL} --ask output:1 output:2", ("2 outputs",)),
        (f"{SIMULATED} --ask output:1", ("output 1", "no outputs")),
        ("--source csv:a --ask terminal", ("--ask", "--robot")),
        ("--source sim:ur5 --robot sim:ur5 --pace inf", ("--pace is inf", "allowed")),
        ("--source replay:a --robot sim:ur5 --pace 0.5", ("--pace is 0.5", "allowed")),
        (f"{REAL} --ask terminal --pace 2", ("--pace is 2", "allowed is 1")),
        ("--source sim:ur5 --key none", ("--key", "leave it out")),
        ("--source udp://127.0.0.1:9 --skin ur5 --key none", ("key none",)),
        ("", ("--source",)),
    ],
)
def test_invalid_option_is_one_line_and_exit_code_2(words, parts, capsys):
    code, out, err = call(capsys, "run", *words.split())
    assert (code, out) == (2, "") and err.count("\n") == 1
    assert all(part in err for part in parts)


def test_recording_that_cannot_be_written_is_refused(recording, capsys, tmp_path):
    words = ["--source", f"replay:{recording[0]}", "--record", tmp_path / "no/a.mcap"]
    code, _, err = call(capsys, "run", *words)
    assert code == 2 and err.count("\n") == 1


@pytest.mark.parametrize(
    ("source", "options", "shown"),
    [
        ("serial:/dev/ttyACM0", {}, ""),
        ("udp://0.0.0.0:9", {"key": Path("a")}, ""),
        ("udp://127.0.0.1:9", {"allow_unauthenticated": True}, "unauthenticated"),
        (
            "udp://0.0.0.0:9",
            {"allow_unauthenticated": True, "allow_remote": True},
            "unauthenticated",
        ),
        ("sim:ur5", {"allow_simulated_touch": True}, "simulated"),
        ("replay:a.mcap", {"allow_simulated_touch": True}, "simulated"),
    ],
)
def test_source_that_may_move_a_robot_shows_its_doubt(source, options, shown):
    robot = "ur://127.0.0.1"
    ask = ("terminal",)
    command = RunCommand((source,), robot=robot, ask=ask, skin="ur5", **options)
    check_options(command)
    calibration = replace(Calibration.uniform(4, 4095, 400.0), source="rest")
    doubts = describe_doubts(command, calibration)
    assert [doubt.split(":")[0] for doubt in doubts] == [shown] * bool(shown)


@pytest.mark.parametrize(
    ("robot", "ask", "options", "output"),
    [
        ("sim:ur5", (), {}, None),
        ("sim:ur5", ("terminal", "page"), {"view": True}, None),
        ("ur://127.0.0.1", ("foxglove",), {"foxglove": True}, None),
        ("ur://127.0.0.1", ("output:7",), {}, 7),
        ("ur://127.0.0.1", ("terminal", "ros2", "output:1"), {"ros2": True}, 1),
    ],
)
def test_arm_is_opened_with_output_that_it_asks_by(
    robot, ask, options, output, monkeypatch
):
    def keep(uri, **given):
        opened.append((uri, given["question_output"]))

    opened = []
    monkeypatch.setattr(eskin.app, "open_arm", keep)
    command = RunCommand(("csv:a",), robot=robot, ask=ask, **options)
    check_options(command)
    open_command_arm(command, ManualClock())
    assert opened == [(robot, output)]


@pytest.mark.parametrize(
    ("source", "measured", "warned"),
    [
        ("serial:/dev/ttyUSB0", "nominal", True),
        ("serial:/dev/ttyUSB0", "rest", False),
        ("sim:ur5", "nominal", False),
    ],
)
def test_device_without_a_calibration_of_its_own_is_warned_of(source, measured, warned):
    calibration = replace(Calibration.uniform(4, 4095, 400.0), source=measured)
    doubts = describe_doubts(RunCommand((source,), skin="ur5"), calibration)
    assert any("eskin calibrate" in doubt for doubt in doubts) == warned


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"source": "rest"}, "forces are relative"),
        (
            {"source": "presses", "gain_deviation": np.array([0.1, 0.4])},
            "factor of 2.2",
        ),
        ({"source": "exact"}, ""),
    ],
)
def test_how_far_forces_may_be_from_the_true_ones_is_told(changes, part):
    """By the patch that is known least; of no calibration at all the doubt says it."""
    told = describe_forces(replace(Calibration.uniform(4, 4095, 400.0), **changes))
    assert part in told and bool(told) == bool(part)


@pytest.fixture
def pokes(tmp_path):
    """The path of a recording of a hand that pokes the forearm four times."""
    live = InteractiveSkin(seed=5)
    skin = live.mounted.skin
    place = skin.positions[skin.find_taxels("forearm_back")[100]].astype(float)
    stream = []
    for number in range(300):
        if number in (120, 165, 210, 255):
            live.hand.poke(LinkPoint("forearm_link", place), 12.0, 0.3)
        stream.append(live.scan(SECOND + number * SECOND // 50, np.zeros(6)))
    path = tmp_path / "poked.mcap"
    metadata = Metadata(dataset="scene", session="one")
    with RecordingWriter(path, "ur5", skin, live.calibration, metadata) as writer:
        write_all(writer, stream, ())
    return path


def test_pokes_of_recording_pause_arm(pokes, tmp_path, monkeypatch, capsys):
    arms = []
    open_arm = eskin.app.open_arm

    def open_and_keep(*arguments, **options):
        arms.append(open_arm(*arguments, **options))
        return arms[-1]

    monkeypatch.setattr(eskin.app, "open_arm", open_and_keep)
    (tmp_path / "pausing.yaml").write_text(PAUSING)
    words = ["--source", f"replay:{pokes}", "--robot", "sim:ur5"]
    result, out = call_json(
        capsys, "run", *words, "--commands", tmp_path / "pausing.yaml"
    )
    (arm,) = arms
    assert arm.state().paused
    assert result["readings"] == 300 and result["detections"] >= result["commands"] >= 1
    assert "done: poke on forearm_back" in out


@pytest.fixture
def policy_of(tmp_path):
    """Build the policy of a simulated UR5 for a model, a command map and a robot."""

    def policy_of(gestures=("none", "poke"), commands=None, urdf="ur5"):
        mounted = mount_skin("ur5", urdf)
        info = SimpleNamespace(skin=mounted.skin, mounted=mounted)
        model = SimpleNamespace(card=SimpleNamespace(vocabulary=gestures))
        path = tmp_path / "map.yaml"
        path.write_text(commands or PAUSING)
        command = RunCommand(("replay:a",), commands=commands and path)
        arm = SimulatedArm(clock=ManualClock())
        return build_policy(command, arm, model, SimpleNamespace(info=info))

    return policy_of


def test_arm_that_no_gesture_can_stop_is_refused(policy_of):
    policy_of().close()
    policy_of(commands=PAUSING).close()
    for wrong in ({"gestures": ("none", "knock")}, {"commands": SLOWING}):
        with pytest.raises(CommandError, match="no gesture of the model that pauses"):
            policy_of(**wrong)


def test_arm_of_other_joints_than_the_robot_of_the_skin_is_refused(policy_of, tmp_path):
    urdf = (resources.files("eskin.robot") / "presets" / "ur5.urdf").read_text()
    other = tmp_path / "gen3.urdf"
    other.write_text(urdf.replace("shoulder_pan_joint", "joint_1"))
    with pytest.raises(ArmError, match="joint_1.* and its arm has shoulder_pan"):
        policy_of(urdf=other)


def test_reader_that_closes_the_output_ends_the_stream(pokes, monkeypatch, capsys):
    def fail(*_):
        raise BrokenPipeError

    monkeypatch.setattr(TerminalPrinter, "on_message", fail)
    monkeypatch.setattr("eskin.cli.main.drop_output", lambda: None)
    words = ("run", "--source", f"replay:{pokes}", "--pace", "inf")
    assert call(capsys, *words)[::2] == (STOPPED, "")


def test_page_of_run_shows_its_arm_and_takes_no_touches():
    recognition = Recognition(Recognizer.load("ur5"))
    command = RunCommand(("udp://127.0.0.1:9",), view=True, port=0)
    for arm in (SimulatedArm(clock=ManualClock()), None):
        doubts = ("unauthenticated", "not calibrated")
        viewer = build_listeners(command, None, recognition, arm, [], doubts)[-1]
        assert isinstance(viewer, Viewer) and viewer.arm is arm
        scene = viewer.describe_scene()
        assert scene.is_arm == (arm is not None) and not scene.touchable
        assert scene.warning == "unauthenticated; not calibrated"


def test_page_of_run_shows_what_its_policy_asks():
    recognition = Recognition(Recognizer.load("ur5"))
    scene = make_paused_scene()
    command = RunCommand(("serial:a",), view=True, port=0)
    arm = scene.arm
    policies = [scene.policy]
    viewer = build_listeners(command, None, recognition, arm, policies, ())[-1]
    assert isinstance(viewer, Viewer)
    now = scene.clock.now()
    assert viewer.question(now) == QuestionBoard("poke")
    scene.touch("grab")
    assert viewer.question(now).action == "resume"
