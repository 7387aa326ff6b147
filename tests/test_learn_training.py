"""Balanced windows, honest splits, and a network that learns what it is shown."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from sklearn.linear_model import Ridge
from torch.nn.functional import cross_entropy, one_hot

from eskin.errors import ModelError, RecordingError
from eskin.learn import training
from eskin.learn.batches import Sampler, build_sampler
from eskin.learn.checkpoint import EarlyStopping
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import (
    compute_statistics,
    predict_clips,
    score_instants,
    score_segments,
)
from eskin.learn.last_layer import (
    compute_closed_touches,
    draw_statistics,
    fit_closing_layer,
    fit_open_layer,
    regress,
    spread,
)
from eskin.learn.training import TEMPERATURES, Trainer
from eskin.live import Model, ModelCard
from helpers.clips import generated
from helpers.learning import AS_RECORDED, TINY, record, record_people

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("few_windows")]

VOCABULARY = ("none", "hold", "tap")
PEOPLE = ("ann", "bob", "cleo", "dan")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return prepare(record_people(tmp_path_factory.mktemp("people"), PEOPLE))


def make_sampler(dataset, recordings=(0, 1, 2, 3), crop=1.0) -> Sampler:
    return build_sampler(dataset, VOCABULARY, set(recordings), 100, crop)


class Cut(Exception):
    """What ends a training from outside."""


def weights(network):
    return torch.cat([w.flatten().double() for w in network.state_dict().values()])


def test_every_class_is_drawn_as_often_however_rare_it_is(dataset):
    # Of eight gestures one is a tap.
    taps = [s for s in dataset.segments if s.gesture == "tap"][1:]
    few = replace(dataset, segments=tuple(s for s in dataset.segments if s not in taps))
    sampler = make_sampler(few)
    _, _, labels = sampler.draw(3000, np.random.default_rng(0))
    np.testing.assert_allclose(np.bincount(labels) / 3000, 1 / 3, atol=0.04)


def test_every_segment_of_a_class_is_drawn_as_often(dataset):
    sampler = make_sampler(dataset)
    ends, _, labels = sampler.draw(3000, np.random.default_rng(0))
    recording = dataset.recording[ends[np.array(labels) == 1]]
    shares = np.bincount(recording, minlength=4) / len(recording)
    np.testing.assert_allclose(shares, 1 / 4, atol=0.06)


def test_a_window_ends_in_a_gesture_of_its_class_and_recording(dataset):
    sampler = make_sampler(dataset, (1, 3), 0.5)
    ends, firsts, labels = sampler.draw(500, np.random.default_rng(0))
    assert [dataset.gestures[end] for end in ends] == [VOCABULARY[i] for i in labels]
    assert set(dataset.recording[ends].tolist()) == {1, 3}
    assert (firsts >= dataset.starts[ends]).all()
    assert (firsts <= ends).all()


def test_windows_end_at_least_a_tenth_of_a_second_after_the_onset(dataset):
    sampler = make_sampler(dataset)
    ends, firsts, _ = sampler.draw(500, np.random.default_rng(0))
    onset = {row: s.first for s in dataset.segments for row in range(s.first, s.end)}
    last = {s.end - 1 for s in dataset.segments}
    for end in ends.tolist():
        since = dataset.stamps[end] - dataset.stamps[onset[end]]
        assert since >= 100_000_000 or end in last
    # Cropped windows, all of them here, see nothing from before their gesture.
    assert firsts.tolist() == [onset[end] for end in ends.tolist()]
    ends, firsts, _ = make_sampler(dataset, crop=0.0).draw(50, np.random.default_rng(0))
    np.testing.assert_array_equal(firsts, dataset.starts[ends])


def test_a_trainer_uses_only_its_own_recordings(dataset):
    config = replace(TINY, validation=0.5)
    trainer = Trainer(dataset, VOCABULARY, config, [0, 1, 3])

    def seen(sampler):
        return {
            segment.recording
            for datasets in sampler.classes.values()
            for segments in datasets.values()
            for segment in segments
        }

    assert trainer.held_out is not None
    train = seen(trainer.batches.sampler)
    held = seen(trainer.held_out.sampler)
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
    assert 0 <= trainer.score_held_out()[0] <= 1
    assert trainer.score_held_out()[1] > 0


def test_a_network_can_fit_eight_segments(dataset):
    config = replace(
        TINY,
        epochs=1,
        steps=60,
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
    scores = score_segments(network, dataset, segments)
    predicted = [VOCABULARY[i] for i in scores.argmax(axis=1)]
    assert predicted == [segment.gesture for segment in segments]
    # And instants: the middle of a gesture is it, the rest before all is none.
    middles = np.array([(s.first + s.end) // 2 for s in segments])
    rows = np.append(middles, 35)
    at = score_instants(network, dataset, rows).argmax(axis=1)
    truth = [dataset.gestures[row] for row in rows]
    assert [VOCABULARY[i] for i in at] == truth
    warm = score_instants(network, dataset, rows, temperature=2.0)
    np.testing.assert_allclose(np.exp(warm).sum(axis=1), 1, rtol=1e-5)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_seed_decides_the_weights(dataset, workers):
    config = replace(TINY, workers=workers)
    one, same, other = (
        weights(Trainer(dataset, VOCABULARY, config, seed=seed).run(quiet=True))
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
        assert not torch.equal(weight, before[name]), name


def cut_after(trainer, steps, monkeypatch):
    """Let a trainer come to its end after so many more steps."""
    step = trainer.step
    left = iter(range(steps))

    def or_cut(*args) -> None:
        if next(left, None) is None:
            raise Cut
        step(*args)

    monkeypatch.setattr(trainer, "step", or_cut)


def test_training_resumed_at_any_step_gives_the_same_weights(
    dataset, tmp_path, monkeypatch
):
    """Also cut again and again, and with what is drawn by torch."""
    network = replace(TINY.network, dropout=0.5)
    config = replace(TINY, epochs=3, validation=0.25, ridge=0.1, network=network)
    monkeypatch.setattr(training, "SAVE_PERIOD", -1.0)
    whole = Trainer(dataset, VOCABULARY, config)
    wanted = weights(whole.run(quiet=True))
    options = {"quiet": True, "checkpoint": tmp_path / "m.training", "facts": "these"}
    for steps in (1, 0, 3):
        cut = Trainer(dataset, VOCABULARY, config)
        cut_after(cut, steps, monkeypatch)
        with pytest.raises(Cut):
            cut.run(**options)
    again = Trainer(dataset, VOCABULARY, config)
    assert torch.equal(weights(again.run(**options)), wanted)
    assert again.epochs == whole.epochs == 3
    assert again.score_held_out()[1] == whole.score_held_out()[1]


def test_a_finished_training_is_not_resumed(dataset, tmp_path, monkeypatch):
    """Cut after its last step, while it is scored, say: at its end, or stopped."""
    kept = tmp_path / "m.training"
    losses = [5.0, 2.0, 3.0, 4.0, 1.0, 1.0]
    for most, epochs in ((9, 4), (4, 4), (2, 2)):
        config = replace(TINY, epochs=most, steps=1, patience=1, validation=0.25)
        found = []
        for _ in range(2):
            trainer = Trainer(dataset, VOCABULARY, config)
            left = iter(losses)
            monkeypatch.setattr(trainer, "validation_loss", lambda x=left: next(x))
            monkeypatch.setattr(training, "SAVE_PERIOD", -1.0)
            found.append(
                weights(trainer.run(quiet=True, checkpoint=kept, facts="these"))
            )
            assert trainer.epochs == epochs
        assert torch.equal(*found)
        kept.unlink()


def test_checkpoints_are_written_during_training_if_a_file_is_given(dataset, tmp_path):
    kept = tmp_path / "m.training"
    Trainer(dataset, VOCABULARY, TINY).run(quiet=True, checkpoint=kept, facts="these")
    assert not kept.exists()  # It was over before the first half minute.
    with pytest.raises(ModelError, match="cannot be read"):
        kept.write_bytes(b"nothing")
        Trainer(dataset, VOCABULARY, TINY).run(
            quiet=True, checkpoint=kept, facts="these"
        )


def test_data_to_validate_on_leaves_all_others_to_train_on(dataset, tmp_path):
    other = prepare(record_people(tmp_path, ("eve", "fay")))
    config = replace(TINY, validation=0.5)
    trainer = Trainer(dataset, VOCABULARY, config, validation=other)
    assert trainer.held_out is not None
    assert trainer.held_out.dataset is other
    assert trainer.batches.dataset is dataset
    assert trainer.holdout.train == {0, 1, 2, 3}
    one = Trainer(dataset, VOCABULARY, config, validation=other).validation_loss()
    assert one == trainer.validation_loss()
    trainer.run(quiet=True)
    assert 0 <= trainer.score_held_out()[0] <= 1


def test_a_network_without_shear_is_validated_without_it(dataset, tmp_path):
    with_shear = prepare([record(tmp_path / "shear.mcap", kind="shear")])
    trainer = Trainer(dataset, VOCABULARY, TINY, validation=with_shear)
    assert not trainer.shear
    trainer.run(quiet=True)
    assert np.isfinite(trainer.validation_loss())


def test_initial_weights_are_used_where_shapes_match(dataset):
    first = Trainer(dataset, ("none", "hold"), TINY, seed=1)
    weights_of = {k: v.numpy() for k, v in first.network.state_dict().items()}
    model = Model(weights_of, ModelCard(("none", "hold"), network=TINY.network))
    trainer, other = (
        Trainer(dataset, VOCABULARY, TINY, seed=2, start=start)
        for start in (model, None)
    )
    own = other.network.state_dict()
    for name, weight in trainer.network.state_dict().items():
        fits = "classify" not in name
        wanted = torch.as_tensor(weights_of[name]) if fits else own[name]
        assert torch.equal(weight, wanted), name


def test_closing_layer_of_a_model_to_start_from_is_not_used(dataset):
    first = Trainer(dataset, VOCABULARY, TINY, seed=1)
    first.network.add_closing_layer()
    weights_of = {k: v.numpy() for k, v in first.network.state_dict().items()}
    model = Model(weights_of, ModelCard(VOCABULARY, network=TINY.network))
    network = Trainer(dataset, VOCABULARY, TINY, seed=2, start=model).network
    assert not network.has_closing_layer
    assert torch.equal(
        network.summary_head.classify.weight, first.network.summary_head.classify.weight
    )


def test_accuracy_and_temperature_are_of_generated_clips(tmp_path, monkeypatch):
    clips = prepare(generated(tmp_path, clips=6))
    made = {clip.gesture for mine in clips.clips for clip in mine} - {"none"}
    vocabulary = ("none", *sorted(made))
    trainer = Trainer(
        clips, vocabulary, replace(TINY, validation=0.0), validation=clips
    )
    answers = predict_clips(trainer.network.eval(), clips, vocabulary)
    right = (answers.predicted == answers.truth).mean()
    assert trainer.score_held_out()[0] == pytest.approx(right)
    wanted = trainer.score_held_out()[1]
    # Clips without contact do not enter the temperature.
    [mine] = clips.clips
    late = tuple(replace(clip, start=clip.end, end=clip.end + 1) for clip in mine)
    unfelt = replace(clips, clips=((*mine, *late),))
    trainer = Trainer(
        clips, vocabulary, replace(TINY, validation=0.0), validation=unfelt
    )
    assert trainer.score_held_out()[1] == wanted
    none = np.mean([clip.gesture == "none" for clip in mine])
    assert trainer.score_held_out()[0] == pytest.approx((right + none) / 2)


def test_only_held_out_clips_are_predicted(tmp_path):
    [path] = generated(tmp_path)
    clips = prepare([path, path])
    sessions = tuple(
        replace(r, metadata=replace(r.metadata, session=f"day-{n}"))
        for n, r in enumerate(clips.recordings)
    )
    clips = replace(clips, recordings=sessions)
    config = replace(TINY, validation=0.5)
    trainer = Trainer(clips, clips.vocabulary, config)
    [held] = trainer.held_recordings
    logits, labels = trainer.predict_held_out()
    assert len(logits) == len(labels) == len(clips.clips[held]) > 0


def test_without_a_finite_loss_the_last_weights_stay():
    network = torch.nn.Linear(1, 1)
    kept = network.weight.clone()
    best = EarlyStopping(patience=9)
    assert not best.update(network, float("nan"))
    best.restore(network)
    assert torch.equal(network.weight, kept)


def test_training_stops_early_with_the_weights_of_its_best_epoch(dataset, monkeypatch):
    config = replace(TINY, epochs=9, steps=1, patience=1, validation=0.25)
    trainer = Trainer(dataset, VOCABULARY, config)
    losses = iter([5.0, 2.0, 3.0, 4.0, 1.0])
    seen = []

    def loss():
        seen.append(weights(trainer.network))
        return next(losses)

    monkeypatch.setattr(trainer, "validation_loss", loss)
    network = trainer.run(quiet=True)
    assert trainer.epochs == 4
    assert torch.equal(weights(network), seen[1])


def test_regression_is_that_of_scikit_learn():
    """With weights; a class without examples and a constant statistic count nothing."""
    rng = np.random.default_rng(0)
    x = rng.normal(2.0, 3.0, (50, 6))
    labels = rng.integers(0, 3, 50)
    x[:, 5] = 1.0
    share = rng.uniform(0.5, 1.5, 50)
    share /= share.sum()
    targets = np.eye(4)[labels]
    arrays = [torch.as_tensor(each) for each in (x, targets, share)]
    weights, offsets = regress(arrays[0], arrays[1], arrays[2], 0.1)
    mean = share @ x[:, :5]
    z = (x[:, :5] - mean) / np.sqrt(share @ (x[:, :5] - mean) ** 2)
    reference = Ridge(alpha=0.1).fit(z, targets, share)
    found = x @ weights.numpy().T + offsets.numpy()
    np.testing.assert_allclose(found, reference.predict(z), atol=1e-5)
    np.testing.assert_allclose(weights[:, 5], 0.0, atol=1e-9)
    np.testing.assert_allclose(weights[3], 0.0, atol=1e-9)


@pytest.mark.parametrize("width", [0, 4])
def test_last_layer_is_the_mean_of_the_trained_one_and_the_regression(dataset, width):
    config = replace(TINY, network=replace(TINY.network, width=width))
    trainer = Trainer(dataset, VOCABULARY, config)
    network = trainer.network.eval()
    batches = trainer.batches
    with torch.no_grad():
        x, labels = draw_statistics(network, batches, 128, 4, np.random.default_rng(0))
        before = network.classify_statistics(x.float())
        fit_open_layer(network, batches, 128, 4, 0.1, np.random.default_rng(0))
        added = 2.0 * network.classify_statistics(x.float()) - before
    share = torch.full((len(x),), 1 / len(x), dtype=x.dtype)
    weights, offsets = regress(x, one_hot(labels, 3).double(), share, 0.1)
    regression = x @ weights.T + offsets
    scale = (added * regression).sum() / (regression**2).sum()
    torch.testing.assert_close(added.double(), scale * regression, rtol=0, atol=1e-4)
    assert float(spread(added)) == pytest.approx(float(spread(before)), rel=1e-3)


@pytest.mark.parametrize("width", [0, 4])
def test_closing_layer_adds_what_is_unexplained_at_ends_of_touches_to_the_open_one(
    dataset, width
):
    config = replace(TINY, network=replace(TINY.network, width=width))
    trainer = Trainer(dataset, VOCABULARY, config)
    network = trainer.network.eval()
    sampler = trainer.batches.sampler
    rng = np.random.default_rng(0)
    trained = weights(network)
    x, labels, share = compute_closed_touches(network, sampler, rng)
    segments, _, _ = sampler.list_segments()
    ends = np.array([segment.end - 1 for segment in segments])
    firsts = np.array([segment.first for segment in segments])
    wanted = compute_statistics(network, dataset, ends, firsts)
    torch.testing.assert_close(x, wanted.double())
    of_class = torch.zeros(3, dtype=share.dtype).index_add(0, labels, share)
    np.testing.assert_allclose(of_class, 1 / 3)
    fit_closing_layer(network, sampler, 0.1, rng)
    assert network.has_closing_layer
    with torch.no_grad():
        before = network.classify_statistics(x.float())
        after = network.classify_statistics(x.float(), closing=True)
    unexplained = one_hot(labels, 3).double() - before.double().softmax(dim=1)
    regressed, offsets = regress(x, unexplained, share, 0.1)
    added = 4.0 * (x @ regressed.T + offsets)
    torch.testing.assert_close((after - before).double(), added, rtol=0, atol=1e-4)
    losses = [cross_entropy(logits, labels) for logits in (before, after)]
    assert losses[1] < losses[0]
    network.remove_closing_layer()
    assert torch.equal(weights(network), trained)


def test_a_network_whose_statistics_are_not_finite_keeps_its_layers(dataset):
    trainer = Trainer(dataset, VOCABULARY, TINY)
    network = trainer.network.eval()
    sampler = trainer.batches.sampler
    with torch.no_grad():
        network.summary_head.project.bias.fill_(torch.nan)
    fit_closing_layer(network, sampler, 0.1, np.random.default_rng(0))
    for head in network.heads:
        assert torch.equal(head.close.weight, head.classify.weight)


@pytest.mark.parametrize("validation", [0.0, 0.5])
def test_layers_are_fitted_on_training_recordings_alone(dataset, validation):
    """Also the same again by the same seed."""
    config = replace(TINY, ridge=0.1, validation=validation)
    least = [0, 1, 2, 3]
    first = Trainer(dataset, VOCABULARY, config, least)
    held = first.held_recordings
    strange = tuple(
        replace(s, gesture="hold" if s.gesture == "tap" else "tap")
        if s.recording in held
        else s
        for s in dataset.segments
    )
    second = Trainer(replace(dataset, segments=strange), VOCABULARY, config, least)
    for trainer in (first, second):
        trainer.closing_losses = lambda: (1.0, 0.0)
        trainer.calibrated_loss = iter([2.0, 1.0]).__next__
        trainer.validation_loss = lambda: 1.0
    networks = [trainer.run(quiet=True) for trainer in (first, second)]
    assert all(network.has_closing_layer for network in networks)
    assert torch.equal(*map(weights, networks))


def test_open_layer_is_kept_as_trained_where_the_regression_is_worse(dataset):
    trainer = Trainer(dataset, VOCABULARY, replace(TINY, validation=0.5, ridge=0.1))
    last = trainer.network.summary_head.classify.weight
    trained = last.clone()
    first = trainer.network.summary_head.project.weight.clone()
    trainer.calibrated_loss = iter([2.0, 1.0]).__next__
    trainer.fit_open_layer()
    assert not torch.equal(last, trained)
    assert torch.equal(trainer.network.summary_head.project.weight, first)
    found = last.clone()
    trainer.calibrated_loss = iter([1.0, 2.0]).__next__
    trainer.fit_open_layer()
    assert torch.equal(last, found)


@pytest.mark.parametrize(("with_it", "kept"), [(0.9, True), (1.0, False)])
def test_closing_layer_is_kept_where_it_lowers_the_loss_of_held_out_touches(
    dataset, with_it, kept
):
    trainer = Trainer(dataset, VOCABULARY, replace(TINY, validation=0.5, ridge=0.1))
    trainer.closing_losses = lambda: (1.0, with_it)
    trainer.fit_closing_layer()
    assert trainer.network.has_closing_layer == kept


def test_interrupted_fit_leaves_the_network_as_trained(dataset, monkeypatch):
    trainer = Trainer(dataset, VOCABULARY, replace(TINY, ridge=0.1, validation=0.0))
    trained = weights(trainer.network)

    def stop(*_) -> None:
        trainer.network.add_closing_layer()
        raise KeyboardInterrupt

    monkeypatch.setattr(training, "fit_open_layer", lambda *_: None)
    monkeypatch.setattr(training, "fit_closing_layer", stop)
    trainer.fit_last_layers()
    assert trainer.stopped
    assert torch.equal(weights(trainer.network), trained)


def test_the_temperature_is_above_zero_and_no_worse_than_none(dataset):
    config = replace(TINY, validation=0.5)
    trainer = Trainer(dataset, VOCABULARY, config)
    trainer.run(quiet=True)
    logits, labels = trainer.predict_validation_windows()
    t = trainer.score_held_out()[1]
    assert t > 0
    loss = torch.nn.functional.cross_entropy
    losses = [float(loss(logits / other, labels)) for other in TEMPERATURES]
    assert float(loss(logits / t, labels)) == min(losses)
    unvalidated = Trainer(dataset, VOCABULARY, replace(TINY, validation=0.0))
    assert unvalidated.score_held_out()[1] == 1.0
    assert np.isnan(unvalidated.score_held_out()[0])
