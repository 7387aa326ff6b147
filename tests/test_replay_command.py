"""`eskin replay`, as it is called."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.model import save_model
from eskin.recording import read_recording
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


def call(capsys, *argv):
    code = run(["replay", *(str(word) for word in argv)])
    out, err = capsys.readouterr()
    return code, out, err


def last_json(out):
    return json.loads(out.strip().splitlines()[-1])


@pytest.fixture
def model(tmp_path):
    save_model(tmp_path / "m.safetensors", model_of(network()))
    return tmp_path / "m.safetensors"


@pytest.fixture
def recording(tmp_path):
    on = mounted()
    stream = scans(on, two_hands(on), 25, 5.5)
    return record(tmp_path / "rec.mcap", on, stream, LABELS)


def test_replay_prints_each_detection_beside_its_label(model, recording, capsys):
    code, out, err = call(capsys, recording, "--model", model, "--json")
    assert (code, err) == (0, "")
    result = last_json(out)
    assert set(result) == {"detections"}
    rows = sorted(result["detections"], key=lambda row: row["touch"])
    assert [row["touch"] for row in rows] == [1, 2, 3]
    assert [row["label"] for row in rows] == ["stroke", "stroke", "poke"]
    assert set(rows[0]) >= {
        "gesture",
        "confidence",
        "onset",
        "end",
        "link",
        "patch",
        "p_world",
        "n_world",
        "direction_world",
        "peak_force",
        "stamp",
        "seconds",
    }
    printed = out.splitlines()[2:5]
    for row, line in zip(result["detections"], printed, strict=True):
        assert f"{row['seconds']:.2f}s" in line
        assert row["gesture"] in line
        assert row["label"] in line
    assert "3 detections" in out


def test_without_labels_there_is_nothing_beside(model, tmp_path, capsys):
    on = mounted()
    path = record(tmp_path / "bare.mcap", on, scans(on, two_hands(on), 25, 5.5))
    code, out, _ = call(capsys, path, "--model", model, "--json")
    assert code == 0
    assert {row["label"] for row in last_json(out)["detections"]} == {None}


def test_a_touch_without_a_label_is_beside_none(model, tmp_path, capsys):
    on = mounted()
    stream = scans(on, two_hands(on), 25, 5.5)
    path = record(tmp_path / "some.mcap", on, stream, LABELS[1:])
    _, out, _ = call(capsys, path, "--model", model, "--json")
    rows = sorted(last_json(out)["detections"], key=lambda row: row["touch"])
    assert [row["label"] for row in rows] == ["none", "none", "poke"]


def test_the_label_is_that_which_the_touch_shares_most_time_with(
    model, tmp_path, capsys
):
    on = mounted()
    stream = scans(on, two_hands(on)[:1], 25, 4.0)
    labels = [label(2.0, 2.5, "poke"), label(2.5, 3.0, "stroke"), label(3.0, 9, "poke")]
    path = record(tmp_path / "two.mcap", on, stream, labels)
    at_its_end = "--threshold", "2"
    _, out, _ = call(capsys, path, "--model", model, *at_its_end, "--json")
    [row] = last_json(out)["detections"]
    assert row["label"] == "stroke"


def test_beside_a_detection_stand_labels_of_one_source_only(model, tmp_path, capsys):
    on = mounted()
    stream = scans(on, two_hands(on)[:1], 25, 4.0)
    rough, found = label(0.5, 4.0, "poke"), label(2.2, 2.9, "stroke")
    labels = [replace(rough, source="range"), replace(found, source="auto")]
    path = record(tmp_path / "two.mcap", on, stream, labels)
    _, out, _ = call(capsys, path, "--model", model, "--json")
    [row] = last_json(out)["detections"]
    assert row["label"] == "stroke"


def test_a_touch_still_open_at_the_end_is_detected(tmp_path, capsys):
    on = mounted()
    path = record(tmp_path / "open.mcap", on, scans(on, two_hands(on), 25, 4.4))
    save_model(tmp_path / "none.safetensors", say_always("none"))
    _, out, _ = call(capsys, path, "--model", tmp_path / "none.safetensors", "--json")
    found = [(row["touch"], row["gesture"]) for row in last_json(out)["detections"]]
    assert sorted(found) == [(1, "none"), (2, "none"), (3, "none")]


def test_replaying_twice_gives_the_same(model, recording, capsys):
    once = call(capsys, recording, "--model", model, "--json")
    assert call(capsys, recording, "--model", model, "--json") == once


def test_the_recording_is_written_again_with_its_detections(
    model, recording, tmp_path, capsys
):
    target = tmp_path / "out.mcap"
    argv = (recording, "--model", model, "--record", target, "--json")
    code, out, _ = call(capsys, *argv)
    assert code == 0
    before, after = read_recording(recording), read_recording(target)
    assert before.detections == ()
    assert [d.stamp for d in after.detections] == [
        row["stamp"] for row in last_json(out)["detections"]
    ]
    assert (after.labels, after.count) == (before.labels, before.count)
    one, other = before.arrays(), after.arrays()
    assert np.array_equal(one.counts, other.counts)
    call(capsys, target, "--model", model, "--record", target)
    assert read_recording(target).detections == after.detections


def test_a_recording_cut_in_half_replays_and_says_so(
    model, recording, tmp_path, capsys
):
    half = tmp_path / "half.mcap"
    whole = recording.read_bytes()
    half.write_bytes(whole[: len(whole) * 3 // 4])
    code, out, err = call(capsys, half, "--model", model, "--json")
    assert (code, err) == (0, "")
    assert "cut or damaged" in out
    assert 1 <= len(last_json(out)["detections"]) <= 3


def test_bad_input_is_one_line_and_leaves_nothing(model, recording, tmp_path, capsys):
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(model.read_bytes()[:200])
    shear = tmp_path / "shear.safetensors"
    save_model(shear, model_of(network("shear")))
    wrong = tmp_path / "wrong.safetensors"
    other = model_of(network(), ("none", "poke", "stroke", "grab", "wave"))
    save_model(wrong, other)
    start = tmp_path / "start.mcap"
    start.write_bytes(recording.read_bytes()[:200])
    files = set(tmp_path.iterdir())
    for argv, message in (
        ((recording, "--model", tmp_path / "gone"), "no such model; allowed are ur5"),
        ((recording, "--model", damaged), "is no model file"),
        ((recording, "--model", shear), "needs shear, skin 'grid'"),
        ((recording, "--model", wrong), "for its card's network and its 5 classes"),
        ((tmp_path / "gone.mcap", "--model", model), "no recording at"),
        ((start, "--model", model), "is cut before its"),
        ((model, "--model", model), "give a recording made by eskin"),
        ((recording, "--model", model, "--record", tmp_path / "no/a.mcap"), "folder"),
        ((recording, "--model", model, "--record", tmp_path), "is a folder"),
        ((recording, "--model", model, "--classes", "poke"), "--classes"),
        ((), "recording"),
    ):
        code, out, err = call(capsys, *argv)
        assert (code, out) == (2, ""), argv
        assert message.lower() in err.lower()
        assert len(err.strip().splitlines()) == 1
        assert set(tmp_path.iterdir()) == files
