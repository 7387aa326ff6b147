"""Generation: whole files, one index, the same bytes however they came about."""

import signal
import subprocess
import sys
import time
from fcntl import LOCK_EX, flock
from pathlib import Path

import numpy as np
import pytest

from eskin.errors import GenerationError
from eskin.recording import find_recordings, read_recording
from eskin.sim.dataset import GenerationSettings, generate
from eskin.touch import Calibrator
from helpers.simulation import Dying, Failing, Slow, StandIn

SECOND = 1_000_000_000
SMALL = GenerationSettings("train", "square", seed=3, clips=23, subjects=4)


def made(folder, settings=SMALL, **options):
    generate(folder, settings, **({"factory": StandIn} | options))
    return folder


def content(folder):
    """Every file of a folder by its place."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return made(tmp_path_factory.mktemp("whole"))


def test_a_set_is_its_recordings_its_index_and_its_settings(whole):
    files = [f"train-000{number}.mcap" for number in range(4)]
    assert sorted(content(whole)) == ["clips.jsonl", "generation.json", *files]


def test_a_recording_is_a_lead_in_and_a_clip_every_six_seconds(whole):
    recording = read_recording(whole / "train-0001.mcap")
    stamps = recording.arrays().stamps
    assert len(stamps) == 75 + 6 * 100
    starts = np.append(0, np.flatnonzero(np.diff(stamps) > SECOND) + 1)
    seconds = (stamps[starts] - stamps[0]) / SECOND
    np.testing.assert_array_equal(seconds, 6.0 * np.arange(7))
    assert set(np.diff(stamps)) == {20_000_000, 4_520_000_000, 4_020_000_000}
    assert recording.metadata.dataset == "train"
    assert recording.metadata.subject == "train-p1"
    assert recording.metadata.session == "train-0001"
    assert recording.metadata.notes["build"] == "fresh-b1"
    assert recording.robot_name == "table"


def test_every_touch_has_a_true_label_and_an_automatic_one_where_it_is_felt(whole):
    for path in find_recordings([whole]):
        labels = read_recording(path).labels
        true = [label for label in labels if label.source == "true"]
        auto = [label for label in labels if label.source == "auto"]
        truths = list(read_recording(path).truths())
        assert len(true) == len(auto) > 0
        for label, found in zip(true, auto, strict=True):
            assert label.gesture == found.gesture
            assert abs(label.start - found.start) <= 60_000_000
            assert abs(label.end - found.end) <= 60_000_000
            inside = [t for t in truths if label.start <= t.stamp < label.end]
            assert {truth.gesture for truth in inside} == {label.gesture}
            assert len({truth.touch for truth in inside}) == 1
        assert {truth.touch for truth in truths} == set(range(len(true)))


def test_automatic_labels_are_those_of_the_live_calibration(whole):
    recording = read_recording(whole / "train-0000.mcap")
    calibrator = Calibrator(recording.skin, recording.calibration)
    touched = []
    for scan in recording.scans():
        reading = calibrator.push(scan)
        if reading.pressure.max(where=reading.valid, initial=0.0) > 5.0:
            touched.append(scan.stamp)
    spans = [(x.start, x.end) for x in recording.labels if x.source == "auto"]
    for stamp in touched:
        assert any(start <= stamp < end for start, end in spans)


@pytest.mark.parametrize("workers", [1, 2])
def test_the_bytes_do_not_depend_on_the_number_of_workers(whole, tmp_path, workers):
    assert content(made(tmp_path, workers=workers)) == content(whole)


def test_another_seed_or_difficulty_gives_other_clips(whole, tmp_path):
    for name, settings in {
        "seed": GenerationSettings("train", "square", seed=4, clips=23, subjects=4),
        "set": GenerationSettings("val", "square", seed=3, clips=23, subjects=4),
    }.items():
        other = content(made(tmp_path / name, settings))
        same = set(other.values()) & set(content(whole).values())
        assert not same


def test_a_set_that_is_there_is_not_made_again(whole, tmp_path):
    made(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.mcap")}
    result = generate(tmp_path, SMALL, factory=Failing)
    assert (result.clips, result.made, result.files) == (23, 0, 4)
    after = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*.mcap")}
    assert before == after
    assert content(tmp_path) == content(whole)


@pytest.mark.parametrize("damage", ["file", "line", "half", "index", "part", "more"])
def test_what_is_missing_is_made_and_what_is_left_over_removed(whole, tmp_path, damage):
    made(tmp_path)
    index = tmp_path / "clips.jsonl"
    lines = index.read_bytes().splitlines(keepends=True)
    if damage == "file":
        (tmp_path / "train-0002.mcap").unlink()
    if damage == "line":
        index.write_bytes(b"".join(lines[:-1]))
    if damage == "half":
        index.write_bytes(b"".join(lines)[: len(lines[0]) * 15])
    if damage == "index":
        index.unlink()
    if damage == "part":
        (tmp_path / "train-0003.mcap").rename(tmp_path / "train-0003.mcap.part")
    if damage == "more":
        index.write_bytes(b"".join(lines) + b'{"file": "train-00')
    made(tmp_path)
    assert content(tmp_path) == content(whole)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_clip_that_cannot_be_made_is_named_and_only_whole_files_stay(
    whole, tmp_path, workers
):
    message = r"clip 1 of train-0001\.mcap .* ZeroDivisionError: no force"
    with pytest.raises(GenerationError, match=message) as caught:
        made(tmp_path, factory=Failing, workers=workers)
    assert "\n" not in str(caught.value)
    left = content(tmp_path)
    assert sorted(left) == ["clips.jsonl", "generation.json", "train-0000.mcap"]
    assert len(left["clips.jsonl"].splitlines()) == 5
    assert content(made(tmp_path)) == content(whole)


def test_a_worker_that_dies_ends_it_in_one_line(tmp_path):
    with pytest.raises(GenerationError, match="a worker died, perhaps for want of"):
        made(tmp_path, factory=Dying, workers=2)
    assert not list(tmp_path.glob("*.part"))
    assert len(list(tmp_path.glob("*.mcap"))) <= 1


SCRIPT = """
from pathlib import Path
from helpers.simulation import Slow
from eskin.sim.dataset.generate import generate
from eskin.sim.dataset.settings import GenerationSettings
if __name__ == "__main__":
    settings = GenerationSettings("train", "square", seed=3, clips=23, subjects=4)
    generate(Path({folder!r}), settings, {workers}, Slow)
