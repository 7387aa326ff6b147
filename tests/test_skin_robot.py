"""Tests of the robot in a skin's folder: it is found, checked, and never led astray."""

import ast
import shutil

import numpy as np
import pytest

from eskin.app import SourceConfig, mount_device_skin, open_source
from eskin.cli.checks import load_overrides
from eskin.errors import RobotError, SkinError, SkinMismatchError
from eskin.live import Recognizer
from eskin.notebook import show_skin
from eskin.recording import Metadata, RecordingWriter, read_recording, write_all
from eskin.robot import ROBOT_PRESETS, Kinematics, load_robot
from eskin.robot.urdf import MAX_URDF_BYTES
from eskin.skin import (
    KeptRobot,
    MountedSkin,
    describe_robot,
    load_robot_for_skin,
    mount_skin,
    save_skin,
)
from eskin.touch import Calibration, Scan
from helpers.cli import assert_refused, call
from helpers.skins import ARM, BOX_ARM, SKIN, write_skin
from helpers.source import MODULES, name_module, parse_module

MESH = ARM.replace("PANEL", '<mesh filename="package://gone/panel.stl"/>')
DEVICE = "udp://127.0.0.1:1"
COMMANDS = (
    "run --skin SKIN --source DEVICE",
    "record DEVICE --skin SKIN --gestures a b --out a.mcap",
    "calibrate DEVICE --skin SKIN --out a.json",
    "doctor --source DEVICE --skin SKIN",
    "skin check SKIN",
    "skin check SKIN --live --source DEVICE",
    "skin show SKIN",
    "skin pose DEVICE --skin SKIN --points points.csv --out b",
    "skin convert SKIN b",
    "convert table a.npz b --skin SKIN",
    "device SKIN --seconds 1",
    "generate b --skin SKIN --clips 1",
)
"""Commands that mount a skin on its robot."""
PANEL = """solid panel
facet normal 0 0 1
  outer loop
    vertex 0 0 0
    vertex 1 0 0
    vertex 0 1 0
  endloop
endfacet
endsolid panel
"""
OTHER = BOX_ARM.replace('"arm"', '"other"')
ENTRANCES = {
    "device": lambda skin, path, given: mount_device_skin(
        [DEVICE], SourceConfig(skin=skin, robot=given)
    ),
    "notebook": lambda skin, path, given: show_skin(np.zeros(SKIN.count), skin, given),
    "recogniser of a skin": lambda skin, path, given: Recognizer.load(
        "ur5", skin, given
    ),
    "recogniser of a recording": lambda skin, path, given: Recognizer.load(
        "ur5", recording=read_recording(path), robot=given
    ),
    "source of a recording": lambda skin, path, given: open_source(
        f"replay:{path}", config=SourceConfig(robot=given)
    ).close(),
    "recording": lambda skin, path, given: MountedSkin(
        SKIN, read_recording(path, load_overrides(None, given)).load_robot()
    ),
}
"""Functions of Python that mount the skin of a folder or of a recording."""
PLAYERS = (
    "run --source replay:RECORDING --pace inf",
    "record replay:RECORDING --gestures a b --out a.mcap",
    "calibrate replay:RECORDING --out a.json",
    "skin check SKIN --live --source replay:RECORDING",
    "replay RECORDING",
    "report RECORDING --out a.html",
    "view RECORDING --port 0 --seconds 0.1",
)
"""Commands that mount the skin of a recording."""
LOADERS = {"load_robot", "load_urdf", "load_preset", "parse_urdf"}
SKINLESS = {
    "arms.dynamics": "the robot of an arm's task",
    "arms.task": "the robot of an arm's task",
    "design.commands.convert": "a URDF of sensors, which becomes a skin",
    "design.commands.design": "a robot that is to get a skin",
    "design.commands.paint": "a robot that is to get a skin",
    "design.commands.place": "a robot that is to get a skin",
    "robot.presets": "reads robots by name or path",
    "robot.urdf": "reads robots from files",
    "sim.bench.latency": "a preset's robot",
    "sim.bench.sender": "a preset's robot",
    "sim.bench.throughput": "a preset's robot",
    "sim.dataset.devices": "a preset's robot",
    "sim.demo.browser": "the robot of an arm's task",
}
"""Modules that load a robot although they do not ask for that of a skin, and why."""


def write_recording(path, robot, urdf):
    """Write a recording of the skin at rest, on a robot with one joint."""
    calibration = Calibration.uniform(SKIN.count, 4095, 400.0)
    counts = np.full(SKIN.count, 200, np.int32)
    received = np.ones(SKIN.count, bool)
    scans = [Scan(n * 20_000_000, counts, received, np.zeros(1)) for n in range(1, 30)]
    header = (robot, SKIN, calibration, Metadata(), ("turn",), urdf)
    with RecordingWriter(path, *header) as writer:
        write_all(writer, scans, ())
    return path


