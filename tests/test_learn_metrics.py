"""Scores are those of the books."""

import numpy as np
import pytest
from benchmarks.simulation.ceiling import wilson_interval
from sklearn.metrics import (
    accuracy_score,
    confusion_matrix,
    f1_score,
    precision_recall_fscore_support,
)

from eskin.learn.metrics import (
    bootstrap_accuracy,
    bootstrap_difference,
    compute_group_accuracies,
    compute_reliability,
    score_predictions,
)
from eskin.learn.plots import draw_confusion, draw_reliability

NAMES = ("none", "hold", "tap")


def test_a_score_counted_by_hand():
    truth = np.array([1, 1, 1, 2, 2])
    said = np.array([1, 1, 2, 2, 0])
    result = score_predictions(truth, said, NAMES)
    assert result.accuracy == pytest.approx(3 / 5)
    assert result.confusion.tolist() == [[0, 0, 0], [0, 2, 1], [1, 0, 1]]
    assert result.per_class["hold"] == {
        "precision": 1.0,
        "recall": 0.6667,
        "f1": 0.8,
        "count": 3.0,
    }
    assert result.per_class["none"]["f1"] == 0.0
    # `none` is never the truth, so it has no part in the mean.
    assert result.macro_f1 == pytest.approx((0.8 + 0.5) / 2)


@pytest.mark.parametrize("seed", range(3))
def test_scores_are_those_of_sklearn(seed):
    rng = np.random.default_rng(seed)
    truth, said = rng.integers(3, size=(2, 50))
    result = score_predictions(truth, said, NAMES)
    assert result.accuracy == pytest.approx(accuracy_score(truth, said))
    assert result.macro_f1 == pytest.approx(f1_score(truth, said, average="macro"))
    np.testing.assert_array_equal(result.confusion, confusion_matrix(truth, said))
    columns = precision_recall_fscore_support(truth, said)
    for index, name in enumerate(NAMES):
        expected = [float(column[index]) for column in columns]
        assert list(result.per_class[name].values()) == pytest.approx(
            expected, abs=6e-5
        )


def test_each_group_has_its_own_accuracy():
    right = np.array([True, False, True, True])
    assert compute_group_accuracies(right, ["b", "b", "a", "a"]) == {"a": 1.0, "b": 0.5}


def test_confidence_that_is_kept_has_no_calibration_error():
    confidence = np.repeat([0.5, 0.75, 1.0], 4)
    right = np.array([1, 1, 0, 0, 1, 1, 1, 0, 1, 1, 1, 1], bool)
    assert compute_reliability(confidence, right).error == pytest.approx(0)


def test_calibration_error_is_the_mean_gap_between_confidence_and_truth():
    assert compute_reliability(
        np.full(10, 0.9), np.zeros(10, bool)
    ).error == pytest.approx(0.9)
    # Gaps of 0.5 and 0.25 in two bins of four and two examples.
    confidence = np.array([1.0, 1.0, 1.0, 1.0, 0.25, 0.25])
    right = np.array([1, 1, 0, 0, 0, 0], bool)
    expected = (4 * 0.5 + 2 * 0.25) / 6
    assert compute_reliability(confidence, right).error == pytest.approx(expected)
    # Too much in one bin does not make up for too little in another.
    confidence, right = np.array([0.75, 0.25]), np.array([False, True])
    assert compute_reliability(confidence, right).error == pytest.approx(0.75)


def test_the_interval_holds_the_difference_and_turns_with_it():
    rng = np.random.default_rng(1)
    ours, theirs = rng.random(80) < 0.8, rng.random(80) < 0.5
    low, high = bootstrap_difference(ours, theirs)
    difference = ours.mean() - theirs.mean()
    assert low < difference < high
    spread = np.std(ours.astype(float) - theirs) / np.sqrt(80)
    assert high - low == pytest.approx(2 * 1.96 * spread, rel=0.1)
    back = bootstrap_difference(theirs, ours)
    assert back == pytest.approx((-high, -low), abs=0.02)


