"""`lab.results`: the training of each table."""

from lab.comparison import MethodResult
from lab.comparison.results import KeptResult, keep_result
from lab.results import describe_trainings


def test_seconds_of_kept_trainings_are_added(tmp_path):
    for n, seconds in enumerate((1800.0, 5400.0)):
        result = MethodResult("a", n, seconds, {})
        keep_result(tmp_path / "a.jsonl", KeptResult(f"a{n}", "0", result))
    assert (
        describe_trainings(tmp_path)
        == "2 trainings kept, of 2.0 hours on one core together"
    )
