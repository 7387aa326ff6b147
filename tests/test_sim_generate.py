"""These tests check generation: sets as files, and their index."""

import json
import shutil
import subprocess
import sys
import time
from fcntl import LOCK_EX, flock
from pathlib import Path

import numpy as np
import pytest

from eskin.errors import GenerationError
from eskin.recording import find_recordings, read_recording
from eskin.sim.dataset import (
    GenerationSettings,
    generate,
    read_index,
    remake_clip,
)
from eskin.units import NS_PER_S
from helpers.simulation import (
    Dying,
    Failing,
    StandIn,
    build_small_simulator,
    read_files,
)

pytestmark = pytest.mark.slow

SMALL_SET = GenerationSettings("train", "ur5", seed=3, clips=23, subjects=4)


def make_set(folder, settings=SMALL_SET, factory=StandIn, **options):
    generate(folder, settings, factory=factory, **options)
    return folder


def select_labels(recording, source):
    return [label for label in recording.labels if label.source == source]


@pytest.fixture(scope="module")
def small_set(tmp_path_factory):
    return make_set(tmp_path_factory.mktemp("small"))


@pytest.fixture
def copied_set(small_set, tmp_path):
    return Path(shutil.copytree(small_set, tmp_path / "copy"))


def test_set_is_its_recordings_index_and_settings(small_set):
    files = [f"train-000{number}.mcap" for number in range(4)]
    assert sorted(read_files(small_set)) == ["clips.jsonl", "generation.json", *files]


def test_recording_is_a_lead_in_and_a_clip_every_six_seconds(small_set):
    recording = read_recording(small_set / "train-0001.mcap")
    stamps = recording.arrays().stamps
    assert len(stamps) == 75 + 6 * 100
    starts = np.append(0, np.flatnonzero(np.diff(stamps) > NS_PER_S) + 1)
    seconds = (stamps[starts] - stamps[0]) / NS_PER_S
    np.testing.assert_array_equal(seconds, 6.0 * np.arange(7))
    assert set(np.diff(stamps)) == {20_000_000, 4_520_000_000, 4_020_000_000}
    metadata = recording.metadata
    assert (metadata.dataset, metadata.subject) == ("train", "train-p1")
    assert (metadata.session, metadata.notes["build"]) == ("train-0001", "fresh-b1")
    assert recording.robot_name == "table"


def test_every_touch_has_a_true_and_an_automatic_label(small_set, tmp_path):
    make_set(tmp_path, GenerationSettings("streams", "ur5", clips=1))
    for path in find_recordings([small_set, tmp_path]):
        recording = read_recording(path)
        true, auto = (select_labels(recording, name) for name in ("true", "auto"))
        truths = list(recording.truths())
        assert len(true) == len(auto) > 0
        for label, found in zip(true, auto, strict=True):
            assert label.gesture == found.gesture
            assert abs(label.start - found.start) <= 60_000_000
            assert abs(label.end - found.end) <= 60_000_000
            inside = [t for t in truths if label.start <= t.stamp < label.end]
            assert {truth.gesture for truth in inside} == {label.gesture}
            assert len({truth.touch for truth in inside}) == 1
        assert {truth.touch for truth in truths} == set(range(len(true)))
        if path.parent == tmp_path:
            assert 66 <= (recording.end - recording.start) / NS_PER_S <= 126
            assert len(true) > 10


def test_complete_set_is_not_made_again(small_set, copied_set):
    before = {path: path.stat().st_mtime_ns for path in copied_set.glob("*.mcap")}
    result = generate(copied_set, SMALL_SET, factory=Failing)
    assert (result.clips, result.made, result.files) == (23, 0, 4)
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert read_files(copied_set) == read_files(small_set)


def edit_index(edit):
    """Return a function that changes the bytes of the index of a folder."""

    def damage(folder):
        index = folder / "clips.jsonl"
        index.write_bytes(edit(index.read_bytes()))

    return damage


