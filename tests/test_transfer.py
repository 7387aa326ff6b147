"""The benchmark on people that weights never learned from plays what was felt."""

import json
from collections import Counter

import numpy as np
import pytest
from benchmarks import transfer
from benchmarks.transfer import SETS, Group, TransferSetting, Trial, TrialAnswer

from eskin import load_model
from eskin.recording.socialtouch import GESTURES
from helpers.socialtouch import pressed, text_of, write_socialtouch

SOCIAL = SETS["socialtouch"]
SETTING = TransferSetting(4.0, 40.0, 50.0)


def trial_of(counts, period=0.08):
    seconds = np.arange(len(counts)) * period
    return Trial("P0", "poke_short", seconds, counts / 255)


def test_every_gesture_of_a_set_is_in_one_group_but_for_those_parted_by_duration():
    parted = [g for g in SOCIAL.groups if g.longer or g.shorter < np.inf]
    whole = [group for group in SOCIAL.groups if group not in parted]
    counts = Counter(name for group in whole for name in group.gestures)
    assert set(counts.values()) == {1}
    assert {name for group in SOCIAL.groups for name in group.gestures} == set(GESTURES)
    assert set(counts) | set(parted[0].gestures) == set(GESTURES)


def test_a_trial_is_played_between_rest_and_passes_through_its_readings():
    rng = np.random.default_rng(0)
    trial = trial_of(rng.integers(0, 256, (4, 456)))
    scans = list(transfer.scans_of(trial, 50.0))
    counts = np.stack([scan.counts for scan in scans])
    stamps = np.array([scan.stamp for scan in scans])
    assert np.all(np.diff(stamps) == 20_000_000)
    assert not counts[:75].any() and not counts[-30:].any()
    begin = round(50 * 1.58)
    expected = trial.share * transfer.FINEST
    np.testing.assert_allclose(counts[begin : begin + 13 : 4], expected, atol=0.51)
    middle = (expected[0] + expected[1]) / 2
    np.testing.assert_allclose(counts[begin + 2], middle, atol=0.51)


def test_what_is_not_felt_is_none_and_nothing_is_said():
    trial = trial_of(np.zeros((5, 456)))
    [answer] = transfer.answer_trials([trial], SOCIAL, load_model("ur5"), SETTING)
    assert (answer.forced, answer.averaged, answer.said) == ("none", "none", ())
    assert answer.seconds == 0


def test_the_largest_touch_is_answered_after_its_last_contact():
    counts = pressed((2, 6), 12) + pressed((2, 12), 12, slice(0, 1), slice(0, 1)) // 20
    trial = trial_of(counts)
    model = load_model("ur5")
    pitch = SETTING.pitch_mm / 1000
    skin = transfer.build_grid_skin(19, 24, pitch, calibrated=True)
    mounted = transfer.MountedSkin(skin, transfer.load_robot("table"))
    calibration = transfer.Calibration.uniform(skin.count, transfer.FINEST, 40.0)
    touches = transfer.TouchTraces(transfer.Recognizer(model, mounted, calibration))
    for scan in transfer.scans_of(trial, 50.0):
        touches.push(scan)
    touches.finish()
    touch = touches.largest()
    assert touch is not None
    assert touch.impulse == max(trace.impulse for trace in touches.traces.values())
    late = (touch.stamps[touch.end] - touch.last) / 1e9
    assert 0.1 <= late < 0.12
    np.testing.assert_allclose(touch.forced().sum(), 1, atol=1e-5)
    assert touch.averaged().argmax() == touch.forced().argmax(), "one window only"


def test_figures_say_what_is_right_and_wrong():
    model = load_model("ur5")
    answers = [
        TrialAnswer("P0", "a", "poke", "poke", ("poke",), 1.0),
        TrialAnswer("P0", "a", "none", "poke", ("grab", "poke"), 1.0),
        TrialAnswer("P1", "a", "none", "none", ("unknown",), 1.0),
        TrialAnswer("P1", "a", "none", "none", (), 0.1),
        TrialAnswer("P1", "b", "poke", "none", (), 1.0),
    ]
    group = Group("pokes", ("a",), "poke", bar=0.6, longer=0.5)
    found = transfer.figures(answers, group, model)
    assert (found["n"], found["truth"], found["bar"]) == (3, "poke", 0.6)
    assert found["forced_right"] == pytest.approx(1 / 3)
    assert found["averaged_right"] == pytest.approx(2 / 3)
    assert found["live_right"] == pytest.approx(2 / 3)
    assert found["live_wrong"] == pytest.approx(1 / 3)
    assert found["live"]["nothing"] == pytest.approx(1 / 3)
    assert set(found["people"]) == {"P0", "P1"}
    rest = transfer.figures(answers, Group("rest", ("a",), "none"), model)
    assert (rest["live_right"], rest["live_wrong"]) == (0.5, 0.5)
    empty = transfer.figures(answers, Group("empty", ("c",), "none"), model)
    assert (empty["n"], empty["forced_right"]) == (0, None)


def test_the_command_prints_tables_and_writes_figures(tmp_path, monkeypatch, capsys):
    text = text_of([pressed(), pressed((1, 5))])
    write_socialtouch(tmp_path / "in", text=text)
    target = tmp_path / "figures.json"
    argv = ["--data", str(tmp_path / "in"), "--json", str(target), "--sweep"]
    monkeypatch.setattr("sys.argv", ["transfer", "--headline", *argv])
    monkeypatch.setattr(transfer, "SWEEP_PITCHES", (4.0,))
    monkeypatch.setattr(transfer, "SWEEP_SCALES", (20.0, 40.0))
    transfer.main()
    out = capsys.readouterr().out
    assert "| poke | poke | 2 |" in out and "| 4 mm, 20 kPa |" in out
    found = json.loads(target.read_text())
    assert list(found["groups"]) == ["poke", "stroke", "resting hand or arm"]
    assert found["groups"]["poke"]["n"] == 2
    same = found["sweep"][1]["forced_right"]["poke"]
    assert same == found["groups"]["poke"]["forced_right"]
