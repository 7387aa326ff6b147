"""Laws of the paper's experiments: the trials, and how answers are summed up."""

import pytest

from lab.comparison.results import AnsweredClips, MethodResult
from lab.paper.pictures import draw_neighbours
from lab.paper.printed import ACCURACIES, TIMES_MS
from lab.paper.trials import (
    DISTANCES,
    NEIGHBOURS,
    POOLINGS,
    TRIED,
    Trial,
    compute_accuracy,
    format_lead,
    name_cell,
    name_distance,
)

pytestmark = pytest.mark.slow


def result(method, draw, right, people=3, clips=30):
    """Answers of which the first `right` are right, the clips dealt to the people."""
    truth = ("poke",) * clips
    answer = ("poke",) * right + ("grab",) * (clips - right)
    names = tuple(f"p{clip % people}" for clip in range(clips))
    answered = {"val": AnsweredClips(truth, truth, names)}
    answered["test"] = AnsweredClips(truth, answer, names)
    return MethodResult(method, draw, 1.0, answered)


def answers(**rights):
    """Answers of methods to one draw after the other, by how many are right."""
    return {
        Trial("paper", method, draw): result(method, draw, right)
        for method, some in rights.items()
        for draw, right in enumerate(some)
    }


def test_every_cell_of_fig_11_and_every_distance_is_tried_once():
    cells = {name_cell(k, pooling) for k in NEIGHBOURS for pooling in POOLINGS}
    distances = {name_distance(distance) for distance in DISTANCES}
    assert len(cells) == 8 and len(distances) == 4
    assert cells & distances == {"paper"}
    assert cells | distances <= set(TRIED)


def test_the_settings_of_every_trial_differ():
    """Answers are kept by what a method prints of itself."""
    names = [name for name in TRIED if name.startswith("paper")]
    assert len({repr(TRIED[name]) for name in names}) == len(names)


def test_every_printed_figure_is_of_a_method_that_is_tried():
    assert set(ACCURACIES) == set(TIMES_MS) <= set(TRIED)


def test_an_accuracy_is_over_the_clips_of_all_draws():
    found = compute_accuracy(answers(one=(30, 15)), "paper", "one", "test")
    assert found is not None
    assert (found.mean, found.draws) == (0.75, 2)
    assert found.low < 0.75 < found.high
    assert str(found).startswith("75.0 (")


def test_an_interval_is_over_people_where_they_are_many():
    """Of one person the answers are alike here, so that fewer people are less sure."""
    few = {Trial("paper", "one", 0): result("one", 0, 15, people=2)}
    many = {Trial("paper", "one", 0): result("one", 0, 15, people=30)}
    whole = {
        Trial("paper", "one", 0): MethodResult(
            "one",
            0,
            1.0,
            {
                "test": AnsweredClips(
                    ("poke",) * 30,
                    ("poke",) * 15 + ("grab",) * 15,
                    tuple(f"p{clip // 5}" for clip in range(30)),
                )
            },
        )
    }
    widths = []
    for some in (few, many, whole):
        found = compute_accuracy(some, "paper", "one", "test")
        assert found is not None
        widths.append(found.high - found.low)
    assert widths[0] == pytest.approx(widths[1], abs=0.1)
    assert widths[2] > 1.5 * widths[1]


def test_a_lead_is_paired_over_the_draws_that_both_have():
    some = answers(one=(30, 30, 0), two=(15, 15))
    assert format_lead(some, "paper", "one", "two").startswith("+50.0 (")
    assert format_lead(some, "paper", "one", "three") == ""


def test_what_has_not_been_run_has_no_accuracy():
    assert compute_accuracy(answers(one=(30,)), "paper", "two", "test") is None
    assert compute_accuracy(answers(one=(30,)), "paper-places", "one", "test") is None


def test_fig_11_is_drawn_of_the_cells_that_there_are(tmp_path):
    some = answers(paper=(20, 25))
    draw_neighbours(some, NEIGHBOURS, tmp_path / "fig11.png")
    assert (tmp_path / "fig11.png").stat().st_size > 10_000
