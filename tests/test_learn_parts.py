"""One recording made ready: the sequences that the recogniser would see live."""

import numpy as np
import pytest

from eskin.graph import GraphConfig, GraphStream, join_graphs
from eskin.learn.ground_truth import find_runs, read_clips
from eskin.learn.prepared_recording import PreparedRecording, prepare_recording
from eskin.recording import read_recording
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from eskin.touch import PipelineConfig, TouchPipeline
from helpers.clips import Elsewhere, generated
from helpers.graphs import assert_same
from helpers.learning import record
from helpers.live import Press, mounted, scans
from helpers.live import record as record_scans

GRAPH = GraphConfig(fixed=5, live=2)


def part(path) -> PreparedRecording:
    return prepare_recording(read_recording(path), PipelineConfig(), GRAPH)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A generated recording, and what is made of it."""
    [path] = generated(tmp_path_factory.mktemp("set"))
    return path, part(path)


def two_at_once(path, calibrated):
    """Two touches far apart that begin together, then one more."""
    on = mounted(calibrated=calibrated)
    presses = [
        Press(2.4, 3.0, 62, 62),
        Press(2.4, 2.8, 87, 87),
        Press(3.7, 4.0, 205, 200),
    ]
    return record_scans(path, on, scans(on, presses, 25, 4.4))


@pytest.mark.parametrize("calibrated", [True, False])
def test_the_rows_are_the_graphs_of_the_stream_in_sequences(tmp_path, calibrated):
    recording = read_recording(two_at_once(tmp_path / "a.mcap", calibrated))
    on = MountedSkin(recording.skin, load_robot("table"))
    pipeline = TouchPipeline(on, recording.calibration)
    stream, live = GraphStream(on, GRAPH), {}
    for scan in recording.scans():
        for key, graph in stream.push(pipeline.push(scan)).items():
            live.setdefault(key, []).append((scan.stamp, graph))
    found = part(recording.path)
    rows = [row for key in sorted(live) for row in live[key]]
    assert found.stamps.tolist() == [stamp for stamp, _ in rows]
    assert_same(found.graphs, join_graphs([graph for _, graph in rows]))
    lengths = [last - first for first, last in find_runs(found.sequence[:, None])]
    assert lengths == [len(live[key]) for key in sorted(live)]
    assert len(live) == (3 if calibrated else 1)


def test_every_touch_of_a_clip_is_the_one_that_was_made(simulated):
    path, found = simulated
    clips = read_clips(path)
    assert found.touches is not None
    assert len(found.touches) == len(clips) > 0
    for number, (first, end) in enumerate(find_runs(found.sequence[:, None])):
        [clip] = [c for c in clips if c.start <= found.stamps[first] < c.end]
        fit = found.touches[number]
        assert fit is not None
        assert (fit.gesture, fit.kind) == (clip.gesture, "tip")
        assert (np.diff(found.stamps[first:end]) > 0).all()
    assert len({fit.touch for fit in found.touches if fit}) == len(clips)


def test_what_no_touch_truly_made_is_fitted_to_none(tmp_path):
    [path] = generated(tmp_path / "set", Elsewhere)
    found = part(path)
    assert len(found.stamps) > 0
    assert found.touches == (None,) * (found.sequence.max() + 1)


def test_a_recording_that_does_not_know_the_truth_has_no_fits(tmp_path):
    assert part(record(tmp_path / "a.mcap", calibrated=True)).touches is None


def test_a_recording_without_touch_is_a_part_without_rows(tmp_path):
    quiet = part(record(tmp_path / "quiet.mcap", (), calibrated=True))
    assert (quiet.graphs.count, len(quiet.stamps), len(quiet.sequence)) == (0, 0, 0)
    other = part(record(tmp_path / "a.mcap", calibrated=True))
    assert_same(join_graphs([quiet.graphs, other.graphs]), other.graphs)
