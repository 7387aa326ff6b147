"""Tests of tables of frames: small files of our own, as the sets are published."""

import re

import numpy as np
import pytest

from eskin.recording import NONE, read_recording
from helpers.cli import assert_refused, call, call_json

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
    write_csv(tmp_path / "a.csv", ("who", "what"), [(("Ann B", "Wave"), frames)], ";")
    options = (*GRID, "--person", "who", "--pitch-mm", 5, "--full-scale-kpa", 40)
    _, found = convert(capsys, tmp_path, "table", tmp_path / "a.csv", *options)
    recording = found["a-Ann_B"]
    counts = np.array([scan.counts for scan in recording.scans()])
    pressure = recording.calibration.gain * counts
    np.testing.assert_allclose(pressure, 2 * frames, atol=1e-3)
    assert recording.skin.calibrated and name_labels(recording) == ["Wave"]
    assert recording.metadata.subject == "Ann B"


ALIKE = {
    "Poke": "poke",
    "DOUBLE PAT": "double_pat",
    "finger_touch": "finger touch",
    "No Touch": "none",
    "no_touch": "none",
    "My Wave": "My Wave",
}
"""Labels, and the gestures that they are."""


def test_label_that_looks_like_a_gesture_of_eskins_models_is_that(tmp_path, capsys):
    parts = [((name,), build_frames(4, 6, 2)) for name in ALIKE]
    write_csv(tmp_path / "a.csv", ("what",), parts)
    _, found = convert(capsys, tmp_path, "table", tmp_path / "a.csv", *GRID)
    expected = [*dict.fromkeys(ALIKE.values())]
    assert [*dict.fromkeys(name_labels(found["a"]))] == expected


NAMES = ("轻拍", "нажать", "👋", "👩🏽‍🔧", "swipe+", "swipe-", "drücken", "a, b/c")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_names_in_any_letters_and_encoding_are_kept(tmp_path, capsys, encoding):
    parts = [(("王/芳", f'"{name}"'), build_frames(4, 6, 2)) for name in NAMES]
    write_csv(tmp_path / "a.csv", ("who", "what"), parts)
    text = (tmp_path / "a.csv").read_text()
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    options = (*GRID, "--person", "who")
    _, found = convert(capsys, tmp_path, "table", tmp_path / "a.csv", *options)
    assert name_labels(found["a-王_芳"]) == [*NAMES]
    assert found["a-王_芳"].metadata.subject == "王/芳"


@pytest.mark.parametrize(
    ("names", "part"),
    [
        (("Wave", "wave"), "'Wave' and 'wave' differ only in case"),
        (("my_wave", "my wave"), "'my_wave' and 'my wave' differ only in case"),
        (("unknown",), "own word"),
        (('"two\nlines"',), "cannot be printed"),
        (("x" * 201,), "201 bytes"),
    ],
)
@pytest.mark.parametrize("files", [1, 2])
def test_names_that_no_recogniser_can_have_are_refused(
    tmp_path, capsys, names, part, files
):
    """Names of one set look alike in whichever of its files they are."""
    parts = [((name,), build_frames(4, 6, 2)) for name in ("none", *names)]
    write_csv(tmp_path / "a.csv", ("what",), parts[: 2 if files == 2 else None])
    write_csv(tmp_path / "b.csv", ("what",), parts[-1:])
    source = tmp_path if files == 2 else tmp_path / "a.csv"
    words = ("convert", "table", source, tmp_path / "out", *GRID)
    assert_refused(capsys, *words, part=part)
    assert not (tmp_path / "out").exists()


TABLE = "what;a;b;c;d;e;f\n\ntap;1;2;3;4;5;6\ntap;1;2;3;4;5;6\n"


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("5;6\n", "5;nan\n", "line 3, column f is 'nan'"),
        ("5;6\n", "5;inf\n", "line 3, column f is 'inf'"),
        ("4;5", "-4;5", "line 3, column d is -4"),
        ("1;2", "1;x", "line 3, column b is 'x'"),
        ("1;2", "1;", "line 3, column b is ''"),
        ("1;2", "1;1_0", "line 3, column b is '1_0'"),
        ("1;2", "1;2,5", "line 3, column b is '2,5'"),
        ("1;2", "1;2;2", "line 3 has 8 columns, line 1 names 7"),
        ("1;2", "1", "line 3 has 6 columns, line 1 names 7"),
        ("tap", "dr\xfccken", "line 3 is no UTF-8"),
        ("tap", '"tap', "line 3 or one after it cannot be read"),
        ("what", "w\0a\0", "holds zero bytes, as UTF-16 does"),
    ],
)
def test_first_line_of_a_table_that_cannot_be_read_is_named(
    tmp_path, capsys, old, new, part
):
    """What is wrong is told by the line of the file, and by the name of the column."""
    table = TABLE.replace(old, new, 1).encode("latin-1")
    (tmp_path / "a.csv").write_bytes(table)
    words = ("convert", "table", tmp_path, tmp_path / "out", *GRID)
    code, _, error = call(capsys, *words)
    assert code == 2 and re.search(f"a.csv.*{part}.*; allowed are", error), error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_empty_lines_and_a_separator_at_the_end_of_rows_mean_nothing(tmp_path, capsys):
    found = []
    for number, row in enumerate(("6\n", "6;\r\n", "6\n\n\n")):
        path = tmp_path / f"{number}.csv"
        path.write_text(TABLE.replace("6\n", row))
        (tmp_path / "out").mkdir(exist_ok=True)
        _, recordings = convert(capsys, tmp_path, "table", path, *GRID)
        scans = recordings[str(number)].scans()
        found.append([scan.counts.tolist() for scan in scans])
    assert found == [[[1, 2, 3, 4, 5, 6]] * 2] * 3


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (GRID[:6], "without --label"),
        ((*GRID, "--person", "weight"), "0 columns are 'weight'"),
        ((*GRID[2:], "--rows", 4), "correct --rows"),
        ((*GRID, "--full-scale", 100), "line 3, column ch2 is 200"),
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
