"""Tests of prepared recordings: the sequences seen live, kept in files to the bit."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.learn import prepared_recording
from eskin.learn.dataset import prepare
from eskin.learn.ground_truth import TouchLabel, read_clips
from eskin.learn.prepared_recording import (
    compute_pack_key,
    load_prepared,
    pack_recording,
    prepare_recording,
    save_prepared,
)
from eskin.live import GraphBatch, GraphConfig, GraphStream, join_graphs
from eskin.recording import read_recording
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.touch import ContactConfig, PipelineConfig, TouchPipeline
from helpers.clips import generated
from helpers.graphs import assert_same
from helpers.learning import record
from helpers.live import Press, mounted, scans
from helpers.live import record as record_scans

pytestmark = pytest.mark.slow

PIPELINE = PipelineConfig()
GRAPH = GraphConfig()


def prepare_file(path, graph=GRAPH):
    return prepare_recording(read_recording(path), PIPELINE, graph)


def assert_same_values(one: GraphBatch, other: GraphBatch) -> None:
    """Check that graphs are equal to the bit; whole numbers may be narrower."""
    for name in GraphBatch._fields:
        a = getattr(one, name)
        b = getattr(other, name)
        assert np.array_equal(a, b), name
        assert a.dtype.kind == b.dtype.kind, name
        assert a.dtype == b.dtype or a.dtype.kind == "i", name


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """Return the path of a recording of a real skin."""
    return record(tmp_path_factory.mktemp("real") / "real.mcap", calibrated=True)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """Return the path of a generated recording."""
    [path] = generated(tmp_path_factory.mktemp("set"), clips=3)
    return path


@pytest.mark.parametrize(("calibrated", "count"), [(True, 3), (False, 1)])
def test_rows_are_the_graphs_of_the_stream_in_sequences(tmp_path, calibrated, count):
    """Two touches that begin together, then one more."""
    on = mounted(calibrated=calibrated)
    presses = [(2.4, 3.0, 62, 62), (2.4, 2.8, 87, 87), (3.7, 4.0, 205, 200)]
    stream = scans(on, [Press(*one) for one in presses], 25, 4.4)
    recording = read_recording(record_scans(tmp_path / "a.mcap", on, stream))
    on = MountedSkin(recording.skin, load_robot("table"))
    config = GraphConfig(fixed=5, live=2)
    pipeline = TouchPipeline(on, recording.calibration)
    graphs = GraphStream(on, config)
    live = {}
    for scan in recording.scans():
        for key, graph in graphs.build_graphs(pipeline.push_scan(scan)).items():
            live.setdefault(key, []).append((scan.stamp, graph))
    found = prepare_file(recording.path, config)
    rows = [row for key in sorted(live) for row in live[key]]
    assert found.stamps.tolist() == [stamp for stamp, _ in rows]
    assert_same(found.graphs, join_graphs([graph for _, graph in rows]))
    lengths = [len(live[key]) for key in sorted(live)]
    assert found.sequence.tolist() == np.repeat(np.arange(count), lengths).tolist()


def test_touch_that_was_never_confirmed_is_left_out(tmp_path):
    """A taxel whose counts jump and stay is not recognised live either."""
    on = mounted(calibrated=True)
    stream = list(scans(on, [Press(2.4, 3.0, 62, 62)], 25, 4.4))
    for n, scan in enumerate(stream[90:], 90):
        counts = scan.counts.copy()
        counts[200] += 400
        stream[n] = replace(scan, counts=counts)
    path = record_scans(tmp_path / "a.mcap", on, stream)
    recording = read_recording(path)
    pipeline = TouchPipeline(on, recording.calibration)
    states = [pipeline.push_scan(scan) for scan in recording.scans()]
    assert max(touch.id for state in states for touch in state.tracking.open) == 2
    found = prepare_file(path)
    assert found.sequence.max() == 0
    assert found.stamps[-1] < stream[90].stamp


def test_each_sequence_of_a_clip_is_of_the_touch_that_was_made(simulated):
    found = prepare_file(simulated)
    clips = read_clips(simulated)
    assert found.touches is not None
    assert len({touch.touch for touch in found.touches if touch}) == len(clips) > 0
    for number, touch in enumerate(found.touches):
        stamps = found.stamps[found.sequence == number]
        [clip] = [c for c in clips if c.start <= stamps[0] < c.end]
        assert touch is not None
        assert (touch.gesture, touch.kind) == (clip.gesture, "tip")
        assert (np.diff(stamps) > 0).all()


def test_recording_of_a_real_skin_holds_no_truth(real):
    assert prepare_file(real).touches is None


@pytest.mark.parametrize(
    ("kind", "touches"),
    [
        ("pressure", None),
        ("shear", (TouchLabel(3, "poke", "tip"), None, TouchLabel(4, "rub", ""))),
    ],
)
def test_prepared_recording_is_read_as_it_was_written(tmp_path, kind, touches):
    path = record(tmp_path / "a.mcap", ["hold"], kind=kind)
    prepared = replace(prepare_file(path), touches=touches)
    assert prepared.graphs.shear.any() == (kind == "shear")
    save_prepared(tmp_path / "a.npz", prepared)
    read = load_prepared(tmp_path / "a.npz")
    assert_same_values(read.graphs, prepared.graphs)
    assert np.array_equal(read.stamps, prepared.stamps)
    assert np.array_equal(read.sequence, prepared.sequence)
    assert read.touches == touches


def test_recording_without_touch_has_no_rows(tmp_path, real):
    quiet = prepare_file(record(tmp_path / "a.mcap", (), calibrated=True))
    assert (quiet.graphs.size, len(quiet.stamps), len(quiet.sequence)) == (0, 0, 0)
    save_prepared(tmp_path / "a.npz", quiet)
    read = load_prepared(tmp_path / "a.npz").graphs
    touched = prepare_file(real).graphs
    assert_same(join_graphs([read, touched]), touched)


def test_packed_recordings_give_the_same_data_set_to_the_bit(real, simulated, tmp_path):
    paths = [real, simulated]
    plain = prepare(paths)
    for _ in ("written", "read"):
        packed = prepare(paths, pack=tmp_path / "pack")
        assert_same_values(packed.graphs, plain.graphs)
        for name in ("stamps", "sequence", "recording", "starts"):
            assert np.array_equal(getattr(packed, name), getattr(plain, name)), name
        for name in ("gestures", "segments", "missed", "clips", "vocabulary"):
            assert getattr(packed, name) == getattr(plain, name), name
        assert [r.path for r in packed.recordings] == paths


def test_recording_is_prepared_once_whatever_its_name(real, tmp_path, monkeypatch):
    pack = tmp_path / "pack"
    first = pack_recording(real, pack, PIPELINE, GRAPH)
    monkeypatch.setattr(prepared_recording, "prepare_recording", pytest.fail)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(real.read_bytes())
    assert pack_recording(copy, pack, PIPELINE, GRAPH) == first
    assert list(pack.iterdir()) == [first]


def test_other_bytes_and_settings_are_packed_in_other_files(real, simulated):
    contacts = PipelineConfig(contacts=ContactConfig(on=9.0, off=8.0))
    keys = [
        compute_pack_key(real, PIPELINE, GRAPH),
        compute_pack_key(simulated, PIPELINE, GRAPH),
        compute_pack_key(real, contacts, GRAPH),
        compute_pack_key(real, PIPELINE, GraphConfig(live=3)),
        compute_pack_key(real, PIPELINE, GRAPH.without_shear()),
        compute_pack_key(real, PIPELINE, GraphConfig(posed=False)),
    ]
    assert len(set(keys)) == len(keys)
    assert keys[0] == compute_pack_key(real, PipelineConfig(), GraphConfig())
