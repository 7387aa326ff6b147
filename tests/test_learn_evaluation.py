"""Tests of scoring a recogniser on windows, segments and clips."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import log_softmax

from eskin.errors import RecordingError, SkinMismatchError
from eskin.learn import evaluation
from eskin.learn.batches import build_network_input, cut_windows
from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import (
    compute_log_probabilities,
    find_last_rows,
    predict_clips,
    score_dataset,
    score_instants,
    score_segments,
)
from eskin.learn.ground_truth import MissedGesture
from eskin.learn.live_answers import gather_answers
from eskin.live import ModelCard
from helpers.clips import clip_at, generated, loaded
from helpers.learning import NETWORK, record_people
from helpers.live import model_of, network, with_closing_layer

VOCABULARY = ("none", "hold", "tap")
CARD = ModelCard(VOCABULARY, network=NETWORK, temperature=1.7)
WORDS = ("poke", "none", "stroke")
"""Vocabulary of made-up clips."""


def make_network(vocabulary=VOCABULARY):
    return network(vocabulary=vocabulary, width=4, layers=1, channels=8)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return prepare(record_people(tmp_path_factory.mktemp("people"), ("ann", "bob")))


@pytest.fixture(scope="module")
def net():
    return make_network()


@pytest.fixture(scope="module")
def result(net, dataset):
    return score_dataset(net, CARD, dataset)


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    """Return a generated set of clips, the card of a model for it, and its network."""
    dataset = prepare(generated(tmp_path_factory.mktemp("clips"), clips=4))
    gestures = {clip.gesture for clips in dataset.clips for clip in clips}
    card = replace(CARD, vocabulary=("none", *sorted(gestures - {"none"})))
    return dataset, card, make_network(card.vocabulary)


def test_readings_embedded_once_give_the_scores_of_whole_windows(
    net, dataset, monkeypatch
):
    monkeypatch.setattr(evaluation, "WINDOW_BATCH", 3)
    monkeypatch.setattr(evaluation, "READING_BATCH", 7)
    ends = np.array([3, 60, 61, 100, 140, 200, 260])
    firsts = dataset.starts[ends]
    found = compute_log_probabilities(net, dataset, ends, firsts, 1.7)
    windows = cut_windows(dataset, ends, firsts, 100)
    graphs = dataset.graphs.select(windows.rows)
    with torch.no_grad():
        logits = net(build_network_input(graphs, windows, False))
    expected = log_softmax(logits / 1.7, dim=1).numpy()
    np.testing.assert_allclose(found, expected, atol=1e-5)


@pytest.mark.parametrize("kind", ["people", "clips"])  # the first is not calibrated
def test_answers_of_a_replay_are_those_of_the_network_offline(
    kind, net, dataset, clips
):
    data, card, network = (dataset, CARD, net) if kind == "people" else clips
    answers = gather_answers(model_of(network, card.vocabulary), data)
    ends = np.arange(len(data.stamps))
    live = compute_log_probabilities(answers, data, ends, data.starts, 1.7)
    offline = compute_log_probabilities(network, data, ends, data.starts, 1.7)
    assert offline.std(axis=0).max() > 0.1
    np.testing.assert_allclose(live, offline, atol=1e-4)
    assert data.sequence.max() >= 1


def test_score_of_a_segment_depends_on_its_rows_alone(net, dataset):
    segments = dataset.labelled
    together = score_segments(net, dataset, segments)
    for index, one in enumerate(segments):
        rows = np.arange(one.first, one.end)
        only = replace(
            dataset,
            graphs=dataset.graphs.select(rows),
            stamps=dataset.stamps[rows],
            sequence=np.zeros(len(rows), np.int64),
            recording=dataset.recording[rows],
            gestures=dataset.gestures[one.first : one.end],
        )
        moved = replace(one, first=0, end=len(rows))
        alone = score_segments(net, only, [moved])
        np.testing.assert_allclose(together[index], alone[0], atol=1e-5)


def test_every_segment_and_instant_is_counted_once(result, dataset):
    assert result.segments.confusion.sum() == len(dataset.labelled) == 4
    assert result.instants.confusion.sum() == len(dataset.stamps)
    assert [row["count"] for row in result.segments.per_class.values()] == [0, 2, 2]
    assert 0 <= result.ece <= 1
    assert set(result.per_subject) == {"ann", "bob"}
    mean = np.mean(list(result.per_subject.values()))
    assert mean == pytest.approx(result.segments.accuracy)


def test_none_is_an_answer_only_where_it_is_labelled(net, result, dataset):
    """Scores are by session where people are unknown."""
    assert result.segments.confusion[:, 0].sum() == 0
    silence = [s for s in dataset.segments if s.gesture == "none"]
    changed = replace(
        dataset,
        segments=tuple(replace(s, labelled=True) for s in dataset.segments),
        recordings=tuple(
            replace(r, metadata=replace(r.metadata, subject=""))
            for r in dataset.recordings
        ),
    )
    labelled = score_dataset(net, CARD, changed)
    assert labelled.segments.confusion.sum(axis=1).tolist() == [len(silence), 2, 2]
    assert set(labelled.per_subject) == {"day-0", "day-1"}


def test_missed_gesture_counts_as_certain_none_for_its_person(net, result, dataset):
    missed = (MissedGesture("tap", 1), MissedGesture("tap", 1))
    found = score_dataset(net, CARD, replace(dataset, missed=missed))
    change = found.segments.confusion - result.segments.confusion
    assert change.tolist() == [[0, 0, 0], [0, 0, 0], [2, 0, 0]]
    assert found.ece == pytest.approx((4 * result.ece + 2) / 6)
    assert found.per_subject["ann"] == result.per_subject["ann"]
    assert found.per_subject["bob"] == pytest.approx(result.per_subject["bob"] / 2)
    silent = tuple(s for s in dataset.segments if not s.labelled)
    only = score_dataset(net, CARD, replace(dataset, segments=silent, missed=missed))
    assert (only.segments.accuracy, only.ece) == (0.0, 1.0)


def test_recordings_that_do_not_fit_the_model_are_refused(net, dataset, clips):
    silent = tuple(s for s in dataset.segments if not s.labelled)
    soft = replace(clips[0], clips=((clip_at(-9.0, "soft"),),))
    grab = replace(CARD, vocabulary=("none", "hold", "grab"))
    for card, data, parts in (
        (grab, dataset, "tap.*none, hold"),
        (CARD, replace(dataset, missed=(MissedGesture("soft", 0),)), "hold soft"),
        (clips[1], soft, "hold soft"),
        (replace(CARD, kind="shear"), dataset, "shear.*--train.no-shear"),
    ):
        with pytest.raises(SkinMismatchError, match=parts):
            score_dataset(net, card, data)
    with pytest.raises(RecordingError, match="no label of 2 recordings is of a"):
        score_dataset(net, CARD, replace(dataset, segments=silent))


def test_clip_is_answered_at_the_last_reading_of_its_touch(clips):
    dataset, card, net = clips
    [made] = dataset.clips
    found = predict_clips(net, dataset, card.vocabulary, 1.7)
    assert found.clips == made
    assert [card.vocabulary[n] for n in found.truth] == [c.gesture for c in made]
    rows = np.array(list(find_last_rows(dataset, [(0, clip) for clip in made])))
    assert (np.diff(dataset.sequence[rows]) > 0).all()
    following = np.append(dataset.sequence, -1)[rows + 1]
    assert (following != dataset.sequence[rows]).all()
    firsts = dataset.starts[rows]
    expected = compute_log_probabilities(net, dataset, rows, firsts, 1.7)
    np.testing.assert_allclose(found.log_probabilities, expected, atol=1e-6)
    scored = score_dataset(net, card, dataset)
    accuracy = np.mean(found.predicted == found.truth)
    assert scored.segments.confusion.sum() == len(made)
    assert scored.segments.accuracy == pytest.approx(accuracy)
    assert np.isnan(scored.interval).all(), "there is one person"
    assert scored.instants is None


def test_closing_layer_answers_for_segments_and_clips_but_not_for_instants(
    net, dataset, clips
):
    def answer(network, card, data):
        rows = np.arange(0, len(data.stamps), 7)
        return (
            score_segments(network, data, data.labelled),
            predict_clips(network, data, card.vocabulary).log_probabilities,
            score_instants(network, data, rows),
        )

    for data, card, plain in ((dataset, CARD, net), clips):
        model = model_of(plain, card.vocabulary)
        before = answer(plain, card, data)
        same = answer(to_network(with_closing_layer(model)), card, data)
        changed = answer(to_network(with_closing_layer(model, 0.5)), card, data)
        for each, other in zip(before, same, strict=True):
            np.testing.assert_array_equal(each, other)
        for each, other in zip(before[:2], changed[:2], strict=True):
            assert not len(each) or np.abs(each - other)[np.isfinite(each)].max() > 0.05
        np.testing.assert_array_equal(before[2], changed[2])


@pytest.mark.parametrize(
    ("times", "sequence", "forces", "begins", "expected"),
    [
        # The largest impulse counts, not the largest force.
        ([0, 0.05, 0.1, 0.4, 0.45], [0, 0, 0, 1, 1], [2, 2, 2, 2.5, 2.5], [0], [2]),
        ([0, 0.05, 0.1, 0.4, 0.45], [0, 0, 0, 1, 1], [2, 2, 2, 6, 6], [0], [4]),
        # Whatever came before.
        ([0, 0.1, 0.2, 0.3], [0, 0, 1, 1], [3, 3, 2, 2], [0, 10], [1, -1]),
        ([0, 5, 20, 20.1, 20.2], [0, 0, 1, 1, 2], [50, 50, 3, 3, 2], [20, 30], [3, -1]),
        # A touch belongs to the clip in which it began.
        (
            [0, 0.1, 2, 3.9, 4.1],
            [0, 0, 1, 2, 2],
            [1, 1, 1, 2, 2],
            [0, 2, 4],
            [1, 4, -1],
        ),
    ],
)
def test_touch_of_largest_impulse_answers_for_a_clip(
    times, sequence, forces, begins, expected
):
    made = tuple(clip_at(begin) for begin in begins)
    dataset = loaded(times, sequence, forces, (made,))
    assert list(find_last_rows(dataset, [(0, clip) for clip in made])) == expected


def test_touch_belongs_to_its_own_recording():
    clips = ((clip_at(0.0, "stroke"),), (clip_at(0.0), clip_at(2.0)))
    times = [0.0, 0.1, 0.0, 0.1]
    sequence = [0, 0, 1, 1]
    dataset = loaded(times, sequence, [9.0, 9.0, 1.0, 1.0], clips, [0, 0, 1, 1])
    every = [(n, clip) for n, made in enumerate(clips) for clip in made]
    assert list(find_last_rows(dataset, every)) == [1, 3, -1]
    found = predict_clips(make_network(WORDS), dataset, WORDS)
    some = predict_clips(make_network(WORDS), dataset, WORDS, recordings={1})
    assert (found.recording.tolist(), some.recording.tolist()) == ([0, 1, 1], [1, 1])
    np.testing.assert_allclose(
        some.log_probabilities, found.log_probabilities[1:], atol=1e-6
    )


def test_clip_of_an_unknown_gesture_is_skipped_and_one_without_touch_is_none():
    clips = ((clip_at(0.0, "wave"), clip_at(2.0), clip_at(4.0, "stroke")), ())
    dataset = loaded([0.1, 2.1, 2.2], [0, 1, 1], [1.0, 1.0, 1.0], clips)
    found = predict_clips(make_network(WORDS), dataset, WORDS)
    assert [clip.gesture for clip in found.clips] == ["poke", "stroke"]
    assert (found.recording.tolist(), found.truth.tolist()) == ([0, 0], [0, 2])
    assert 0 < np.exp(found.log_probabilities[0]).min() < 1
    np.testing.assert_array_equal(np.exp(found.log_probabilities[1]), [0, 1, 0])
    untouched = loaded([], np.zeros(0, int), [], clips)
    nothing = predict_clips(make_network(WORDS), untouched, WORDS)
    assert nothing.predicted.tolist() == [1, 1]
