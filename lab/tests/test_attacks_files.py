"""Tests of hostile files: every reader refuses them in one line, with its own error."""

import pytest

from eskin.app import SourceConfig, load_calibration
from eskin.cli.checks import check_files
from eskin.command import load_commands
from eskin.drivers.sessions import read_key
from eskin.errors import (
    CommandError,
    DeviceError,
    ImportSourceError,
    ModelError,
    RecordingError,
    RobotError,
    SkinError,
)
from eskin.labelling.editing import load_replayed
from eskin.live import check_weights, load_model
from eskin.recording import load_ranges, read_recording
from eskin.recording.reader import parse_shared_skin
from eskin.robot import load_robot
from eskin.sets import convert_sleeve
from eskin.skin import MountedSkin, load_skin, skin_from_bytes, skin_to_bytes
from eskin.touch import TouchPipeline
from lab.attacks.files import FILES, NAMES
from lab.attacks.hostile_recordings import build_skin_writer
from lab.attacks.hostile_texts import (
    CHANGES,
    SMALL,
    squeeze_taxels,
    stack_taxels,
    write_card,
    write_changed_skin,
)
from lab.fuzz.robots import load_robot_whole


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
    "key": (read_key, DeviceError),
    "skin": (load_skin, SkinError),
    "robot": (load_robot_whole, RobotError),
    "recording": (view, (RecordingError, SkinError)),
    "set": (lambda path: convert_sleeve(path, path / "out"), ImportSourceError),
}
LONG = {
    "1 GB of zeros in 1 MB",
    "a 3MF of 300 MB in 300 kB",
    "10,000 taxels in one point",
    "10,000 taxels, of them four far away",
    "1,000,000 elements",
    "250,000 equal labels",
    "20,000 links",
    "a skin of 200 MB",
    "1,500 patches",
    "a mesh of 64 MB",
}
"""Files that take long to write, or to read with checked types; the command tries them,
and smaller ones are below."""
SLOW = ("200,000", "32 MB", "5,000,000", "10,000,000", "60 MB", "512 MB", "1 MB")
"""Parts of the names of files that take half a second."""
CASES = [
    pytest.param(
        kind,
        write,
        id=f"{kind}: {name}",
        marks=[pytest.mark.slow] if any(part in name for part in SLOW) else [],
    )
    for kind, files in FILES.items()
    for name, write in files.items()
    if name not in LONG
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


@pytest.mark.parametrize(
    ("old", "new", "part"), CHANGES, ids=lambda value: ascii(value)[:30]
)
def test_changed_skin_is_refused_alike_in_folder_and_recording(
    tmp_path, old, new, part
):
    write_changed_skin(old, new)(tmp_path)
    whole = skin_to_bytes(SMALL).decode()
    assert whole.count(old)
    with pytest.raises(SkinError) as in_recording:
        skin_from_bytes(whole.replace(old, new, 1).encode())
    with pytest.raises(SkinError) as in_folder:
        load_skin(tmp_path)
    for caught in (in_recording, in_folder):
        assert len(str(caught.value).splitlines()) == 1
    assert part in str(in_folder.value)


@pytest.mark.parametrize(
    ("skin", "limit", "part"),
    [
        (squeeze_taxels(49), "touch.adjacency.MAX_PAIRS", "neighbours"),
        (squeeze_taxels(49, far=1.0), "touch.adjacency.MAX_PAIRS", "neighbours"),
        (stack_taxels(40), "skin.check.MAX_COINCIDENT", "40 taxels in one place"),
    ],
)
def test_skin_of_too_many_pairs_is_refused(tmp_path, monkeypatch, skin, limit, part):
    path = tmp_path / NAMES["recording"]
    build_skin_writer(skin)(path)
    monkeypatch.setattr(f"eskin.{limit}", 1)
    parse_shared_skin.cache_clear()
    with pytest.raises((SkinError, RecordingError), match=part):
        check_files([str(path)])


def test_slow_commands_check_the_files_that_they_read_first(tmp_path, monkeypatch):
    """But not those that they write, nor options and folders."""
    monkeypatch.chdir(tmp_path)
    write_card()(tmp_path / "new.safetensors")
    (tmp_path / "set").mkdir()
    check_files(["--json", "set", "gone.mcap", "--out", "new.safetensors"])
    with pytest.raises(ModelError, match="lacks parameter"):
        check_files(["set", "new.safetensors"])
