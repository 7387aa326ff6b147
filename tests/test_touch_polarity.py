"""Tests of counts that fall under pressure: a touch tells it, one place turns them."""

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from eskin.app import SourceConfig, open_source
from eskin.calibration import CalibrationGuide, GuideConfig
from eskin.command.skin_monitor import SkinMonitor, SkinMonitorConfig
from eskin.recording import Metadata, RecordingWriter, write_all
from eskin.skin import MountedSkin
from eskin.stream import FaultReporter, RecognitionState
from eskin.touch import Calibration, Scan, TouchPipeline
from helpers.cli import call, call_json
from helpers.guided import (
    CALIBRATION,
    MOUNTED,
    PERIOD,
    SKIN,
    make_scans,
    press,
    press_counts,
    rest,
)
from helpers.touch import build_grid_skin, one_link_robot

FULL = CALIBRATION.full_scale
TAXELS = (27, 36, 100, 91)
HAND = dict(width=2)
TOUCH = [*rest(40), *press(27)]
FALLING = replace(CALIBRATION, falling=True)
SIGNS = (1, -1)


def fall(scans):
    """Return scans of a sensor with a pull-up resistor."""
    return [replace(scan, counts=FULL - scan.counts) for scan in scans]


def play(scans, calibration=CALIBRATION, mounted=MOUNTED):
    """Return the states of a pipeline."""
    pipeline = TouchPipeline(mounted, calibration)
    return [pipeline.push_scan(scan) for scan in scans]


def find_ways(states):
    """Return the ways of counts that are told, once for each time they begin."""
    reporter = FaultReporter(SKIN)
    events = [
        event
        for state in states
        for event in reporter.report_faults(state.reading.stamp, state.faults)
    ]
    return [event.text for event in events if "under pressure" in event.text]


def change(scans, first, last, value, taxels=slice(None)):
    """Return scans of which some taxels have a value for a while."""
    out = []
    for number, scan in enumerate(scans):
        counts = scan.counts.copy()
        if first <= number < last:
            counts[taxels] = value
        out.append(replace(scan, counts=counts))
    return out


@pytest.mark.parametrize("offset", [200, 1500])
def test_falling_counts_are_told_once_by_the_first_touch(offset):
    touches = [*TOUCH, *press(100), *press(91)]
    scans = [
        replace(scan, counts=scan.counts + offset - 200) for scan in make_scans(touches)
    ]
    states = play(fall(scans))
    (text,) = find_ways(states)
    assert "counts that fall under pressure" in text and "--falling" in text
    assert find_ways(states[: len(TOUCH)])
    assert not find_ways(states[:45])
    assert not find_ways(play(scans))
    (text,) = find_ways(play(scans, FALLING))
    assert "counts that rise under pressure" in text and "leave out --falling" in text


def test_readings_are_the_same_whichever_way_counts_go():
    scans = list(make_scans([*TOUCH, *press(100)]))
    calibration = replace(CALIBRATION, rest=np.full(SKIN.count, 200.0))
    turned = replace(calibration, falling=True, rest=FULL - calibration.rest)
    for one, other in (
        (play(scans), play(fall(scans), FALLING)),
        (play(scans, calibration), play(fall(scans), turned)),
    ):
        assert any(state.contacts for state in one)
        for a, b in zip(one, other, strict=True):
            assert a.reading.pressure.tobytes() == b.reading.pressure.tobytes()
            assert a.reading.valid.tobytes() == b.reading.valid.tobytes()
            assert a.faults == b.faults


def test_counts_below_zero_are_invalid_either_way():
    scans = change(make_scans(rest(30)), 20, 30, -1, [5])
    for calibration in (CALIBRATION, FALLING):
        assert not play(scans, calibration)[-1].reading.valid[5]


