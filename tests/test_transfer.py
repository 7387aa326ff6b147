"""Tests of the benchmark on people that no weights were trained on."""

import json

import numpy as np
import pytest
from benchmarks import transfer
from benchmarks.transfer import SETS, Group, TransferSetting, Trial, TrialAnswer

from eskin import load_model
from helpers.socialtouch import pressed, text_of, write_socialtouch

SOCIAL = SETS["socialtouch"]
SETTING = TransferSetting(4.0, 40.0, 50.0)


def make_trial(counts, period=0.08):
    seconds = np.arange(len(counts)) * period
    return Trial("P0", "poke_short", seconds, counts / 255)


@pytest.fixture(scope="module")
def model():
    return load_model("ur5")


def test_trial_is_interpolated_between_rest():
    rng = np.random.default_rng(0)
    trial = make_trial(rng.integers(0, 256, (4, 456)))
    scans = list(transfer.build_scans(trial, 50.0))
    counts = np.stack([scan.counts for scan in scans])
    assert np.all(np.diff([scan.stamp for scan in scans]) == 20_000_000)
    assert not counts[:75].any() and not counts[-30:].any()
    begin = round(50 * 1.58)
    expected = trial.share * transfer.FINEST
    np.testing.assert_allclose(counts[begin : begin + 13 : 4], expected, atol=0.51)
    middle = (expected[0] + expected[1]) / 2
    np.testing.assert_allclose(counts[begin + 2], middle, atol=0.51)


def test_trial_without_contact_is_answered_none(model):
    trial = make_trial(np.zeros((5, 456)))
    [answer] = transfer.answer_trials([trial], SOCIAL, model, SETTING)
    assert (answer.forced, answer.averaged, answer.detected) == ("none", "none", ())
    assert answer.seconds == 0


def test_largest_touch_is_answered_after_its_last_contact(model):
    counts = pressed((2, 6), 12) + pressed((2, 12), 12, slice(0, 1), slice(0, 1)) // 20
    pitch = SETTING.pitch_mm / 1000
    skin = transfer.build_grid_skin(19, 24, pitch, calibrated=True)
    mounted = transfer.MountedSkin(skin, transfer.load_robot("table"))
    calibration = transfer.Calibration.uniform(skin.count, transfer.FINEST, 40.0)
    touches = transfer.TouchTraces(transfer.Recognizer(model, mounted, calibration))
    for scan in transfer.build_scans(make_trial(counts), 50.0):
        touches.push(scan)
    touches.finish()
    touch = touches.largest()
    assert touch is not None
    assert touch.impulse == max(trace.impulse for trace in touches.traces.values())
    late = (touch.stamps[touch.end] - touch.last) / 1e9
    assert 0.1 <= late < 0.12
    np.testing.assert_allclose(touch.forced().sum(), 1, atol=1e-5)
    assert touch.averaged().argmax() == touch.forced().argmax(), "there is one window"


def test_figures_are_shares_of_the_answers_of_a_group(model):
    answers = [
        TrialAnswer("P0", "a", "poke", "poke", ("poke",), 1.0),
        TrialAnswer("P0", "a", "none", "poke", ("grab", "poke"), 1.0),
        TrialAnswer("P1", "a", "none", "none", ("unknown",), 1.0),
        TrialAnswer("P1", "a", "none", "none", (), 0.1),
        TrialAnswer("P1", "b", "poke", "none", (), 1.0),
    ]
    group = Group("pokes", ("a",), "poke", bar=0.6, longer=0.5)
    found = transfer.compute_results(answers, group, model)
    assert (found["n"], found["truth"], found["bar"]) == (3, "poke", 0.6)
    names = ("forced_right", "averaged_right", "live_right", "live_wrong")
    shares = [found[name] for name in names] + [found["live"]["nothing"]]
    assert shares == pytest.approx([1 / 3, 2 / 3, 2 / 3, 1 / 3, 1 / 3])
    assert set(found["people"]) == {"P0", "P1"}
    rest = transfer.compute_results(answers, Group("rest", ("a",), "none"), model)
    assert (rest["live_right"], rest["live_wrong"]) == (0.5, 0.5)
    empty = transfer.compute_results(answers, Group("empty", ("c",), "none"), model)
    assert (empty["n"], empty["forced_right"]) == (0, None)


@pytest.mark.slow
def test_benchmark_prints_tables_and_writes_figures(tmp_path, monkeypatch, capsys):
    text = text_of([pressed(), pressed((1, 5))])
    write_socialtouch(tmp_path / "in", text=text)
    target = tmp_path / "figures.json"
    words = ["--data", str(tmp_path / "in"), "--json", str(target), "--sweep"]
    monkeypatch.setattr("sys.argv", ["transfer", "--headline", *words])
    monkeypatch.setattr(transfer, "SWEEP_PITCHES", (4.0,))
    monkeypatch.setattr(transfer, "SWEEP_SCALES", (20.0, 40.0))
    transfer.main()
    out = capsys.readouterr().out
    assert "| poke | poke | 2 |" in out and "| 4 mm, 20 kPa |" in out
    found = json.loads(target.read_text())
    required = [group.name for group in transfer.group_socialtouch() if group.bar]
    assert list(found["groups"]) == required
    assert found["groups"]["poke"]["n"] == 2
    same = found["sweep"][1]["forced_right"]["poke"]
    assert same == found["groups"]["poke"]["forced_right"]
