"""Batches: every reading's summary, some readings' graphs, of the same people."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from eskin.learn.batches import (
    BatchBuilder,
    build_sampler,
)
from eskin.learn.config import NO_AUGMENTATION, AugmentConfig
from eskin.learn.dataset import prepare
from eskin.live import compute_summary
from helpers.learning import record_people

SLOTS = 100
VARIED = AugmentConfig(noise=0.1, patch=0.5, lost=0.3, halved=0.5, stretch=0.3)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return prepare(record_people(tmp_path_factory.mktemp("people"), ("ann", "bob")))


def make_builder(dataset, config=NO_AUGMENTATION) -> BatchBuilder:
    recordings = range(len(dataset.recordings))
    sampler = build_sampler(dataset, ("none", "hold", "tap"), recordings, SLOTS, 0.7)
    return BatchBuilder(dataset, sampler, config, SLOTS, shear=False)


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("config", [NO_AUGMENTATION, VARIED])
def test_a_batch_has_all_summaries_and_few_graphs(dataset, config):
    batch = make_builder(dataset, config).build(8, 5, 4, rng())
    assert (batch.slot_index.windows, batch.encoded.slot_index.windows) == (8, 5)
    assert len(batch.labels) == 8
    assert len(batch.summary) == len(batch.slot_index.window)
    counts = torch.bincount(batch.slot_index.window, minlength=8)
    encoded = torch.bincount(batch.encoded.slot_index.window, minlength=8)
    assert (counts > 0).all()
    assert torch.equal(encoded[:5], counts[:5].clamp(max=4))
    assert not encoded[5:].any()


def test_without_augmentation_a_batch_holds_the_recorded_readings(dataset):
    batch = make_builder(dataset).build(8, 8, 1000, rng())
    every = compute_summary(dataset.graphs, False)
    for row in batch.summary.numpy():
        assert (np.abs(every - row).max(axis=1) < 1e-4).any()


@pytest.mark.parametrize("config", [NO_AUGMENTATION, VARIED])
def test_graphs_belong_to_the_encoded_readings(dataset, config):
    """Both views of a window see the same person on the same skin."""
    batch = make_builder(dataset, config).build(6, 4, 9, rng())
    some = batch.encoded
    every = {
        (window, slot): row
        for window, slot, row in zip(
            batch.slot_index.window.tolist(),
            batch.slot_index.slot.tolist(),
            batch.summary,
            strict=True,
        )
    }
    near = [
        (batch.summary[batch.slot_index.window == window] - row)
        .abs()
        .max(dim=1)[0]
        .min()
        for window, row in zip(
            some.slot_index.window.tolist(), some.graphs.summary, strict=True
        )
    ]
    assert max(near) < 1e-5
    places = zip(
        some.slot_index.window.tolist(), some.slot_index.slot.tolist(), strict=True
    )
    assert set(places) <= set(every)


def test_lost_readings_are_not_in_the_batch(dataset):
    def count(config):
        return len(make_builder(dataset, config).build(32, 1, 1, rng()).summary)

    whole = count(NO_AUGMENTATION)
    assert count(replace(NO_AUGMENTATION, halved=1.0)) == pytest.approx(
        whole / 2, rel=0.1
    )
    assert count(replace(NO_AUGMENTATION, lost=0.6)) == pytest.approx(
        0.7 * whole, rel=0.1
    )


@pytest.mark.parametrize("config", [NO_AUGMENTATION, VARIED])
def test_the_generator_decides_everything(dataset, config):
    one, same, other = (
        make_builder(dataset, config).build(6, 4, 9, rng(seed)) for seed in (1, 1, 2)
    )
    assert torch.equal(one.summary, same.summary)
    assert torch.equal(one.labels, same.labels)
    for field in fields(one.encoded.graphs):
        a, b = (getattr(batch.encoded.graphs, field.name) for batch in (one, same))
        assert torch.equal(a, b), field.name
    assert one.summary.shape != other.summary.shape or not torch.equal(
        one.summary, other.summary
    )


def test_data_sets_with_a_share_have_it_and_the_others_the_rest(dataset):
    """The two people belong to data sets of their own."""
    recordings = tuple(
        replace(one, metadata=replace(one.metadata, dataset=name))
        for one, name in zip(dataset.recordings, ("recorded", "others"), strict=True)
    )
    mixed = replace(dataset, recordings=recordings)
    shares = {"recorded": 0.8}
    sampler = build_sampler(mixed, ("none", "hold", "tap"), (0, 1), SLOTS, 0.0, shares)
    drawn = [sampler.draw_segment(1, rng(n)).recording for n in range(400)]
    assert np.mean(np.array(drawn) == 0) == pytest.approx(0.8, abs=0.06)
