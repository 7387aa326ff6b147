"""Tests of live logits: each reading gives what its whole window gives offline."""

import numpy as np
import pytest
import torch

from eskin.learn.batches import build_network_input, cut_windows
from eskin.learn.checkpoint import to_model, to_network
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import compute_log_probabilities
from eskin.learn.live_answers import gather_answers
from eskin.live import GraphBuilder, Recognizer, compute_probabilities
from eskin.live.graph import NO_HISTORY
from eskin.live.graph_builder import TouchNodes
from eskin.live.network import LogitStream
from eskin.touch import Reading
from helpers.live import (
    calibration_of,
    label,
    model_of,
    mounted,
    network,
    record,
    scans,
    two_hands,
    with_closing_layer,
)

pytestmark = pytest.mark.slow

# Skin, kind of model, rate [Hz] and indices of the scans that are lost.
SCENES = {
    "10 Hz": (("grid",), "pressure", 10, ()),
    "100 Hz": (("grid",), "pressure", 100, (240,)),
    "50 Hz with gaps": (("grid",), "pressure", 50, (120, 121, 125, *range(132, 160))),
    "not calibrated": (("grid", False), "pressure", 20, (50,)),
    "shear": (("grid", True, "shear"), "shear", 30, (75,)),
    "shear, not used": (("grid", True, "shear"), "pressure", 10, ()),
    "ur5, arm moving": (("ur5",), "pressure", 20, (55, 56)),
}


ALONE = [("ur5, arm moving", 0), ("shear", 0)]
"""Scenes for a network of the summary alone, whose live graphs have no neighbours."""


