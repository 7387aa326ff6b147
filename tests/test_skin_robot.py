"""Tests of the robot in a skin's folder: it is found, checked, and never led astray."""

import shutil

import numpy as np
import pytest

from eskin.errors import SkinError, SkinMismatchError
from eskin.robot import Kinematics, load_robot
from eskin.robot.urdf import MAX_URDF_BYTES
from eskin.skin import load_robot_for_skin, mount_skin, save_skin
from helpers.cli import assert_refused, call
from helpers.skins import ARM, BOX_ARM, SKIN, write_skin

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
    with pytest.raises(SkinMismatchError):
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
    before = sorted(tmp_path.rglob("*"))
    words = line.replace("SKIN", str(folder)).replace("DEVICE", DEVICE).split()
    assert_refused(capsys, *words, part="give the robot with --robot-urdf")
    assert sorted(tmp_path.rglob("*")) == before


def test_folder_without_a_robot_is_mounted_on_the_one_that_is_given(tmp_path):
    save_skin(SKIN, tmp_path)
    (tmp_path / "robot.urdf").write_text(BOX_ARM)
    assert load_robot_for_skin(tmp_path) is None
    with pytest.raises(SkinMismatchError, match="--robot-urdf"):
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
