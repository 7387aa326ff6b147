"""Tests of hostile files: every reader refuses them in one line, with its own error."""

import pytest
from benchmarks.attacks.files import FILES, NAMES
from benchmarks.attacks.hostile_texts import SMALL

from eskin.app import SourceConfig, load_calibration
from eskin.command import load_commands
from eskin.errors import (
    CommandError,
    DeviceError,
    ImportSourceError,
    ModelError,
    RecordingError,
    RobotError,
    SkinError,
)
from eskin.model import check_weights, load_model
from eskin.recording import convert_sleeve, load_ranges, read_recording
from eskin.robot import load_robot, load_urdf
from eskin.skin import MountedSkin, load_skin
from eskin.touch import TouchPipeline
from eskin.viewer.editing import load_replayed


def view(path):
    """Read a recording as `eskin view` does, and make its pipeline."""
    recording = read_recording(path)
    load_replayed(recording)
    mounted = MountedSkin(recording.skin, load_robot("table"))
    TouchPipeline(mounted, recording.calibration)


READERS = {
    "model": (lambda path: check_weights(load_model(path)), ModelError),
    "ranges": (lambda path: load_ranges(path, 0), RecordingError),
    "commands": (
        lambda path: load_commands(path, ("none", "poke"), SMALL),
        CommandError,
    ),
    "calibration": (
        lambda path: load_calibration(SourceConfig(calibration=path), SMALL),
        (RecordingError, DeviceError),
    ),
    "skin": (load_skin, SkinError),
    "robot": (load_urdf, RobotError),
    "recording": (view, (RecordingError, SkinError)),
    "set": (lambda path: convert_sleeve(path, path / "out"), ImportSourceError),
}
SLOW = {"1 GB of zeros in 1 MB", "a 3MF of 300 MB in 300 kB"}
"""Files that take long to write."""
CASES = [
    pytest.param(kind, write, id=f"{kind}: {name}")
    for kind, files in FILES.items()
    for name, write in files.items()
    if name not in SLOW
]


@pytest.mark.parametrize(("kind", "write"), CASES)
def test_hostile_file_is_refused_in_one_line(tmp_path, monkeypatch, kind, write):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / NAMES[kind]
    write(path)
    read, error = READERS[kind]
    with pytest.raises(error) as caught:
        read(path)
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 2000