@pytest.mark.parametrize(("scene", "width"), [*((name, 8) for name in SCENES), *ALONE])
def test_stream_gives_the_logits_of_the_offline_windows(scene, width, tmp_path):
    skin, kind, rate, lost = SCENES[scene]
    on = mounted(*skin)
    net = network(kind, width=width)
    model = model_of(net)
    stream = scans(on, two_hands(on), rate, 4.6, lost)
    path = record(tmp_path / "two.mcap", on, stream, [label(2.3, 3.2, "stroke")])
    dataset = prepare([path], model.card.pipeline, model.card.graph)
    recognizer = Recognizer(model, on, calibration_of(on.skin))
    found = {}
    confirmed = set()
    for scan in stream:
        recognizer.push(scan)
        for key, logits in recognizer.logits.items():
            found.setdefault(key, []).append(logits)
        state = recognizer.state
        confirmed |= {touch.id for touch in (*state.open, *state.closed)}
    if on.skin.calibrated:
        found = {key: rows for key, rows in found.items() if key in confirmed}
    assert len(found) >= (3 if on.skin.calibrated else 1)
    counts = [len(rows) for rows in found.values()]
    assert counts == np.bincount(dataset.sequence).tolist()
    ends = np.arange(len(dataset.stamps))
    ends = np.unique(np.append(ends[:: max(1, rate // 10)], ends[-1]))
    windows = cut_windows(dataset, ends, dataset.starts[ends], net.config.slots)
    graphs = dataset.graphs.select(windows.rows)
    with torch.no_grad():
        offline = net(build_network_input(graphs, windows, net.shear)).numpy()
    assert offline.std(axis=0).max() > 0.1
    live = np.concatenate(list(found.values()))
    np.testing.assert_allclose(live[ends], offline, atol=1e-4)


@pytest.mark.parametrize("width", [0, 8])
def test_a_closing_layer_changes_the_answer_at_closing_alone(width):
    on = mounted()
    net = network(width=width)
    plain = model_of(net)
    models = [plain, with_closing_layer(plain), with_closing_layer(plain, 0.5)]
    stream = scans(on, two_hands(on), 50, 4.6)
    recognizers = [Recognizer(each, on, calibration_of(on.skin)) for each in models]
    detections = [[], [], []]
    differences = []
    for scan in stream:
        for recognizer, found in zip(recognizers, detections, strict=True):
            found += [each.record() for each in recognizer.push(scan)]
        first, *others = (each.classifier for each in recognizers)
        for key, logits in first.logits.items():
            for other in others:
                assert np.array_equal(other.logits[key], logits)
                assert np.array_equal(
                    other.probabilities[key], first.probabilities[key]
                )
            same, changed = (other.closing_probabilities[key] for other in others)
            assert np.array_equal(same, first.probabilities[key])
            differences.append(np.abs(changed - same).max())
    assert detections[0] == detections[1]
    assert max(differences) > 0.05


@pytest.mark.parametrize("calibrated", [True, False])
def test_closing_logits_of_a_stream_are_those_of_torch_offline(calibrated, tmp_path):
    on = mounted(calibrated=calibrated)
    model = with_closing_layer(model_of(network()), 0.5)
    stream = scans(on, two_hands(on), 20, 4.6)
    path = record(tmp_path / "two.mcap", on, stream, [label(2.3, 3.2, "stroke")])
    dataset = prepare([path], model.card.pipeline, model.card.graph)
    answers = gather_answers(model, dataset)
    net = to_network(model)
    ends = np.arange(len(dataset.stamps))
    scores = [
        compute_log_probabilities(each, dataset, ends, dataset.starts, closing=closing)
        for each in (answers, net)
        for closing in (False, True)
    ]
    np.testing.assert_allclose(scores[0], scores[2], atol=1e-4)
    np.testing.assert_allclose(scores[1], scores[3], atol=1e-4)
    assert np.abs(scores[2] - scores[3]).max() > 0.05
    assert all(
        np.array_equal(to_model(net, model.card).weights[name], weight)
        for name, weight in model.weights.items()
    )


def make_reading(on, n, taxels, rng):
    pressure = np.zeros(on.skin.count, np.float32)
    pressure[taxels] = rng.uniform(1, 50, len(taxels))
    shear = rng.normal(size=(on.skin.count, 2)).astype(np.float32)
    q = rng.uniform(-1, 1, len(on.robot.joint_names))
    valid = np.ones(on.skin.count, bool)
    return Reading(20_000_000 * n, pressure, valid, q, shear)


def choose_nodes(on, keys, rng):
    """Choose a few taxels for each of some sequences, none for two of them."""
    nodes = {}
    for key in keys:
        own = np.arange(key, on.skin.count, 20)
        taxels, earlier = (np.sort(rng.choice(own, n, replace=False)) for n in (6, 5))
        nodes[key] = TouchNodes(taxels, earlier, rng.uniform(0, 9, len(NO_HISTORY)))
    return nodes


def test_sequences_do_not_depend_on_others_at_once_or_before():
    """Also where many begin at once, or one ends and begins again."""
    on = mounted()
    rng = np.random.default_rng(2)
    model = model_of(network())
    count = 17
    together = LogitStream(model, GraphBuilder(on))
    alone = {key: LogitStream(model, GraphBuilder(on)) for key in range(1, count + 1)}
    results = []
    for n, most in enumerate((3, 8, count, 2, 0, 2, 8)):
        keys = rng.permutation(np.arange(1, most + 1)).tolist()
        nodes = choose_nodes(on, keys, rng)
        reading = make_reading(on, n, np.arange(on.skin.count), rng)
        together.compute_logits(reading, nodes)
        assert list(together.logits) == list(together.probabilities) == keys
        for key, stream in alone.items():
            own = {key: nodes[key]} if key in nodes else {}
            has_ended = stream.logits and not own
            stream.compute_logits(reading, own)
            if has_ended:
                alone[key] = LogitStream(model, stream.builder)
            for field in ("logits", "probabilities") if own else ():
                found = getattr(together, field)[key]
                assert np.array_equal(found, getattr(stream, field)[key])
                results.append((found, found.copy()))
    assert all(np.array_equal(found, then) for found, then in results)


def test_probabilities_are_a_softmax_that_does_not_overflow():
    logits = np.array([3.0, -1.0, 0.5], np.float32)
    powers = np.exp(logits.astype(np.float64) / 2.0)
    found = compute_probabilities(logits, 2.0)
    np.testing.assert_allclose(found, powers / powers.sum(), 1e-6)
    extreme = compute_probabilities(np.array([1e4, 0.0, -1e4], np.float32), 0.5)
    assert extreme.tolist() == [1.0, 0.0, 0.0]
