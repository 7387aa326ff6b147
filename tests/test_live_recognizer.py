"""Tests of the recogniser: from scans to detections, with the pose and without."""

from dataclasses import replace

import numpy as np
import pytest

import eskin
from eskin.errors import ModelError, ReadingError, RobotError, SkinMismatchError
from eskin.learn.prepared_recording import prepare_recording
from eskin.live import DecisionConfig, GraphConfig, Recognizer, load_model
from eskin.live.first_use import compile_network
from eskin.live.step_kernels import step
from eskin.recording import read_recording
from eskin.touch import PipelineConfig, TouchPipeline
from helpers.graphs import FOLDED, assert_same, find_meeting_taxels
from helpers.live import (
    SECOND,
    START,
    VOCABULARY,
    Press,
    calibration_of,
    model_of,
    mounted,
    network,
    record,
    say_always,
    scans,
    two_hands,
)

pytestmark = pytest.mark.slow


def build_recognizer(on, model=None, **settings):
    model = model or model_of(network())
    config = DecisionConfig(**{"brief_seconds": 0.0} | settings)
    return Recognizer(model, on, calibration_of(on.skin), config)


def recognise(recognizer, stream):
    found = [detection for scan in stream for detection in recognizer.push(scan)]
    return [*found, *recognizer.finish()]


def to_records(detections):
    return [detection.record() for detection in detections]


def test_network_is_compiled_once_for_all_models_and_skins():
    """Else what a second process has compiled at first use is compiled again."""
    compile_network()
    compiled = list(step.signatures)
    for name in ("grid", "ur5"):
        on = mounted(name)
        recognise(build_recognizer(on), scans(on, two_hands(on), 20, 2.0))
    assert step.signatures == compiled and len(compiled) == 1


@pytest.mark.parametrize("name", ["grid", "ur5"])
@pytest.mark.parametrize("gesture", ["stroke", "none"])
def test_each_touch_has_one_detection(name, gesture):
    on = mounted(name)
    recognizer = build_recognizer(on, say_always(gesture))
    found = recognise(recognizer, scans(on, two_hands(on), 20, 5.0))
    assert not recognizer.directions.contacts
    assert not recognizer.decision_filter.pending
    assert sorted(detection.touch for detection in found) == [1, 2, 3]
    for detection in found:
        assert detection.gesture == gesture
        assert detection.onset <= detection.end <= detection.stamp
        after_onset = (detection.stamp - detection.onset) / SECOND
        after_contact = (detection.stamp - detection.end) / SECOND
        is_open = 0.06 <= after_onset <= 0.12
        assert after_contact >= 0.33 if gesture == "none" else is_open


def test_merged_touches_have_one_detection():
    on = mounted()
    stream = scans(on, [Press(2.4, 3.6, 60, 73), Press(2.4, 3.6, 89, 76)], 25, 4.6)
    pipeline = TouchPipeline(on, calibration_of(on.skin))
    closed = [
        touch for scan in stream for touch in pipeline.push_scan(scan).closed_touches
    ]
    assert sum(touch.merged_into is not None for touch in closed) == 1
    recognizer = build_recognizer(on, say_always("none"))
    assert [found.touch for found in recognise(recognizer, stream)] == [1]


