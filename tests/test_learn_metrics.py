"""Tests of scores against sklearn, closed forms and values counted by hand."""

import numpy as np
import pytest
from scipy.stats import binomtest, chi2
from sklearn.metrics import (
    accuracy_score,
    confusion_matrix,
    f1_score,
    precision_recall_fscore_support,
)

from eskin.learn.metrics import (
    bootstrap_accuracy,
    bootstrap_difference,
    bound_accuracy,
    bound_rate,
    bound_share,
    compute_reliability,
    score_predictions,
)
from eskin.learn.plots import draw_confusion, draw_reliability

NAMES = ("none", "hold", "tap")


def test_class_that_never_occurs_has_no_part_in_the_mean_f1():
    truth = np.array([1, 1, 1, 2, 2])
    predicted = np.array([1, 1, 2, 2, 0])
    result = score_predictions(truth, predicted, NAMES)
    assert result.per_class["none"]["f1"] == 0.0
    assert result.macro_f1 == pytest.approx((0.8 + 0.5) / 2)


@pytest.mark.parametrize("seed", range(3))
def test_scores_equal_those_of_sklearn(seed):
    truth, predicted = np.random.default_rng(seed).integers(3, size=(2, 50))
    result = score_predictions(truth, predicted, NAMES)
    assert result.accuracy == pytest.approx(accuracy_score(truth, predicted))
    assert result.macro_f1 == pytest.approx(f1_score(truth, predicted, average="macro"))
    np.testing.assert_array_equal(result.confusion, confusion_matrix(truth, predicted))
    columns = np.transpose(precision_recall_fscore_support(truth, predicted))
    for name, expected in zip(NAMES, columns, strict=True):
        found = list(result.per_class[name].values())
        assert found == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize(
    ("confidence", "correct", "error"),
    [
        ([0.5] * 4 + [0.75] * 4 + [1.0] * 4, [1, 1, 0, 0, 1, 1, 1, 0, 1, 1, 1, 1], 0),
        ([0.9] * 10, [0] * 10, 0.9),
        ([1.0] * 4 + [0.25] * 2, [1, 1, 0, 0, 0, 0], (4 * 0.5 + 2 * 0.25) / 6),
        # Overconfidence in one bin does not make up for the opposite in another.
        ([0.75, 0.25], [0, 1], 0.75),
        ([], [], 0),
    ],
)
def test_calibration_error_is_the_mean_gap_between_confidence_and_accuracy(
    confidence, correct, error
):
    found = compute_reliability(np.array(confidence), np.array(correct, bool))
    assert found.error == pytest.approx(error)


def test_answers_are_counted_in_the_bin_of_their_confidence():
    confidence = np.array([0.0, 0.05, 0.3, 0.31, 1.0])
    found = compute_reliability(confidence, np.array([0, 0, 1, 0, 1], bool))
    assert found.count.tolist() == [2, 0, 0, 0, 2, *[0] * 9, 1]
    assert found.confidence[[0, 1, 4, 14]] == pytest.approx([0.025, 0.0, 0.305, 1.0])
    assert found.accuracy[[0, 1, 4, 14]] == pytest.approx([0.0, 0.0, 0.5, 1.0])


@pytest.fixture
def answers():
    """Return which answers of two methods to the same examples are correct."""
    rng = np.random.default_rng(1)
    return rng.random(80) < 0.8, rng.random(80) < 0.5


def test_interval_of_a_difference_is_as_wide_as_its_standard_error(answers):
    ours, theirs = answers
    low, high = bootstrap_difference(ours, theirs)
    assert low < ours.mean() - theirs.mean() < high
    spread = np.std(ours.astype(float) - theirs) / np.sqrt(80)
    assert high - low == pytest.approx(2 * 1.96 * spread, rel=0.1)
    back = bootstrap_difference(theirs, ours)
    assert back == pytest.approx((-high, -low), abs=0.02)
    assert bootstrap_difference(ours, ours) == (0.0, 0.0)


