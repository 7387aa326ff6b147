"""Tests of importing public sets: files made as in the sets, and some real ones."""

import csv
import gzip
import json
from datetime import UTC, datetime

import numpy as np
import pytest

from eskin.errors import ImportSourceError
from eskin.recording import read_recording
from eskin.sets import (
    convert_shearsense,
    convert_sleeve,
    convert_socialtouch,
)
from eskin.sets.shearsense import (
    find_shearsense_files,
    parse_participant,
    parse_support,
)
from eskin.sets.socialtouch import GESTURES
from eskin.skin import load_skin
from helpers.socialtouch import HEADER, pressed, text_of, write_socialtouch

SECOND = 1_000_000_000
SLEEVE = "Grab_20250521150749_annotated.json.gz"
SHEARSENSE = "tap/tapP1_FLAT.npz"


def make_sleeve(labels=("None", "Grab"), timestamp="20250521150749"):
    """Return the content of a sleeve file, with one frame for each label."""
    rng = np.random.default_rng(0)
    frames = [
        {"label": label, "data": (rng.integers(0, 171, (19, 27)) * 1.5).tolist()}
        for label in labels
    ]
    return {"id": "x", "label": "Grab", "timestamp": timestamp, "frames": frames}


def write_sleeve(folder, name=SLEEVE, content=None):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    data = json.dumps(content or make_sleeve()).encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


def write_shearsense(folder, name=SHEARSENSE, length=20, **changes):
    """Write a file of three arrays, some of them given by name; return the arrays."""
    rng = np.random.default_rng(0)
    shape = (length, 6, 6)
    names = ("arr_0", "arr_1", "arr_2")
    arrays = {name: rng.integers(0, 257, shape).astype(np.int16) for name in names}
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(path, **(arrays | changes))
    return list(arrays.values())


def convert_all(convert, folder, *given):
    """Convert `in` to `out`; return the counts of the conversion and its recordings."""
    result = convert(folder / "in", folder / "out", *given)
    found = [read_recording(path) for path in sorted((folder / "out").glob("*.mcap"))]
    assert result.recordings == len(found)
    counts = (result.taxels, result.readings, result.labels)
    return counts, found


def build_stamp(*date):
    return int(datetime(*date, tzinfo=UTC).timestamp()) * SECOND


def assert_refused(convert, folder, *parts, path=None):
    """Check that a conversion fails in one line and leaves nothing."""
    with pytest.raises(ImportSourceError) as caught:
        convert(folder / "in", folder / "out")
    message = str(caught.value)
    assert all(part in message for part in (*parts, str(path or ""))), message
    assert "\n" not in message
    assert not (folder / "out").exists()


