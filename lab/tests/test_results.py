"""`lab.results`: the training of each table."""

import pytest

from eskin.sim.dataset import GenerationSettings
from helpers.clips import generated
from lab.comparison import METHODS, MethodResult
from lab.comparison.results import KeptResult, keep_result
from lab.results import OF_581, Command, build_task, describe_trainings


@pytest.mark.parametrize(("trained_on", "clips"), OF_581.items())
def test_a_point_of_the_learning_curve_trains_on_its_number_of_clips(trained_on, clips):
    sittings = GenerationSettings("paper", clips=clips, subjects=6).sessions
    train = [one.clips for one in sittings if one.file.startswith("train/")]
    assert sum(train) == trained_on and len(train) == 6


def test_learning_curves_hold_nothing_out(tmp_path):
    generated(tmp_path / "a", clips=1)
    places = (tmp_path / "a", tmp_path / "a")
    task = build_task(Command(sets=tmp_path), "a b", METHODS["eskin"], *places, 3)
    assert (task.name, task.seed, task.share) == ("a b", 3, 0.0)


def test_seconds_of_kept_trainings_are_added(tmp_path):
    for n, seconds in enumerate((1800.0, 5400.0)):
        result = MethodResult("a", n, seconds, {})
        keep_result(tmp_path / "a.jsonl", KeptResult(f"a{n}", "0", result))
    assert (
        describe_trainings(tmp_path)
        == "2 trainings kept, of 2.0 hours on one core together"
    )
