"""Tests of `eskin export`: other programs open what it writes."""

import contextlib
import io
import json
import re
import sys

import numpy as np
import onnxruntime
import pyarrow.parquet as parquet
import pytest
import torch
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from eskin.cli.main import run
from eskin.exports.rosbag import write_bag
from eskin.learn.checkpoint import to_network
from eskin.learn.nn import (
    NetworkInput,
    SlotIndex,
    build_graph_tensors,
)
from eskin.learn.onnx_export import NAMES, StepInput, export_onnx
from eskin.live import SLOT_NS, GraphStream, Recognizer, load_model
from eskin.recording import Label, read_recording
from eskin.registry import advise_install
from eskin.touch import TouchPipeline
from helpers.cli import assert_refused, call, call_json
from helpers.graphs import random_graph
from helpers.live import (
    START,
    Press,
    calibration_of,
    model_of,
    mounted,
    network,
    record,
    scans,
)

pytestmark = pytest.mark.slow

SECOND = 1_000_000_000
PRESSES = [Press(2.3, 2.7, 65, 65), Press(3.6, 4.2, 100, 103)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """The path of a recording of two presses, the first of which is labelled."""
    path = tmp_path_factory.mktemp("export") / "touched.mcap"
    stream = scans(mounted(), PRESSES, 50, 5.2)
    labels = [Label(START + 23 * SECOND // 10, START + 27 * SECOND // 10, "poke")]
    return record(path, mounted(), stream, labels), stream


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The path of the shipped weights as ONNX, and what the command printed."""
    path = tmp_path_factory.mktemp("onnx") / "ur5.onnx"
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert run(["export", "ur5", "--onnx", str(path), "--json"]) == 0
    return path, json.loads(out.getvalue().splitlines()[-1])


def open_session(path):
    return onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])


def feed(graph, window, present, shear=False):
    """Return the inputs of a step from the graph of one reading."""
    tensors = build_graph_tensors(graph, shear)
    parts = [getattr(tensors, name) for name in NAMES[:9]]
    one = StepInput(*parts, torch.as_tensor(window), torch.as_tensor(present))
    return {name: getattr(one, name).numpy() for name in NAMES}


@pytest.fixture(scope="module")
def exported_shear(tmp_path_factory):
    """A model of skins with shear, and its path as ONNX."""
    path = tmp_path_factory.mktemp("onnx") / "shear.onnx"
    model = model_of(network("shear", width=4, layers=1, channels=8))
    assert export_onnx(model, path) < 1e-4
    return model, path


@pytest.mark.parametrize("kind", ["pressure", "shear"])
def test_onnx_network_gives_logits_of_torch_on_contacts_of_any_size(
    exported, exported_shear, kind
):
    model, path = exported_shear
    if kind == "pressure":
        model = load_model("ur5")
        path = exported[0]
    session = open_session(path)
    net = to_network(model)
    rng = np.random.default_rng(5)
    slots = net.config.slots
    size = len(net.summary_mean) + 2 * net.config.width
    sizes = set()
    for nodes in np.linspace(0, 250, 25).astype(int).tolist():
        graph = random_graph(rng, nodes)
        inputs = feed(
            graph,
            np.zeros((slots, size), np.float32),
            np.zeros(slots, np.float32),
            kind == "shear",
        )
        [found] = session.run(["logits"], inputs)
        index = SlotIndex(torch.tensor([0]), torch.tensor([slots - 1]), 1)
        tensors = build_graph_tensors(graph, kind == "shear")
        with torch.no_grad():
            expected = net(NetworkInput(tensors, index))[0].numpy()
        np.testing.assert_allclose(found, expected, atol=1e-4, rtol=1e-5)
        sizes.add((len(inputs["forces"]), len(inputs["targets"])))
    assert len(sizes) > 20


def test_steps_of_onnx_network_give_probabilities_of_the_live_recogniser(exported):
    on = mounted()
    model = load_model("ur5")
    session = open_session(exported[0])
    card = model.card
    calibration = calibration_of(on.skin)
    live = Recognizer(model, on, calibration)
    pipeline = TouchPipeline(on, calibration, card.pipeline)
    stream = GraphStream(on, card.graph)
    shapes = {one.name: one.shape for one in session.get_inputs()}
    windows = {}
    compared = 0
    for scan in scans(on, PRESSES, 50, 5.2):
        live.push(scan)
        slot = scan.stamp // SLOT_NS
        for touch, graph in stream.build_graphs(pipeline.push_scan(scan)).items():
            empty = (np.zeros(shapes["window"]), np.zeros(shapes["present"]), slot)
            window, present, last = windows.get(touch, empty)
            for values in (window, present):
                values[:] = np.roll(values, last - slot, axis=0)
                values[len(values) - (slot - last) :] = 0
            inputs = feed(graph, np.float32(window), np.float32(present))
            features, _, found = session.run(None, inputs)
            window[-1] = features
            present[-1] = 1
            windows[touch] = window, present, slot
            if touch in live.probabilities:
                np.testing.assert_allclose(found, live.probabilities[touch], atol=1e-4)
                compared += 1
    assert compared > 50


def test_export_of_shipped_weights_states_its_error(exported):
    path, result = exported
    assert 0 <= result["max_error"] < 1e-4
    known = open_session(path).get_modelmeta().custom_metadata_map
    assert known["kind"] == "pressure" and "poke" in known["vocabulary"]


def test_bag_opens_as_one_of_ros2(recording, tmp_path, capsys):
    path, stream = recording
    result, _ = call_json(capsys, "export", path, "--rosbag", tmp_path / "bag")
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([tmp_path / "bag"], default_typestore=store) as bag:
        assert bag.message_count == result["messages"] == len(stream) + 1
        assert bag.start_time == stream[0].stamp
        for connection in bag.connections:
            definition = connection.msgdef.data
            store.register(get_types_from_msg(definition, connection.msgtype))
        stamps = []
        counts = []
        for connection, stamp, data in bag.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            if connection.topic == "/eskin/reading":
                stamps.append(stamp)
                counts.append(message.counts.tolist())
            else:
                assert message.gesture == "poke"
    assert stamps == [scan.stamp for scan in stream]
    assert counts == [scan.counts.tolist() for scan in stream]


def test_bag_of_a_recording_that_is_cut_holds_what_is_left(recording, tmp_path):
    data = recording[0].read_bytes()
    cut = tmp_path / "cut.mcap.part"
    cut.write_bytes(data[: len(data) * 2 // 3])
    left = read_recording(cut)
    assert left.truncated and 0 < left.count < len(recording[1])
    write_bag([left], tmp_path / "bag")
    whole = read_recording(tmp_path / "bag" / "cut.mcap")
    assert whole.count == left.count and not whole.truncated


def test_tables_hold_a_row_a_reading_and_a_row_a_touch(recording, tmp_path, capsys):
    path, stream = recording
    result, _ = call_json(capsys, "export", path, "--parquet", tmp_path / "tables")
    readings = parquet.read_table(tmp_path / "tables" / "readings.parquet")
    assert result["readings"] == readings.num_rows == len(stream)
    stamps = readings["stamp"].cast("int64").to_pylist()
    assert stamps == [scan.stamp for scan in stream]
    for name in ("counts", "received", "q"):
        expected = [getattr(scan, name).tolist() for scan in stream]
        assert readings[name].to_pylist() == expected
    assert readings["shear"].null_count == len(stream)
    labelled = [name == "poke" for name in readings["gesture"].to_pylist()]
    assert sum(labelled) == 20 and labelled[115] and not labelled[135]
    assert max(max(row) for row in readings["pressure"].to_pylist()) > 30
    first, second = parquet.read_table(
        tmp_path / "tables" / "touches.parquet"
    ).to_pylist()
    assert result["touches"] == 2
    assert (first["gesture"], first["label_source"]) == ("poke", "true")
    assert second["gesture"] is None and second["detected"] is None
    for row, press in zip((first, second), PRESSES, strict=True):
        assert row["duration"] == pytest.approx(press.end - press.begin, abs=0.1)
        assert row["peak_pressure"] > 30 and row["peak_force"] > 0
        place = mounted().skin.positions[press.target]
        assert np.linalg.norm(np.array(row["latest"]) - place) < 0.01


@pytest.mark.parametrize("option", ["--rosbag", "--parquet"])
def test_folder_that_is_there_is_kept(recording, tmp_path, capsys, option):
    words = ("export", recording[0], option, tmp_path)
    assert_refused(capsys, *words, part="is there already")
    assert not list(tmp_path.iterdir())


def test_export_needs_one_format_and_a_model_or_recordings(recording, tmp_path, capsys):
    both = ("--rosbag", tmp_path / "a", "--parquet", tmp_path / "b")
    assert_refused(capsys, "export", recording[0], *both, part="one of --onnx")
    assert_refused(capsys, "export", recording[0], part="one of --onnx")
    assert_refused(capsys, "export", "--rosbag", tmp_path / "a", part="nothing to")
    assert_refused(capsys, "export", tmp_path / "a", "--rosbag", tmp_path / "a")
    two = ("export", "ur5", "ur5-sim", "--onnx", tmp_path / "a.onnx")
    assert_refused(capsys, *two, part="2 models")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("package", "option"), [("pyarrow", "parquet"), ("onnxruntime", "onnx")]
)
def test_package_that_is_missing_is_named(
    recording, tmp_path, capsys, monkeypatch, package, option
):
    monkeypatch.setitem(sys.modules, package, None)
    source = "ur5" if option == "onnx" else recording[0]
    extra = "export" if option == "onnx" else option
    words = ("export", source, "--to", option, tmp_path / "out")
    code, _, err = call(capsys, *words)
    assert code == 2 and advise_install(extra) in err
    # The option of that format was not given.
    assert f"--{option}" not in err
    assert not list(tmp_path.iterdir())


def test_example_runs_the_exported_network(exported, run_example):
    code, out, _ = run_example("07_onnx_step.py", "--model", exported[0])
    assert code == 0 and re.search(r"touch 1  poke \d+%\Z", out.strip()), out