def test_equal_answers_have_an_interval_of_no_width():
    right = np.array([True, False, True])
    assert bootstrap_difference(right, right) == (0.0, 0.0)


def test_examples_that_come_in_copies_tell_no_more_than_one_of_them():
    rng = np.random.default_rng(1)
    ours, theirs = rng.random(80) < 0.8, rng.random(80) < 0.5
    once = bootstrap_difference(ours, theirs)
    copies = [np.repeat(right, 50) for right in (ours, theirs)]
    names = np.repeat(np.arange(80), 50).tolist()
    assert bootstrap_difference(*copies, cluster=names) == pytest.approx(once)
    narrow = np.ptp(bootstrap_difference(*copies))
    assert narrow < np.ptp(once) / 5


def test_whole_clusters_are_drawn_however_their_examples_are_ordered():
    rng = np.random.default_rng(2)
    ours, theirs = rng.random(90) < 0.7, rng.random(90) < 0.4
    cluster = rng.integers(12, size=90)
    order = rng.permutation(90)
    one = bootstrap_difference(ours, theirs, cluster=cluster.tolist())
    other = bootstrap_difference(
        ours[order], theirs[order], cluster=cluster[order].tolist()
    )
    assert one == pytest.approx(other)
    assert bootstrap_difference(ours, theirs, cluster=[7] * 90) == pytest.approx(
        (ours.mean() - theirs.mean(),) * 2
    )


def test_reliability_has_every_answer_in_the_bin_of_its_confidence():
    confidence = np.array([0.0, 0.05, 0.3, 0.31, 1.0])
    found = compute_reliability(confidence, np.array([0, 0, 1, 0, 1], bool))
    assert found.count.tolist() == [2, 0, 0, 0, 2, *[0] * 9, 1]
    assert found.confidence[[0, 1, 4, 14]] == pytest.approx([0.025, 0.0, 0.305, 1.0])
    assert found.accuracy[[0, 1, 4, 14]] == pytest.approx([0.0, 0.0, 0.5, 1.0])
    assert found.error == pytest.approx((2 * 0.025 + 2 * 0.195 + 0) / 5)


def test_nothing_answered_has_no_calibration_error():
    assert compute_reliability(np.empty(0), np.empty(0, bool)).error == 0.0


@pytest.mark.parametrize(("right", "count"), [(0, 20), (7, 20), (20, 20), (950, 1000)])
def test_the_ends_of_a_wilson_interval_are_shares_that_just_fit(right, count):
    low, high = wilson_interval(right, count)
    assert 0 <= low <= right / count <= high <= 1
    for end in {low, high} - {0.0, 1.0}:
        deviation = np.sqrt(end * (1 - end) / count)
        assert abs(right / count - end) / deviation == pytest.approx(1.96, abs=0.01)


def test_an_accuracy_is_as_uncertain_as_people_differ():
    people = [name for name in "abcdefghij" for _ in range(30)]
    rng = np.random.default_rng(3)
    alike = rng.random(300) < 0.7
    apart = np.array([name < "h" for name in people])
    assert alike.mean() == pytest.approx(apart.mean(), abs=0.05)
    narrow, wide = (bootstrap_accuracy(right, people) for right in (alike, apart))
    assert narrow[0] < alike.mean() < narrow[1]
    assert np.ptp(wide) > 3 * np.ptp(narrow)
    assert np.ptp(wide) == pytest.approx(2 * 1.96 * np.sqrt(0.21 / 10), rel=0.15)


def test_pictures_are_whole_files(tmp_path):
    draw_confusion(np.array([[3, 1], [0, 0]]), ("a", "b"), tmp_path / "c.png", "two")
    found = compute_reliability(np.array([0.2, 0.9]), np.array([False, True]))
    draw_reliability(found, tmp_path / "new" / "r.png", "2 answers")
    for path in (tmp_path / "c.png", tmp_path / "new" / "r.png"):
        assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ValueError, match="foo"):
        draw_reliability(found, tmp_path / "r.foo", "2 answers")
    assert len(list(tmp_path.rglob("*.*"))) == 2
