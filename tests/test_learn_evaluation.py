"""A recogniser's scores on recordings."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import log_softmax

from eskin.errors import RecordingError, SkinMismatchError
from eskin.learn import evaluation
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import (
    check_fits,
    compute_confidence,
    compute_log_probabilities,
    evaluate,
    find_window_ends,
    predict_clips,
    score_instants,
    score_segments,
)
from eskin.learn.ground_truth import MissedGesture, Segment
from eskin.learn.plots import draw_confusion
from eskin.learn.windows import build_network_input, cut_windows
from eskin.model import ModelCard
from helpers.clips import generated
from helpers.learning import NETWORK, START, bare, record_people
from helpers.live import network

VOCABULARY = ("none", "hold", "tap")
CARD = ModelCard(VOCABULARY, network=NETWORK, temperature=1.7)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return prepare(record_people(tmp_path_factory.mktemp("people"), ("ann", "bob")))


@pytest.fixture(scope="module")
def net():
    return network(vocabulary=VOCABULARY, width=4, layers=1, channels=8)


@pytest.fixture(scope="module")
def result(net, dataset):
    return evaluate(net, CARD, dataset)


def test_embedding_each_reading_once_gives_what_whole_windows_give(
    net, dataset, monkeypatch
):
    monkeypatch.setattr(evaluation, "WINDOW_BATCH", 3)
    monkeypatch.setattr(evaluation, "READING_BATCH", 7)
    ends = np.array([3, 60, 61, 100, 140, 200, 260])
    firsts = dataset.starts[ends]
    found = compute_log_probabilities(net, dataset, ends, firsts, 1.7)
    windows = cut_windows(dataset, ends, firsts, 100)
    with torch.no_grad():
        logits = net(
            build_network_input(dataset.graphs.select(windows.rows), windows, False)
        )
    expected = log_softmax(logits / 1.7, dim=1).numpy()
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_an_instants_answer_does_not_depend_on_what_comes_after(net, dataset):
    both = score_instants(net, dataset, np.array([60, 130]))
    alone = score_instants(net, dataset, np.array([60]))
    np.testing.assert_allclose(both[:1], alone, atol=1e-5)


def test_windows_of_a_segment_end_every_half_second_and_with_its_end():
    stamps = START + np.arange(100) * 50_000_000
    dataset = bare(stamps, np.zeros(100, np.int64))

    def ends(first, end):
        return find_window_ends(dataset, Segment("hold", 0, first, end, True)).tolist()

    assert ends(0, 100) == [40, 50, 60, 70, 80, 90, 99]
    assert ends(10, 61) == [50, 60]
    assert ends(10, 40) == [39]
    assert ends(10, 11) == [10]


def test_a_segment_is_scored_by_itself(net, dataset):
    segments = dataset.labelled
    together = score_segments(net, dataset, segments)
    for index, segment in enumerate(segments):
        alone = score_segments(net, dataset, [segment])
        np.testing.assert_allclose(together[index], alone[0], atol=1e-5)
    last = segments[-1]
    rows = slice(last.first, last.end)
    only = replace(
        dataset,
        graphs=dataset.graphs.select(np.arange(last.first, last.end)),
        stamps=dataset.stamps[rows],
        sequence=np.zeros(last.end - last.first, np.int64),
        recording=dataset.recording[rows],
        gestures=dataset.gestures[rows],
    )
    moved = replace(last, first=0, end=last.end - last.first)
    np.testing.assert_allclose(
        score_segments(net, only, [moved])[0], together[-1], atol=1e-5
    )


def test_the_counts_are_those_of_the_recordings(result, dataset):
    assert result.segments.confusion.sum() == len(dataset.labelled) == 4
    assert result.instants.confusion.sum() == len(dataset.stamps)
    assert [row["count"] for row in result.segments.per_class.values()] == [0, 2, 2]
    assert 0 <= result.ece <= 1
    assert set(result.per_subject) == {"ann", "bob"}
    mean = np.mean(list(result.per_subject.values()))
    assert mean == pytest.approx(result.segments.accuracy)


def test_none_is_answered_only_where_a_label_says_it(net, result, dataset):
    assert result.segments.confusion[:, 0].sum() == 0
    silence = [s for s in dataset.segments if s.gesture == "none"]
    spoken = replace(
        dataset,
        segments=tuple(
            replace(s, labelled=True) if s in silence else s for s in dataset.segments
        ),
    )
    counts = evaluate(net, CARD, spoken).segments.confusion.sum(axis=1)
    assert counts.tolist() == [len(silence), 2, 2]


def test_a_gesture_that_was_missed_counts_as_none_for_its_person(net, result, dataset):
    missed = (MissedGesture("tap", 1), MissedGesture("tap", 1))
    found = evaluate(net, CARD, replace(dataset, missed=missed))
    change = found.segments.confusion - result.segments.confusion
    assert change.tolist() == [[0, 0, 0], [0, 0, 0], [2, 0, 0]]
    # `none` was certain.
    assert found.ece == pytest.approx((4 * result.ece + 2) / 6)
    assert found.per_subject["ann"] == result.per_subject["ann"]
    assert found.per_subject["bob"] == pytest.approx(result.per_subject["bob"] / 2)
    silent = tuple(s for s in dataset.segments if not s.labelled)
    only = evaluate(net, CARD, replace(dataset, segments=silent, missed=missed))
    assert (only.segments.accuracy, only.ece) == (0.0, 1.0)
    unknown = replace(dataset, missed=(MissedGesture("soft", 0),))
    with pytest.raises(SkinMismatchError, match="hold soft, which the model does not"):
        check_fits(CARD, unknown)


def test_of_a_generated_set_whole_clips_are_scored(tmp_path):
    dataset = prepare(generated(tmp_path))
    [clips] = dataset.clips
    vocabulary = ("none", *sorted({clip.gesture for clip in clips} - {"none"}))
    card = ModelCard(vocabulary, network=NETWORK, temperature=1.7)
    net = network(vocabulary=vocabulary, width=4, layers=1, channels=8)
    found = evaluate(net, card, dataset)
    answers = predict_clips(net, dataset, vocabulary, 1.7)
    right = answers.predicted == answers.truth
    assert found.segments.confusion.sum() == len(clips)
    assert found.instants is None
    assert found.segments.accuracy == pytest.approx(right.mean())
    low, high = found.interval
    assert low <= found.segments.accuracy <= high
    # Also where nothing was felt of a gesture that the model does not know.
    soft = replace(clips[0], gesture="soft", start=0, end=1)
    unknown = replace(dataset, clips=((*clips, soft),))
    with pytest.raises(SkinMismatchError, match="hold soft, which the model does not"):
        evaluate(net, card, unknown)


def test_without_people_scores_are_by_session(net, dataset):
    recordings = tuple(
        replace(r, metadata=replace(r.metadata, subject="")) for r in dataset.recordings
    )
    nameless = evaluate(net, CARD, replace(dataset, recordings=recordings))
    assert set(nameless.per_subject) == {"day-0", "day-1"}


def test_confidence_is_the_share_of_the_winner():
    probabilities = np.array([[0.2, 0.7, 0.1], [0.5, 0.25, 0.25]])
    np.testing.assert_allclose(compute_confidence(np.log(probabilities)), [0.7, 0.5])
    with np.errstate(divide="ignore"):
        without_none = np.log([[0.0, 0.3, 0.1]])
    np.testing.assert_allclose(compute_confidence(without_none), [0.75])


def test_recordings_that_do_not_fit_the_model_are_refused(dataset):
    other = replace(CARD, vocabulary=("none", "hold", "grab"))
    with pytest.raises(SkinMismatchError, match="hold tap, which the model does not"):
        check_fits(other, dataset)
    with pytest.raises(SkinMismatchError, match="needs shear.*--train.no-shear"):
        check_fits(replace(CARD, kind="shear"), dataset)
    silent = tuple(s for s in dataset.segments if not s.labelled)
    with pytest.raises(RecordingError, match="no labels; scoring needs them"):
        check_fits(CARD, replace(dataset, segments=silent))


def test_confusions_are_drawn_whole_or_not_at_all(tmp_path):
    picture = tmp_path / "made" / "a.png"
    confusion = np.array([[3, 1], [0, 2]])
    draw_confusion(confusion, ("none", "hold"), picture, "title")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert list(picture.parent.iterdir()) == [picture]
    with pytest.raises(ValueError, match="foo"):
        draw_confusion(confusion, ("none", "hold"), tmp_path / "b" / "a.foo", "title")
    assert not list(tmp_path.rglob("*.foo"))
