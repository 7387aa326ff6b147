"""Tests of tables of frames: small files of our own, as the sets are published."""

import numpy as np
import pytest

from eskin.recording import NONE, read_recording
from helpers.cli import assert_refused, call_json

pytestmark = pytest.mark.slow

REST = 7


def build_frames(count, size, at):
    """Return frames at rest but for one taxel, pressed in the middle of them."""
    frames = np.full((count, size), REST)
    frames[1:-1, at] = 200
    return frames


def write_csv(path, head, parts, cut=","):
    """Write the frames of parts, each with the same first cells but for `{n}`."""
    [size] = {frames.shape[1] for _, frames in parts}
    lines = [cut.join((*head, *(f"ch{n}" for n in range(size))))]
    for cells, frames in parts:
        for n, frame in enumerate(frames, 1):
            own = [str(cell).format(n=n) for cell in cells]
            lines.append(cut.join((*own, *map(str, frame))))
    path.write_text("\n".join(lines))


def convert(capsys, tmp_path, name, source, *options):
    """Convert; return the counts and the recordings by name."""
    out = tmp_path / "out"
    result, _ = call_json(capsys, "convert", name, source, out, *options)
    return result, {path.stem: read_recording(path) for path in sorted(out.iterdir())}


def name_labels(recording):
    return [label.gesture for label in recording.labels]


def test_repetitions_of_cost_start_where_frames_count_anew(tmp_path, capsys):
    head = (" subject", " variant", " gesture", " frame")
    parts = [
        ((person, 1, gesture, "{n}"), build_frames(9, 64, at))
        for person, gesture, at in ((1, 1, 3), (2, 14, 5), (1, 1, 4), (1, 6, 0))
    ]
    write_csv(tmp_path / "CoST.csv", head, parts)
    result, found = convert(capsys, tmp_path, "cost", tmp_path / "CoST.csv")
    assert result == {"recordings": 2, "taxels": 64, "readings": 36, "labels": 4}
    assert list(found) == ["CoST-1", "CoST-2"]
    first = found["CoST-1"]
    assert name_labels(first) == ["grab", "grab", "poke"]
    assert name_labels(found["CoST-2"]) == ["tickle"]
    assert first.metadata.subject == "1" and first.calibration.full_scale == 1023
    np.testing.assert_array_equal(first.calibration.rest, REST)
    stamps = np.array([scan.stamp for scan in first.scans()])
    assert np.diff(stamps[:9]) == pytest.approx(1e9 / 135, abs=1)
    assert stamps[9] - stamps[8] > 2e9
    counts = np.array([scan.counts for scan in first.scans()])
    np.testing.assert_array_equal(
        counts, np.concatenate([parts[n][1] for n in (0, 2, 3)])
    )


def test_captures_of_haart_change_with_their_conditions(tmp_path, capsys):
    head = ("ParticipantNo", "Substrate", "Cover", "Gesture")
    parts = [
        ((4, "foam", cover, gesture), build_frames(6, 64, 9))
        for cover, gesture in (("fur", "noTouch"), ("fur", "pat"), ("none", "pat"))
    ]
    write_csv(tmp_path / "training.csv", head, parts)
    _, found = convert(capsys, tmp_path, "haart", tmp_path)
    assert name_labels(found["training-4"]) == [NONE, "pat", "pat"]


def test_capfingerid_has_a_person_a_file_and_a_label_a_trial(tmp_path, capsys):
    frames = build_frames(12, 405, 40).reshape(-1, 27, 15).astype(np.uint8)
    trial = np.repeat(np.arange(3), 4)
    labels = np.array(["tap", "pause", "tap"])
    np.savez(tmp_path / "P03.npz", frames=frames, trial=trial, labels=labels, rate=14.3)
    _, found = convert(capsys, tmp_path, "capfingerid", tmp_path)
    assert name_labels(found["P03"]) == ["tap", "pause", "tap"]
    assert found["P03"].metadata.subject == "P03"


GRID = ("--rows", 2, "--columns", 3, "--rate", 20, "--label", "what")


def test_table_of_fractions_keeps_their_ratios_and_its_pitch(tmp_path, capsys):
    frames = build_frames(5, 6, 2) / 10
    write_csv(tmp_path / "a.csv", ("who", "what"), [(("Ann B", "Tap"), frames)], ";")
    options = (*GRID, "--person", "who", "--pitch-mm", 5, "--full-scale-kpa", 40)
    _, found = convert(capsys, tmp_path, "table", tmp_path / "a.csv", *options)
    recording = found["a-Ann_B"]
    counts = np.array([scan.counts for scan in recording.scans()])
    pressure = recording.calibration.gain * counts
    np.testing.assert_allclose(pressure, 2 * frames, atol=1e-3)
    assert recording.skin.calibrated and name_labels(recording) == ["tap"]


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (GRID[:6], "without --label"),
        ((*GRID, "--person", "weight"), "0 columns are 'weight'"),
        ((*GRID[2:], "--rows", 4), "correct --rows"),
        ((*GRID, "--full-scale", 100), "a taxel is 200"),
        ((*GRID, "--rate", 0.5), "--rate is 0.5"),
    ],
)
def test_table_that_its_options_do_not_fit_is_refused(tmp_path, capsys, options, part):
    write_csv(tmp_path / "a.csv", ("what",), [(("tap",), build_frames(5, 6, 2))])
    words = ("convert", "table", tmp_path / "a.csv", tmp_path / "out", *options)
    assert_refused(capsys, *words, part=part)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["", "what,a,b,c,d,e,f\n", "what,a,b,c,d,e,f\ntap,1"])
def test_cut_or_empty_table_is_refused(tmp_path, capsys, text):
    (tmp_path / "a.csv").write_text(text)
    words = ("convert", "table", tmp_path, tmp_path / "out", *GRID)
    assert_refused(capsys, *words, part="a.csv")
    (tmp_path / "a.csv").rename(tmp_path / "a.npz")
    assert_refused(capsys, *words, part="a.npz")


def test_options_of_tables_are_refused_for_other_sets(tmp_path, capsys):
    words = ("convert", "sleeve", tmp_path, tmp_path / "out", "--rows", 3)
    assert_refused(capsys, *words, part="--rows is given for sleeve")
