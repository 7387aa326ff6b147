"""Aging of recordings: the same touches as another, worn skin measures them."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.learn.dataset import prepare
from eskin.learn.prepared_recording import compute_pack_key
from eskin.learn.recording_transforms import Aging, AgingConfig
from eskin.learn.training import Trainer
from eskin.live import GraphConfig
from eskin.recording import read_recording
from eskin.touch import PipelineConfig
from helpers.clips import generated
from helpers.learning import TINY, record, record_people

pytestmark = pytest.mark.slow

UNCHANGED = AgingConfig(
    patch_gain=0.0, taxel_gain=0.0, exponent=0.0, unfelt=0.0, noise=0.0
)


def stack_counts(scans) -> np.ndarray:
    return np.array([scan.counts for scan in scans])


@pytest.fixture(scope="module", params=["linear", "divider"])
def recording(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("aging")
    if request.param == "divider":
        return read_recording(generated(folder / "set")[0])
    return read_recording(record(folder / "a.mcap", calibrated=True))


def test_zero_aging_keeps_the_counts(recording):
    rest = np.median(stack_counts(list(recording.scans())[:50]), axis=0)
    was, now = (
        stack_counts(scans)
        for scans in (recording.scans(), Aging(UNCHANGED, 0).transform_scans(recording))
    )
    touched = was > rest
    assert touched.any()
    # Rounding takes at most one count; counts below rest are raised to it.
    assert np.abs(now - was)[touched].max() <= 1
    assert np.abs(now - np.maximum(was, rest)).max() <= 1


def test_a_dead_zone_only_lowers_counts(recording):
    insensitive = Aging(replace(UNCHANGED, unfelt=20.0), 0)
    was = stack_counts(Aging(UNCHANGED, 0).transform_scans(recording))
    now = stack_counts(insensitive.transform_scans(recording))
    assert (now <= was).all()
    assert (now < was).any()


def test_the_seed_alone_decides_the_skin(recording):
    one, again, other = (
        stack_counts(Aging(AgingConfig(), number).transform_scans(recording))
        for number in (0, 0, 1)
    )
    assert np.array_equal(one, again)
    assert (one != other).any()


def test_only_counts_change(recording):
    for was, now in zip(
        recording.scans(),
        Aging(AgingConfig(), 0).transform_scans(recording),
        strict=True,
    ):
        assert now.stamp == was.stamp
        assert np.array_equal(now.received, was.received)
        assert np.array_equal(now.q, was.q)
        assert now.counts.dtype == was.counts.dtype
        assert np.array_equal(now.counts[~was.received], was.counts[~was.received])


def test_counts_stay_within_the_converter(recording):
    strong = AgingConfig(patch_gain=5.0, noise=1.0)
    now = stack_counts(Aging(strong, 0).transform_scans(recording))
    assert now.min() == 0
    assert now.max() == recording.calibration.full_scale


def test_a_dataset_holds_each_recording_on_every_skin(tmp_path):
    paths = generated(tmp_path / "set", clips=2)
    versions = [None, Aging(AgingConfig(), 0)]
    alone = prepare(paths)
    plain = prepare(paths, transforms=versions)
    packed = prepare(paths, transforms=versions, pack=tmp_path / "pack")
    assert len(plain.recordings) == len(plain.clips) == 2 * len(paths)
    own = plain.recording < len(paths)
    assert np.array_equal(plain.stamps[own], alone.stamps)
    assert set(plain.recording[~own]) <= set(range(len(paths), 2 * len(paths)))
    for name in ("stamps", "sequence", "recording"):
        assert np.array_equal(getattr(packed, name), getattr(plain, name)), name
    assert packed.segments == plain.segments


def test_held_out_recordings_are_held_out_on_every_skin(tmp_path):
    paths = record_people(tmp_path, ("ann", "bob", "cleo", "dan"))
    dataset = prepare(paths, transforms=[None, Aging(AgingConfig(), 0)])
    trainer = Trainer(dataset, dataset.vocabulary, replace(TINY, validation=0.5))
    trained_on = {s.recording for s in list_segments(trainer.batches)}
    held = {s.recording for s in list_segments(trainer.held_out)}
    assert len(trained_on) == 2 * len(trainer.holdout.train) == 4
    assert held == trainer.holdout.held and max(held) < len(paths)
    assert not {index % len(paths) for index in trained_on} & held


def list_segments(builder):
    classes = builder.sampler.classes.values()
    return [s for datasets in classes for found in datasets.values() for s in found]


def test_every_aging_has_its_own_pack_key(tmp_path):
    path = record(tmp_path / "a.mcap")
    skins = [
        None,
        Aging(AgingConfig(), 0),
        Aging(AgingConfig(), 1),
        Aging(AgingConfig(unfelt=1.0), 0),
    ]
    keys = {
        compute_pack_key(path, PipelineConfig(), GraphConfig(), skin) for skin in skins
    }
    assert len(keys) == len(skins)
