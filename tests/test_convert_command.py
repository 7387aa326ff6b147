"""`eskin convert` and `eskin label`, as they are called."""

import json

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.recording import read_recording

COUNTS = (19, 27)


def write_source(folder, name="Grab_20250521150749_annotated.json"):
    """Six seconds of a sleeve file: grabs from 3.0 to 3.5 s and 5.0 to 5.5 s."""
    frames = []
    for index in range(60):
        held = 30 <= index < 35 or 50 <= index < 55
        data = np.full(COUNTS, 1.5)
        data[4:8, 5:9] += 150.0 * held
        label = "Grab" if held else "None"
        frames.append({"label": label, "data": data.tolist()})
    folder.mkdir(exist_ok=True)
    text = json.dumps({"timestamp": "20250521150749", "frames": frames})
    (folder / name).write_text(text)


def call(capsys, *argv):
    code = run([str(word) for word in argv])
    out, err = capsys.readouterr()
    return code, out, err


def last_json(out):
    return json.loads(out.strip().splitlines()[-1])


@pytest.fixture
def converted(tmp_path, capsys):
    write_source(tmp_path / "in")
    call(capsys, "convert", "sleeve", tmp_path / "in", tmp_path / "out")
    [path] = (tmp_path / "out").iterdir()
    return path


def test_convert_says_what_it_wrote(tmp_path, capsys):
    write_source(tmp_path / "in")
    code, out, _ = call(
        capsys, "convert", "sleeve", tmp_path / "in", tmp_path / "out", "--json"
    )
    assert code == 0
    assert last_json(out) == {
        "recordings": 1,
        "taxels": 513,
        "readings": 60,
        "labels": 2,
    }


def test_convert_of_bad_input_is_one_line_and_leaves_nothing(tmp_path, capsys):
    write_source(tmp_path / "in")
    bad = tmp_path / "in/Tap_20250521151000.json"
    bad.write_text('{"frames": [')
    for argv in (
        ("convert", "sleeve", tmp_path / "in", tmp_path / "out"),
        ("convert", "shearsense", tmp_path / "in", tmp_path / "out"),
        ("convert", "socialtouch", tmp_path / "in", tmp_path / "out"),
        ("convert", "sleeve", tmp_path / "gone", tmp_path / "out"),
        ("convert", "glove", tmp_path / "in", tmp_path / "out"),
        ("convert", "sleeve", tmp_path / "in", bad),
    ):
        code, out, err = call(capsys, *argv)
        assert (code, out) == (2, "")
        assert len(err.strip().splitlines()) == 1
        assert not (tmp_path / "out").exists()


def test_label_adds_labels_and_says_how_they_agree(converted, capsys):
    code, out, _ = call(capsys, "label", converted, "--json")
    result = last_json(out)
    assert (code, set(result)) == (0, {"labels", "agreement"})
    assert result["labels"] == 2
    assert result["agreement"]["accuracy"] == 1.0
    assert result["agreement"]["balanced_accuracy"] == 1.0
    labels = read_recording(converted).labels
    assert [label.source for label in labels] == ["auto", "true", "auto", "true"]


def test_labelling_twice_changes_nothing_more(converted, capsys):
    call(capsys, "label", converted)
    once = converted.read_bytes()
    call(capsys, "label", converted)
    assert converted.read_bytes() == once


def test_label_into_another_folder_leaves_the_recording_alone(
    converted, tmp_path, capsys
):
    before = converted.read_bytes()
    copies = tmp_path / "copies"
    code, _, _ = call(capsys, "label", converted.parent, "--out", copies)
    assert code == 0
    assert converted.read_bytes() == before
    assert len(read_recording(copies / converted.name).labels) == 4


def test_label_takes_ranges_and_options(converted, tmp_path, capsys):
    ranges = tmp_path / "ranges.yaml"
    ranges.write_text("- {start_s: 2, end_s: 6, gesture: squeeze}")
    argv = ("--ranges", ranges, "--min-window", "1.6", "--threshold", "30", "--json")
    code, out, _ = call(capsys, "label", converted, *argv)
    assert (code, last_json(out)["labels"]) == (0, 1)
    labels = read_recording(converted).labels
    sources = sorted((label.source, label.gesture) for label in labels)
    assert sources == [
        ("auto", "squeeze"),
        ("range", "squeeze"),
        ("true", "grab"),
        ("true", "grab"),
    ]


def test_of_several_recordings_none_is_labelled_where_one_cannot_be(
    converted, tmp_path, capsys, monkeypatch
):
    before = converted.read_bytes()
    cut = tmp_path / "z.mcap"
    cut.write_bytes(before[:-30])
    out = tmp_path / "copies"
    (out / "z.mcap").mkdir(parents=True)
    for argv, message in (
        ((converted, cut), "z.mcap is cut short and would be replaced"),
        ((converted, cut, "--out", out), "z.mcap: it is a folder"),
        ((converted, cut, "--out", cut), "is no folder that can be written to"),
    ):
        code, _, err = call(capsys, "label", *argv)
        assert (code, len(err.strip().splitlines())) == (2, 1)
        assert message in err
        assert converted.read_bytes() == before
    assert [path.name for path in out.iterdir()] == ["z.mcap"]
    monkeypatch.setattr("os.access", lambda *_: False)
    code, _, err = call(capsys, "label", converted)
    assert code == 2 and "no folder that can be written to" in err
    assert converted.read_bytes() == before


def test_label_of_bad_input_is_one_line_and_changes_nothing(
    converted, tmp_path, capsys
):
    before = converted.read_bytes()
    other = tmp_path / "other.mcap"
    other.write_bytes(before[:300])
    ranges = tmp_path / "ranges.yaml"
    ranges.write_text("- nothing")
    for argv, message in (
        ((), "no recording given"),
        ((tmp_path / "gone.mcap",), "no recording at"),
        ((converted, other), "is cut before its"),
        ((converted, "--ranges", ranges), "range 1 is nothing"),
        ((converted, converted.parent / "..", "--ranges", ranges), "one at a time"),
        ((converted, "--threshold", "-1"), "--threshold is -1.0"),
        ((converted, "--min-window", "nan"), "--min-window is nan"),
        ((converted, "--window", "1"), "--window"),
    ):
        if "one at a time" in message:
            other.write_bytes(before)
        code, out, err = call(capsys, "label", *argv)
        assert (code, out) == (2, ""), err
        assert message in err
        assert len(err.strip().splitlines()) == 1
    assert converted.read_bytes() == before


def test_labels_of_the_real_sleeve_set_are_better_than_its_ranges(
    sleeve_folder, tmp_path, capsys
):
    call(capsys, "convert", "sleeve", sleeve_folder, tmp_path / "out")
    _, out, _ = call(capsys, "label", tmp_path / "out", "--json")
    agreement = last_json(out)["agreement"]
    assert agreement["events"] == 224
    assert agreement["accuracy"] > 0.75
    assert agreement["balanced_accuracy"] > 0.7