DAMAGES = {
    "no file": lambda folder: (folder / "train-0002.mcap").unlink(),
    "no index": lambda folder: (folder / "clips.jsonl").unlink(),
    "part": lambda folder: (folder / "train-0003.mcap").rename(
        folder / "train-0003.mcap.part"
    ),
    "no last line": edit_index(lambda data: data[: data[:-1].rfind(b"\n") + 1]),
    "half an index": edit_index(lambda data: data[: len(data) * 15 // 23]),
    "half a line more": edit_index(lambda data: data + b'{"file": "train-00'),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=list(DAMAGES))
def test_generation_repairs_a_damaged_set(small_set, copied_set, damage):
    damage(copied_set)
    assert read_files(copied_set) != read_files(small_set)
    assert read_files(make_set(copied_set)) == read_files(small_set)


@pytest.mark.parametrize("workers", [0, 1])
def test_generation_continues_after_a_clip_fails(small_set, tmp_path, workers):
    message = r"clip 1 of train-0001\.mcap .* ZeroDivisionError: no force"
    with pytest.raises(GenerationError, match=message) as caught:
        make_set(tmp_path, factory=Failing, workers=workers)
    assert "\n" not in str(caught.value)
    left = read_files(tmp_path)
    assert sorted(left) == ["clips.jsonl", "generation.json", "train-0000.mcap"]
    assert len(left["clips.jsonl"].splitlines()) == 5
    progress = []
    make_set(tmp_path, on_progress=progress.append)
    assert progress == [5, 11, 17, 23]
    assert read_files(tmp_path) == read_files(small_set)


def test_death_of_a_worker_ends_the_generation(tmp_path):
    with pytest.raises(GenerationError, match="a worker died"):
        make_set(tmp_path, factory=Dying, workers=1)
    assert not list(tmp_path.glob("*.part"))
    assert len(list(tmp_path.glob("*.mcap"))) <= 1


SCRIPT = f"""
from eskin.sim.dataset import GenerationSettings, generate
from helpers.simulation import Slow
generate({{!r}}, {SMALL_SET!r}, 2, Slow)
"""


def test_killed_generation_continues_to_the_same_bytes(small_set, tmp_path):
    env = {"PYTHONPATH": str(Path(__file__).parent), "OMP_NUM_THREADS": "1"}
    call = [sys.executable, "-c", SCRIPT.format(str(tmp_path))]
    with subprocess.Popen(call, env=env, stdout=subprocess.PIPE) as process:
        while not (tmp_path / "train-0000.mcap").exists():
            assert process.poll() is None
            time.sleep(0.01)
        process.kill()
        # The output ends when the workers have ended too.
        process.communicate(timeout=60)
    assert len(list(tmp_path.glob("*.mcap"))) < 4
    for recording in tmp_path.glob("*.mcap"):
        assert not read_recording(recording).truncated
    assert read_files(make_set(tmp_path)) == read_files(small_set)


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"set_name": "val"}, "set_name train, not val"),
        ({"skin": "ur10"}, "skin ur5, not ur10"),
        ({"difficulty": 1.0}, "difficulty 1.5, not 1.0"),
    ],
)
def test_folder_of_other_settings_is_refused(copied_set, changes, parts):
    before = read_files(copied_set)
    usual = {"set_name": "train", "skin": "ur5", "seed": 3, "clips": 23}
    settings = GenerationSettings(**(usual | {"subjects": 4} | changes))
    with pytest.raises(GenerationError, match=parts) as caught:
        make_set(copied_set, settings)
    assert "\n" not in str(caught.value)
    assert read_files(copied_set) == before


def test_folder_in_use_or_of_other_recordings_is_refused(copied_set):
    before = read_files(copied_set)
    with (copied_set / "generation.json").open() as file:
        flock(file, LOCK_EX)
        with pytest.raises(GenerationError, match="another eskin generate"):
            make_set(copied_set)
    (copied_set / "generation.json").unlink()
    with pytest.raises(GenerationError, match="no generation"):
        make_set(copied_set)
    for path in copied_set.glob("*.mcap"):
        assert path.read_bytes() == before.pop(path.name)
        path.unlink()
    (copied_set / "generation.json").write_text("[")
    with pytest.raises(GenerationError, match="cannot be read"):
        make_set(copied_set)


def test_line_of_the_index_has_its_documented_keys(small_set):
    line = json.loads((small_set / "clips.jsonl").read_text().splitlines()[0])
    keys = "file number start gesture kind subject build pose_group moving difficulty"
    assert list(line)[:11] == [*keys.split(), "regime"]
    keys = "touch gesture kind subject link onset end impulse"
    assert set(line["touches"][0]) == set(keys.split())
    assert line["plan"]["person"]["seed"]


def test_touches_of_the_index_are_those_of_the_truth(small_set):
    truths = {}
    for path in small_set.glob("*.mcap"):
        for truth in read_recording(path).truths():
            truths.setdefault((path.name, truth.touch), []).append(truth)
    for row in read_index(small_set):
        for touch in row.touches:
            own = truths[row.file, touch.touch]
            seconds = [(truth.stamp - row.start) / NS_PER_S for truth in own]
            assert touch.onset <= min(seconds) and max(seconds) < touch.end
            assert touch.impulse == pytest.approx(sum(t.force for t in own) / 50)
            assert {truth.gesture for truth in own} == {touch.gesture, row.gesture}


def test_any_clip_can_be_made_again_alone(tmp_path):
    settings = GenerationSettings("test-x", clips=5, subjects=1)
    make_set(tmp_path, settings, factory=build_small_simulator)
    generator = build_small_simulator(settings.skin)
    for row in read_index(tmp_path)[-2:]:
        arrays = read_recording(tmp_path / row.file).arrays()
        clip = remake_clip(row, generator)
        first = int(np.searchsorted(arrays.stamps, row.start))
        assert arrays.stamps[first] == row.start
        for name in ("counts", "received", "q"):
            recorded = getattr(arrays, name)[first : first + len(clip.counts)]
            np.testing.assert_array_equal(recorded, getattr(clip, name))
