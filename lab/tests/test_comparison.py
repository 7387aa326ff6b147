"""Comparison: examples of clips, and results that are kept until settings change."""

import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest

from eskin.errors import EskinError, RecordingError
from eskin.learn.ground_truth import read_clips
from eskin.recording import read_recording
from eskin.touch import TouchPipeline
from helpers.clips import generated
from helpers.learning import record_people
from lab.baselines import READINGS
from lab.comparison.examples import LARGEST_PRESSURE, cut_clip_windows, find_examples
from lab.comparison.methods import METHODS, Method
from lab.comparison.results import TrainingTask, find_stale, run_tasks

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two sets of six clips each."""
    place = tmp_path_factory.mktemp("sets")
    generated(place / "a")
    generated(place / "b", chosen="train")
    return place


@pytest.fixture
def a(folder, tmp_path):
    return find_examples([folder / "a"], tmp_path / "pack")


@pytest.fixture
def b(folder, tmp_path):
    return find_examples([folder / "b"], tmp_path / "pack")


@dataclass(frozen=True)
class ConstantBaseline(Method):
    """Predicts one class, and logs each training."""

    answer: int = 0
    log: str = "/dev/null"

    def fit(self, examples, seed):
        with open(self.log, "a") as file:
            file.write("x")
        row = np.eye(len(examples.gestures))[self.answer]
        return lambda other: np.tile(row, (other.count, 1))


def task(examples, tests=None, answer=0, **changed):
    made = TrainingTask("constant", ConstantBaseline(answer), examples, tests or {}, 0)
    return replace(made, **changed)


def test_windows_hold_the_calibrated_pressures_of_their_clip(a):
    recording = read_recording(a.paths[0])
    clips = read_clips(a.paths[0])
    pipeline = TouchPipeline(a.mounted, recording.calibration)
    assert a.windows.pressure.shape[:2] == (len(a.clips), READINGS)
    for scan in recording.scans():
        reading, _ = pipeline.calibrate(scan)
        above = reading.pressure >= pipeline.front_end.floor
        pressure = np.where(reading.valid & above, reading.pressure, 0)
        for n, clip in enumerate(clips):
            if clip.start <= scan.stamp < clip.end:
                slot = (scan.stamp - clip.start) * READINGS // (clip.end - clip.start)
                np.testing.assert_allclose(
                    a.windows.pressure[n, slot], pressure, atol=0.01, rtol=1e-3
                )
                np.testing.assert_allclose(a.windows.q[n, slot], scan.q, atol=1e-6)
    assert a.windows.pressure.max() > 1


def test_slots_without_reading_repeat_the_previous_one(a, monkeypatch):
    path = a.paths[0]
    clip = read_clips(path)[0]
    taxels = a.mounted.skin.count

    def read_pressures(recording):
        for slot in (10, 60):
            stamp = clip.start + slot * (clip.end - clip.start) // READINGS
            yield (
                stamp,
                np.full(taxels, slot),
                np.full(len(recording.joint_names), slot),
            )

    monkeypatch.setattr("lab.comparison.examples.read_pressures", read_pressures)
    pressure, _ = cut_clip_windows(path)
    held = np.repeat([0, 10, 60], [10, 50, 40])
    np.testing.assert_array_equal(pressure[0, :, -1], held)
    assert not pressure[1:].any()


def test_invalid_taxels_are_zero_in_windows(a, monkeypatch):
    before = a.windows.pressure.copy()
    hardest = before.max(axis=(0, 1)).argmax()
    calibrate = TouchPipeline.calibrate

    def all_but_one_valid(pipeline, scan):
        reading, faults = calibrate(pipeline, scan)
        return replace(reading, valid=np.arange(len(reading.valid)) != hardest), faults

    monkeypatch.setattr(TouchPipeline, "calibrate", all_but_one_valid)
    pressure, _ = cut_clip_windows(a.paths[0])
    assert before[..., hardest].max() > 1
    before[..., hardest] = 0
    np.testing.assert_array_equal(pressure, before[: len(pressure)])


def test_noise_is_zero_in_windows_and_saturation_is_bounded(a, monkeypatch):
    calibrate = TouchPipeline.calibrate

    def noisy(pipeline, scan):
        reading, faults = calibrate(pipeline, scan)
        pressure = 0.9 * pipeline.front_end.floor.astype(np.float32)
        pressure[::2] = 1e6
        return replace(reading, pressure=pressure), faults

    monkeypatch.setattr(TouchPipeline, "calibrate", noisy)
    pressure, _ = cut_clip_windows(a.paths[0])
    np.testing.assert_array_equal(np.unique(pressure[..., 1::2]), 0)
    assert pressure[..., ::2].max() == LARGEST_PRESSURE


def test_recordings_without_clips_are_refused(tmp_path):
    record_people(tmp_path, ("ann",))
    with pytest.raises(RecordingError, match="is of no set of clips; allowed are sets"):
        find_examples([tmp_path], tmp_path)


@pytest.mark.parametrize("change", ["gesture", "start"])
def test_other_labels_or_times_of_clips_change_the_digest(change, a, tmp_path):
    def copied(name, was="", now=""):
        shutil.copytree(a.paths[0].parent, tmp_path / name / "a")
        index = next((tmp_path / name).rglob("clips.jsonl"))
        index.write_text(index.read_text().replace(was, now, 1))
        return find_examples([tmp_path / name], tmp_path)

    _, clip = a.clips[0]
    was, now = {
        "gesture": (f'"gesture": "{clip.gesture}"', '"gesture": "kick"'),
        "start": (f'"start": {clip.start}', f'"start": {clip.start - 1}'),
    }[change]
    same = copied("same")
    other = copied("other", was, now)
    assert same.digest == a.digest != other.digest
    digests = [task(each, {"test": each}).digest for each in (same, a, other)]
    assert digests[0] == digests[1] != digests[2]


def test_held_out_recordings_are_not_trained_on(folder, tmp_path):
    trained_on = []

    class Spy(ConstantBaseline):
        def fit(self, examples, seed):
            trained_on.extend(examples.paths)
            return super().fit(examples, seed)

    both = find_examples([folder], tmp_path)
    results = [
        TrainingTask("spy", Spy(), both, {}, seed, share=0.5).run() for seed in range(6)
    ]
    trained_on = trained_on[: len(trained_on) // 6]
    held = len(both.clips) - sum(len(read_clips(path)) for path in trained_on)
    assert held > 0 and len(results[0].answered["val"].truth) == held
    assert {each.answered["val"] for each in results} == {results[0].answered["val"]}


def test_a_training_is_repeated_only_if_anything_differs(a, b, tmp_path):
    log = tmp_path / "log"
    kept = tmp_path / "results.jsonl"
    first = task(a, {"test": b}, method=ConstantBaseline(0, str(log)))
    assert run_tasks([first], kept) == run_tasks([first], kept)
    assert log.read_text() == "x"
    for changed in (
        {"seed": 1},
        {"method": ConstantBaseline(1, str(log))},
        {"train": b},
        {"tests": {"test": a}},
        {"share": 0.5},
    ):
        run_tasks([replace(first, **changed)], kept)
    assert log.read_text() == "xxxxxx"


def test_a_result_of_other_settings_is_stale_until_made_again(a, tmp_path):
    before = task(a)
    now = task(a, answer=1)
    path = tmp_path / "results.jsonl"
    run_tasks([before], path)
    assert find_stale([before], path) == []
    assert find_stale([now], path) == [now.label]
    run_tasks([now], path)
    assert find_stale([now], path) == [] and path.read_text().count("\n") == 1


def test_tasks_of_the_same_name_are_refused(a, tmp_path):
    with pytest.raises(EskinError, match="several trainings are named 'constant, seed"):
        run_tasks([task(a), task(a, answer=1)], tmp_path / "results.jsonl")


def test_after_the_time_limit_only_kept_results_are_returned(a, tmp_path):
    tasks = [task(a, seed=seed) for seed in range(2)]
    run_tasks(tasks[1:], tmp_path / "r.jsonl")
    found = run_tasks(tasks, tmp_path / "r.jsonl", seconds=-1.0)
    assert found[0] is None and found[1] is not None


@pytest.mark.parametrize("kept", ["\n", "{", "[]", '{"method": "x"}'])
def test_a_damaged_file_of_results_is_named_and_unchanged(a, b, tmp_path, kept):
    path = tmp_path / "results.jsonl"
    path.write_text(kept)
    with pytest.raises(EskinError, match="results.jsonl is no file of results .*; del"):
        run_tasks([task(a, {"test": b})], path)
    assert path.read_text() == kept


def test_eskin_is_the_first_method():
    assert next(iter(METHODS)) == "eskin"
