"""Tests of files written by earlier versions, which still open.

`tests/data/make_formats.py` of commit 6f03fd1 wrote them when their format was new.
"""

from pathlib import Path

import numpy as np
import pytest

from eskin.learn.checkpoint import to_network
from eskin.live import load_model
from eskin.recording import EventRecord, Label, Metadata, TruthRecord, read_recording

FORMATS = Path(__file__).parent / "data" / "formats"
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STAMPS = [START, START + 20_000_000, START + 40_000_000]


@pytest.fixture(scope="module")
def recording():
    return read_recording(FORMATS / "recording_1.mcap")


def test_header_of_a_recording_is_read(recording):
    assert (recording.robot_name, recording.joint_names) == ("table", ("a", "b"))
    notes = {"simulated": "true"}
    assert recording.metadata == Metadata("set", "ann", "morning", "five", notes)
    skin = recording.skin
    calibration = recording.calibration
    assert (skin.name, skin.count, skin.calibrated) == ("tiny", 6, True)
    assert skin.has_shear and skin.link_names == ("table",)
    assert [patch.id for patch in skin.patches] == ["grid"]
    assert skin.rows.tolist() == [0, 0, 0, 1, 1, 1]
    assert skin.columns.tolist() == [0, 1, 2, 0, 1, 2]
    positions = [(x, y, 0) for y in (-0.005, 0.005) for x in (-0.01, 0, 0.01)]
    np.testing.assert_allclose(skin.positions, positions, atol=1e-9)
    assert skin.normals.tolist() == [[0.0, 0.0, 1.0]] * 6
    np.testing.assert_allclose(skin.areas, 1e-4)
    np.testing.assert_allclose(calibration.gain, np.linspace(0.1, 0.15, 6))
    assert (calibration.full_scale, calibration.shear_gain) == (4095, 0.5)
    assert calibration.shear_rest == 128


def test_scans_of_a_recording_are_read(recording):
    assert (recording.count, recording.truncated) == (3, False)
    arrays = recording.arrays()
    numbers = np.arange(6)
    assert arrays.stamps.tolist() == STAMPS
    assert arrays.q.tolist() == [[0.5, 0.0], [0.5, -0.25], [0.5, -0.5]]
    assert arrays.shear is not None
    for n in range(3):
        assert arrays.counts[n].tolist() == (100 * n + numbers).tolist()
        assert arrays.received[n].tolist() == (numbers != n).tolist()
        assert arrays.shear[n, :, 0].tolist() == (128 + numbers).tolist()
        assert arrays.shear[n, :, 1].tolist() == (128 - n - numbers).tolist()


def test_labels_detections_events_and_truth_of_a_recording_are_read(recording):
    first, _, last = STAMPS
    auto = Label(first, last, "stroke", "auto")
    assert recording.labels == (Label(first, last, "poke"), auto)
    [found] = recording.detections
    assert (found.stamp, found.onset, found.end) == (last, first, STAMPS[1])
    assert (found.gesture, found.confidence, found.peak_force) == ("poke", 0.875, 2.5)
    assert (found.link, found.patch) == ("table", "grid")
    assert found.p_world == (0.25, 0.5, 0.75)
    assert (found.n_world, found.direction_world) == ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    lost = EventRecord(STAMPS[1], "lost", "patch grid is lost", "grid", row=1)
    assert recording.events == (lost,)
    names = ("poke", "tip", "table")
    place = (0.25, -0.5, 0.0)
    assert list(recording.truths()) == [
        TruthRecord(stamp, 7, *names, 1.5 + n, 2e-4, place)
        for n, stamp in enumerate(STAMPS)
    ]


def test_card_and_weights_of_a_model_are_read():
    model = load_model(FORMATS / "model_1.safetensors")
    card = model.card
    assert (card.vocabulary, card.kind) == (("none", "poke", "stroke"), "pressure")
    sizes = ("width", "layers", "channels", "dropout", "slots")
    assert [getattr(card.network, size) for size in sizes] == [4, 1, 4, 0.125, 100]
    graph = card.graph
    decision = card.decision
    assert (graph.fixed, graph.live, graph.live_reach) == (6, 2, 0.03125)
    assert (decision.threshold, decision.least) == (0.75, 0.25)
    assert decision.thresholds == {"poke": 0.5}
    assert (card.temperature, card.training) == (1.5, {"seed": "3"})
    assert (card.data_digest, card.metrics["accuracy"]) == ("ab12", 0.5)
    assert np.isnan(card.metrics["worst"])
    values = np.arange(-3, 4, dtype=np.float32) / 8
    weights = to_network(model).state_dict()
    assert set(weights) == set(model.weights)
    for name, weight in weights.items():
        expected = np.resize(values, model.weights[name].shape)
        assert np.array_equal(weight.numpy(), expected), name
