"""What comes out of a stream is what the whole window gives offline."""

import numpy as np
import pytest
import torch
from benchmarks.live_parts import SequenceWindow, compute_features
from numba.core.runtime import rtsys
from numba.core.runtime._nrt_python import memsys_disable_stats, memsys_enable_stats

from eskin.graph import NO_HISTORY, GraphBuilder, TouchNodes, pack_touch_nodes
from eskin.learn.dataset import prepare
from eskin.learn.windows import build_network_input, cut_windows
from eskin.live import Network, Recognizer, compute_probabilities
from eskin.live.logits import SEQUENCES, LogitStream
from eskin.live.step_kernels import step
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
)

SCENES = {
    "grid at 10 Hz": (("grid",), "pressure", 10, ()),
    "grid at 50 Hz": (("grid",), "pressure", 50, ()),
    "grid at 200 Hz": (("grid",), "pressure", 200, (480,)),
    "grid with readings dropped": (
        ("grid",),
        "pressure",
        50,
        (120, 121, 140, 150, 151),
    ),
    "grid with a gap": (("grid",), "pressure", 50, tuple(range(140, 175))),
    "not calibrated": (("grid", False), "pressure", 20, (50,)),
    "shear": (("grid", True, "shear"), "shear", 50, (133,)),
    "shear, not used": (("grid", True, "shear"), "pressure", 50, ()),
    "ur5, arm moving": (("ur5",), "pressure", 30, (80, 95)),
}


def live_logits(model, on, stream):
    """Logits of every sequence in order of appearance, one row a reading."""
    recognizer = Recognizer(model, on, calibration_of(on.skin))
    found = {}
    for scan in stream:
        recognizer.push(scan)
        for key, logits in recognizer.logits.items():
            found.setdefault(key, []).append(logits)
    return [np.array(rows) for rows in found.values()]


