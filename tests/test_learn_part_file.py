"""Prepared recordings on disk: the same to the bit, made once, whole or not at all."""

from dataclasses import fields, replace

import numpy as np
import pytest

from eskin.graph import GraphBatch, GraphConfig, compute_summary
from eskin.learn import prepared_recording
from eskin.learn.dataset import Dataset, prepare
from eskin.learn.ground_truth import TouchLabel
from eskin.learn.prepared_recording import (
    compute_pack_key,
    load_prepared,
    pack_recording,
    prepare_recording,
    save_prepared,
)
from eskin.recording import read_recording
from eskin.touch import ContactConfig, PipelineConfig
from helpers.clips import generated
from helpers.learning import record

PIPELINE, GRAPH = PipelineConfig(), GraphConfig()


def assert_same_values(one: GraphBatch, other: GraphBatch) -> None:
    """Equal to the last bit; whole numbers may be narrower."""
    for field in fields(GraphBatch):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert np.array_equal(a, b), field.name
        assert a.dtype.kind == b.dtype.kind, field.name
        assert a.dtype == b.dtype or a.dtype.kind == "i", field.name


def assert_same_dataset(one: Dataset, other: Dataset) -> None:
    assert_same_values(one.graphs, other.graphs)
    for name in ("stamps", "sequence", "recording", "starts"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for name in ("gestures", "segments", "missed", "clips", "vocabulary"):
        assert getattr(one, name) == getattr(other, name), name
    paths = [[r.path for r in dataset.recordings] for dataset in (one, other)]
    assert paths[0] == paths[1]


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """A real recording and a generated one."""
    folder = tmp_path_factory.mktemp("recordings")
    real = record(folder / "real.mcap", calibrated=True)
    return [real, *generated(folder / "set")]


@pytest.mark.parametrize("kind", ["pressure", "shear"])
@pytest.mark.parametrize(
    "fits", [None, (), (TouchLabel(3, "poke", "tip"), None, TouchLabel(4, "rub", ""))]
)
def test_a_part_is_read_as_it_was_written(tmp_path, kind, fits):
    recording = read_recording(record(tmp_path / "a.mcap", kind=kind))
    part = replace(prepare_recording(recording, PIPELINE, GRAPH), touches=fits)
    assert part.graphs.shear.any() == (kind == "shear")
    save_prepared(tmp_path / "a.npz", part)
    read = load_prepared(tmp_path / "a.npz")
    assert_same_values(read.graphs, part.graphs)
    assert np.array_equal(read.stamps, part.stamps)
    assert np.array_equal(read.sequence, part.sequence)
    assert read.touches == fits


def test_a_part_without_rows_is_read_as_it_was_written(tmp_path):
    quiet = read_recording(record(tmp_path / "a.mcap", (), calibrated=True))
    part = prepare_recording(quiet, PIPELINE, GRAPH)
    save_prepared(tmp_path / "a.npz", part)
    assert_same_values(load_prepared(tmp_path / "a.npz").graphs, part.graphs)


def test_packed_recordings_give_the_same_data_set_to_the_bit(paths, tmp_path):
    plain = prepare(paths)
    made, found = (prepare(paths, pack=tmp_path / "pack") for _ in range(2))
    for packed in (made, found):
        assert_same_dataset(packed, plain)
    few = np.arange(0, plain.graphs.count, 7)
    one, other = (compute_summary(d.graphs.select(few), False) for d in (plain, found))
    assert np.array_equal(one, other)


def test_a_recording_is_prepared_once_whatever_its_name(paths, tmp_path, monkeypatch):
    pack = tmp_path / "pack"
    first = pack_recording(paths[0], pack, PIPELINE, GRAPH)

    def never(*args) -> None:
        raise AssertionError("prepared in vain")

    monkeypatch.setattr(prepared_recording, "prepare_recording", never)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(paths[0].read_bytes())
    assert pack_recording(copy, pack, PIPELINE, GRAPH) == first
    assert list(pack.iterdir()) == [first]


def test_other_bytes_or_settings_are_another_part(paths):
    contacts = PipelineConfig(contacts=ContactConfig(on=9.0, off=8.0))
    keys = [
        compute_pack_key(paths[0], PIPELINE, GRAPH),
        compute_pack_key(paths[1], PIPELINE, GRAPH),
        compute_pack_key(paths[0], contacts, GRAPH),
        compute_pack_key(paths[0], PIPELINE, GraphConfig(live=3)),
        compute_pack_key(paths[0], PIPELINE, GRAPH.without_shear()),
        compute_pack_key(paths[0], PIPELINE, GraphConfig(posed=False)),
    ]
    assert len(set(keys)) == len(keys)
    assert keys[0] == compute_pack_key(paths[0], PipelineConfig(), GraphConfig())


def test_a_part_that_cannot_be_written_leaves_nothing(paths, tmp_path, monkeypatch):
    def full(file, **arrays) -> None:
        file.write_bytes(b"half")
        raise OSError("no space left")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(OSError, match="no space"):
        pack_recording(paths[0], tmp_path / "pack", PIPELINE, GRAPH)
    assert not list((tmp_path / "pack").iterdir())