"""


@pytest.mark.parametrize("workers", [0, 2])
def test_a_generation_that_is_killed_goes_on_to_the_same_bytes(
    whole, tmp_path, workers
):
    script = tmp_path / "script.py"
    folder = tmp_path / "out"
    script.write_text(SCRIPT.format(folder=str(folder), workers=workers))
    path = str(Path(__file__).parent)
    process = subprocess.Popen(
        [sys.executable, str(script)], env={"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    )
    while not (folder / "train-0000.mcap").exists():
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(list(folder.glob("*.mcap"))) < 4
    for recording in folder.glob("*.mcap"):
        assert not read_recording(recording).truncated
    time.sleep(0.5 if workers else 0.0)
    assert content(made(folder)) == content(whole)


def test_a_folder_that_another_generation_writes_to_is_left_alone(whole, tmp_path):
    made(tmp_path)
    before = content(tmp_path)
    with (tmp_path / "generation.json").open() as file:
        flock(file, LOCK_EX)
        with pytest.raises(GenerationError, match="another eskin generate is writing"):
            made(tmp_path)
    assert content(tmp_path) == before


def test_a_folder_of_other_settings_is_refused_in_one_line(whole, tmp_path):
    made(tmp_path)
    before = content(tmp_path)
    for other, message in (
        (GenerationSettings("val", "square", 3, 23, 4), "set_name train, not val"),
        (GenerationSettings("train", "other", 3, 23, 4), "skin square, not other"),
        (GenerationSettings("train", "square", 4, 23, 4), "seed 3, not 4"),
        (GenerationSettings("train", "square", 3, 24, 4), "clips 23, not 24"),
        (GenerationSettings("train", "square", 3, 23, 3), "subjects 4, not 3"),
        (
            GenerationSettings("train", "square", 3, 23, 4, 1.0),
            "difficulty 1.5, not 1.0",
        ),
    ):
        with pytest.raises(GenerationError, match=message) as caught:
            made(tmp_path, other)
        assert "\n" not in str(caught.value)
    assert content(tmp_path) == before


def test_a_folder_of_other_recordings_is_refused_and_stays(whole, tmp_path):
    (tmp_path / "mine.mcap").write_bytes(b"precious")
    with pytest.raises(GenerationError, match="holds recordings but no generation"):
        made(tmp_path)
    assert content(tmp_path) == {"mine.mcap": b"precious"}
    with pytest.raises(GenerationError, match="cannot write to"):
        made(tmp_path / "mine.mcap")
    (tmp_path / "mine.mcap").unlink()
    (tmp_path / "generation.json").write_text("[")
    with pytest.raises(GenerationError, match="cannot be read"):
        made(tmp_path)


def test_the_paper_set_has_its_days_in_two_folders(tmp_path):
    made(tmp_path, GenerationSettings("paper", "square", clips=24))
    files = sorted(name for name in content(tmp_path) if name.endswith(".mcap"))
    assert [name.split("/")[0] for name in files].count("train") == 4
    assert {name.split("/")[0] for name in files} == {"train", "test"}


def test_a_stream_is_one_recording_with_a_label_for_each_touch(tmp_path):
    made(tmp_path, GenerationSettings("streams", "square", clips=2))
    for path in find_recordings([tmp_path]):
        recording = read_recording(path)
        assert 66 <= (recording.end - recording.start) / SECOND <= 126
        true = [label for label in recording.labels if label.source == "true"]
        auto = [label for label in recording.labels if label.source == "auto"]
        assert len(true) == len(auto) > 10
        for label, found in zip(true, auto, strict=True):
            assert abs(label.start - found.start) <= 60_000_000


def test_progress_tells_how_many_clips_are_done(tmp_path):
    told = []
    made(tmp_path, on_progress=told.append)
    assert told == [0, 5, 11, 17, 23]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"seed": -1}, "seed is -1; allowed are 0 and above"),
        ({"difficulty": -0.5}, "difficulty is -0.5; allowed are 0"),
        ({"difficulty": float("nan")}, "difficulty is nan"),
        ({"set_name": "all"}, "no set 'all'"),
        ({"clips": 0}, "0 clips asked"),
    ],
)
def test_settings_that_make_no_sense_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        GenerationSettings(**wrong)


def test_slowness_changes_nothing(whole, tmp_path):
    assert content(made(tmp_path, factory=Slow)) == content(whole)
