"""The clips of a generated set, as its index tells them."""

import json

import pytest

from eskin.errors import RecordingError
from eskin.learn.ground_truth import INDEX_NAME, Clip, read_clips
from eskin.recording import read_recording
from eskin.sim.dataset import read_index
from eskin.sim.dataset.index import INDEX_NAME as WRITTEN_NAME
from helpers.clips import START, generated


def line(file="a.mcap", start: int | str = START, **others) -> str:
    """What is looked at of a line of an index."""
    facts = {"file": file, "start": start, "gesture": "poke", "kind": "tip"}
    return json.dumps(facts | {"plan": {"seconds": 2.0}} | others)


def index(folder, *lines):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / INDEX_NAME).write_text("\n".join(lines) + "\n")
    return folder


def test_a_generated_recording_has_its_clips_in_order(tmp_path):
    paths = generated(tmp_path)
    found = [clip for path in paths for clip in read_clips(path)]
    rows = read_index(tmp_path)
    assert WRITTEN_NAME == INDEX_NAME
    assert [(c.start, c.gesture, c.kind) for c in found] == [
        (row.start, row.gesture, row.kind) for row in rows
    ]
    for path in paths:
        stamps = [scan.stamp for scan in read_recording(path).scans()]
        for clip in read_clips(path):
            inside = [stamp for stamp in stamps if clip.start <= stamp < clip.end]
            assert (inside[0], len(inside)) == (clip.start, 100)


def test_each_file_of_a_set_has_its_own_clips(tmp_path):
    lines = [line(), line("b/c.mcap", START + 5), line(start=START + 9, kind="")]
    folder = index(tmp_path / "set", *lines)
    assert read_clips(folder / "a.mcap") == (
        Clip(START, START + 2_000_000_000, "poke", "tip"),
        Clip(START + 9, START + 2_000_000_009, "poke", ""),
    )
    assert [clip.start for clip in read_clips(folder / "b" / "c.mcap")] == [START + 5]


def test_what_is_of_no_set_of_clips_has_none(tmp_path):
    assert read_clips(tmp_path / "a.mcap") == ()
    folder = index(tmp_path / "set", line())
    assert read_clips(folder / "other.mcap") == ()
    streams = index(tmp_path / "streams", line(gesture=""))
    assert read_clips(streams / "a.mcap") == ()


@pytest.mark.parametrize(
    "bad", ["{", "[]", "7", '{"file": "a.mcap"}', line(start="soon"), line(plan={})]
)
def test_an_index_that_cannot_be_read_is_one_line_that_names_it(tmp_path, bad):
    folder = index(tmp_path / "set", line(), bad)
    with pytest.raises(
        RecordingError, match=r"clips.jsonl line 2 is no clip"
    ) as caught:
        read_clips(folder / "a.mcap")
    assert "\n" not in str(caught.value)
    assert "run the same eskin generate again" in str(caught.value)
