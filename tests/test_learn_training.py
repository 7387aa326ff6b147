"""Balanced windows, honest splits, and a network that learns what it is shown."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from eskin.errors import RecordingError
from eskin.learn.dataset import prepare
from eskin.learn.sampler import Sampler, make_sampler
from eskin.learn.scoring import instant_scores, segment_scores
from eskin.learn.training import TEMPERATURES, Best, TrainConfig, Trainer
from eskin.model import SLOT_NS
from eskin.nn import summary
from learn_scenes import AS_RECORDED, TINY, record_people

VOCABULARY = ("none", "hold", "tap")
PEOPLE = ("ann", "bob", "cleo", "dan")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return prepare(record_people(tmp_path_factory.mktemp("people"), PEOPLE))


def sampler_of(dataset, recordings=(0, 1, 2, 3), crop=1.0) -> Sampler:
    return make_sampler(dataset, VOCABULARY, set(recordings), 100, crop)


def weights(network):
    return torch.cat([w.flatten().double() for w in network.state_dict().values()])


def test_every_class_is_drawn_as_often_however_rare_it_is(dataset):
    # Of eight gestures one is a tap.
    taps = [s for s in dataset.segments if s.gesture == "tap"][1:]
    few = replace(dataset, segments=tuple(s for s in dataset.segments if s not in taps))
    sampler = sampler_of(few)
    _, _, labels = sampler.draw(3000, np.random.default_rng(0))
    np.testing.assert_allclose(np.bincount(labels) / 3000, 1 / 3, atol=0.04)


def test_every_segment_of_a_class_is_drawn_as_often(dataset):
    sampler = sampler_of(dataset)
    ends, _, labels = sampler.draw(3000, np.random.default_rng(0))
    recording = dataset.recording[ends[np.array(labels) == 1]]
    shares = np.bincount(recording, minlength=4) / len(recording)
    np.testing.assert_allclose(shares, 1 / 4, atol=0.06)


def test_a_window_ends_in_a_gesture_of_its_class_and_recording(dataset):
    sampler = sampler_of(dataset, (1, 3), 0.5)
    ends, firsts, labels = sampler.draw(500, np.random.default_rng(0))
    assert [dataset.gestures[end] for end in ends] == [VOCABULARY[i] for i in labels]
    assert set(dataset.recording[ends].tolist()) == {1, 3}
    assert (firsts >= dataset.starts[ends]).all()
    assert (firsts <= ends).all()


def test_a_window_is_asked_for_a_gesture_a_tenth_of_a_second_old(dataset):
    sampler = sampler_of(dataset)
    ends, firsts, _ = sampler.draw(500, np.random.default_rng(0))
    onset = {row: s.first for s in dataset.segments for row in range(s.first, s.end)}
    last = {s.end - 1 for s in dataset.segments}
    for end in ends.tolist():
        since = dataset.stamps[end] - dataset.stamps[onset[end]]
        assert since >= 100_000_000 or end in last
    # Cropped windows, all of them here, see nothing from before their gesture.
    assert firsts.tolist() == [onset[end] for end in ends.tolist()]
    ends, firsts, _ = sampler_of(dataset, crop=0.0).draw(50, np.random.default_rng(0))
    np.testing.assert_array_equal(firsts, dataset.starts[ends])


def test_a_trainer_sees_no_recording_but_its_own(dataset):
    config = replace(TINY, validation=0.5)
    trainer = Trainer(dataset, VOCABULARY, config, [0, 1, 3])

    def seen(sampler):
        parts = sampler.classes.values()
        return {segment.recording for part in parts for segment in part}

    assert trainer.held is not None
    train, held = seen(trainer.sampler), seen(trainer.held)
    assert train | held == {0, 1, 3}
    assert not train & held


def test_one_gesture_alone_cannot_be_trained_on(dataset):
    with pytest.raises(RecordingError, match="at least two classes") as caught:
        Trainer(dataset, ("hold",), TINY)
    assert "hold only hold;" in str(caught.value)


def test_validation_may_hold_one_gesture_only(dataset):
    only = replace(
        dataset,
        segments=tuple(
            s for s in dataset.segments if s.gesture == ("hold", "tap")[s.recording % 2]
        ),
    )
    trainer = Trainer(only, VOCABULARY, replace(TINY, validation=0.25))
    trainer.run(quiet=True)
    assert 0 <= trainer.validation_accuracy() <= 1
    assert trainer.temperature() > 0


def test_eight_segments_are_learned_to_the_last(dataset):
    config = replace(
        TINY,
        epochs=1,
        steps=90,
        batch=24,
        encoded=16,
        readings=6,
        rate=2e-2,
        decay=0.0,
        smoothing=0.0,
        validation=0.0,
        augment=replace(AS_RECORDED, crop=0.5),
    )
    trainer = Trainer(dataset, VOCABULARY, config)
    network = trainer.run(quiet=True)
    assert not network.training
    segments = dataset.labelled
    assert len(segments) == 8
    scores = segment_scores(network, dataset, segments)
    said = [VOCABULARY[i] for i in scores.argmax(axis=1)]
    assert said == [segment.gesture for segment in segments]
    # And instants: the middle of a gesture is it, the rest before all is none.
    middles = np.array([(s.first + s.end) // 2 for s in segments])
    rows = np.append(middles, 35)
    at = instant_scores(network, dataset, rows).argmax(axis=1)
    truth = [dataset.gestures[row] for row in rows]
    assert [VOCABULARY[i] for i in at] == truth
    np.testing.assert_allclose(np.exp(at_sum(network, dataset, rows)), 1, rtol=1e-5)


def at_sum(network, dataset, rows):
    scores = instant_scores(network, dataset, rows, temperature=2.0)
    return np.logaddexp.reduce(scores, axis=1)


def test_a_seed_decides_the_weights(dataset):
    one, same, other = (
        weights(Trainer(dataset, VOCABULARY, TINY, seed=seed).run(quiet=True))
        for seed in (3, 3, 4)
    )
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


def test_training_changes_every_part_that_has_weights(dataset):
    deep = replace(TINY, network=replace(TINY.network, layers=2))
    trainer = Trainer(dataset, VOCABULARY, deep)
    before = {k: v.clone() for k, v in trainer.network.named_parameters()}
    trainer.run(quiet=True)
    for name, weight in trainer.network.named_parameters():
        assert torch.isfinite(weight).all(), name
        # Where the last layer moves the taxels to is not looked at any more.
        unused = name == "encoder.layers.1.move.weight"
        assert torch.equal(weight, before[name]) == unused, name


def test_a_batch_has_all_summaries_and_few_graphs(dataset):
    config = replace(TINY, encoded=5)
    batch = Trainer(dataset, VOCABULARY, config).batch(8)
    assert (batch.places.windows, batch.some.places.windows) == (8, 5)
    assert len(batch.labels) == 8
    counts = torch.bincount(batch.places.window, minlength=8)
    encoded = torch.bincount(batch.some.places.window, minlength=8)
    assert torch.equal(encoded[:5], counts[:5].clamp(max=TINY.readings))
    assert not encoded[5:].any()


def test_without_augmentation_a_batch_holds_the_recorded_readings(dataset):
    config = replace(TINY, augment=AS_RECORDED, readings=1000)
    batch = Trainer(dataset, VOCABULARY, config).batch(8)
    every = summary(dataset.graphs, False)
    for row in batch.summary.numpy():
        assert (np.abs(every - row).max(axis=1) < 1e-4).any()


def test_the_best_weights_are_restored():
    network = torch.nn.Linear(1, 1)
    best = Best(patience=2)
    stops = []
    for epoch, loss in enumerate((3.0, 4.0, 1.0, 2.0, 1.5, 1.0, 0.1)):
        with torch.no_grad():
            network.weight.fill_(epoch)
        stops.append(best.is_enough(network, loss))
        if stops[-1]:
            break
    assert stops == [False] * 5 + [True]
    best.restore(network)
    assert network.weight.item() == 2.0


def test_without_a_finite_loss_the_last_weights_stay():
    network = torch.nn.Linear(1, 1)
    kept = network.weight.clone()
    best = Best(patience=9)
    assert not best.is_enough(network, float("nan"))
    best.restore(network)
    assert torch.equal(network.weight, kept)


def test_training_stops_early_with_the_weights_of_its_best_epoch(dataset, monkeypatch):
    config = replace(TINY, epochs=9, steps=1, patience=1, validation=0.25)
    trainer = Trainer(dataset, VOCABULARY, config)
    losses, seen = iter([5.0, 2.0, 3.0, 4.0, 1.0]), []

    def loss():
        seen.append(weights(trainer.network))
        return next(losses)

    monkeypatch.setattr(trainer, "validation_loss", loss)
    network = trainer.run(quiet=True)
    assert trainer.epochs == 4
    assert torch.equal(weights(network), seen[1])


def test_the_temperature_is_above_zero_and_no_worse_than_none(dataset):
    config = replace(TINY, validation=0.5)
    trainer = Trainer(dataset, VOCABULARY, config)
    trainer.run(quiet=True)
    logits, labels = trainer.validation_logits()
    t = trainer.temperature()
    assert t > 0
    loss = torch.nn.functional.cross_entropy
    losses = [float(loss(logits / other, labels)) for other in TEMPERATURES]
    assert float(loss(logits / t, labels)) == min(losses)
    unvalidated = Trainer(dataset, VOCABULARY, replace(TINY, validation=0.0))
    assert unvalidated.temperature() == 1.0
    assert np.isnan(unvalidated.validation_accuracy())


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("epochs", 0),
        ("steps", -1),
        ("batch", 0),
        ("encoded", 0),
        ("readings", 0),
        ("patience", -1),
        ("rate", 0.0),
        ("rate", float("nan")),
        ("decay", -0.1),
        ("decay", float("inf")),
        ("smoothing", 1.5),
        ("validation", 1.0),
        ("validation", -0.1),
    ],
)
def test_settings_that_mean_nothing_are_refused_by_name(entry, value):
    with pytest.raises(ValueError, match=f"{entry} is {value}; allowed"):
        TrainConfig(**{entry: value})


def test_windows_of_the_head_are_two_seconds():
    assert TrainConfig().network.slots * SLOT_NS == 2_000_000_000