def test_sleeve_file_keeps_every_value_and_label(tmp_path):
    labels = ["None", "Squeez", "Squeez", "None", None, "hug", "Unknown"]
    content = make_sleeve(labels)
    write_sleeve(tmp_path / "in", content=content)
    counted, [recording] = convert_all(convert_sleeve, tmp_path)
    assert counted == (513, 7, 3)
    assert recording.path.name == SLEEVE.replace("json.gz", "mcap")
    arrays = recording.arrays()
    expected = [frame["data"] for frame in content["frames"]]
    np.testing.assert_array_equal(arrays.counts * 1.5, np.reshape(expected, (7, 513)))
    assert arrays.received.all()
    start = build_stamp(2025, 5, 21, 15, 7, 49)
    np.testing.assert_array_equal(arrays.stamps, start + np.arange(7) * SECOND // 10)
    spans = [
        (x.gesture, (x.start - start) * 10 // SECOND, (x.end - start) * 10 // SECOND)
        for x in recording.labels
    ]
    assert spans == [("squeeze", 1, 3), ("hug", 5, 6), ("tap", 6, 7)]
    assert {label.source for label in recording.labels} == {"true"}


def test_sleeve_session_ends_after_ten_minutes_or_with_the_day(tmp_path):
    sessions = {
        "20250528141500": "20250528-1415",
        "20250528142500": "20250528-1415",
        "20250528143459": "20250528-1415",
        "20250528144500": "20250528-1445",
        "20250528235900": "20250528-2359",
        "20250529000100": "20250529-0001",
    }
    for time in sessions:
        write_sleeve(tmp_path / "in", f"Tap_{time}_annotated.json")
    _, found = convert_all(convert_sleeve, tmp_path)
    assert [r.metadata.session for r in found] == list(sessions.values())


def test_files_are_plain_nested_or_a_single_one(tmp_path):
    """The time of a sleeve file may stand in its content alone."""
    write_sleeve(tmp_path / "in", "a/tap.json", make_sleeve(timestamp="20250101120000"))
    write_sleeve(tmp_path / "in")
    (tmp_path / "in/notes.txt").write_text("not part of the set")
    _, [_, found] = convert_all(convert_sleeve, tmp_path)
    assert found.metadata.session == "20250101-1200"
    path = write_socialtouch(tmp_path / "in", "a/touch_p0_g31-1_5_9h_0m_1s.csv")
    write_socialtouch(tmp_path / "in", gesture=0)
    (tmp_path / "in/GesturesRated.csv").write_text("id,gesture_name\n")
    assert convert_socialtouch(tmp_path / "in", tmp_path / "both").recordings == 2
    assert convert_socialtouch(path, tmp_path / "alone").recordings == 1


def set_pixel(content, value):
    content["frames"][1]["data"][2][5] = value


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda c: c["frames"][1]["data"].pop(), ["frame 1", "(18, 27)", "(19, 27)"]),
        (lambda c: c["frames"][1]["data"][3].pop(), ["frame 1", "19 x 27"]),
        (lambda c: set_pixel(c, float("nan")), ["frame 1", "nan", "0 to 255"]),
        (lambda c: set_pixel(c, None), ["frame 1", "nan", "0 to 255"]),
        (lambda c: set_pixel(c, 256.5), ["frame 1", "256.5", "0 to 255"]),
        (lambda c: c.pop("frames"), ["no frames"]),
        (lambda c: c["frames"].append("x"), ["frame 2", "19 x 27"]),
    ],
)
def test_invalid_sleeve_file_is_refused(tmp_path, change, parts):
    write_sleeve(tmp_path / "in")
    content = make_sleeve()
    change(content)
    bad = write_sleeve(tmp_path / "in", "Tap_20250521150905.json", content)
    assert_refused(convert_sleeve, tmp_path, *parts, path=bad)
    bad.write_bytes(bad.read_bytes()[:40])
    assert_refused(convert_sleeve, tmp_path, "not whole JSON", path=bad)


def test_shearsense_file_keeps_every_value(tmp_path):
    name = "rub/rubP3_Mar15th2023_PILLOW 19_26_05.npz"
    arrays = write_shearsense(tmp_path / "in", name, length=90)
    counted, [recording] = convert_all(convert_shearsense, tmp_path)
    assert counted == (36, 90, 1)
    assert recording.path.name == "rub_P3_Mar15th2023_PILLOW_19_26_05.mcap"
    found = recording.arrays()
    np.testing.assert_array_equal(found.counts, arrays[0].reshape(90, 36))
    np.testing.assert_array_equal(found.shear[..., 0], arrays[1].reshape(90, 36))
    np.testing.assert_array_equal(found.shear[..., 1], arrays[2].reshape(90, 36))
    assert recording.skin.has_shear and not recording.skin.calibrated
    assert recording.calibration.shear_rest == 128
    start = build_stamp(2023, 3, 15, 19, 26, 5)
    since_start = np.arange(90) / 44.7 * 1e9
    np.testing.assert_allclose(found.stamps - start, since_start, atol=200)
    [label] = recording.labels
    assert (label.gesture, label.start) == ("rub", start)
    assert label.end > found.stamps[-1]


@pytest.mark.parametrize(
    ("name", "gesture", "subject", "session"),
    [
        ("rub/rubP8-Mar22 19_55_28_FLAT.npz", "rub", "P8", "FLAT"),
        ("no/noP12_Mar16th2023_1_pillow 17_38_23.npz", "none", "P12", "PILLOW"),
        ("press/pressP30_Sep15th2023_FLAT 12_00_00.npz", "press", "P30", "FLAT"),
        ("Outward caress/p9 flat.npz", "outward_caress", "P9", "FLAT"),
        ("tap/tap_Sep15th2023_p4_FLAT.npz", "tap", "P4", "FLAT"),
        ("tap/tap_participant_07.npz", "tap", "P7", "UNKNOWN"),
    ],
)
def test_shearsense_name_gives_gesture_subject_and_session(
    tmp_path, name, gesture, subject, session
):
    write_shearsense(tmp_path / "in", name)
    _, [recording] = convert_all(convert_shearsense, tmp_path)
    assert [label.gesture for label in recording.labels] == [gesture]
    metadata = recording.metadata
    assert (metadata.subject, metadata.session) == (subject, session)


SHAPE = (20, 6, 6)


