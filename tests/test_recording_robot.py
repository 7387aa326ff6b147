"""Tests of the robot of a recording: its URDF travels with it, and no other file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eskin.errors import RobotError, SkinMismatchError
from eskin.learn.dataset import prepare
from eskin.recording import (
    Overrides,
    RecordingWriter,
    read_recording,
    rewrite_recording,
    write_all,
)
from eskin.robot.urdf import parse_urdf
from helpers.learning import record

URDF = b"""<robot name="panel">
  <link name="table">
    <collision><geometry><box size="0.2 0.2 0.02"/></geometry></collision>
    <collision><geometry><mesh filename="/etc/passwd.stl"/></geometry></collision>
  </link>
  <joint name="turn" type="revolute">
    <parent link="world"/><child link="table"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/>
  </joint>
  <link name="world"/>
</robot>"""


def give(urdf):
    """Return overrides that give the robot of a URDF."""
    return Overrides(robot=parse_urdf(urdf, Path("given.urdf")))


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return a recording of a panel on a robot that does not come with eskin."""
    folder = tmp_path_factory.mktemp("panel")
    table = read_recording(record(folder / "table.mcap"))
    target = folder / "panel.mcap"
    write_panel(target, table, URDF)
    return target


def write_panel(path, table, urdf):
    """Write a recording of the table again, as of the panel at half a turn."""
    header = (table.skin, table.calibration, table.metadata, ("turn",), urdf)
    scans = (replace(scan, q=np.array([0.5])) for scan in table.scans())
    with RecordingWriter(path, "panel", *header) as writer:
        write_all(writer, scans, table.labels)


def test_recording_carries_the_urdf_of_its_robot(path, tmp_path):
    recording = read_recording(path)
    assert (recording.robot_name, recording.urdf) == ("panel", URDF)
    rewrite_recording(recording, tmp_path / "copy.mcap")
    robot = read_recording(tmp_path / "copy.mcap").load_robot()
    assert robot.joint_names == ("turn",)


def test_writer_takes_the_joints_of_the_urdf(path, tmp_path):
    known = read_recording(path)
    header = ("panel", known.skin, known.calibration, known.metadata, None, URDF)
    with RecordingWriter(tmp_path / "own.mcap", *header):
        pass
    assert read_recording(tmp_path / "own.mcap").joint_names == ("turn",)


def test_meshes_that_a_recorded_urdf_names_are_not_read(path):
    table, world = read_recording(path).load_robot().links
    assert len(table.geoms) == 1 and not world.geoms


def test_recordings_of_an_own_robot_are_learned_from_as_they_are(path):
    assert len(prepare([path]).stamps) > 20


def test_recording_without_its_urdf_needs_one(path, tmp_path):
    older = tmp_path / "older.mcap"
    write_panel(older, read_recording(path), b"")
    with pytest.raises(RobotError, match="'panel'.*allowed.*ur5.*--robot-urdf"):
        prepare([older])
    overrides = give(URDF)
    assert read_recording(older, overrides).load_robot().joint_names == ("turn",)
    assert len(prepare([older], overrides=overrides).stamps) > 20


def add_joint(name, before=b"</robot>"):
    """Return the URDF with one more joint, which stands first or last."""
    added = (
        f'<link name="{name}"/><joint name="{name}" type="continuous">'
        f'<parent link="table"/><child link="{name}"/></joint>'
    )
    return URDF.replace(before, added.encode() + before)


def test_positions_of_a_recording_go_to_the_joints_of_their_names(path, tmp_path):
    """In whatever order a robot that is given in place of the recorded one has them."""
    known = read_recording(path)
    both = tmp_path / "both.mcap"
    names = ("turn", "grip")
    urdf = add_joint("grip")
    header = ("panel", known.skin, known.calibration, known.metadata, names, urdf)
    scans = (replace(scan, q=np.array([0.5, 0.1])) for scan in known.scans())
    with RecordingWriter(both, *header) as writer:
        write_all(writer, scans, ())
    for given, q in ((add_joint("grip", b"<joint"), [0.1, 0.5]), (URDF, [0.5])):
        recording = read_recording(both, give(given))
        assert recording.joint_names == recording.load_robot().joint_names
        np.testing.assert_array_equal(next(recording.scans()).q, q)


def test_robot_with_joints_that_were_not_recorded_is_refused_at_once(path):
    with pytest.raises(SkinMismatchError, match="joints turn, .* also grip; allowed"):
        read_recording(path, give(add_joint("grip")))


def test_recorded_urdf_that_cannot_be_used_is_named(path, tmp_path):
    broken = tmp_path / "broken.mcap"
    write_panel(broken, read_recording(path), b"<robot")
    with pytest.raises(RobotError, match="recorded robot 'panel' is not XML"):
        read_recording(broken).load_robot()


def test_prepared_recording_depends_on_the_robot_that_is_given(path, tmp_path):
    turned = give(URDF.replace(b"0 0 1", b"0 1 0"))
    for overrides in (Overrides(), turned, give(URDF)):
        prepare([path], pack=tmp_path, overrides=overrides)
    assert len(list(tmp_path.glob("*.npz"))) == 3
