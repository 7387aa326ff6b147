"""From scans to detections."""

from dataclasses import replace

import numpy as np
import pytest

import eskin
from eskin.errors import ModelError, ReadingError, SkinMismatchError
from eskin.live import Recognizer
from eskin.model import DecisionConfig, save_model
from eskin.touch import TouchPipeline
from helpers.live import (
    SECOND,
    START,
    VOCABULARY,
    Press,
    calibration_of,
    model_of,
    mounted,
    network,
    say_always,
    scans,
    two_hands,
)


def recognizer_of(on, model=None, **settings):
    model = model or model_of(network())
    config = DecisionConfig(**settings)
    return Recognizer(model, on, calibration_of(on.skin), config)


def run(recognizer, stream):
    found = []
    for scan in stream:
        found += recognizer.push(scan)
    return [*found, *recognizer.finish()]


def seconds(stamp):
    return (stamp - START) / SECOND


@pytest.mark.parametrize("name", ["grid", "ur5"])
@pytest.mark.parametrize("said", ["stroke", "none"])
def test_every_touch_has_one_detection(name, said):
    on = mounted(name)
    stream = scans(on, two_hands(on), 25, 5.5)
    recognizer = recognizer_of(on, say_always(said))
    found = run(recognizer, stream)
    assert (
        not recognizer.directions.contacts and not recognizer.decision_filter.evidence
    )
    assert [d.touch for d in sorted(found, key=lambda d: d.touch)] == [1, 2, 3]
    assert {d.gesture for d in found} == {said}
    for detection in found:
        late = detection.stamp - detection.end
        assert detection.onset <= detection.end <= detection.stamp
        if said == "none":
            assert late >= 0.5 * SECOND
        else:
            assert 0.06 <= (detection.stamp - detection.onset) / SECOND <= 0.12


def test_touches_that_become_one_have_one_detection():
    on = mounted()
    toward = [Press(2.4, 3.6, 60, 73), Press(2.4, 3.6, 89, 76)]
    stream = scans(on, toward, 50, 4.6)
    calibration = calibration_of(on.skin)
    pipeline = TouchPipeline(on, calibration)
    merges = [
        t
        for scan in stream
        for t in pipeline.push(scan).closed_touches
        if t.merged_into
    ]
    assert len(merges) == 1
    for said in ("stroke", "none"):
        late = say_always(said)
        found = run(recognizer_of(on, late, thresholds={"stroke": 2.0}), stream)
        assert [d.touch for d in found] == [1]


