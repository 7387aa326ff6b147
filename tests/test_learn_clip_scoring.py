"""A clip is answered by its touch of largest impulse, at that touch's last reading."""

import numpy as np
import pytest

from eskin.learn.dataset import prepare
from eskin.learn.evaluation import (
    compute_log_probabilities,
    find_last_rows,
    predict_clips,
)
from helpers.clips import clip_at, generated, loaded
from helpers.live import network

VOCABULARY = ("poke", "none", "stroke")


def net():
    return network(vocabulary=VOCABULARY, width=4, layers=1, channels=8)


def ends(dataset):
    every = [(n, clip) for n, clips in enumerate(dataset.clips) for clip in clips]
    return list(find_last_rows(dataset, every))


def test_the_touch_of_largest_impulse_speaks_and_not_the_strongest():
    times = [0.1, 0.15, 0.2, 0.25, 0.3, 0.5, 0.55]
    sequence = [0, 0, 0, 0, 0, 1, 1]
    long, hard = [2.0] * 5 + [4.0] * 2, [2.0] * 5 + [6.0] * 2
    clips = ((clip_at(0.0),),)
    assert ends(loaded(times, sequence, long, clips)) == [4]
    assert ends(loaded(times, sequence, hard, clips)) == [6]


@pytest.mark.parametrize("offset", [0, 4])
def test_the_impulse_of_a_touch_is_its_own(offset):
    """Whatever came before it, and wherever it stands."""
    times = 5.0 * np.arange(3).repeat(offset or 1)
    early = len(times)
    times = np.append(times, [20.0, 20.1, 20.2, 20.3])
    sequence = np.append(np.zeros(early, int), [1, 1, 2, 2])
    forces = np.append(np.full(early, 50.0), [3.0, 3.0, 2.0, 2.0])
    found = loaded(times, sequence, forces, ((clip_at(20.0), clip_at(30.0)),))
    assert ends(found) == [early + 1, -1]


def test_a_touch_is_of_the_clip_in_which_it_began():
    times, sequence = [0.0, 0.1, 2.0, 2.1, 3.9, 4.1], [0, 0, 1, 1, 2, 2]
    clips = ((clip_at(0.0), clip_at(2.0), clip_at(4.0)),)
    forces = [1.0, 1.0, 1.0, 1.0, 2.0, 2.0]
    assert ends(loaded(times, sequence, forces, clips)) == [1, 5, -1]


def test_a_touch_is_of_its_own_recording():
    times, recording = [0.0, 0.1, 0.0, 0.1], [0, 0, 1, 1]
    clips = ((clip_at(0.0),), (clip_at(0.0),), (clip_at(0.0),))
    found = loaded(times, [0, 0, 1, 1], [9.0, 9.0, 1.0, 1.0], clips, recording)
    assert ends(found) == [1, 3, -1]


def test_only_the_recordings_asked_for_are_answered():
    times, recording = [0.0, 0.1, 0.0, 0.1], [0, 0, 1, 1]
    clips = ((clip_at(0.0, "stroke"),), (clip_at(0.0), clip_at(2.0)))
    dataset = loaded(times, [0, 0, 1, 1], [9.0, 9.0, 1.0, 1.0], clips, recording)
    every = predict_clips(net(), dataset, VOCABULARY)
    some = predict_clips(net(), dataset, VOCABULARY, recordings={1})
    assert every.recording.tolist() == [0, 1, 1]
    assert some.recording.tolist() == [1, 1]
    np.testing.assert_allclose(
        some.log_probabilities, every.log_probabilities[1:], atol=1e-6
    )


def test_clips_of_gestures_that_the_model_does_not_know_are_passed_over():
    clips = ((clip_at(0.0, "wave"), clip_at(2.0), clip_at(4.0, "wave")),)
    dataset = loaded([0.1, 2.1, 2.2], [0, 1, 1], [1.0, 1.0, 1.0], clips)
    found = predict_clips(net(), dataset, VOCABULARY)
    assert [clip.gesture for clip in found.clips] == ["poke"]
    assert found.recording.tolist() == [0] and found.truth.tolist() == [0]
    assert len(found.log_probabilities) == 1


def test_a_clip_without_touch_is_certainly_none():
    clips = ((clip_at(0.0, "stroke"), clip_at(2.0)),)
    dataset = loaded([2.1, 2.15], [0, 0], [1.0, 2.0], clips)
    found = predict_clips(net(), dataset, VOCABULARY)
    assert found.truth.tolist() == [2, 0]
    assert found.predicted[0] == 1
    np.testing.assert_array_equal(np.exp(found.log_probabilities[0]), [0, 1, 0])
    assert 0 < np.exp(found.log_probabilities[1]).min() < 1


def test_a_set_without_any_touch_is_answered_none():
    dataset = loaded([], np.zeros(0, int), [], ((clip_at(0.0), clip_at(2.0)), ()))
    found = predict_clips(net(), dataset, VOCABULARY)
    assert found.predicted.tolist() == [1, 1]
    assert found.recording.tolist() == [0, 0]


def test_the_answer_is_what_is_said_at_the_last_reading_of_the_touch(tmp_path):
    dataset = prepare(generated(tmp_path))
    made = [clip for clips in dataset.clips for clip in clips]
    known = ("none", *sorted({clip.gesture for clip in made} - {"none"}))
    model = network(vocabulary=known, width=4, layers=1, channels=8)
    found = predict_clips(model, dataset, known, temperature=1.7)
    assert found.clips == tuple(made)
    assert [known[n] for n in found.truth] == [clip.gesture for clip in made]
    rows = np.array(ends(dataset))
    assert (rows >= 0).all()
    assert (np.diff(dataset.sequence[rows]) > 0).all()
    following = np.append(dataset.sequence, -1)[rows + 1]
    assert (following != dataset.sequence[rows]).all()
    expected = compute_log_probabilities(
        model, dataset, rows, dataset.starts[rows], 1.7
    )
    np.testing.assert_allclose(found.log_probabilities, expected, atol=1e-6)