def test_detection_has_time_place_direction_and_force():
    on = mounted()
    press = Press(2.4, 3.2, 65, 72, 40.0)
    stream = scans(on, [press], 50, 3.9)
    [found] = recognise(build_recognizer(on, say_always("none")), stream)
    assert (found.link, found.patch) == ("table", "grid")
    distances = np.linalg.norm(on.skin.positions - found.p_world, axis=1)
    assert found.taxel == np.argmin(distances)
    np.testing.assert_allclose(found.p_world, on.skin.positions[72], atol=0.006)
    np.testing.assert_allclose(found.n_world, [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(found.direction_world, [1, 0, 0], atol=1e-3)
    assert (found.onset - START) / SECOND == pytest.approx(2.41, abs=0.03)
    assert (found.end - START) / SECOND == pytest.approx(3.17, abs=0.05)
    assert found.confidence == pytest.approx(1.0, abs=1e-3)
    loads = [press.pressure(on.skin, (scan.stamp - START) / SECOND) for scan in stream]
    most = max(load.sum() for load in loads) * 1000 * on.skin.areas[0]
    assert found.peak_force == pytest.approx(most, rel=0.1)


def test_touch_that_stays_on_a_moving_link_has_no_direction():
    on = mounted("ur5")
    taxels = on.skin.find_taxels(on.skin.patches[-1].id)
    place = taxels[len(taxels) // 2]
    stream = scans(on, [Press(2.4, 3.4, place, place, 40.0)], 25, 4.5)
    q = np.array([scan.q for scan in stream if scan.stamp >= START + 2 * SECOND])
    p_world, _ = on.place_taxels(q, np.array([place]))
    assert np.linalg.norm(np.ptp(p_world[:, 0], axis=0)) > 0.1
    [found] = recognise(build_recognizer(on, say_always("none")), stream)
    assert not found.direction_world.any()
    assert found.p_world.any()
    row = found.record()
    assert row.direction_world == (0.0, 0.0, 0.0)
    assert (row.gesture, row.stamp) == ("none", found.stamp)


def test_readings_that_repeat_a_measurement_change_no_probability():
    """Every open touch has some at every reading, and closes in time."""
    on = mounted()
    pipeline = TouchPipeline(on, calibration_of(on.skin))
    compared = 0
    recognizer = Recognizer(say_always("none"), on, None)
    found = []
    for scan in scans(on, [Press(2.4, 3.2, 65, 72, 40.0)], 12, 4.2):
        reading = pipeline.push_scan(scan).reading
        before = {}
        for n in range(4):
            stamp = reading.stamp + n * 20_000_000
            found += recognizer.push(replace(reading, stamp=stamp))
            [*touches] = recognizer.state.open
            assert recognizer.probabilities.keys() == {touch.id for touch in touches}
            logits = {
                touch.id: recognizer.logits[touch.id]
                for touch in touches
                if touch.last == stamp
            }
            for touch in logits.keys() & before.keys():
                assert np.array_equal(logits[touch], before[touch])
                compared += 1
            before = logits
    assert compared > 20
    [detection] = found
    assert (detection.stamp - detection.end) / SECOND == pytest.approx(0.36, abs=0.03)


def make_stroke_on_arm():
    """Return a stroke along a patch of the ur5, and its first and last taxel."""
    on = mounted("ur5")
    taxels = on.skin.find_taxels(on.skin.patches[0].id)
    a = taxels[0]
    b = taxels[len(taxels) // 2]
    return on, scans(on, [Press(2.4, 3.2, a, b, 40.0)], 25, 4.2), np.array([a, b])


def test_direction_is_in_the_pose_of_the_last_contact():
    on, stream, ends = make_stroke_on_arm()
    [found] = recognise(build_recognizer(on, say_always("none")), stream)
    q = next(scan for scan in stream if scan.stamp == found.end).q
    still = [replace(scan, q=q) for scan in stream]
    [other] = recognise(build_recognizer(on, say_always("none")), still)
    np.testing.assert_allclose(found.direction_world, other.direction_world, atol=1e-6)
    a, b = on.place_taxels(q, ends)[0]
    assert found.direction_world @ (b - a) / np.linalg.norm(b - a) > 0.9
    assert np.linalg.norm(found.direction_world) == pytest.approx(1.0)


def test_probabilities_of_open_touches_are_calibrated():
    on = mounted()
    net = network()
    cold = build_recognizer(on, model_of(net))
    warm = build_recognizer(on, model_of(net, temperature=2.0))
    at_once = []
    for scan in scans(on, two_hands(on), 20, 5.0):
        cold.push(scan)
        warm.push(scan)
        touches = {touch.id for touch in warm.state.touches}
        assert set(warm.probabilities) == set(warm.logits) == touches
        at_once.append(len(touches))
        for touch, p in warm.probabilities.items():
            assert p.shape == (len(VOCABULARY),)
            assert p.sum() == pytest.approx(1.0)
            squared = p**2 / (p**2).sum()
            np.testing.assert_allclose(squared, cold.probabilities[touch], atol=1e-5)
    assert max(at_once) == 2


def test_skin_without_calibration_has_one_detection_for_each_touch():
    on = mounted("grid", calibrated=False)
    recognizer = build_recognizer(on, say_always("poke"))
    found = []
    for scan in scans(on, two_hands(on), 20, 5.0):
        found += recognizer.push(scan)
        assert set(recognizer.logits) == {0}
        assert bool(recognizer.probabilities) == bool(recognizer.state.touches)
    assert [detection.touch for detection in found] == [1, 2]


def test_readings_are_recognised_as_their_scans():
    on = mounted()
    by_scans = build_recognizer(on)
    decision = by_scans.decision_filter.config
    by_readings = Recognizer(by_scans.model, on, None, decision)
    stream = scans(on, two_hands(on), 20, 4.4)
    for scan in stream:
        found = by_scans.push(scan)
        again = by_readings.push(by_scans.state.reading)
        assert to_records(again) == to_records(found)
        assert by_scans.logits.keys() == by_readings.logits.keys()
    with pytest.raises(ReadingError, match="calibration"):
        by_readings.push(stream[-1])


def test_model_for_shear_needs_shear():
    model = model_of(network("shear"))
    on = mounted()
    with pytest.raises(SkinMismatchError, match="shear.*'grid'"):
        Recognizer(model, on, calibration_of(on.skin))
    on = mounted("grid", kind="shear")
    [scan] = scans(on, [], 10, 0.1)
    with pytest.raises(ReadingError, match="shear"):
        build_recognizer(on, model).push(replace(scan, shear=None))


def test_model_for_pressure_ignores_shear():
    on = mounted("grid", calibrated=False, kind="shear")
    with_shear = build_recognizer(on)
    without = build_recognizer(on)
    for scan in scans(on, [Press(2.3, 2.9, 65, 72, 6.0)], 20, 3.4):
        dragged = scan.shear + 60 * (scan.counts.max() > 40)
        with_shear.push(replace(scan, shear=dragged.astype(np.int32)))
        without.push(replace(scan, shear=None))
        assert np.array_equal(with_shear.logits[0], without.logits[0])


def test_refused_scan_changes_nothing():
    on = mounted()
    straight = build_recognizer(on)
    disturbed = build_recognizer(on)
    for scan in scans(on, two_hands(on), 20, 3.5):
        want = straight.push(scan)
        found = disturbed.push(scan)
        assert to_records(found) == to_records(want)
        short = replace(scan, counts=scan.counts[:-1], received=scan.received[:-1])
        for bad in (short, scan, replace(scan, stamp=scan.stamp - 1)):
            with pytest.raises(ReadingError):
                disturbed.push(bad)
        for key, logits in straight.logits.items():
            assert np.array_equal(disturbed.logits[key], logits)


def test_finish_closes_open_touches_once():
    on = mounted()
    stream = scans(on, [Press(2.4, 2.9, 100, 100)], 25, 3.0)
    recognizer = build_recognizer(on, say_always("none"))
    assert recognizer.finish() == []
    assert not [found for scan in stream for found in recognizer.push(scan)]
    [last] = recognizer.finish()
    assert (last.gesture, last.stamp) == ("none", stream[-1].stamp)
    assert recognizer.finish() == []
    assert not recognizer.directions.contacts and not recognizer.probabilities


def test_recogniser_is_loaded_from_files_and_names(tmp_path):
    path = tmp_path / "m.safetensors"
    on = mounted()
    model_of(network()).save(path)
    recognizer = eskin.Recognizer.load(path, "ur5")
    assert recognizer.mounted.skin.count == 2112
    assert recognizer.model.card.vocabulary == VOCABULARY
    assert Recognizer.load("ur5").mounted.skin.name == "ur5"
    given = Recognizer.load(path, on.skin, "table", calibration_of(on.skin))
    assert recognise(given, scans(on, [], 10, 0.3)) == []
    with pytest.raises(RobotError, match="'grid'.*robot"):
        Recognizer.load(path, on.skin)
    with pytest.raises(SkinMismatchError, match="skin"):
        Recognizer.load(path)
    with pytest.raises(ModelError, match="gone"):
        Recognizer.load(tmp_path / "gone.safetensors", "ur5")


BLIND = GraphConfig(posed=False)
OPEN = np.array([0.4, -1.3, 1.1, -0.7, 0.9, 0.2])


@pytest.fixture(scope="module")
def posed_model():
    model = load_model("ur5")
    assert model.card.graph.posed
    return model


@pytest.fixture(scope="module")
def blind_model(posed_model):
    return replace(posed_model, card=replace(posed_model.card, graph=BLIND))


@pytest.fixture(scope="module")
def poses():
    """Make the same counts on wrist and arm folded, where they meet, open, moving."""
    on = mounted("ur5")
    (wrist, arm) = find_meeting_taxels()
    presses = [Press(2.2, 2.8, wrist, wrist), Press(2.3, 2.8, arm, arm - 6, 40.0)]
    moving = scans(on, presses, 20, 3.6)
    still = [[replace(scan, q=q) for scan in moving] for q in (FOLDED, OPEN)]
    return *still, moving


def get_answers(model, stream):
    """Return the probabilities at every reading, and the detections without place."""
    on = mounted("ur5")
    probabilities = []
    found = []
    recognizer = Recognizer(model, on, calibration_of(on.skin))
    for scan in stream:
        found += recognizer.push(scan)
        probabilities.append(
            {k: p.tolist() for k, p in recognizer.probabilities.items()}
        )
    names = ("stamp", "touch", "gesture", "confidence", "onset", "end", "link")
    found += recognizer.finish()
    return probabilities, [[getattr(each, name) for name in names] for each in found]


def test_without_the_pose_the_same_counts_have_the_same_answers(blind_model, poses):
    want, *others = (get_answers(blind_model, stream) for stream in poses)
    assert any(want[0]) and want[1]
    assert others == [want, want]


def test_with_the_pose_touches_merge_where_links_meet(posed_model, poses):
    folded, apart, _ = (get_answers(posed_model, stream)[0] for stream in poses)
    assert [max(map(len, each)) for each in (folded, apart)] == [1, 2]


def test_without_the_pose_the_same_counts_have_the_same_graphs(poses, tmp_path):
    prepared = []
    for n, stream in enumerate(poses):
        path = record(tmp_path / f"{n}.mcap", mounted("ur5"), stream)
        recording = read_recording(path)
        prepared.append(prepare_recording(recording, PipelineConfig(), BLIND))
    first, *others = prepared
    for other in others:
        assert_same(first.graphs, other.graphs)
        assert np.array_equal(first.sequence, other.sequence)


def test_without_the_pose_detections_have_the_place_in_it(posed_model, blind_model):
    on, stream, _ = make_stroke_on_arm()
    stream = [replace(scan, q=OPEN) for scan in stream]
    one, two = (
        recognise(Recognizer(model, on, calibration_of(on.skin)), stream)
        for model in (posed_model, blind_model)
    )
    for name in ("p_world", "n_world", "direction_world"):
        found, want = (getattr(each[0], name) for each in (two, one))
        np.testing.assert_allclose(found, want, atol=1e-6)
