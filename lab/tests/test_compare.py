"""`lab.compare`: tables, continuation, refusals."""

import json

import pytest

from helpers.clips import generated
from lab.compare import run_compare
from lab.comparison.results import read_results
from lab.program import run_program

pytestmark = pytest.mark.slow


def call(capsys, *words):
    """Run `lab.compare`; return its exit code, text and error."""
    code = run_program(run_compare, list(map(str, words)))
    return code, *capsys.readouterr()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two sets of six clips each."""
    place = tmp_path_factory.mktemp("sets")
    generated(place / "a")
    generated(place / "b", chosen="train")
    return place


def test_each_repetition_has_its_own_seed(folder, tmp_path, capsys):
    words = ["--train", folder / "a", folder / "b", "--seeds", 2]
    words += ["--test", folder / "b", folder / "a", "--methods", "knn-max"]
    words += ["--pack", tmp_path / "pack", "--results", tmp_path / "results"]
    assert call(capsys, *words)[0] == 0
    kept = read_results(tmp_path / "results")
    assert sorted(each.result.seed for each in kept.values()) == [0, 1, 2, 3]


def test_the_table_has_a_row_per_method_and_kept_results_are_reused(
    folder, tmp_path, capsys
):
    words = ["--train", folder / "a", "--test", folder / "b", "--json"]
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
        (["--pack", "pyproject.toml"], "pyproject.toml is no folder"),
        ([], "--test a has 1 recording of --train, such as "),
    ],
)
def test_compare_refuses_bad_arguments(folder, tmp_path, capsys, words, message):
    command = ["--train", folder / "a", "--test", folder / "b", folder / "a"]
    command += ["--results", tmp_path / "r", "--pack", tmp_path / "p", *words]
    code, _, err = call(capsys, *command)
    assert code == 2 and err.count("\n") == 1 and message in err