def test_a_detection_says_where_which_way_and_how_hard():
    on = mounted()
    p = on.skin.positions
    press = Press(2.4, 3.2, 65, 72, 40.0)
    stream = scans(on, [press], 50, 4.5)
    [found] = run(recognizer_of(on, say_always("none")), stream)
    assert (found.link, found.patch) == ("table", "grid")
    np.testing.assert_allclose(found.p_world, p[72], atol=0.006)
    np.testing.assert_allclose(found.n_world, [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(found.direction_world, [1, 0, 0], atol=1e-3)
    assert 2.38 <= seconds(found.onset) <= 2.44
    assert 3.12 <= seconds(found.end) <= 3.22
    assert found.confidence == pytest.approx(1.0, abs=1e-3)
    loads = [press.pressure(on.skin, seconds(scan.stamp)) for scan in stream]
    most = max(load.sum() for load in loads) * 1000 * on.skin.areas[0]
    assert found.peak_force == pytest.approx(most, rel=0.1)


def test_a_touch_that_stays_has_no_direction():
    on = mounted()
    [found] = run(
        recognizer_of(on, say_always("poke")),
        scans(on, [Press(2.4, 2.8, 100, 100)], 50, 4),
    )
    assert not found.direction_world.any()
    record = found.record()
    assert record.direction_world == (0.0, 0.0, 0.0)
    assert (record.gesture, record.stamp) == ("poke", found.stamp)


def test_the_motion_of_the_arm_is_no_travel():
    on = mounted("ur5")
    taxels = on.skin.find_taxels(on.skin.patches[-1].id)
    here = taxels[len(taxels) // 2]
    stream = scans(on, [Press(2.4, 3.4, here, here, 40.0)], 25, 4.5)
    q = np.array([scan.q for scan in stream if scan.stamp >= START + 2 * SECOND])
    tip, _ = on.place_taxels(q, np.array([here]))
    assert np.linalg.norm(np.ptp(tip[:, 0], axis=0)) > 0.1
    [found] = run(recognizer_of(on, say_always("none")), stream)
    assert not found.direction_world.any()
    assert found.p_world @ found.p_world > 0


def test_the_direction_of_travel_is_where_the_arm_is_at_the_last_contact():
    on = mounted("ur5")
    taxels = on.skin.find_taxels(on.skin.patches[0].id)
    a, b = taxels[0], taxels[len(taxels) // 2]
    stream = scans(on, [Press(2.4, 3.2, a, b, 40.0)], 25, 4.5)
    [found] = run(recognizer_of(on, say_always("none")), stream)
    q = next(scan for scan in stream if scan.stamp == found.end).q
    still = [replace(scan, q=q) for scan in stream]
    [there] = run(recognizer_of(on, say_always("none")), still)
    np.testing.assert_allclose(found.direction_world, there.direction_world, atol=1e-6)
    points, _ = on.place_taxels(q, np.array([a, b]))
    way = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    assert found.direction_world @ way > 0.9
    assert np.linalg.norm(found.direction_world) == pytest.approx(1.0)


def test_probabilities_are_calibrated_and_only_of_open_touches():
    on = mounted()
    stream = scans(on, two_hands(on), 25, 5.5)
    net = network()
    cold = recognizer_of(on, model_of(net))
    warm = recognizer_of(on, model_of(net, temperature=2.0))
    at_once = 0
    for scan in stream:
        cold.push(scan)
        warm.push(scan)
        touches = {touch.id for touch in warm.state.touches}
        assert set(warm.probabilities) == set(warm.logits) == touches
        at_once = max(at_once, len(touches))
        for touch, p in warm.probabilities.items():
            assert p.shape == (len(VOCABULARY),)
            assert p.sum() == pytest.approx(1.0)
            squared = p**2 / (p**2).sum()
            np.testing.assert_allclose(squared, cold.probabilities[touch], atol=1e-5)
    assert at_once == 2


def test_a_skin_whose_distances_mean_nothing_still_has_one_detection_a_touch():
    on = mounted("grid", calibrated=False)
    recognizer = recognizer_of(on, say_always("poke"))
    stream = scans(on, two_hands(on), 25, 5.5)
    found = []
    for scan in stream:
        found += recognizer.push(scan)
        assert set(recognizer.logits) == {0}
        assert bool(recognizer.probabilities) == bool(recognizer.state.touches)
    assert [d.touch for d in found] == [1, 2]


def test_readings_may_be_pushed_in_place_of_scans():
    on = mounted()
    stream = scans(on, two_hands(on), 25, 5.0)
    of_scans = recognizer_of(on)
    of_readings = Recognizer(of_scans.model, on, None)
    for scan in stream:
        said = of_scans.push(scan)
        again = of_readings.push(of_scans.state.reading)
        assert [d.record() for d in said] == [d.record() for d in again]
        assert of_scans.logits.keys() == of_readings.logits.keys()


def test_a_recogniser_without_calibration_refuses_scans():
    on = mounted()
    recognizer = Recognizer(model_of(network()), on, None)
    [scan] = scans(on, [], 10, 0.1)
    with pytest.raises(ReadingError, match="there is no calibration"):
        recognizer.push(scan)


def test_a_model_for_shear_refuses_a_skin_without():
    model = model_of(network("shear"))
    on = mounted()
    with pytest.raises(SkinMismatchError, match="needs shear, skin 'grid' measures"):
        Recognizer(model, on, calibration_of(on.skin))
    felt = mounted("grid", kind="shear")
    [scan] = scans(felt, [], 10, 0.1)
    recognizer = Recognizer(model, felt, calibration_of(felt.skin))
    with pytest.raises(ReadingError, match="has no shear, which the model needs"):
        recognizer.push(replace(scan, shear=None))


def test_a_model_for_pressure_says_the_same_whatever_the_shear():
    on = mounted("grid", calibrated=False, kind="shear")
    stream = scans(on, [Press(2.3, 2.9, 65, 72, 6.0)], 25, 4.0)
    with_shear, without = recognizer_of(on), recognizer_of(on)
    for scan in stream:
        drag = np.where(scan.counts[:, None] > 25, scan.shear + 60, scan.shear)
        with_shear.push(replace(scan, shear=drag.astype(np.int32)))
        without.push(replace(scan, shear=None))
        np.testing.assert_array_equal(with_shear.logits[0], without.logits[0])


def test_a_bad_scan_changes_nothing():
    on = mounted()
    stream = scans(on, two_hands(on), 25, 5.0)
    straight, disturbed = recognizer_of(on), recognizer_of(on)
    short = replace(
        stream[0], counts=stream[0].counts[:-1], received=stream[0].received[:-1]
    )
    for scan in stream:
        expected = straight.push(scan)
        got = disturbed.push(scan)
        assert [d.record() for d in got] == [d.record() for d in expected]
        for bad in (short, scan, replace(scan, stamp=scan.stamp - 1)):
            with pytest.raises(ReadingError):
                disturbed.push(bad)
        for key, logits in straight.logits.items():
            assert np.array_equal(disturbed.logits[key], logits)


def test_finishing_says_the_last_word_once():
    on = mounted()
    stream = scans(on, [Press(2.4, 2.9, 100, 100)], 25, 3.0)
    recognizer = recognizer_of(on, say_always("none"))
    assert recognizer.finish() == []
    assert not [d for scan in stream for d in recognizer.push(scan)]
    [last] = recognizer.finish()
    assert (last.gesture, last.stamp) == ("none", stream[-1].stamp)
    assert recognizer.finish() == []
    assert not recognizer.directions.contacts and not recognizer.probabilities


def test_a_recogniser_is_loaded_from_files_by_names(tmp_path):
    path = tmp_path / "m.safetensors"
    save_model(path, model_of(network()))
    recognizer = eskin.Recognizer.load(path, "ur5")
    assert recognizer.mounted.skin.count == 2112
    assert recognizer.model.card.vocabulary == VOCABULARY
    on = mounted()
    given = Recognizer.load(path, on.skin, "table", calibration_of(on.skin))
    for scan in scans(on, [], 10, 0.3):
        given.push(scan)
    with pytest.raises(SkinMismatchError, match="'grid' is given without a robot"):
        Recognizer.load(path, on.skin)
    with pytest.raises(ModelError, match="no such model; allowed are ur5"):
        Recognizer.load(tmp_path / "gone.safetensors", "ur5")


def test_the_live_path_needs_no_torch():
    import subprocess
    import sys

    code = (
        "import sys, eskin, eskin.live, eskin.cli.recordings; eskin.Recognizer;"
        "assert not {'torch', 'sklearn', 'eskin.nn', 'eskin.learn'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
