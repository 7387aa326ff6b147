"""Methods compared on the same clips: what they are given, and what is kept."""

import json
import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure

from eskin.cli.main import run
from eskin.errors import EskinError, RecordingError
from eskin.learn.baselines import READINGS
from eskin.learn.comparison import (
    METHODS,
    AnsweredClips,
    Method,
    MethodResult,
    TrainingTask,
    find_examples,
    find_stale,
    read_results,
    run_tasks,
)
from eskin.learn.comparison.encoders import ENCODERS
from eskin.learn.comparison.examples import cut_clip_windows
from eskin.learn.comparison.study import Variant, build_study_rows, plot_shares
from eskin.learn.ground_truth import read_clips
from eskin.model import LENGTH_CM, NetworkConfig
from eskin.nn import build_graph_tensors
from eskin.recording import read_recording
from eskin.touch import TouchPipeline
from helpers.clips import generated
from helpers.graphs import orthogonal, random_graph, turned
from helpers.learning import record_people

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two sets of six clips each."""
    place = tmp_path_factory.mktemp("sets")
    generated(place / "a")
    generated(place / "b", chosen="train")
    return place


@pytest.fixture
def examples(folder, tmp_path):
    return find_examples([folder / "a"], tmp_path / "pack")


@dataclass(frozen=True)
class Guess(Method):
    """Predictor the same to everything, and counts how often it learned."""

    answer: int = 0
    log: str = ""

    def fit(self, examples, seed):
        with open(self.log or "/dev/null", "a") as file:
            file.write("x")
        size = len(examples.gestures)

        def answers(other):
            return np.tile(np.eye(size)[self.answer], (len(other.clips), 1))

        return answers


def test_a_window_shows_what_the_pipeline_says_in_the_two_seconds_of_its_clip(examples):
    path = examples.paths[0]
    recording, clips = read_recording(path), read_clips(path)
    pipeline = TouchPipeline(examples.mounted, recording.calibration)
    windows = examples.windows
    assert windows.pressure.shape[:2] == (len(examples.clips), READINGS)
    for scan in recording.scans():
        reading, _ = pipeline.calibrate(scan)
        felt = np.where(reading.valid, reading.pressure, 0)
        for n, clip in enumerate(clips):
            if clip.start <= scan.stamp < clip.end:
                slot = (scan.stamp - clip.start) * READINGS // (clip.end - clip.start)
                np.testing.assert_allclose(
                    windows.pressure[n, slot], felt, atol=0.01, rtol=1e-3
                )
                np.testing.assert_allclose(windows.q[n, slot], scan.q, atol=1e-6)
    assert windows.pressure.max() > 1


def test_where_no_reading_came_a_window_shows_the_one_before(examples, monkeypatch):
    path = examples.paths[0]
    clip, taxels = read_clips(path)[0], examples.mounted.skin.count

    def read_pressures(recording, transform):
        for slot in (10, 60):
            stamp = clip.start + slot * (clip.end - clip.start) // READINGS
            yield (
                stamp,
                np.full(taxels, slot),
                np.full(len(recording.joint_names), slot),
            )

    monkeypatch.setattr(
        "eskin.learn.comparison.examples.read_pressures", read_pressures
    )
    pressure, _ = cut_clip_windows(path)
    held = np.repeat([0, 10, 60], [10, 50, 40])
    np.testing.assert_array_equal(pressure[0, :, -1], held)
    assert not pressure[1:].any()


def test_what_is_not_valid_reads_zero_in_a_window(examples, monkeypatch):
    felt = examples.windows.pressure
    told = TouchPipeline.calibrate

    def calibrated(pipeline, scan):
        reading, faults = told(pipeline, scan)
        return replace(reading, valid=np.arange(len(reading.valid)) % 2 == 1), faults

    monkeypatch.setattr(TouchPipeline, "calibrate", calibrated)
    pressure, _ = cut_clip_windows(examples.paths[0])
    assert felt[..., ::2].max() > 1
    np.testing.assert_array_equal(pressure[..., ::2], 0)
    assert pressure[..., 1::2].any()


def test_windows_from_the_pack_are_those_that_were_made(examples):
    again = replace(examples)
    np.testing.assert_array_equal(examples.windows.pressure, again.windows.pressure)
    np.testing.assert_array_equal(examples.windows.q, again.windows.q)


def test_recordings_that_are_no_clips_are_refused(tmp_path):
    record_people(tmp_path, ("ann",))
    with pytest.raises(RecordingError, match="is of no set of clips; allowed are sets"):
        find_examples([tmp_path], tmp_path)


def test_what_is_held_out_is_not_learned_from(folder, tmp_path):
    learned = []

    class Spy(Guess):
        def fit(self, examples, seed):
            learned.extend(examples.paths)
            return super().fit(examples, seed)

    every = find_examples([folder], tmp_path)
    result = TrainingTask("spy", Spy(), every, {}, 0, share=0.5).run()
    held = len(every.clips) - sum(len(read_clips(path)) for path in learned)
    assert held > 0 and len(result.answered["val"].truth) == held
    again = [
        TrainingTask("spy", Spy(), every, {}, seed, share=0.5).run()
        for seed in range(6)
    ]
    assert {each.answered["val"] for each in again} == {result.answered["val"]}


def test_a_training_is_done_once_and_again_where_anything_differs(folder, tmp_path):
    log, kept = tmp_path / "log", tmp_path / "results.jsonl"
    a, b = (find_examples([folder / name], tmp_path) for name in "ab")
    task = TrainingTask("guess", Guess(0, str(log)), a, {"test": b}, 0)
    first, again = (run_tasks([task], kept) for _ in range(2))
    assert first == again and log.read_text() == "x"
    others = (
        replace(task, seed=1),
        replace(task, method=Guess(1, str(log))),
        replace(task, train=b),
        replace(task, tests={"test": a}),
        replace(task, share=0.5),
    )
    for other in others:
        run_tasks([other], kept)
    assert log.read_text() == "xxxxxx"


def test_a_result_of_other_settings_is_stale_until_it_is_made_again(folder, tmp_path):
    a = find_examples([folder / "a"], tmp_path)
    before, now = (TrainingTask("guess", Guess(n), a, {}, 0) for n in range(2))
    path = tmp_path / "results.jsonl"
    run_tasks([before], path)
    assert find_stale([before], path) == []
    assert find_stale([now], path) == [now.label]
    run_tasks([now], path)
    assert find_stale([now], path) == [] and path.read_text().count("\n") == 1


def test_tasks_of_one_name_are_refused(folder, tmp_path):
    a = find_examples([folder / "a"], tmp_path)
    tasks = [TrainingTask("guess", Guess(n), a, {}, 0) for n in range(2)]
    with pytest.raises(EskinError, match="several trainings are named 'guess, seed 0"):
        run_tasks(tasks, tmp_path / "results.jsonl")


def test_what_is_not_begun_in_time_is_left_and_what_is_done_is_not(folder, tmp_path):
    a = find_examples([folder / "a"], tmp_path)
    tasks = [TrainingTask("guess", Guess(), a, {}, seed) for seed in range(2)]
    run_tasks(tasks[1:], tmp_path / "r.jsonl")
    found = run_tasks(tasks, tmp_path / "r.jsonl", seconds=-1.0)
    assert found[0] is None and found[1] is not None


def test_only_the_plain_encoder_feels_how_a_touch_is_turned_in_the_world():
    rng = np.random.default_rng(0)
    batch = random_graph(rng, 30)
    there = turned(batch, orthogonal(rng, 1))
    for kind, make in ENCODERS.items():
        torch.manual_seed(0)
        encoder = make(NetworkConfig()).double().eval()
        here, away = (
            encoder(build_graph_tensors(each, False, torch.float64)).detach().numpy()
            for each in (batch, there)
        )
        assert np.abs(here).max() > 0.1
        assert np.allclose(here, away, atol=1e-4) == (kind != "plain"), kind


def test_every_encoder_feels_coordinates_in_the_same_unit():
    batch = build_graph_tensors(random_graph(np.random.default_rng(0), 30), False)
    felt = []
    for kind, make in ENCODERS.items():
        encoder = make(NetworkConfig())
        encoder.layers[0].register_forward_pre_hook(lambda _, seen: felt.append(seen))
        encoder(batch)
        (_, x, *_) = felt.pop()
        torch.testing.assert_close(LENGTH_CM * x, batch.positions, msg=kind)


def test_an_accuracy_of_nothing_is_drawn_and_none_is_not():
    axes = Figure().subplots()
    plot_shares(axes, [4, 8, 16], [(0.0, 0.0), (None, 0.0), (0.5, 0.1)], "k", "a")
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), [0.0, np.nan, 50.0])


def test_an_encoder_of_one_pooling_knows_nothing_of_the_other():
    batch = build_graph_tensors(random_graph(np.random.default_rng(0), 30), False)
    for kind in ("max", "mean"):
        torch.manual_seed(0)
        encoder = ENCODERS[kind](NetworkConfig(width=8))
        found = encoder(batch)
        np.testing.assert_allclose(
            found[:, :8].detach(), found[:, 8:].detach(), atol=1e-5
        )


def call(capsys, *argv):
    code = run([str(word) for word in argv])
    return code, *capsys.readouterr()


def test_every_draw_is_learned_with_a_seed_of_its_own(folder, tmp_path, capsys):
    words = ["compare", "--train", folder / "a", folder / "b", "--seeds", 2]
    words += ["--test", folder / "b", folder / "a", "--methods", "knn-max"]
    words += ["--pack", tmp_path / "pack", "--results", tmp_path / "results"]
    assert call(capsys, *words)[0] == 0
    kept = read_results(tmp_path / "results")
    assert sorted(each.result.seed for each in kept.values()) == [0, 1, 2, 3]


def test_the_table_has_a_row_a_method_and_a_cut_comparison_goes_on(
    folder, tmp_path, capsys
):
    words = ["compare", "--train", folder / "a", "--test", folder / "b", "--json"]
    words += ["--methods", "knn-max", "mlp-max", "--pack", tmp_path / "pack"]
    words += ["--results", tmp_path / "results"]
    code, out, err = call(capsys, *words)
    assert (code, err) == (0, "")
    rows = json.loads(out.splitlines()[-1])["rows"]
    assert [row["name"] for row in rows] == ["knn-max", "mlp-max"]
    assert {"val_accuracy", "test_accuracy", "std"} <= rows[0].keys()
    gestures = sorted(rows[0]["by_gesture"])
    assert f"| b, clips of | {' | '.join(gestures)} |" in out
    assert "| knn-max | 1 | " in out
    again = call(capsys, *words, "--minutes", -1)
    assert json.loads(again[1].splitlines()[-1])["rows"] == rows


@pytest.mark.parametrize(
    ("words", "left"),
    [
        (["compare", "--train", "a", "--test", "b", "--methods", "knn-max"], 1),
        (["study", "a", "--k", "8", "--picture", "study.png"], 12),
    ],
)
def test_what_is_cut_before_its_first_training_says_what_is_left(
    folder, tmp_path, capsys, monkeypatch, words, left
):
    monkeypatch.chdir(tmp_path)
    words = [folder / word if word in ("a", "b") else word for word in words]
    code, out, err = call(capsys, *words, "--minutes", -1, "--json")
    said, rows = out.splitlines()
    assert (code, err, json.loads(rows)["rows"]) == (0, "", [])
    assert said == f"{left} of {left} trainings are left; the same command goes on"
    assert not (tmp_path / "study.png").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--methods", "magic"], "--methods names magic; allowed are eskin, "),
        (["--seeds", "0"], "seeds is 0; allowed is from 1"),
        (["--train", "x", "y", "z"], "--train names 3 and --test 2; allowed are as"),
        (["--test", "a/x", "b/x"], "--test names folders x, x; allowed is each name"),
        (["--results", "tests"], "is a folder; give the path of a file"),
        (["--pack", "pyproject.toml"], "pyproject.toml is no folder that can be"),
        ([], "1 recordings of --test a, such as "),
    ],
)
def test_what_cannot_be_compared_is_refused(folder, tmp_path, capsys, words, message):
    command = ["compare", "--train", folder / "a", "--test", folder / "b", folder / "a"]
    command += ["--results", tmp_path / "r", "--pack", tmp_path / "p", *words]
    code, _, err = call(capsys, *command)
    assert code == 2 and err.count("\n") == 1 and message in err


def test_a_study_has_a_row_a_variant_and_a_picture(
    folder, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(
        Variant, "build_method", lambda variant, epochs: Guess(variant.k - 4)
    )
    for part, name in (("train", "a"), ("test", "b")):
        shutil.copytree(folder / name, tmp_path / "set" / part)
    picture = tmp_path / "study.png"
    words = ["study", tmp_path / "set", "--k", "4", "5", "--networks", "paper"]
    words += ["--results", tmp_path / "r", "--pack", tmp_path / "pack", "--json"]
    code, out, err = call(capsys, *words, "--picture", picture)
    assert (code, err) == (0, "")
    rows = json.loads(out.splitlines()[-1])["rows"]
    variants = [(row["k"], row["pool"], row["runs"]) for row in rows]
    assert variants == [(4, "max", 3), (4, "mean", 3), (5, "max", 3), (5, "mean", 3)]
    assert {row["test_std"] for row in rows} == {0.0}
    table = [line for line in out.splitlines() if line.startswith("| ")]
    assert table[0].count("| K 4, max ahead |") == 2 and len(table) == 5
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "no set of clips is named; allowed is one or more"),
        (["a", "--picture", "study.gif"], "allowed are .png, .svg, .pdf; change its"),
        (["a", "--results", "tests"], "is a folder; give the path of a file"),
    ],
)
def test_what_cannot_be_studied_is_refused(folder, capsys, words, message):
    words = [folder / word if word == "a" else word for word in words]
    code, _, err = call(capsys, "study", *words)
    assert code == 2 and err.count("\n") == 1 and message in err


@pytest.mark.parametrize("kept", ["\n", "{", "[]", '{"method": "x"}'])
def test_a_damaged_result_is_named_and_left_alone(folder, tmp_path, kept):
    a, b = (find_examples([folder / name], tmp_path / "pack") for name in ("a", "b"))
    task = TrainingTask("guess", Guess(0), a, {"test": b}, 0)
    path = tmp_path / "results.jsonl"
    path.write_text(kept)
    with pytest.raises(EskinError, match="results.jsonl is no file of results .*; del"):
        run_tasks([task], path)
    assert path.read_text() == kept


def test_a_variant_is_held_against_the_first_of_its_network_where_both_were_trained():
    def result(right):
        truth, people = ("poke", "grab") * 2, ("p1", "p1", "p2", "p2")
        answer = truth if right else ("poke",) * 4
        return MethodResult("", 0, 1.0, {"test": AnsweredClips(truth, answer, people)})

    ours = [Variant("eskin", k, "max") for k in (4, 8, 16)]
    theirs = Variant("paper", 8, "max")
    found = {
        ours[0]: {(0, 0): result(True), (1, 0): result(True)},
        ours[1]: {(0, 0): result(False), (1, 0): result(True), (2, 0): result(False)},
        ours[2]: {(2, 0): result(True)},
        theirs: {(0, 0): result(False)},
    }
    first, second, other = build_study_rows(found)
    assert (first.k, second.k, other.network) == (4, 8, "paper")
    assert (first.runs, second.runs, other.runs) == (2, 2, 1)
    assert (first.test_ahead, other.test_ahead, second.val_ahead) == (None, None, None)
    assert second.test_accuracy == 0.75 and second.test_ahead.mean == 0.25


def test_ours_is_the_first_of_the_methods():
    assert next(iter(METHODS)) == "eskin"