@pytest.fixture
def kept(tmp_path):
    """Return a skin's folder and a recording that keep the same robot."""
    folder = write_skin(tmp_path)
    path = tmp_path / "kept.mcap"
    return folder, write_recording(path, "arm", (folder / "robot.urdf").read_bytes())


@pytest.fixture
def used(monkeypatch):
    """Return the robots on which skins are mounted from now on."""
    robots = []
    mount = MountedSkin.__init__

    def note(self, skin, robot):
        robots.append(robot)
        mount(self, skin, robot)

    monkeypatch.setattr(MountedSkin, "__init__", note)
    return robots


@pytest.fixture(params=[None, "table", "other.urdf"])
def given(request, tmp_path):
    """Return the robot that a person gives, and the URDF of the one that is used."""
    name = request.param
    if name == "other.urdf":
        (tmp_path / name).write_text(OTHER)
        name = str(tmp_path / name)
    return name, BOX_ARM.encode() if name is None else load_robot(name).urdf


@pytest.fixture(params=["missing", "changed", "too large", "link", "folder"])
def broken(request, tmp_path):
    """Return the folder of a skin whose robot cannot be used."""
    folder = write_skin(tmp_path)
    urdf = folder / "robot.urdf"
    data = urdf.read_bytes()
    urdf.unlink()
    if request.param == "changed":
        urdf.write_bytes(data.replace(b"0.3", b"0.4"))
    elif request.param == "too large":
        urdf.write_bytes(data.ljust(MAX_URDF_BYTES + 1))
    elif request.param == "link":
        (tmp_path / "outside.urdf").write_bytes(data)
        urdf.symlink_to(tmp_path / "outside.urdf")
    elif request.param == "folder":
        urdf.mkdir()
    return folder


@pytest.mark.parametrize("text", [BOX_ARM, MESH])
def test_robot_goes_with_the_folder_of_its_skin(tmp_path, text):
    whole = tmp_path / "arm.urdf"
    whole.write_text(text)
    expected = load_robot(whole)
    moved = shutil.move(write_skin(tmp_path, text), tmp_path / "elsewhere")
    for path in (moved, str(moved), moved / "skin.yaml"):
        robot = mount_skin(path).robot
        assert robot.urdf == expected.urdf == (moved / "robot.urdf").read_bytes()
        assert robot.joint_names == expected.joint_names
        q = np.array([0.7])
        poses = Kinematics(robot).poses(q)
        np.testing.assert_array_equal(poses, Kinematics(expected).poses(q))


def test_folder_of_a_skin_without_a_robot_keeps_none(tmp_path):
    folder = write_skin(tmp_path)
    save_skin(SKIN, folder)
    assert not (folder / "robot.urdf").exists()
    with pytest.raises(RobotError):
        mount_skin(folder)


def test_meshes_are_not_read_and_said_to_be_left_out(tmp_path, capsys):
    folder = write_skin(tmp_path, MESH)
    robot = mount_skin(folder).robot
    assert [len(link.geoms) for link in robot.links] == [1, 0]
    for words in (("check",), ("show", "--out", tmp_path / "a.png")):
        code, out, _ = call(capsys, "skin", words[0], folder, *words[1:])
        [line] = [line for line in out.splitlines() if "--robot-urdf" in line]
        assert code == 0 and "1 of its 2 links" in line
    assert write_skin(tmp_path) == folder
    code, out, _ = call(capsys, "skin", "check", folder)
    assert code == 0 and "--robot-urdf" not in out