NO_TOUCH = {
    "a hand from the start that lifts": [
        *[press_counts(27, **HAND)] * 60,
        *rest(60),
        *press(30),
    ],
    "a hand that lifts, lies down again, and lifts": [
        *[press_counts(27, **HAND)] * 60,
        *rest(20),
        *[press_counts(27, **HAND)] * 20,
        *rest(40),
    ],
    "a finger from the start that lifts and presses again": [
        *[press_counts(27)] * 60,
        *rest(10),
        *press(27),
        *rest(10),
    ],
    "the dip after a long touch": [
        *rest(40),
        *[press_counts(27)] * 300,
        *[-press_counts(27) // 10] * 40,
        *rest(40),
        *[-press_counts(27) // 10] * 40,
        *rest(40),
    ],
    "a bend": [*rest(40), *[np.where(SKIN.columns < 4, 60, -80)] * 20, *rest(40)],
    "a change that lasts": [*rest(40), *[-press_counts(27) // 2] * 300, *rest(40)],
    "drift": [np.full(SKIN.count, -n) for n in range(190)],
}


@pytest.mark.parametrize("way", [CALIBRATION, FALLING])
@pytest.mark.parametrize("name", NO_TOUCH)
def test_what_is_no_falling_touch_is_not_told(name, way):
    scans = list(make_scans(NO_TOUCH[name]))
    scans = fall(scans) if way.falling else scans
    assert not find_ways(play(scans, way))


@pytest.mark.parametrize(
    ("value", "lasts"),
    [*product((0, 120, FULL - 120, FULL), (2, 10, 60)), (0, 400), (FULL - 120, 400)],
)
@pytest.mark.parametrize("lost", ["patch", "row", "skin", "taxel"])
def test_what_is_lost_and_comes_back_is_not_told(value, lasts, lost):
    """Falling counts are these, turned: their readings are the same (above)."""
    taxels = {
        "patch": np.flatnonzero(SKIN.patch_index == 0),
        "row": np.flatnonzero((SKIN.patch_index == 0) & (SKIN.rows == 3)),
        "skin": np.arange(SKIN.count),
        "taxel": [27],
    }[lost]
    scans = make_scans(rest(180 + lasts))
    assert not find_ways(play(change(scans, 60, 60 + lasts, value, taxels)))


def test_one_corrupt_scan_tells_nothing():
    scans = list(make_scans(rest(60)))
    for seed in range(20):
        rng = np.random.default_rng(seed)
        taxels = rng.choice(SKIN.count, rng.integers(1, SKIN.count), replace=False)
        values = rng.integers(0, FULL, len(taxels))
        assert not find_ways(play(change(scans, 40, 41, values, taxels)))


def test_cells_far_apart_tell_by_two_of_them():
    skin = build_grid_skin(2, 4, pitch=0.05)
    mounted = MountedSkin(skin, one_link_robot())
    calibration = Calibration.uniform(skin.count, 1023, 100.0)
    counts = np.full((120, skin.count), 900, np.int32)
    for cell, begin in ((2, 50), (2, 70), (5, 90)):
        counts[begin : begin + 10, cell] = 400
    received = np.ones(skin.count, bool)
    scans = [
        Scan(PERIOD * (n + 1), row + n % 2, received, np.zeros(0))
        for n, row in enumerate(counts)
    ]
    assert not find_ways(play(scans[:85], calibration, mounted))
    assert len(find_ways(play(scans, calibration, mounted))) == 1


def test_calibration_finds_the_way_of_counts_by_itself():
    above = [*rest(110), *(scan for taxel in TAXELS * 2 for scan in press(taxel))]
    config = GuideConfig(presses=3, forces=(4.0,))
    results = []
    for scans in (list(make_scans(above)), fall(make_scans(above))):
        guide = CalibrationGuide(MOUNTED, CALIBRATION, config)
        events = [event for scan in scans if (event := guide.push(scan))]
        turned = [event.text for event in events if event.kind == "turned"]
        results.append((guide.finish().calibration, turned))
    (rising, none), (falling, turned) = results
    assert none == [] and turned == ["counts fall under pressure"]
    assert (rising.falling, falling.falling) == (False, True)
    np.testing.assert_allclose(falling.rest, FULL - rising.rest, atol=0.02)
    np.testing.assert_allclose(falling.noise, rising.noise)
    np.testing.assert_allclose(falling.gain, rising.gain, rtol=0.05)
    again = Calibration.from_bytes(falling.to_bytes())
    assert again.falling and again.to_bytes() == falling.to_bytes()
    assert not find_ways(play(fall(make_scans(above)), again))


def test_file_says_the_way_and_older_files_say_rising():
    content = json.loads(CALIBRATION.to_bytes())
    assert "falling" not in content and content["version"] == 1
    assert json.loads(FALLING.to_bytes())["version"] == 2
    for value, falls in ((True, True), (False, False)):
        data = json.dumps(content | {"falling": value}).encode()
        assert Calibration.from_bytes(data).falling is falls


def test_arm_is_held_while_no_touch_can_be_felt():
    scans = fall(make_scans(TOUCH))
    monitor = SkinMonitor(SKIN, SkinMonitorConfig(), scans[0].stamp)
    for state in play(scans):
        monitor.update(RecognitionState(state, {}, ()), ())
    assert "the other way" in (str(monitor.find_problem(scans[-1].stamp)))


@pytest.fixture
def recording(tmp_path):
    """Record a falling sensor of which nothing but the data sheet is known."""
    path = tmp_path / "falling.mcap"
    metadata = Metadata("test", "nobody", "one")
    with RecordingWriter(path, "table", SKIN, CALIBRATION, metadata) as writer:
        write_all(writer, fall(make_scans([*TOUCH, *rest(20)])), [])
    return path


def test_option_sets_the_way_and_its_recording_keeps_it(recording, tmp_path, capsys):
    with open_source(
        f"replay:{recording}", config=SourceConfig(falling=True)
    ) as source:
        assert source.info.calibration.falling
    _, printed = call_json(capsys, "replay", recording)
    assert "counts that fall under pressure" in printed
    copy = tmp_path / "copy.mcap"
    words = ("replay", recording, "--falling", "--record", copy)
    assert call(capsys, *words)[0] == 0
    found, printed = call_json(capsys, "replay", copy)
    assert "under pressure" not in printed
    assert [row["patch"] for row in found["detections"]] == ["p0"]
