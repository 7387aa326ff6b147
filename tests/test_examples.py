"""Tests of the examples: each runs on a tiny budget and refuses missing data."""

import json
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from eskin.learn.onnx_export import export_onnx
from eskin.model import load_model
from helpers.learning import FLAGS

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[1] / "examples"
REAL_TOUCHES = "01_real_touches.py"
ONNX_STEP = "02_onnx_step.py"


@pytest.fixture
def run_example(monkeypatch, capsys):
    """Run an example as a program; return its exit code, text and error."""

    def run(name, *words):
        monkeypatch.setattr(sys, "argv", [name, *map(str, words)])
        code = 0
        try:
            runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        except SystemExit as stop:
            code = stop.code or 0
        return code, *capsys.readouterr()

    return run


def write_sleeve(folder, gesture, stamp):
    """Write nine seconds of the sleeve, touched from 4 to 6 s and from 7 to 8 s."""
    frames = []
    for index in range(90):
        touched = 40 <= index < 60 or 70 <= index < 80
        data = np.full((19, 27), 1.5)
        row, size = (4, 8) if gesture == "Grab" else (4 + index % 9, 2)
        data[row : row + size, 5 : 5 + size] += 150.0 * touched
        label = gesture if touched else "None"
        frames.append({"label": label, "data": data.tolist()})
    folder.mkdir(exist_ok=True)
    text = json.dumps({"timestamp": stamp, "frames": frames})
    (folder / f"{gesture}_{stamp}_annotated.json").write_text(text)


def test_examples_are_short_numbered_and_titled():
    paths = sorted(EXAMPLES.glob("*.py"))
    assert [path.name for path in paths] == [REAL_TOUCHES, ONNX_STEP]
    for path in paths:
        title, *lines = path.read_text().splitlines()
        assert len(lines) < 100, path
        assert path.name[:2].isdigit()
        assert title.startswith('"""') and title.endswith(".")


def test_real_touches_trains_on_all_but_last_session(tmp_path, run_example):
    for day in ("20250521", "20250528"):
        write_sleeve(tmp_path, "Grab", f"{day}150000")
        write_sleeve(tmp_path, "Stroke", f"{day}150100")
    words = ["--data", tmp_path, *FLAGS, "--train.validation", "0"]
    code, out, err = run_example(REAL_TOUCHES, *words)
    assert (code, err) == (0, "")
    for part in (
        "4 recordings, 8 labelled",
        "training on 2",
        "20250528-1500",
        "4 touches",
    ):
        assert part in out
    assert "Grab_20250528150000_annotated" in out
    assert "Grab_20250521150000_annotated" not in out


@pytest.mark.parametrize("content", ["nothing", "folder", "other", "one session"])
def test_real_touches_refuses_missing_data_in_one_line(content, tmp_path, run_example):
    data = tmp_path / "data"
    if content != "nothing":
        data.mkdir()
    if content == "other":
        (data / "notes.txt").write_text("no recordings here")
    if content == "one session":
        write_sleeve(data, "Grab", "20250521150000")
    code, out, err = run_example(REAL_TOUCHES, "--data", data, *FLAGS)
    assert code == 2 and len(err.splitlines()) == 1
    if content != "one session":
        assert out == "" and str(data) in err
        assert "github.com/mdethmers/Social-Touch-Research" in err
        assert "make touches DATA=" in err


def test_onnx_network_recognises_a_poke_step_by_step(tmp_path, run_example):
    path = tmp_path / "ur5.onnx"
    export_onnx(load_model("ur5"), path)
    code, out, _ = run_example(ONNX_STEP, "--model", path)
    lines = out.splitlines()
    assert code == 0 and 20 < len(lines) < 60 and "touch 1  poke" in lines[-1]
