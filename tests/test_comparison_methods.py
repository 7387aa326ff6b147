"""Methods that are compared: what their results are kept by, and what they take."""

import shutil
from dataclasses import fields, replace
from functools import partial
from inspect import signature

import numpy as np
import pytest
from benchmarks.crossvalidation import Standardised

from eskin.graph import GraphConfig
from eskin.learn.baselines import PaperBaseline
from eskin.learn.baselines.estimators import (
    GradientBoosting,
    LinearDiscriminant,
    NearestNeighbours,
    Perceptron,
    RandomForest,
    SupportVectors,
)
from eskin.learn.baselines.flat import FlatBaseline
from eskin.learn.comparison import (
    ABLATIONS,
    METHODS,
    BaselineMethod,
    RecogniserMethod,
    TrainingTask,
    find_examples,
    methods,
)
from eskin.learn.comparison.encoders import ENCODERS
from eskin.learn.comparison.methods import build_touch_rows
from eskin.learn.comparison.study import Variant
from eskin.learn.evaluation import ClipPredictions
from eskin.learn.training import Trainer
from eskin.nn import build_graph_tensors
from helpers.clips import generated
from helpers.graphs import random_graph
from helpers.learning import TINY

pytestmark = pytest.mark.slow

ESTIMATORS = (
    SupportVectors(),
    NearestNeighbours(),
    Perceptron(),
    LinearDiscriminant(),
    RandomForest(),
    GradientBoosting(),
)
SHORT = replace(TINY, validation=0.0)


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Six clips."""
    folder = tmp_path_factory.mktemp("set")
    generated(folder / "a")
    return find_examples([folder / "a"], folder / "pack")


@pytest.fixture
def untrained(monkeypatch):
    """Trainers that were to be run, and are not."""
    trainers = []

    def run(trainer, quiet):
        trainers.append(trainer)
        return trainer.network.eval()

    monkeypatch.setattr(Trainer, "run", run)
    return trainers


def key(method, examples):
    return TrainingTask("a", method, examples, {"test": examples}, 0).digest


def test_a_method_prints_as_all_its_settings_and_no_address():
    for name, method in {**METHODS, **ABLATIONS}.items():
        assert " at 0x" not in repr(method), name
        if isinstance(method, BaselineMethod):
            assert isinstance(method.make, partial)
            takes = set(signature(method.make.func).parameters) - {"mounted"}
            assert set(method.make.keywords) == takes, name


@pytest.mark.parametrize("one", ESTIMATORS)
def test_another_setting_of_an_estimator_is_another_result(one, examples):
    others = [
        replace(one, **{each.name: 2 * getattr(one, each.name)}) for each in fields(one)
    ]
    every = [one, *others]
    every += [Standardised(each) for each in every]
    made = [partial(FlatBaseline, estimator=each, features="bins") for each in every]
    keys = [key(BaselineMethod(make), examples) for make in made]
    assert len(set(keys)) == len(every) == 2 * (1 + len(fields(one)))
    assert key(BaselineMethod(partial(made[0])), examples) == keys[0]


def test_an_estimator_has_the_settings_that_it_prints():
    for one, name, value in (
        (SupportVectors(C=3.0), "machine__C", 3.0),
        (NearestNeighbours(k=3), "n_neighbors", 3),
        (Perceptron(hidden=(3,)), "hidden_layer_sizes", (3,)),
        (Perceptron(decay=0.3), "alpha", 0.3),
        (Perceptron(epochs=3), "max_iter", 3),
        (LinearDiscriminant(shrinkage=0.3), "shrinkage", 0.3),
        (RandomForest(trees=3), "n_estimators", 3),
        (RandomForest(leaf=3), "min_samples_leaf", 3),
        (GradientBoosting(trees=3), "max_iter", 3),
        (GradientBoosting(leaves=3), "max_leaf_nodes", 3),
        (GradientBoosting(rate=0.3), "learning_rate", 0.3),
        (Standardised(NearestNeighbours(k=3)), "kneighborsclassifier__n_neighbors", 3),
    ):
        assert one(0).get_params()[name] == value, one


@pytest.mark.parametrize("change", ["gesture", "start"])
def test_clips_said_to_be_others_are_other_examples(change, examples, tmp_path):
    def copied(name, was="", now=""):
        shutil.copytree(examples.paths[0].parents[1], tmp_path / name)
        index = next((tmp_path / name).rglob("clips.jsonl"))
        index.write_text(index.read_text().replace(was, now, 1))
        return find_examples([tmp_path / name], tmp_path)

    _, clip = examples.clips[0]
    was, now = {
        "gesture": (f'"gesture": "{clip.gesture}"', '"gesture": "kick"'),
        "start": (f'"start": {clip.start}', f'"start": {clip.start - 1}'),
    }[change]
    same, other = copied("same"), copied("other", was, now)
    assert same.digest == examples.digest != other.digest
    method = METHODS["eskin"]
    assert key(method, same) == key(method, examples) != key(method, other)


def embedded(trainer):
    """What the encoder of a network makes of a touch."""
    batch = build_graph_tensors(random_graph(np.random.default_rng(0), 30), False)
    return trainer.network.encoder(batch).detach().numpy().tobytes()


def test_a_recogniser_is_trained_with_its_encoder(examples, untrained):
    for kind in ENCODERS:
        RecogniserMethod(SHORT, kind).fit(examples, 0)
    RecogniserMethod(SHORT).fit(examples, 0)
    *found, ours = (embedded(trainer) for trainer in untrained)
    assert len(set(found)) == len(ENCODERS) and ours == found[0]


@pytest.mark.parametrize(("small", "times"), [(3, 2), (6, 1), (500, 1)])
def test_more_clips_take_as_many_more_steps(
    small, times, examples, untrained, monkeypatch
):
    monkeypatch.setattr(methods, "SMALL", small)
    assert len(examples.clips) == 6
    RecogniserMethod(SHORT).fit(examples, 0)
    assert untrained[0].config == replace(SHORT, steps=times * SHORT.steps)


def test_where_nothing_is_felt_the_answer_is_none_or_what_was_learned_most(
    examples, tmp_path, untrained, monkeypatch
):
    def nothing(network, dataset, vocabulary):
        certain = np.where(np.array(vocabulary) == "none", 0.0, -np.inf)
        unknown = np.zeros(2, dtype=np.int64)
        return ClipPredictions((), unknown, unknown, np.tile(certain, (2, 1)))

    generated(tmp_path / "a", chosen="paper")
    touches = find_examples([tmp_path / "a"], tmp_path / "pack")
    monkeypatch.setattr(methods, "predict_clips", nothing)
    for learned in (examples, touches):
        shares = np.array([name == "none" for name in learned.gestures], float)
        if learned is touches:
            made = [clip.gesture for _, clip in learned.clips]
            counts = [made.count(name) for name in learned.gestures]
            shares = np.array(counts) / len(made)
        answers = RecogniserMethod(SHORT).fit(learned, 0)(learned)
        np.testing.assert_allclose(np.exp(answers), np.tile(shares, (2, 1)))
    assert "none" in examples.gestures and "none" not in touches.gestures


def test_a_variant_of_ours_has_its_neighbours_and_pooling(examples, untrained):
    for k, pool in ((5, "max"), (5, "mean"), (7, "mean")):
        Variant("eskin", k, pool).build_method(epochs=1).fit(examples, 0)
    assert [trainer.config.graph.fixed for trainer in untrained] == [5, 5, 7]
    largest, mean, other = map(embedded, untrained)
    assert largest != mean == other


def test_a_variant_of_the_papers_has_its_neighbours_and_pooling(examples, monkeypatch):
    found = []

    def learn(baseline, clips, labels, seed):
        network = baseline.build()
        neighbours = network.selector.table.shape[1]
        found.append((neighbours, network.pooling, baseline.config.epochs))

    monkeypatch.setattr(PaperBaseline, "fit_windows", learn)
    wanted = [(5, "mean", 3), (7, "max", 2)]
    for k, pool, epochs in wanted:
        Variant("paper", k, pool).build_method(epochs).fit(examples, 0)
    assert found == wanted


def test_trees_on_a_touch_see_its_features_and_nothing_where_nothing_is_felt(
    examples, monkeypatch
):
    rows = build_touch_rows(examples)
    assert len(rows) == len(examples.clips) and np.isfinite(rows).all()
    assert rows.any(axis=1).all() and len(np.unique(rows, axis=0)) == len(rows)
    ends = list(methods.find_last_rows(examples.dataset(GraphConfig()), examples.clips))
    ends[2] = -1
    monkeypatch.setattr(methods, "find_last_rows", lambda dataset, every: ends)
    other = build_touch_rows(examples)
    assert not other[2].any()
    np.testing.assert_array_equal(np.delete(other, 2, 0), np.delete(rows, 2, 0))
