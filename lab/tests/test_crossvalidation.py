"""Who is answered for was never learned from."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from eskin.errors import RecordingError
from eskin.learn.dataset import prepare
from eskin.learn.training import Trainer
from eskin.recording import find_recordings
from helpers.learning import AS_RECORDED, TINY, record_people
from lab import real_recordings
from lab.baselines import FitConfig
from lab.baselines.estimators import RandomForest
from lab.real_recordings import (
    CNN,
    ON_FEATURES,
    ON_SERIES,
    classify_segments,
    find_groups,
    train_folds,
    train_without,
)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("few_windows")]

PEOPLE = ("ann", "bob", "cleo")
FOUR = ("hold", "tap", "tap", "hold")
LEARNED = replace(
    TINY,
    steps=25,
    batch=16,
    encoded=16,
    rate=2e-2,
    decay=0.0,
    smoothing=0.0,
    validation=0.0,
    augment=replace(AS_RECORDED, crop=0.5),
)
BRIEF = replace(LEARNED, steps=2)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("people")
    return prepare(record_people(folder, PEOPLE, gestures=FOUR))


@pytest.fixture
def brief_fits(monkeypatch):
    monkeypatch.setattr(real_recordings, "CNN_FIT", FitConfig(epochs=8, batch=32))
    monkeypatch.setitem(ON_FEATURES, "random forest", RandomForest(trees=10))
    # Boosted trees need more examples in a leaf than there are.
    monkeypatch.delitem(ON_FEATURES, "boosting")


def weights(network):
    return {name: w.numpy() for name, w in network.state_dict().items()}


def assert_same(one, other):
    for group in one:
        a, b = weights(one[group]), weights(other[group])
        for name in a:
            np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_no_fold_trains_on_its_own_group(dataset, monkeypatch):
    trainers = []

    class Spy(Trainer):
        def __init__(self, *args, **options) -> None:
            super().__init__(*args, **options)
            self.drawn = set()
            trainers.append(self)
            draw = self.batches.sampler.draw

            def watched(count, rng):
                ends, firsts, labels = draw(count, rng)
                rows = [np.arange(a, b + 1) for a, b in zip(firsts, ends, strict=True)]
                self.drawn |= set(dataset.recording[np.concatenate(rows)].tolist())
                return ends, firsts, labels

            object.__setattr__(self.batches.sampler, "draw", watched)

    monkeypatch.setattr(real_recordings, "Trainer", Spy)
    networks = train_folds(dataset, ["a", "b", "a"], TINY)
    assert list(networks) == ["a", "b"]
    assert [trainer.drawn for trainer in trainers] == [{1}, {0, 2}]


def test_a_fold_does_not_depend_on_those_trained_before_it(dataset):
    """So their order and the processes that train them do not matter."""
    groups = ["a", "b", "a"]
    together = train_folds(dataset, groups, TINY, seed=1)
    torch.manual_seed(99)
    assert_same({"b": train_without(dataset, groups, "b", TINY, 1)}, together)


def test_clearly_different_gestures_are_recognised_on_held_out_people(
    dataset, brief_fits
):
    groups = find_groups(dataset, "subject")
    assert groups == list(PEOPLE)
    networks = train_folds(dataset, groups, LEARNED)
    answers = classify_segments(dataset, groups, networks, False, 0)
    assert answers.vocabulary == ("hold", "tap")
    assert answers.groups == tuple(np.repeat(PEOPLE, 4).tolist())
    assert answers.truth.tolist() == [0, 1, 1, 0] * 3
    assert set(answers.predicted) == {"eskin", *ON_FEATURES, *ON_SERIES, CNN}
    for name, predicted in answers.predicted.items():
        assert (predicted == answers.truth).mean() >= 0.75, name


def test_shuffled_labels_are_not_recognised_better_than_by_chance(dataset, brief_fits):
    rng = np.random.default_rng(5)
    gestures = rng.permutation(["hold", "tap"] * 6).tolist()
    shuffled = replace(
        dataset,
        segments=tuple(
            replace(s, gesture=gestures.pop()) if s.labelled else s
            for s in dataset.segments
        ),
    )
    groups = find_groups(dataset, "subject")
    # That no network learns from its own group is tested above.
    networks = train_folds(shuffled, groups, BRIEF)
    answers = classify_segments(shuffled, groups, networks, False, 0)
    for name, predicted in answers.predicted.items():
        assert 0.05 < (predicted == answers.truth).mean() < 0.85, name


def test_a_single_group_is_refused(dataset):
    one = replace(dataset, recordings=dataset.recordings[:1])
    with pytest.raises(RecordingError, match="all recordings have subject 'ann'"):
        find_groups(one, "subject")


def test_table_of_people_is_answered_for_with_each_person_held_out(
    tmp_path, brief_fits, capsys
):
    lines = ["subject,variant,gesture,frame," + ",".join(f"ch{n}" for n in range(64))]
    for person, gesture in itertools.product((1, 2), (6, 12) * 3):
        for frame in range(70):
            row = np.zeros(64, int)
            if 15 < frame < 50:
                row[27 if gesture == 6 else 24 + frame // 10] = 700
            lines.append(",".join(map(str, (person, 1, gesture, frame, *row))))
    (tmp_path / "CoST.csv").write_text("\n".join(lines))
    convert, measure = real_recordings.KINDS["cost"]
    convert(tmp_path / "CoST.csv", tmp_path / "out")
    command = real_recordings.Command("cost", tmp_path, workers=1, train=BRIEF)
    measure(find_recordings([tmp_path / "out"]), command)
    out = capsys.readouterr().out
    assert "Repetitions** (12 examples, 2 classes)" in out
    assert all(f"| {name} |" in out for name in (real_recordings.OURS, *ON_FEATURES))
