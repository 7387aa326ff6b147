"""Tests of `eskin convert` and `eskin label`."""

import json

import numpy as np
import pytest

from eskin.recording import read_recording
from helpers.cli import assert_refused, call, call_json, fail_to_write

pytestmark = pytest.mark.slow


@pytest.fixture
def source(tmp_path):
    """Return a folder with a sleeve file: grabs from 3 to 3.5 s and 5 to 5.5 s."""
    frames = []
    for index in range(60):
        held = 30 <= index < 35 or 50 <= index < 55
        data = np.full((19, 27), 1.5)
        data[4:8, 5:9] += 150.0 * held
        frames.append({"label": "Grab" if held else "None", "data": data.tolist()})
    content = {"timestamp": "20250521150749", "frames": frames}
    (tmp_path / "in").mkdir()
    name = "Grab_20250521150749_annotated.json"
    (tmp_path / "in" / name).write_text(json.dumps(content))
    return tmp_path / "in"


@pytest.fixture
def converted(source, tmp_path, capsys):
    """Return the path of the recording of the sleeve file."""
    result, _ = call_json(capsys, "convert", "sleeve", source, tmp_path / "out")
    counts = {"recordings": 1, "taxels": 513, "readings": 60, "labels": 2}
    assert result == counts
    [path] = (tmp_path / "out").iterdir()
    return path


def test_conversion_replaces_no_recording_and_makes_none_beside_it(
    source, converted, tmp_path, capsys
):
    before = converted.read_bytes()
    words = ("convert", "sleeve", source, tmp_path / "out")
    assert_refused(capsys, *words, part=f"{converted.name} is there already")
    assert list((tmp_path / "out").iterdir()) == [converted]
    assert converted.read_bytes() == before


def test_conversion_of_invalid_input_is_refused_and_leaves_nothing(
    source, tmp_path, capsys
):
    bad = source / "Tap_20250521151000.json"
    bad.write_text('{"frames": [')
    out = tmp_path / "out"
    for words in (
        ("sleeve", source, out),
        ("shearsense", source, out),
        ("socialtouch", source, out),
        ("sleeve", tmp_path / "gone", out),
        ("glove", source, out),
        ("sleeve", source, out, "--pitch-mm", "4"),
        ("socialtouch", source, out, "--pitch-mm", "0"),
        ("socialtouch", source, out, "--full-scale-kpa", "inf"),
        ("sleeve", source, bad),
    ):
        assert assert_refused(capsys, "convert", *words) == ""
        assert not out.exists()


@pytest.mark.parametrize("name", ["sleeve", "shearsense", "socialtouch", "table"])
@pytest.mark.parametrize(
    "options", [(), ("--rows", 8, "--columns", 8), ("--skin", "x")]
)
def test_missing_file_is_told_whatever_options_are_given(
    name, options, tmp_path, capsys
):
    gone = tmp_path / "gone.csv"
    words = ("convert", name, gone, tmp_path / "out", *options)
    assert_refused(capsys, *words, part=f"no file or folder {gone}")


def test_label_adds_labels_once_and_scores_them(converted, capsys):
    result, _ = call_json(capsys, "label", converted)
    assert set(result) == {"labels", "agreement"}
    assert result["labels"] == 2
    agreement = result["agreement"]
    assert (agreement["accuracy"], agreement["balanced_accuracy"]) == (1.0, 1.0)
    labels = read_recording(converted).labels
    assert [label.source for label in labels] == ["auto", "true", "auto", "true"]
    once = converted.read_bytes()
    call_json(capsys, "label", converted)
    assert converted.read_bytes() == once


def test_label_writes_copies_into_another_folder(converted, tmp_path, capsys):
    before = converted.read_bytes()
    copies = tmp_path / "copies"
    call_json(capsys, "label", converted.parent, "--out", copies)
    assert converted.read_bytes() == before
    assert len(read_recording(copies / converted.name).labels) == 4


def test_label_uses_ranges_and_options(converted, tmp_path, capsys):
    ranges = tmp_path / "ranges.yaml"
    ranges.write_text("- {start_s: 2, end_s: 6, gesture: squeeze}")
    options = ("--ranges", ranges, "--min-window", "1.6", "--threshold", "30")
    result, _ = call_json(capsys, "label", converted, *options)
    assert result["labels"] == 1
    labels = read_recording(converted).labels
    found = sorted((label.source, label.gesture) for label in labels)
    new = [("auto", "squeeze"), ("range", "squeeze")]
    assert found == [*new, ("true", "grab"), ("true", "grab")]


def test_invalid_input_is_refused_and_no_recording_is_labelled(
    converted, tmp_path, capsys
):
    before = converted.read_bytes()
    start = tmp_path / "start.mcap"
    cut = tmp_path / "z.mcap"
    start.write_bytes(before[:300])
    cut.write_bytes(before[:-30])
    ranges = tmp_path / "ranges.yaml"
    ranges.write_text("- nothing")
    out = tmp_path / "copies"
    (out / "z.mcap").mkdir(parents=True)
    for words, part in (
        ((), "no recording given"),
        ((tmp_path / "gone.mcap",), "no recording at"),
        ((converted, start), "is cut before its"),
        ((converted, "--ranges", ranges), "range 1 is nothing"),
        ((converted, cut, "--ranges", ranges), "one at a time"),
        ((converted, "--threshold", "-1"), "--threshold is -1.0"),
        ((converted, "--min-window", "nan"), "--min-window is nan"),
        ((converted, "--window", "1"), "--window"),
        ((converted, cut), "z.mcap is cut short"),
        ((converted, cut, "--out", out), "z.mcap is there already"),
        ((converted, cut, "--out", cut), "cannot write to"),
    ):
        assert assert_refused(capsys, "label", *words, part=part) == ""
        assert converted.read_bytes() == before
    assert [path.name for path in out.iterdir()] == ["z.mcap"]


def test_folder_that_cannot_be_written_to_is_refused(converted, capsys, monkeypatch):
    before = converted.read_bytes()
    monkeypatch.setattr("tempfile.TemporaryFile", fail_to_write)
    part = "cannot write to"
    assert_refused(capsys, "label", converted, part=part)
    assert converted.read_bytes() == before


def test_labels_of_real_sleeve_files_agree_better_than_their_ranges(
    sleeve_folder, tmp_path, capsys
):
    (tmp_path / "in").mkdir()
    for path in sleeve_folder.rglob("*20250521*"):
        (tmp_path / "in" / path.name).symlink_to(path)
    assert call(capsys, "convert", "sleeve", tmp_path / "in", tmp_path / "out")[0] == 0
    result, _ = call_json(capsys, "label", tmp_path / "out")
    agreement = result["agreement"]
    assert agreement["events"] == 19
    assert agreement["accuracy"] > 0.7
    assert agreement["balanced_accuracy"] > 0.7