@pytest.mark.parametrize(
    ("name", "array", "parts"),
    [
        ("arr_1", np.zeros((20, 6, 5), np.int16), ["(20, 6, 5)"]),
        ("arr_2", np.zeros((19, 6, 6), np.int16), ["(19, 6, 6)"]),
        ("arr_0", np.zeros((0, 6, 6), np.int16), ["(0, 6, 6)"]),
        ("arr_0", np.array(3), ["()"]),
        ("arr_2", np.full(SHAPE, np.nan), ["nan", "0 to 256"]),
        ("arr_0", np.full(SHAPE, -1), ["-1", "0 to 256"]),
        ("arr_1", np.full(SHAPE, "a"), ["type <U1", "numbers"]),
    ],
)
def test_invalid_shearsense_array_is_refused(tmp_path, name, array, parts):
    write_shearsense(tmp_path / "in", **{name: array})
    assert_refused(convert_shearsense, tmp_path, name, *parts, path=SHEARSENSE)


# numpy leaves a truncated archive open for the garbage collector.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_shearsense_file_without_person_or_whole_archive_is_refused(tmp_path):
    path = tmp_path / "in" / SHEARSENSE
    write_shearsense(tmp_path / "in", arr_1=np.full(SHAPE, None))
    assert_refused(convert_shearsense, tmp_path, "archive", path=path)
    write_shearsense(tmp_path / "in")
    for length in (path.stat().st_size - 5, 200, 3, 0):
        path.write_bytes(path.read_bytes()[:length])
        assert_refused(convert_shearsense, tmp_path, "archive", path=path)
    with path.open("wb") as file:
        np.save(file, np.zeros(SHAPE))
    assert_refused(convert_shearsense, tmp_path, "archive", path=path)
    path.unlink()
    write_shearsense(tmp_path / "in", "tap/tap_FLAT.npz")
    assert_refused(convert_shearsense, tmp_path, "tap_FLAT.npz", "no participant")


def test_socialtouch_file_keeps_every_value_and_labels_touched_readings(tmp_path):
    rng = np.random.default_rng(0)
    counts = [rng.integers(0, 9, (5, 456)), pressed((0, 4), 4), np.zeros((3, 456), int)]
    counts[0][1:3, 7] = 255
    write_socialtouch(tmp_path / "in", text=text_of(counts, person=1, gesture=7))
    counted, [recording] = convert_all(convert_socialtouch, tmp_path)
    assert counted == (456, 12, 2)
    assert recording.path.name == "poke_strong_P1_20220420_170523.mcap"
    arrays = recording.arrays()
    np.testing.assert_array_equal(arrays.counts, np.concatenate(counts))
    assert arrays.received.all()
    start = build_stamp(2022, 4, 20, 17, 5, 23)
    first = 83 * 4 + 2000
    second = 83 * 7 + 4000
    times = [83 * np.arange(5), first + 83 * np.arange(4), second + 83 * np.arange(3)]
    milliseconds = (arrays.stamps - start) / 1e6
    np.testing.assert_array_equal(milliseconds, np.concatenate(times))
    spans = [((x.start - start) / 1e6, (x.end - start) / 1e6) for x in recording.labels]
    assert spans == [(83, 83 * 3), (first, first + 83 * 4)]
    assert {label.gesture for label in recording.labels} == {"poke_strong"}
    metadata = recording.metadata
    assert (metadata.subject, metadata.session) == ("P1", "P1-20220420")


def change_cell(column, value):
    """Return a file with a cell of its third reading replaced."""
    lines = text_of([pressed()]).splitlines()
    row = lines[3].split(",")
    row[column] = value
    return "\n".join([*lines[:3], ",".join(row), *lines[4:]]) + "\n"


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (change_cell(9, "256"), ["pixel is 256", "0 to 255"]),
        (change_cell(9, "-1"), ["pixel is -1", "0 to 255"]),
        *((change_cell(9, value), ["461"]) for value in ("1.5", "nan", "", "1,1")),
        (change_cell(0, "1"), ["participantID is 0 and 1"]),
        (change_cell(1, "7"), ["gesture is 6 and 7"]),
        (change_cell(4, "83"), ["83 ms"]),
        (text_of([pressed()], gesture=32), ["gesture is 32", "0 to 31"]),
        (text_of([pressed()], person=-1), ["participantID is -1"]),
        (text_of([pressed()[:, :-1]]), ["460 columns", "461"]),
        (text_of([]), ["no readings"]),
        ("", ["first line is ''", "participantID,gesture,"]),
        (HEADER.replace("time", "ms"), ["first line is 'participantID,"]),
    ],
)
def test_invalid_socialtouch_file_is_refused(tmp_path, text, parts):
    write_socialtouch(tmp_path / "in", "touch_p0_g0-20_4_9h_0m_0s.csv", gesture=0)
    bad = write_socialtouch(tmp_path / "in", text=text)
    assert_refused(convert_socialtouch, tmp_path, *parts, path=bad)


