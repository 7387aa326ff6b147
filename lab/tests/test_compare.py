"""`lab.compare` and `lab.study`: tables, pictures, continuation, refusals."""

import json
import shutil
from functools import partial

import numpy as np
import pytest
from matplotlib.figure import Figure

from helpers.clips import generated
from lab.baselines.estimators import NearestNeighbours
from lab.baselines.flat import FlatBaseline
from lab.compare import run_compare
from lab.comparison.methods import BaselineMethod
from lab.comparison.results import AnsweredClips, MethodResult, read_results
from lab.program import run_program
from lab.study import Variant, build_study_rows, plot_shares, run_study

pytestmark = pytest.mark.slow
PROGRAMS = {"compare": run_compare, "study": run_study}


def call(capsys, name, *words):
    """Run a program of the laboratory; return its exit code, text and error."""
    code = run_program(PROGRAMS[name], list(map(str, words)))
    return code, *capsys.readouterr()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two sets of six clips each."""
    place = tmp_path_factory.mktemp("sets")
    generated(place / "a")
    generated(place / "b", chosen="train")
    return place


def test_each_repetition_has_its_own_seed(folder, tmp_path, capsys):
    words = ["compare", "--train", folder / "a", folder / "b", "--seeds", 2]
    words += ["--test", folder / "b", folder / "a", "--methods", "knn-max"]
    words += ["--pack", tmp_path / "pack", "--results", tmp_path / "results"]
    assert call(capsys, *words)[0] == 0
    kept = read_results(tmp_path / "results")
    assert sorted(each.result.seed for each in kept.values()) == [0, 1, 2, 3]


def test_the_table_has_a_row_per_method_and_kept_results_are_reused(
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
    words += ["--methods", "lda-max", "--minutes", -1]
    assert "1 of 1 trainings are left; the same" in call(capsys, *words)[1]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--methods", "magic"], "--methods names magic; allowed are eskin, "),
        (["--seeds", "0"], "seeds is 0; allowed is from 1"),
        (["--train", "x", "y", "z"], "--train names 3 and --test 2; allowed are as"),
        (["--test", "a/x", "b/x"], "--test names folders x, x; allowed is each name"),
        (["--results", "tests"], "is a folder; give the path of a file"),
        (["--pack", "pyproject.toml"], "pyproject.toml is no folder that can be"),
        ([], "--test a has 1 recording of --train, such as "),
    ],
)
def test_compare_refuses_bad_arguments(folder, tmp_path, capsys, words, message):
    command = ["compare", "--train", folder / "a", "--test", folder / "b", folder / "a"]
    command += ["--results", tmp_path / "r", "--pack", tmp_path / "p", *words]
    code, _, err = call(capsys, *command)
    assert code == 2 and err.count("\n") == 1 and message in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "no set of clips is named; allowed is one or more"),
        (["a", "--picture", "study.gif"], "allowed are .png, .svg, .pdf; change its"),
        (["a", "--results", "tests"], "is a folder; give the path of a file"),
    ],
)
def test_study_refuses_bad_arguments(folder, capsys, words, message):
    words = [folder / word if word == "a" else word for word in words]
    code, _, err = call(capsys, "study", *words)
    assert code == 2 and err.count("\n") == 1 and message in err


def test_study_has_a_row_per_variant_and_a_picture(
    folder, tmp_path, capsys, monkeypatch
):
    def build(variant, epochs):
        neighbours = NearestNeighbours(k=variant.k - 3)
        make = partial(FlatBaseline, estimator=neighbours, features="maxima")
        return BaselineMethod(make)

    monkeypatch.setattr(Variant, "build_method", build)
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


def test_a_variant_is_compared_with_the_first_of_its_network_on_common_runs():
    def result(right):
        truth, people = ("poke", "grab") * 2, ("p1", "p1", "p2", "p2")
        answer = truth if right else ("poke",) * 4
        return MethodResult("", 0, 1.0, {"test": AnsweredClips(truth, answer, people)})

    ours = [Variant("eskin", k, "max") for k in (4, 8, 16)]
    found = {
        ours[0]: {(0, 0): result(True), (1, 0): result(True)},
        ours[1]: {(0, 0): result(False), (1, 0): result(True), (2, 0): result(False)},
        ours[2]: {(2, 0): result(True)},
        Variant("paper", 8, "max"): {(0, 0): result(False)},
    }
    first, second, other = build_study_rows(found)
    assert (first.k, second.k, other.network) == (4, 8, "paper")
    assert (first.runs, second.runs, other.runs) == (2, 2, 1)
    assert (first.test_ahead, other.test_ahead, second.val_ahead) == (None, None, None)
    assert second.test_accuracy == 0.75 and second.test_ahead.mean == 0.25


def test_an_accuracy_of_zero_is_drawn_and_a_missing_one_is_not():
    axes = Figure().subplots()
    plot_shares(axes, [4, 8, 16], [(0.0, 0.0), (None, 0.0), (0.5, 0.1)], "k", "a")
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), [0.0, np.nan, 50.0])
