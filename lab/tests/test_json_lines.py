"""Tests of the results that long benchmarks keep."""

from dataclasses import dataclass

from lab.json_lines import append_results, read_results


@dataclass
class Result:
    row: str
    values: list[float]


def test_results_that_are_appended_are_read_again(tmp_path):
    path, results = tmp_path / "a.jsonl", [Result("a", [1.0]), Result("b", [])]
    assert read_results(path, Result) == []
    for result in results:
        append_results(path, [result])
    assert read_results(path, Result) == results


def test_nothing_is_kept_without_a_file():
    append_results(None, [Result("a", [])])
    assert read_results(None, Result) == []
