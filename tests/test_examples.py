"""Every example runs, here on a tiny budget, and says what it lacks."""

import json
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from eskin.learn.training import TrainConfig
from helpers.learning import FLAGS

EXAMPLES = Path(__file__).parents[1] / "examples"
REAL_TOUCHES = "01_real_touches.py"


def start(name, *argv, monkeypatch):
    """Run an example as a program; its exit code."""
    monkeypatch.setattr(sys, "argv", [name, *(str(word) for word in argv)])
    try:
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    except SystemExit as stop:
        return stop.code or 0
    return 0


def write_sleeve(folder, gesture, stamp):
    """Nine seconds of a sleeve file, its gesture made from 4 to 6 s and 7 to 8 s."""
    frames = []
    for index in range(90):
        held = 40 <= index < 60 or 70 <= index < 80
        data = np.full((19, 27), 1.5)
        row = 4 if gesture == "Grab" else 4 + index % 9
        size = 8 if gesture == "Grab" else 2
        data[row : row + size, 5 : 5 + size] += 150.0 * held
        frames.append({"label": gesture if held else "None", "data": data.tolist()})
    folder.mkdir(exist_ok=True)
    text = json.dumps({"timestamp": stamp, "frames": frames})
    (folder / f"{gesture}_{stamp}_annotated.json").write_text(text)


@pytest.fixture
def sleeve(tmp_path):
    """Two sessions of two gestures."""
    for day in ("20250521", "20250528"):
        write_sleeve(tmp_path / "sleeve", "Grab", f"{day}150000")
        write_sleeve(tmp_path / "sleeve", "Stroke", f"{day}150100")
    return tmp_path / "sleeve"


def test_every_example_has_a_test_here():
    assert [path.name for path in sorted(EXAMPLES.glob("*.py"))] == [REAL_TOUCHES]


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda p: p.name)
def test_an_example_is_short_numbered_and_begins_with_its_title(path):
    lines = path.read_text().splitlines()
    assert len(lines) <= 100
    assert path.name[:2].isdigit()
    assert lines[0].startswith('"""') and lines[0].endswith(".")


def test_real_touches_are_replayed_beside_their_labels(sleeve, monkeypatch, capsys):
    argv = ("--data", sleeve, *FLAGS, "--train.validation", "0")
    assert start(REAL_TOUCHES, *argv, monkeypatch=monkeypatch) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "4 recordings, 8 labelled touches" in out
    assert "training on 2 recordings" in out
    assert "Grab_20250528150000_annotated" in out
    assert "Grab_20250521150000_annotated" not in out
    assert "Session 20250528-1500, never trained on: 4 touches," in out


def test_its_settings_are_those_of_training():
    module = runpy.run_path(str(EXAMPLES / REAL_TOUCHES))
    assert isinstance(module["Demo"](Path()).train, TrainConfig)


@pytest.mark.parametrize("content", ["nothing", "folder", "other"])
def test_without_recordings_it_says_how_to_get_them(
    content, tmp_path, monkeypatch, capsys
):
    data = tmp_path / "data"
    if content != "nothing":
        data.mkdir()
    if content == "other":
        (data / "notes.txt").write_text("no recordings here")
    assert start(REAL_TOUCHES, "--data", data, monkeypatch=monkeypatch) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert f"no recordings in {data}" in err
    assert "github.com/mdethmers/Social-Touch-Research" in err
    assert "make touches DATA=" in err


def test_one_session_alone_is_refused_in_one_line(tmp_path, monkeypatch, capsys):
    write_sleeve(tmp_path / "one", "Grab", "20250521150000")
    argv = ("--data", tmp_path / "one", *FLAGS)
    assert start(REAL_TOUCHES, *argv, monkeypatch=monkeypatch) == 2
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
