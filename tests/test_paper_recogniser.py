"""The paper's network live: its answers are those of whole windows, its files safe."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import ModelError
from eskin.live import Model, Recognizer, check_weights, load_model
from eskin.notebook import find_touches
from eskin.recording import read_recording
from eskin.touch import TouchPipeline
from helpers.cli import assert_refused, call_json
from helpers.live import (
    START,
    calibration_of,
    mounted,
    record,
    scans,
    two_hands,
)

torch = pytest.importorskip("torch", reason="the network needs torch")
paper = pytest.importorskip(
    "eskin_paper_network.model", reason="plugins/paper_network is not installed"
)
from eskin_paper_network.network import PaperNetwork  # noqa: E402
from eskin_paper_network.recogniser import (  # noqa: E402
    LARGEST_PRESSURE,
    MAX_GAP,
    FeatureWindow,
)

pytestmark = pytest.mark.slow

GESTURES = ("double_pat", "grab", "poke", "stroke")
"""Gestures of the paper, without `none`."""


def build(on, classes=4, **settings):
    """Build a network of random weights whose answers differ between readings."""
    torch.manual_seed(0)
    network = PaperNetwork(on, classes, **{"k": 8, "pooling": "max"} | settings).eval()
    with torch.no_grad():
        network.embed.weight *= 10
        for parameter in network.over_time.parameters():
            parameter *= 3
        network.out.weight *= 10
    return network


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """The path of a model of the UR5 that does not know `none`."""
    path = tmp_path_factory.mktemp("paper") / "paper.safetensors"
    paper.save_paper_model(path, build(mounted("ur5")), GESTURES)
    return path


def follow(model, on, stream):
    """Yield the recogniser after each scan."""
    recognizer = Recognizer(model, on, calibration_of(on.skin))
    for scan in stream:
        recognizer.push(scan)
        yield recognizer


def select_felt(on, stream):
    """Return pressures above their noise [kPa] and joint positions, of each scan."""
    pipeline = TouchPipeline(on, calibration_of(on.skin))
    pressures = []
    joints = []
    for scan in stream:
        floor = pipeline.front_end.floor
        state = pipeline.push_scan(scan)
        felt = state.reading.valid & (state.reading.pressure >= floor)
        pressures.append(np.where(felt, state.reading.pressure, 0.0))
        joints.append(state.reading.q)
    pressure = np.float32(pressures)
    q = np.float32(joints)
    return torch.from_numpy(pressure.clip(max=LARGEST_PRESSURE)), torch.from_numpy(q)


# Rate, stride, and by how many readings the first of a slot comes before its middle.
@pytest.mark.parametrize(
    ("rate", "stride", "early"), [(25, 1, 0), (50, 1, 0), (200, 1, 1), (50, 4, 0)]
)
def test_probabilities_are_those_of_the_whole_window_offline(
    rate, stride, early, tmp_path
):
    """Slower readings are repeated; of faster ones the first of each slot counts."""
    on = mounted("ur5")
    path = tmp_path / "a.safetensors"
    network = build(on, stride=stride)
    model = paper.save_paper_model(path, network, GESTURES)
    stream = scans(on, two_hands(on), rate, 4.6)
    pressure, q = select_felt(on, stream)
    found = []
    for index, recognizer in enumerate(follow(model, on, stream)):
        is_used = (index + early) * 50 % rate == 0
        if recognizer.probabilities and is_used:
            found.append((index, *recognizer.probabilities.values()))
    chosen = found[:: len(found) // 12]
    offline = []
    for index, *_ in chosen:
        rows = index + np.arange(-99, 1) * rate // 50
        with torch.inference_mode():
            logits = network(pressure[rows][None], q[rows][None])
        offline.append(logits[0].softmax(dim=0).numpy())
    live = [probabilities[1:] for _, probabilities, *_ in chosen]
    assert len(live) > 5 and np.std(offline, axis=0).max() > 0.03
    np.testing.assert_allclose(live, offline, atol=1e-4)


def test_touches_at_once_have_the_same_probabilities(path):
    on = mounted("ur5")
    together = 0
    for recognizer in follow(load_model(path), on, scans(on, two_hands(on), 50, 3.3)):
        one, *others = recognizer.probabilities.values() or [np.ones(5) / 5]
        assert one.sum() == pytest.approx(1.0, abs=1e-5)
        for other in others:
            np.testing.assert_array_equal(one, other)
            assert one[0] == 0.0 and len(one) == 5
            together += 1
    assert together > 5


def window(slots=4):
    return FeatureWindow(torch.zeros(1), slots)


def push(features, milliseconds):
    """Push features 1, 2, 3 and so on at some times; return the slots."""
    for number, at in enumerate(milliseconds, 1):
        stamp = START + round(at * 1e6)
        if features.count_slots(stamp) > 0:
            features.add_features(stamp, torch.full((1, 1), float(number)))
    return features.features[:, 0].tolist()


def test_readings_out_of_step_fill_one_slot_each():
    assert push(window(), [7, 35, 41, 71]) == [1, 2, 3, 4]
    assert push(window(), [0, 8, 20, 28, 40, 60]) == [1, 3, 5, 6]


def test_missing_reading_repeats_the_one_before_and_none_for_long_is_rest():
    assert push(window(5), [0, 20, 80]) == [1, 2, 2, 2, 3]
    assert push(window(5), [0, 20, 20 + MAX_GAP / 1e6 + 1]) == [0, 0, 0, 0, 3]


@pytest.mark.parametrize("vocabulary", [GESTURES, ("grab", "none", "poke")])
def test_file_is_read_as_it_was_written(vocabulary, tmp_path):
    on = mounted("ur5")
    path = tmp_path / "a.safetensors"
    settings = {"k": 5, "pooling": "mean", "distance": "patch", "stride": 2}
    network = build(on, len(vocabulary), **settings)
    saved = paper.save_paper_model(path, network, vocabulary, training={"epochs": "3"})
    found = load_model(path)
    assert found.card == saved.card and found.digest == saved.digest
    assert set(found.card.vocabulary) == {"none", *vocabulary}
    loaded = paper.load_network(found, on)
    pressure = torch.zeros(1, 100, on.skin.count)
    pressure[0, 40:60, 700:720] = 20.0
    q = torch.zeros(1, 100, len(on.robot.joint_names))
    with torch.inference_mode():
        assert torch.equal(network(pressure, q), loaded(pressure, q))


def change_card(model, **settings):
    card = replace(model.card, settings=model.card.settings | settings)
    return Model(model.weights, card)


def change_weight(model, change):
    weights = dict(model.weights)
    weights["out.weight"] = change(weights["out.weight"])
    return Model(weights, model.card)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda m: change_card(m, k=10**9), "settings: k: got 1000000000, allowed is"),
        (lambda m: change_card(m, k=float("nan")), "settings.k"),
        (
            lambda m: change_card(m, pooling="sum"),
            "settings: pooling: got 'sum',",
        ),
        (lambda m: change_card(m, depth=3), "settings: depth is not known"),
        (lambda m: change_card(m, knows_none=True), "'out.weight' has shape"),
        (lambda m: Model({}, m.card), "lacks parameter"),
        (lambda m: change_weight(m, lambda w: w[:, 1:]), "'out.weight' has shape"),
        (lambda m: change_weight(m, lambda w: w * np.nan), "'out.weight' holds NaN"),
    ],
)
def test_file_that_does_not_fit_is_refused_in_one_line(
    path, change, part, tmp_path, capsys
):
    model = change(load_model(path))
    changed = tmp_path / "changed.safetensors"
    model.save(changed)
    with pytest.raises(ModelError, match=part) as told:
        Recognizer(load_model(changed), mounted("ur5"), None)
    assert "\n" not in str(told.value)
    on = mounted("ur5")
    recording = record(tmp_path / "a.mcap", on, scans(on, [], 50, 0.1))
    assert_refused(capsys, "replay", recording, "--model", changed, part=part)


def test_eskin_does_not_take_its_weights_for_its_own(path):
    with pytest.raises(ModelError, match="allowed here are models of eskin's own"):
        check_weights(load_model(path))


def test_replay_evaluation_and_tables_take_its_file(path, tmp_path, capsys):
    on = mounted("ur5")
    recording = record(tmp_path / "a.mcap", on, scans(on, two_hands(on), 50, 4.6))
    found, _ = call_json(capsys, "replay", recording, "--model", path)
    assert len(found["detections"]) >= 3
    rows = find_touches(read_recording(recording), str(path))
    for touch in rows if isinstance(rows, list) else rows.to_dict("records"):
        assert touch["probabilities"]["none"] == 0.0
        assert touch["embedding"] is None or len(touch["embedding"]) == 32


def test_other_models_need_no_torch():
    code = (
        "import sys, eskin\n"
        "eskin.Recognizer.load('ur5')\n"
        "sys.exit('torch' in sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