def test_copies_of_examples_in_one_cluster_do_not_narrow_the_interval(answers):
    once = bootstrap_difference(*answers)
    copies = [np.repeat(correct, 9) for correct in answers]
    names = np.repeat(np.arange(80), 9).tolist()
    assert bootstrap_difference(*copies, cluster=names) == pytest.approx(once)
    assert np.ptp(bootstrap_difference(*copies)) < np.ptp(once) / 2


def test_interval_depends_on_clusters_but_not_on_the_order_of_examples(answers):
    rng = np.random.default_rng(2)
    cluster = rng.integers(12, size=80)
    order = rng.permutation(80)
    one = bootstrap_difference(*answers, cluster=cluster.tolist())
    shuffled = [correct[order] for correct in answers]
    assert one == pytest.approx(
        bootstrap_difference(*shuffled, cluster=cluster[order].tolist())
    )
    difference = answers[0].mean() - answers[1].mean()
    single = bootstrap_difference(*answers, cluster=[7] * 80)
    assert single == pytest.approx((difference, difference))


def test_accuracy_is_as_uncertain_as_people_differ():
    people = [name for name in "abcdefghij" for _ in range(30)]
    alike = np.random.default_rng(3).random(300) < 0.7
    apart = np.array([name < "h" for name in people])
    narrow, wide = (bootstrap_accuracy(correct, people) for correct in (alike, apart))
    assert narrow[0] < alike.mean() < narrow[1]
    assert np.ptp(wide) > 3 * np.ptp(narrow)
    assert np.ptp(wide) == pytest.approx(2 * 1.96 * np.sqrt(0.21 / 10), rel=0.15)


@pytest.mark.parametrize("people", [2, 3, 8, 30])
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_interval_of_people_who_score_alike_is_that_of_their_examples_or_wider(
    people, share
):
    correct = np.tile(np.arange(10) < 10 * share, people)
    names = np.repeat([f"p{n}" for n in range(people)], 10).tolist()
    low, high = bound_accuracy(correct, names)
    least = bound_share(int(correct.sum()), len(correct))
    assert low <= least[0] and high >= least[1]


def test_interval_of_few_people_holds_the_accuracy_of_all():
    """It does in 95 % of draws of five people whose accuracies differ."""
    rng = np.random.default_rng(0)
    names = np.repeat(list("abcde"), 40).tolist()
    held = []
    for _ in range(400):
        accuracies = rng.beta(8.0, 2.0, 5)
        low, high = bound_accuracy(rng.random(200) < accuracies.repeat(40), names)
        held.append(low <= 0.8 <= high)
    assert np.mean(held) > 0.92


def test_one_person_does_not_show_how_others_differ():
    assert np.isnan(bound_accuracy(np.ones(9, bool), ["ann"] * 9)).all()


def test_many_people_are_drawn_anew():
    correct = np.random.default_rng(5).random(300) < 0.7
    people = [f"p{n % 30}" for n in range(300)]
    assert bound_accuracy(correct, people) == bootstrap_accuracy(correct, people)


def test_plots_are_written_whole_or_not_at_all(tmp_path):
    found = compute_reliability(np.array([0.2, 0.9]), np.array([False, True]))
    plots = {
        draw_confusion: (np.array([[3, 1], [0, 0]]), ("none", "hold")),
        draw_reliability: (found,),
    }
    for number, (draw, values) in enumerate(plots.items()):
        picture = tmp_path / str(number) / "a.png"
        draw(*values, picture, "title")
        assert picture.read_bytes().startswith(b"\x89PNG")
        with pytest.raises(ValueError, match="foo"):
            draw(*values, picture.with_suffix(".foo"), "title")
        assert list(picture.parent.iterdir()) == [picture]


@pytest.mark.parametrize(("count", "whole"), [(0, 7), (3, 7), (7, 7), (40, 200)])
def test_intervals_of_shares_and_rates_equal_those_of_scipy(count, whole):
    expected = binomtest(count, whole).proportion_ci(method="wilson")
    assert bound_share(count, whole) == pytest.approx((expected.low, expected.high))
    low = chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    high = chi2.ppf(0.975, 2 * count + 2) / 2
    assert bound_rate(count, 4.0) == pytest.approx((low / 4, high / 4))


def test_nothing_counted_has_no_interval():
    assert np.isnan([*bound_share(0, 0), *bound_rate(0, 0.0)]).all()