@pytest.mark.parametrize("scene", SCENES)
def test_a_stream_gives_the_logits_of_the_offline_windows(scene, tmp_path):
    place, kind, rate, dropped = SCENES[scene]
    on = mounted(*place)
    stream = scans(on, two_hands(on), rate, 4.9, dropped)
    path = record(tmp_path / "two.mcap", on, stream, [label(2.3, 3.2, "stroke")])
    net = network(kind)
    model = model_of(net)
    dataset = prepare([path], model.card.pipeline, model.card.graph)
    live = live_logits(model, on, stream)
    assert len(live) >= (3 if on.skin.calibrated else 1)
    assert [len(rows) for rows in live] == np.bincount(dataset.sequence).tolist()
    ends = np.arange(len(dataset.stamps))
    ends = np.unique(np.append(ends[:: max(1, rate // 10)], ends[-1]))
    windows = cut_windows(dataset, ends, dataset.starts[ends], net.config.slots)
    with torch.no_grad():
        graphs = dataset.graphs.select(windows.rows)
        offline = net(build_network_input(graphs, windows, net.shear)).numpy()
    assert offline.std(axis=0).max() > 0.1
    np.testing.assert_allclose(np.concatenate(live)[ends], offline, atol=1e-4)


def felt(on, count, rng):
    """A touch of so many taxels at once."""
    return np.sort(rng.permutation(on.skin.count)[:count])


def reading_of(on, n, taxels, rng):
    pressure = np.zeros(on.skin.count, np.float32)
    pressure[taxels] = rng.uniform(1, 50, len(taxels))
    shear = rng.normal(size=(on.skin.count, 2)).astype(np.float32)
    q = rng.uniform(-1, 1, len(on.robot.joint_names))
    valid = np.ones(on.skin.count, bool)
    return Reading(20_000_000 * n, pressure, valid, q, shear)


@pytest.mark.parametrize("kind", ["pressure", "shear"])
def test_a_step_is_graph_then_features_then_window(kind):
    """To the bit, through touches that need more memory than any before."""
    on, rng = mounted("ur5"), np.random.default_rng(0)
    model = model_of(network(kind), temperature=1.7)
    stream = LogitStream(model, GraphBuilder(on))
    builder, live = GraphBuilder(on), Network(model)
    window, earlier = SequenceWindow(live.heads, live.slots), np.empty(0, np.int64)
    memory = stream.workspace
    for n, count in enumerate((5, 40, 0, 900, 3, 400)):
        taxels = felt(on, count, rng)
        reading = reading_of(on, n, taxels, rng)
        builder.advance(reading, taxels)
        one = TouchNodes(taxels, earlier, rng.uniform(0, 9, len(NO_HISTORY)))
        stream.push(reading, pack_touch_nodes({7: one}))
        features = compute_features(live, builder.build(*one))
        want = window.push(reading.stamp, features)
        assert np.array_equal(stream.logits[7], want)
        assert np.array_equal(stream.probabilities[7], compute_probabilities(want, 1.7))
        earlier = taxels
    assert stream.workspace is not memory


def test_a_step_takes_no_memory_in_compiled_code():
    on, rng = mounted("ur5"), np.random.default_rng(1)
    stream = LogitStream(model_of(network("shear")), GraphBuilder(on))
    taxels, out = felt(on, 60, rng), np.empty((2, 2, 4), np.float32)
    reading = reading_of(on, 0, taxels, rng)
    one = TouchNodes(taxels, taxels, NO_HISTORY)
    nodes = pack_touch_nodes({1: one, 2: one})
    stream.push(reading, nodes)
    given = (stream.parts, stream.packed_pool, nodes.packed)
    given += reading.pressure, reading.shear
    given += stream.builder.T_world_link, stream.builder.time_step
    memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        for n in range(30):
            step(*given, 3 * n + 3, out)
        after = rtsys.get_allocation_stats()
    finally:
        memsys_disable_stats()
    assert after.alloc - before.alloc == 30 * 4  # a handle for each array given
    assert after.free - before.free == 30 * 4


def some_nodes(on, keys, rng):
    """A few taxels for each of some sequences, none of which is another's."""
    nodes = {}
    for key in keys:
        own = np.arange(key, on.skin.count, 20)
        taxels, earlier = (np.sort(rng.choice(own, n, replace=False)) for n in (6, 5))
        nodes[key] = TouchNodes(taxels, earlier, rng.uniform(0, 9, len(NO_HISTORY)))
    return nodes


def test_sequences_side_by_side_give_what_each_gives_alone():
    """Through more of them at once than there were rows for."""
    on, rng = mounted("ur5"), np.random.default_rng(2)
    model, count = model_of(network()), 2 * SEQUENCES + 1
    together = LogitStream(model, GraphBuilder(on))
    alone = {key: LogitStream(model, GraphBuilder(on)) for key in range(1, count + 1)}
    for n, most in enumerate((3, SEQUENCES, count, 2, SEQUENCES)):
        keys = rng.permutation(np.arange(1, most + 1)).tolist()
        nodes = some_nodes(on, keys, rng)
        reading = reading_of(on, n, np.arange(on.skin.count), rng)
        together.push(reading, pack_touch_nodes(nodes))
        assert list(together.logits) == list(together.probabilities) == keys
        for key, stream in alone.items():
            own = {key: nodes[key]} if key in nodes else {}
            stream.push(reading, pack_touch_nodes(own))
            for found in ("logits", "probabilities"):
                want = getattr(stream, found)
                assert list(want) == list(own)
                if own:
                    got = getattr(together, found)[key]
                    assert np.array_equal(got, want[key])
    assert len(together.pool.keys) > SEQUENCES


def test_a_sequence_that_has_ended_leaves_nothing_behind():
    """Whoever comes next starts afresh in its row, by another key or by the same."""
    on, rng = mounted("ur5"), np.random.default_rng(3)
    model, last = model_of(network()), 0
    used, fresh = (LogitStream(model, GraphBuilder(on)) for _ in range(2))
    for n, key in enumerate((1, 1, 2, 2, 0, 2, 2)):
        nodes = some_nodes(on, [key] if key else [], rng)
        reading = reading_of(on, n, felt(on, 9, rng), rng)
        if key != last:
            fresh = LogitStream(model, fresh.builder)
        for stream in (used, fresh):
            stream.push(reading, pack_touch_nodes(nodes))
        assert list(used.logits) == list(nodes)
        if key:
            assert np.array_equal(used.logits[key], fresh.logits[key])
        last = key
    assert np.count_nonzero(used.pool.slots > 0) == 1


def test_what_was_told_does_not_change_later():
    on, rng = mounted("ur5"), np.random.default_rng(4)
    stream = LogitStream(model_of(network()), GraphBuilder(on))
    told = []
    for n in range(4):
        nodes = some_nodes(on, [1, 2], rng)
        stream.push(reading_of(on, n, felt(on, 9, rng), rng), pack_touch_nodes(nodes))
        values = [*stream.logits.values(), *stream.probabilities.values()]
        told.append((values, np.copy(values)))
    for values, then in told:
        assert np.array_equal(values, then)


def test_probabilities_are_those_of_a_softmax_and_never_overflow():
    logits = np.array([3.0, -1.0, 0.5], np.float32)
    powers = np.exp(logits.astype(np.float64) / 2.0)
    np.testing.assert_allclose(
        compute_probabilities(logits, 2.0), powers / powers.sum(), 1e-6
    )
    extreme = compute_probabilities(np.array([1e4, 0.0, -1e4], np.float32), 0.5)
    assert extreme.tolist() == [1.0, 0.0, 0.0]