def test_robot_that_is_given_wins_over_one_that_cannot_be_used(broken, tmp_path):
    other = tmp_path / "other.urdf"
    other.write_text(BOX_ARM.replace('"arm"', '"other"'))
    assert mount_skin(broken, other).robot.name == "other"
    with pytest.raises(SkinError, match=r"robot\.urdf"):
        mount_skin(broken)


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_asks_in_one_line_for_a_robot_that_was_changed(
    line, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    folder = write_skin(tmp_path)
    (folder / "robot.urdf").write_text(BOX_ARM.replace("0.3", "0.4"))
    (tmp_path / "a.npz").touch()
    before = sorted(tmp_path.rglob("*"))
    words = line.replace("SKIN", str(folder)).replace("DEVICE", DEVICE).split()
    assert_refused(capsys, *words, part="give the robot with --robot-urdf")
    assert sorted(tmp_path.rglob("*")) == before


def test_folder_without_a_robot_is_mounted_on_the_one_that_is_given(tmp_path):
    save_skin(SKIN, tmp_path)
    (tmp_path / "robot.urdf").write_text(BOX_ARM)
    assert load_robot_for_skin(tmp_path) is None
    with pytest.raises(RobotError, match="'mine' is given without.*--robot-urdf"):
        mount_skin(tmp_path)
    assert mount_skin(tmp_path, tmp_path / "robot.urdf").robot.name == "arm"


def test_skin_is_not_written_with_a_robot_that_lacks_its_link(tmp_path):
    with pytest.raises(SkinMismatchError, match="table"):
        save_skin(SKIN, tmp_path / "out", load_robot("ur5"))
    assert list(tmp_path.iterdir()) == []


def test_skin_converted_from_a_urdf_is_on_its_robot(tmp_path, capsys):
    folder = write_skin(tmp_path)
    words = ("skin", "convert", folder, tmp_path / "sensors.urdf")
    assert call(capsys, *words)[0] == 0
    again = tmp_path / "again"
    words = ("skin", "convert", tmp_path / "sensors.urdf", again)
    assert call(capsys, *words)[0] == 0
    assert mount_skin(again).robot.joint_names == ("turn",)
    assert call(capsys, "skin", "convert", "ur5", tmp_path / "ur5")[0] == 0
    assert mount_skin(tmp_path / "ur5").robot.urdf == load_robot("ur5").urdf


@pytest.mark.parametrize("enter", ENTRANCES.values(), ids=ENTRANCES)
def test_python_takes_the_robot_that_is_given_else_the_one_that_is_kept(
    enter, kept, given, used
):
    enter(*kept, given[0])
    assert {robot.urdf for robot in used} == {given[1]}


@pytest.mark.slow
@pytest.mark.parametrize("line", PLAYERS)
def test_commands_take_the_robot_that_is_given_else_the_one_that_is_kept(
    line, kept, given, used, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    line = line.replace("SKIN", str(kept[0])).replace("RECORDING", str(kept[1]))
    option = () if given[0] is None else ("--robot-urdf", given[0])
    call(capsys, *line.split(), *option)
    assert {robot.urdf for robot in used} == {given[1]}


def test_commands_on_skins_take_the_same_robot(kept, given, monkeypatch, capsys):
    drawn = []
    monkeypatch.setattr(
        "eskin.design.commands.show.draw_picture",
        lambda skin, out, robot: drawn.append(robot.urdf),
    )
    option = () if given[0] is None else ("--robot-urdf", given[0])
    out = kept[0].parent / "a.png"
    assert call(capsys, "skin", "show", kept[0], "--out", out, *option)[0] == 0
    assert drawn == [given[1]]
    code, out, _ = call(capsys, "skin", "check", kept[0], *option)
    name = load_robot_for_skin(*kept[:1], given[0]).name
    assert code == 0 and f"on robot {name}" in out


@pytest.mark.parametrize("enter", ENTRANCES.values(), ids=ENTRANCES)
def test_robot_that_nothing_tells_is_asked_for_in_the_same_words(enter, tmp_path):
    save_skin(SKIN, tmp_path / "bare")
    path = write_recording(tmp_path / "bare.mcap", "arm", b"")
    with pytest.raises(RobotError) as refused:
        enter(tmp_path / "bare", path, None)
    told, allowed, remedy = str(refused.value).split("; ")
    assert told.endswith(("is given without a robot", "'arm' and lacks its URDF"))
    assert allowed.startswith("allowed are a URDF in the skin's folder or in the rec")
    assert "--robot-urdf" in remedy and "robot=" in remedy


def test_robot_that_is_given_for_a_recording_brings_its_meshes(kept, tmp_path):
    (tmp_path / "mesh.urdf").write_text(MESH.replace("package://gone/", ""))
    (tmp_path / "panel.stl").write_text(PANEL)
    overrides = load_overrides(None, str(tmp_path / "mesh.urdf"))
    recording = read_recording(kept[1], overrides)
    assert [len(link.geoms) for link in recording.load_robot().links] == [1, 1]
    assert recording.load_robot().describe_lacking_meshes("drawn") == ""


@pytest.mark.parametrize("name", ROBOT_PRESETS)
def test_robot_is_kept_with_its_urdf_unless_it_comes_with_eskin(name, tmp_path):
    robot = load_robot(name)
    assert describe_robot(robot) == KeptRobot(name)
    (tmp_path / "changed.urdf").write_bytes(robot.urdf + b"<!-- changed -->")
    for other in (load_robot(tmp_path / "changed.urdf"), robot):
        assert load_robot_for_skin(describe_robot(other)).urdf == other.urdf


def test_recorded_name_of_a_robot_is_no_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.urdf").write_text(OTHER)
    path = write_recording(tmp_path / "a.mcap", "other.urdf", b"")
    with pytest.raises(RobotError, match="lacks its URDF"):
        read_recording(path).load_robot()


def test_one_module_answers_which_robot_wears_a_skin():
    found = set()
    for path in MODULES:
        for node in parse_module(path):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                if node.func.id in LOADERS:
                    found.add(name_module(path).removeprefix("eskin."))
    assert found == {"skin.mounting", *SKINLESS}
