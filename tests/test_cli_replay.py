"""Tests of `eskin replay`: detections beside labels, recordings, and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.recording import read_recording
from helpers.cli import call, call_json
from helpers.live import (
    label,
    model_of,
    mounted,
    network,
    record,
    say_always,
    scans,
    two_hands,
)

LABELS = [label(2.2, 3.3, "stroke"), label(4.1, 4.6, "poke")]
POSITIONS = {"p_world", "n_world", "direction_world", "link", "patch", "peak_force"}
TIMES = {"stamp", "seconds", "onset", "end", "gesture", "confidence"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("replay")


@pytest.fixture(scope="module")
def model(folder):
    model_of(network()).save(folder / "m.safetensors")
    return folder / "m.safetensors"


@pytest.fixture(scope="module")
def recording(folder):
    stream = scans(mounted(), two_hands(mounted()), 25, 5.5)
    return record(folder / "rec.mcap", mounted(), stream, LABELS)


def replay(capsys, *words):
    """Return the detections of a replay by their touch, and what it printed."""
    result, out = call_json(capsys, "replay", *words)
    assert set(result) == {"detections"}
    return sorted(result["detections"], key=lambda row: row["touch"]), out


def test_detections_are_printed_beside_their_labels(model, recording, capsys):
    rows, out = replay(capsys, recording, "--model", model)
    assert [row["touch"] for row in rows] == [1, 2, 3]
    assert [row["label"] for row in rows] == ["stroke", "stroke", "poke"]
    assert set(rows[0]) >= POSITIONS | TIMES
    printed = out.splitlines()[2:5]
    for row in rows:
        (line,) = [line for line in printed if f"{row['seconds']:.2f}s" in line]
        assert row["gesture"] in line and row["label"] in line
    assert "3 detections" in out
    assert replay(capsys, recording, "--model", model) == (rows, out)


ROUGH = replace(label(0.5, 4.0, "poke"), source="range")
FOUND = replace(label(2.2, 2.9, "stroke"), source="auto")
THIRDS = [label(2.0, 2.5, "poke"), label(2.5, 3.0, "stroke"), label(3.0, 9, "poke")]


@pytest.mark.parametrize(
    ("labels", "hands", "options", "expected"),
    [
        ([], 4, [], [None] * 3),
        (LABELS[1:], 4, [], ["none", "none", "poke"]),
        (THIRDS, 1, ["--threshold", "2"], ["stroke"]),
        ([ROUGH, FOUND], 1, [], ["stroke"]),
    ],
    ids=["no labels", "some labels", "longest overlap", "best source"],
)
def test_label_beside_detection(
    labels, hands, options, expected, model, tmp_path, capsys
):
    seconds = 5.5 if hands > 1 else 4.0
    stream = scans(mounted(), two_hands(mounted())[:hands], 25, seconds)
    path = record(tmp_path / "a.mcap", mounted(), stream, labels)
    rows, _ = replay(capsys, path, "--model", model, *options)
    assert [row["label"] for row in rows] == expected


def test_touch_open_at_end_is_detected(tmp_path, capsys):
    stream = scans(mounted(), two_hands(mounted()), 25, 4.4)
    path = record(tmp_path / "open.mcap", mounted(), stream)
    say_always("none").save(tmp_path / "none.safetensors")
    rows, _ = replay(capsys, path, "--model", tmp_path / "none.safetensors")
    assert [(row["touch"], row["gesture"]) for row in rows] == [
        (touch, "none") for touch in (1, 2, 3)
    ]


def test_recording_is_written_with_detections(model, recording, tmp_path, capsys):
    target = tmp_path / "out.mcap"
    rows, _ = replay(capsys, recording, "--model", model, "--record", target)
    before = read_recording(recording)
    after = read_recording(target)
    assert before.detections == ()
    stamps = [detection.stamp for detection in after.detections]
    assert stamps == sorted(row["stamp"] for row in rows)
    assert (after.labels, after.count) == (before.labels, before.count)
    assert np.array_equal(before.arrays().counts, after.arrays().counts)
    call(capsys, "replay", target, "--model", model, "--record", target)
    assert read_recording(target).detections == after.detections


def test_cut_recording_is_replayed_and_named(model, recording, tmp_path, capsys):
    data = recording.read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: len(data) * 3 // 4])
    rows, out = replay(capsys, path, "--model", model)
    assert "cut or damaged" in out
    assert 1 <= len(rows) <= 3


@pytest.fixture(scope="module")
def paths(folder, model, recording):
    """Paths of valid and invalid files by their names in the words of a test."""
    paths = {name: folder / f"{name}.safetensors" for name in ("cut", "shear", "words")}
    paths["cut"].write_bytes(model.read_bytes()[:200])
    model_of(network("shear")).save(paths["shear"])
    five = ("none", "poke", "stroke", "grab", "wave")
    model_of(network(), five).save(paths["words"])
    paths["start"] = folder / "start.mcap"
    paths["start"].write_bytes(recording.read_bytes()[:200])
    return paths | {"model": model, "rec": recording, "folder": folder}


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ("{rec} --model {folder}/gone", "no such model"),
        ("{rec} --model {cut}", "no model file"),
        ("{rec} --model {shear}", "needs shear"),
        ("{rec} --model {words}", "5 classes"),
        ("{folder}/gone.mcap --model {model}", "gone.mcap"),
        ("{start} --model {model}", "cut"),
        ("{model} --model {model}", "recording made by eskin"),
        ("{rec} --model {model} --record {folder}/no/a.mcap", "folder"),
        ("{rec} --model {model} --record {folder}", "is a folder"),
        ("{rec} --model {model} --classes poke", "--classes"),
        ("", "recording"),
    ],
)
def test_invalid_input_is_one_line_and_leaves_nothing(words, part, paths, capsys):
    before = set(paths["folder"].iterdir())
    code, out, err = call(capsys, "replay", *words.format(**paths).split())
    assert (code, out) == (2, "")
    assert part in err.lower() and err.count("\n") == 1
    assert set(paths["folder"].iterdir()) == before
