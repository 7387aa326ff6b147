"""Tests of the benchmark on people that no weights were trained on."""

import json

import numpy as np
import pytest

from eskin import load_model
from helpers.socialtouch import pressed, text_of, write_socialtouch
from lab import public_sets, transfer
from lab.public_sets import SETS, Group, Trial
from lab.transfer import TrialAnswer

SOCIAL = SETS["socialtouch"]


def make_trial(counts, period=0.08):
    seconds = np.arange(len(counts)) * period
    return Trial("P0", "poke_short", seconds, counts / 255)


@pytest.fixture(scope="module")
def model():
    return load_model("ur5")


def test_trial_is_interpolated_between_rest():
    rng = np.random.default_rng(0)
    trial = make_trial(rng.integers(0, 256, (4, 456)))
    scans = list(transfer.build_scans(trial))
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
    [answer] = transfer.answer_trials([trial], SOCIAL, model)
    assert (answer.forced, answer.closed) == ("none", "none")
    assert answer.seconds == 0


def test_largest_touch_is_answered_after_its_last_contact(model):
    counts = pressed((2, 6), 12) + pressed((2, 12), 12, slice(0, 1), slice(0, 1)) // 20
    pitch = SOCIAL.pitch_mm / 1000
    skin = transfer.build_grid_skin(19, 24, pitch, calibrated=True)
    mounted = transfer.MountedSkin(skin, transfer.load_robot("table"))
    calibration = transfer.Calibration.uniform(skin.count, transfer.FINEST, 40.0)
    recognizer = transfer.Recognizer(model, mounted, calibration)
    traces = transfer.trace_touches(make_trial(counts), recognizer)
    touch = max(traces.values(), key=lambda trace: trace.impulse)
    due = [stamp >= touch.last + 100_000_000 for stamp in touch.stamps]
    expected = touch.probabilities[due.index(True)]
    np.testing.assert_array_equal(touch.forced, expected)
    np.testing.assert_allclose(expected.sum(), 1, atol=1e-5)
    assert touch.stamps[-1] > touch.last + 300_000_000, "it stays open for a second pat"


def test_figures_are_shares_of_the_answers_of_a_group(model):
    answers = [
        TrialAnswer("P0", "a", "poke", "poke", 1.0),
        TrialAnswer("P0", "a", "none", "poke", 1.0),
        TrialAnswer("P1", "a", "none", "none", 1.0),
        TrialAnswer("P1", "a", "none", "none", 0.1),
        TrialAnswer("P1", "b", "poke", "none", 1.0),
    ]
    group = Group("pokes", ("a",), "poke", longer=0.5)
    inside = transfer.select_answers(answers, group)
    shares = [transfer.compute_accuracy(inside, group, at) for at in (False, True)]
    assert shares == pytest.approx([1 / 3, 2 / 3])
    assert transfer.compute_accuracy([], group) is None
    rows = transfer.format_forced_table(answers, [group], model).splitlines()
    assert rows[3].startswith("| pokes | poke | 3 | ")
    assert rows[3].endswith(" | 33.3% | 66.7% |")
    assert [row.split(" | ")[0] for row in rows[4:]] == ["| - P0", "| - P1"]


@pytest.mark.slow
def test_program_prints_a_table(tmp_path, monkeypatch, capsys):
    text = text_of([pressed(), pressed((1, 5))])
    write_socialtouch(tmp_path, text=text)
    monkeypatch.setattr("sys.argv", ["transfer", "--data", str(tmp_path)])
    transfer.main()
    assert "| poke | poke | 2 |" in capsys.readouterr().out


def test_runs_end_at_pauses_and_after_two_seconds():
    rows = np.array([0, 1, 2, 9, 10, 11, 60])
    [first, second] = public_sets.cut_runs(rows, np.arange(100) * 0.1)
    assert first.tolist() == [0, 1, 2] and second.tolist() == [9, 10, 11]
    long = public_sets.cut_runs(np.arange(45), np.arange(100) * 0.1)
    assert [part[0] for part in long] == [0, 20, 40]
    assert np.concatenate(long).tolist() == list(range(45))


def test_shearsense_is_cut_into_its_contacts(tmp_path):
    length = 100
    folder = tmp_path / "poke"
    folder.mkdir()
    pressure = np.zeros((length, 6, 6))
    pressure[10:20, 1, 2] = pressure[60:75, 4, 0] = 100
    rest = np.full((length, 6, 6), 128)
    name = "pokeP2_Mar15th2023_FLAT 18_21_15.npz"
    np.savez(folder / name, pressure, rest, rest)
    one, other = public_sets.read_shearsense(tmp_path)
    assert (one.subject, one.gesture) == ("P2", "poke")
    assert (len(one.share), len(other.share)) == (10, 15)
    assert one.share[:, 8].min() == pytest.approx(100 / 256)


def test_sleeve_is_cut_at_its_labels_without_its_resting_pressure(tmp_path):
    frames = []
    for label in ["None"] * 6 + ["Grab"] * 4 + ["None"] * 12:
        data = np.full((19, 27), 15.0)
        data[3, 4] += 60.0 * (label == "Grab")
        frames.append({"label": label, "data": data.tolist()})
    content = json.dumps({"timestamp": "20250521150749", "frames": frames})
    (tmp_path / "Grab_20250521150749_annotated.json").write_text(content)
    found = {}
    for trial in public_sets.read_sleeve(tmp_path):
        found.setdefault(trial.gesture, []).append(trial)
    [grab] = found["grab"]
    assert len(grab.share) == 4 and grab.share.sum() == pytest.approx(4 * 60 / 255)
    assert sum(len(trial.share) for trial in found["none"]) == 18
    assert not any(trial.share.any() for trial in found["none"])