def test_socialtouch_file_that_is_truncated_or_has_no_time_is_refused(tmp_path):
    path = write_socialtouch(tmp_path / "in")
    whole = path.read_bytes()
    for length in (0, 3, 100, len(whole) - 5):
        path.write_bytes(whole[:length])
        part = "not whole text" if length else "first line is ''"
        assert_refused(convert_socialtouch, tmp_path, part, path=path)
    path.write_bytes(whole)
    for name in ("touch_p0_g6.csv.gz", "touch_p0_g6-31_2_17h_5m_23s.csv.gz"):
        path = path.rename(path.with_name(name))
        assert_refused(convert_socialtouch, tmp_path, "no day", path=path)


@pytest.mark.parametrize(("pitch", "pressure"), [(0.010, 100.0), (0.004, 40.0)])
def test_geometry_and_units_are_nominal_unless_given(tmp_path, pitch, pressure):
    write_socialtouch(tmp_path / "in")
    given = () if pitch == 0.010 else (pitch, pressure)
    _, [recording] = convert_all(convert_socialtouch, tmp_path, *given)
    assert (recording.robot_name, recording.joint_names) == ("table", ())
    assert recording.skin.calibrated == bool(given)
    expected = load_skin("socialtouch").positions * pitch / 0.010
    np.testing.assert_allclose(recording.skin.positions, expected, atol=1e-9)
    full = recording.calibration.gain * recording.calibration.full_scale
    np.testing.assert_allclose(full, pressure)


@pytest.mark.parametrize(
    "convert", [convert_sleeve, convert_shearsense, convert_socialtouch]
)
def test_folder_without_the_set_is_refused(tmp_path, convert):
    assert_refused(convert, tmp_path, "folder ", path=tmp_path / "in")
    (tmp_path / "in").mkdir()
    assert_refused(convert, tmp_path, "no ", "file", path=tmp_path / "in")


def test_failed_conversion_changes_nothing_in_its_folder(tmp_path):
    """Such as one of two files that would become one recording."""
    for name in (SLEEVE, SLEEVE.removesuffix(".gz")):
        write_sleeve(tmp_path / "in", name)
    assert_refused(convert_sleeve, tmp_path, "would become Grab_", ".mcap")
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine.txt").write_text("kept")
    with pytest.raises(ImportSourceError):
        convert_sleeve(tmp_path / "in", tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine.txt"]


def test_names_of_real_shearsense_files_give_people_and_supports(
    tmp_path, shearsense_folder
):
    files = find_shearsense_files(shearsense_folder)
    people = {parse_participant(path, path.stem) for path in files}
    assert people >= {f"P{number}" for number in range(1, 9)}
    assert {parse_support(path.stem) for path in files} == {"FLAT", "PILLOW"}
    assert len({path.parent for path in files}) == 18
    [file] = shearsense_folder.glob("rub/*P8*FLAT*")
    (tmp_path / "in/rub").mkdir(parents=True)
    (tmp_path / "in/rub" / file.name).symlink_to(file)
    assert convert_shearsense(tmp_path / "in", tmp_path / "out").labels == 1


@pytest.mark.slow
def test_real_socialtouch_files_have_the_gestures_of_their_table(
    tmp_path, socialtouch_folder
):
    with (socialtouch_folder / "GesturesRated.csv").open() as file:
        names = [row["gesture_name"] for row in csv.DictReader(file)]
    assert tuple(name.replace("carress", "caress") for name in names) == GESTURES
    (tmp_path / "in").mkdir()
    for number in (6, 7, 16):
        for path in socialtouch_folder.glob(f"*_g{number}-*"):
            (tmp_path / "in" / path.name).symlink_to(path)
    counted, recordings = convert_all(convert_socialtouch, tmp_path)
    assert (len(recordings), *counted) == (6, 456, 2255, 171)
    assert {r.metadata.subject for r in recordings} == {"P0", "P1"}
    gestures = {label.gesture for r in recordings for label in r.labels}
    assert gestures == {GESTURES[6], GESTURES[7], GESTURES[16]}
