"""Public sets become recordings: files as in the sets, and the sets where present."""

import csv
import gzip
import json
from collections import Counter
from datetime import UTC, datetime

import numpy as np
import pytest

from eskin.errors import ImportSourceError
from eskin.recording import (
    convert_shearsense,
    convert_sleeve,
    convert_socialtouch,
    read_recording,
)
from eskin.recording.shearsense import (
    find_shearsense_files,
    parse_participant,
    parse_support,
)
from eskin.recording.socialtouch import GESTURES
from eskin.skin import load_skin
from helpers.socialtouch import HEADER, pressed, text_of, write_socialtouch

SECOND = 1_000_000_000


def sleeve_content(labels, seed=0, timestamp="20250521150749"):
    rng = np.random.default_rng(seed)
    frames = [
        {
            "frame_index": index,
            "label": label,
            "data": (rng.integers(0, 171, (19, 27)) * 1.5).tolist(),
        }
        for index, label in enumerate(labels)
    ]
    return {"id": "x", "label": "Grab", "timestamp": timestamp, "frames": frames}


def write_sleeve(folder, name, labels=("None", "Grab", "Grab", "None"), **kwargs):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    data = json.dumps(sleeve_content(labels, **kwargs)).encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


def sessions_of(folder):
    recordings = [read_recording(path) for path in sorted(folder.glob("*.mcap"))]
    return {r.path.stem.split("_")[0]: r.metadata.session for r in recordings}


def test_a_sleeve_file_keeps_every_value_and_label(tmp_path):
    labels = ["None", "Squeez", "Squeez", "None", None, "hug", "Unknown"]
    source = write_sleeve(tmp_path / "in", "Squeez_20250521150749_annotated.json.gz")
    source.write_bytes(gzip.compress(json.dumps(sleeve_content(labels)).encode()))
    result = convert_sleeve(tmp_path / "in", tmp_path / "out")
    assert (result.recordings, result.taxels) == (1, 513)
    assert (result.readings, result.labels) == (7, 3)
    recording = read_recording(tmp_path / "out/Squeez_20250521150749_annotated.mcap")
    arrays = recording.arrays()
    pressures = arrays.counts * 1.5
    expected = [frame["data"] for frame in sleeve_content(labels)["frames"]]
    np.testing.assert_array_equal(pressures, np.reshape(expected, (7, 513)))
    assert arrays.received.all()
    start = int(datetime(2025, 5, 21, 15, 7, 49, tzinfo=UTC).timestamp()) * SECOND
    np.testing.assert_array_equal(arrays.stamps, start + np.arange(7) * SECOND // 10)
    spans = [
        (x.gesture, (x.start - start) * 10 // SECOND, (x.end - start) * 10 // SECOND)
        for x in recording.labels
    ]
    assert spans == [("squeeze", 1, 3), ("hug", 5, 6), ("tap", 6, 7)]
    assert {label.source for label in recording.labels} == {"true"}


def test_sleeve_geometry_and_units_are_nominal_and_say_so(tmp_path):
    write_sleeve(tmp_path / "in", "Grab_20250521150749.json")
    convert_sleeve(tmp_path / "in", tmp_path / "out")
    recording = read_recording(tmp_path / "out/Grab_20250521150749.mcap")
    skin = recording.skin
    assert (recording.robot_name, recording.joint_names) == ("table", ())
    assert not skin.calibrated
    steps = np.linalg.norm(np.diff(skin.positions.reshape(19, 27, 3), axis=1), axis=-1)
    np.testing.assert_allclose(steps, 0.010)
    full = recording.calibration.gain * recording.calibration.full_scale
    np.testing.assert_allclose(full, 100.0)


def test_a_sleeve_session_ends_after_ten_minutes_or_with_the_day(tmp_path):
    times = {
        "A": "20250528141500",
        "B": "20250528142500",
        "C": "20250528143459",
        "D": "20250528144500",
        "E": "20250528235900",
        "F": "20250529000100",
    }
    for name, time in times.items():
        write_sleeve(tmp_path / "in", f"{name}_{time}_annotated.json")
    convert_sleeve(tmp_path / "in", tmp_path / "out")
    assert sessions_of(tmp_path / "out") == {
        "A": "20250528-1415",
        "B": "20250528-1415",
        "C": "20250528-1415",
        "D": "20250528-1445",
        "E": "20250528-2359",
        "F": "20250529-0001",
    }


def test_sleeve_files_may_be_plain_nested_or_named_without_a_time(tmp_path):
    write_sleeve(tmp_path / "in", "more/tap.json", timestamp="20250101120000")
    write_sleeve(tmp_path / "in", "Unknown_20250603112719_annotated.json.gz")
    (tmp_path / "in/notes.txt").write_text("not part of the set")
    assert convert_sleeve(tmp_path / "in", tmp_path / "out").recordings == 2
    assert read_recording(tmp_path / "out/tap.mcap").metadata.session == "20250101-1200"


def broken_sleeve(kind):
    content = sleeve_content(["None", "Grab"])
    data = content["frames"][1]["data"]
    if kind == "shape":
        content["frames"][1]["data"] = data[:18]
    elif kind == "ragged":
        data[3] = data[3][:-1]
    elif kind == "nan":
        data[2][5] = float("nan")
    elif kind == "null":
        data[2][5] = None
    elif kind == "range":
        data[2][5] = 256.5
    elif kind == "no frames":
        del content["frames"]
    elif kind == "no data":
        content["frames"][1] = "x"
    text = json.dumps(content).encode()
    packed = gzip.compress(text)
    if kind == "cut json":
        return gzip.compress(text[:900])
    return packed[: len(packed) // 2] if kind == "cut gzip" else packed


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("shape", r"frame 1 has shape \(18, 27\); allowed is \(19, 27\)"),
        ("ragged", "frame 1 has no 19 x 27 numbers"),
        ("nan", "frame 1 holds nan; allowed are 0 to 255"),
        ("null", "frame 1 holds nan; allowed are 0 to 255"),
        ("range", "frame 1 holds 256.5; allowed are 0 to 255"),
        ("no frames", "no frames"),
        ("no data", "frame 1 has no 19 x 27 numbers"),
        ("cut json", "not whole JSON"),
        ("cut gzip", "not whole JSON"),
    ],
)
def test_a_sleeve_file_that_is_broken_is_named_and_nothing_is_left(
    tmp_path, kind, message
):
    write_sleeve(tmp_path / "in", "Grab_20250521150000.json.gz")
    bad = tmp_path / "in/Tap_20250521150500.json.gz"
    bad.write_bytes(broken_sleeve(kind))
    with pytest.raises(ImportSourceError, match=message) as caught:
        convert_sleeve(tmp_path / "in", tmp_path / "out")
    assert str(bad) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def write_shearsense(folder, name, length=20, seed=0, **changes):
    rng = np.random.default_rng(seed)
    shape = (length, 6, 6)
    arrays = [rng.integers(0, 257, shape).astype(np.int16) for _ in range(3)]
    for index, array in changes.items():
        arrays[int(index[1:])] = array
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(path, *arrays)
    return arrays


def test_a_shearsense_file_keeps_every_value(tmp_path):
    arrays = write_shearsense(
        tmp_path / "in", "rub/rubP3_Mar15th2023_PILLOW 19_26_05.npz", length=90
    )
    result = convert_shearsense(tmp_path / "in", tmp_path / "out")
    assert (result.recordings, result.taxels) == (1, 36)
    assert (result.readings, result.labels) == (90, 1)
    path = tmp_path / "out/rub_P3_Mar15th2023_PILLOW_19_26_05.mcap"
    recording = read_recording(path)
    got = recording.arrays()
    np.testing.assert_array_equal(got.counts, arrays[0].reshape(90, 36))
    np.testing.assert_array_equal(got.shear[..., 0], arrays[1].reshape(90, 36))
    np.testing.assert_array_equal(got.shear[..., 1], arrays[2].reshape(90, 36))
    assert recording.skin.has_shear and not recording.skin.calibrated
    assert recording.calibration.shear_rest == 128
    start = int(datetime(2023, 3, 15, 19, 26, 5, tzinfo=UTC).timestamp()) * SECOND
    expected = start + np.arange(90) / 44.7 * 1e9
    np.testing.assert_allclose(got.stamps - start, expected - start, atol=200)
    [label] = recording.labels
    assert (label.gesture, label.start) == ("rub", start)
    assert label.end > got.stamps[-1]
    assert (recording.metadata.subject, recording.metadata.session) == ("P3", "PILLOW")


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
def test_shearsense_names_are_understood_in_all_their_forms(
    tmp_path, name, gesture, subject, session
):
    write_shearsense(tmp_path / "in", name)
    convert_shearsense(tmp_path / "in", tmp_path / "out")
    [path] = (tmp_path / "out").iterdir()
    recording = read_recording(path)
    assert [label.gesture for label in recording.labels] == [gesture]
    assert recording.metadata.subject == subject
    assert recording.metadata.session == session


NAN = np.full((20, 6, 6), np.nan)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"_1": np.zeros((20, 6, 5), np.int16)}, r"arr_1 has shape \(20, 6, 5\)"),
        ({"_2": np.zeros((19, 6, 6), np.int16)}, r"arr_2 has shape \(19, 6, 6\)"),
        ({"_0": np.zeros((0, 6, 6), np.int16)}, r"arr_0 has shape \(0, 6, 6\)"),
        ({"_0": np.array(3)}, r"arr_0 has shape \(\)"),
        ({"_2": NAN}, "arr_2 holds nan; allowed are 0 to 256"),
        ({"_0": np.full((20, 6, 6), -1)}, "arr_0 holds -1; allowed are 0 to 256"),
        ({"_1": np.full((20, 6, 6), "a")}, "arr_1 is of type <U1; allowed are numbers"),
        ({"_1": np.full((20, 6, 6), None)}, "no whole archive"),
    ],
)
def test_a_shearsense_file_that_is_broken_is_named(tmp_path, changes, message):
    write_shearsense(tmp_path / "in", "tap/tapP1_FLAT.npz", **changes)
    with pytest.raises(ImportSourceError, match=message) as caught:
        convert_shearsense(tmp_path / "in", tmp_path / "out")
    assert "tapP1_FLAT.npz" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_shearsense_file_that_is_cut_or_nobodys_is_named(tmp_path):
    write_shearsense(tmp_path / "in", "tap/tap_FLAT.npz")
    with pytest.raises(ImportSourceError, match="no participant such as P8"):
        convert_shearsense(tmp_path / "in", tmp_path / "out")
    path = tmp_path / "in/tap/tap_FLAT.npz"
    for left in (0, 3, 200, path.stat().st_size - 5):
        path.write_bytes(path.read_bytes()[:left])
        with pytest.raises(ImportSourceError, match="no whole archive"):
            convert_shearsense(tmp_path / "in", tmp_path / "out")


def test_a_shearsense_file_that_is_one_array_alone_is_named(tmp_path):
    path = tmp_path / "in/tap/tapP1_FLAT.npz"
    path.parent.mkdir(parents=True)
    with path.open("wb") as file:
        np.save(file, np.zeros((20, 6, 6)))
    with pytest.raises(ImportSourceError, match="tapP1_FLAT.npz: no whole archive .*"):
        convert_shearsense(tmp_path / "in", tmp_path / "out")


def test_a_socialtouch_file_keeps_every_value_and_labels_what_is_touched(tmp_path):
    rng = np.random.default_rng(0)
    counts = [rng.integers(0, 9, (5, 456)), pressed((0, 4), 4), np.zeros((3, 456), int)]
    counts[0][1:3, 7] = 255
    write_socialtouch(tmp_path / "in", text=text_of(counts, person=1, gesture=7))
    result = convert_socialtouch(tmp_path / "in", tmp_path / "out")
    assert (result.recordings, result.taxels) == (1, 456)
    assert (result.readings, result.labels) == (12, 2)
    path = tmp_path / "out/poke_strong_P1_20220420_170523.mcap"
    recording = read_recording(path)
    arrays = recording.arrays()
    np.testing.assert_array_equal(arrays.counts, np.concatenate(counts))
    assert arrays.received.all()
    start = int(datetime(2022, 4, 20, 17, 5, 23, tzinfo=UTC).timestamp()) * SECOND
    ms = (arrays.stamps - start) / 1e6
    first, second = 83 * 4 + 2000, 83 * 7 + 4000
    np.testing.assert_array_equal(ms[:5], np.arange(5) * 83)
    np.testing.assert_array_equal(ms[5:9], first + np.arange(4) * 83)
    np.testing.assert_array_equal(ms[9:], second + np.arange(3) * 83)
    spans = [
        (x.gesture, (x.start - start) / 1e6, (x.end - start) / 1e6)
        for x in recording.labels
    ]
    assert spans == [
        ("poke_strong", 83, 83 * 3),
        ("poke_strong", first, first + 83 * 4),
    ]
    metadata = recording.metadata
    assert (metadata.subject, metadata.session) == ("P1", "P1-20220420")


def test_socialtouch_geometry_and_units_are_nominal_unless_given(tmp_path):
    write_socialtouch(tmp_path / "in")
    convert_socialtouch(tmp_path / "in", tmp_path / "one")
    convert_socialtouch(tmp_path / "in", tmp_path / "two", 0.004, 40.0)
    for folder, pitch, pressure in (("one", 0.010, 100.0), ("two", 0.004, 40.0)):
        [path] = (tmp_path / folder).iterdir()
        recording = read_recording(path)
        assert recording.robot_name == "table" and not recording.skin.calibrated
        places = recording.skin.positions.reshape(19, 24, 3)
        steps = np.linalg.norm(np.diff(places, axis=1), axis=-1)
        np.testing.assert_allclose(steps, pitch)
        full = recording.calibration.gain * recording.calibration.full_scale
        np.testing.assert_allclose(full, pressure)
    [path] = (tmp_path / "one").iterdir()
    preset = load_skin("socialtouch")
    np.testing.assert_array_equal(read_recording(path).skin.positions, preset.positions)


def test_socialtouch_files_may_be_plain_nested_or_one_alone(tmp_path):
    path = write_socialtouch(tmp_path / "in", "a/touch_p0_g31-1_5_9h_0m_1s.csv")
    write_socialtouch(tmp_path / "in", gesture=0)
    (tmp_path / "in/GesturesRated.csv").write_text("id,gesture_name\n")
    assert convert_socialtouch(tmp_path / "in", tmp_path / "out").recordings == 2
    assert convert_socialtouch(path, tmp_path / "alone").recordings == 1


def socialtouch_text(**cells):
    """A file with some cells of its third reading replaced, by column."""
    lines = text_of([pressed()]).splitlines()
    row = lines[3].split(",")
    for column, value in cells.items():
        row[int(column[1:])] = value
    return "\n".join([*lines[:3], ",".join(row), *lines[4:]]) + "\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (socialtouch_text(_9="256"), "a pixel is 256; allowed are 0 to 255"),
        (socialtouch_text(_9="-1"), "a pixel is -1; allowed are 0 to 255"),
        (socialtouch_text(_9="1.5"), "not whole numbers in 461 columns"),
        (socialtouch_text(_9="nan"), "not whole numbers in 461 columns"),
        (socialtouch_text(_9=""), "not whole numbers in 461 columns"),
        (socialtouch_text(_9="1,1"), "not whole numbers in 461 columns"),
        (socialtouch_text(_0="1"), "participantID is 0 and 1; allowed is one a file"),
        (socialtouch_text(_1="7"), "gesture is 6 and 7; allowed is one a file"),
        (socialtouch_text(_4="83"), "at 83 ms is followed by one at 83 ms"),
        (text_of([pressed()], gesture=32), "gesture is 32; allowed are 0 to 31"),
        (text_of([pressed()], person=-1), "participantID is -1; allowed are 0 to"),
        (text_of([pressed()[:, :-1]]), "rows have 460 columns; allowed are 461"),
        (text_of([]), "no readings"),
        ("", "first line is ''; allowed is 'participantID,gesture,"),
        (HEADER.replace("time", "ms"), "first line is 'participantID,.*allowed is"),
    ],
)
def test_a_socialtouch_file_that_is_broken_is_named_and_nothing_is_left(
    tmp_path, text, message
):
    write_socialtouch(tmp_path / "in", "touch_p0_g0-20_4_9h_0m_0s.csv", gesture=0)
    bad = write_socialtouch(tmp_path / "in", text=text)
    with pytest.raises(ImportSourceError, match=message) as caught:
        convert_socialtouch(tmp_path / "in", tmp_path / "out")
    assert str(bad) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_socialtouch_file_that_is_cut_or_has_no_time_is_named(tmp_path):
    path = write_socialtouch(tmp_path / "in")
    whole = path.read_bytes()
    for left in (0, 3, 100, len(whole) - 5):
        path.write_bytes(whole[:left])
        message = "not whole text" if left else "first line is ''"
        with pytest.raises(ImportSourceError, match=message):
            convert_socialtouch(tmp_path / "in", tmp_path / "out")
    path.write_bytes(whole)
    for name in ("touch_p0_g6.csv.gz", "touch_p0_g6-31_2_17h_5m_23s.csv.gz"):
        path = path.rename(path.with_name(name))
        with pytest.raises(ImportSourceError, match=f"{name}: name holds no day"):
            convert_socialtouch(tmp_path / "in", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "convert", [convert_sleeve, convert_shearsense, convert_socialtouch]
)
def test_a_folder_without_the_set_is_refused(tmp_path, convert):
    with pytest.raises(ImportSourceError, match="no folder .*gone"):
        convert(tmp_path / "gone", tmp_path / "out")
    (tmp_path / "in").mkdir()
    with pytest.raises(ImportSourceError, match=r"no (\.npz )?file (in|below)"):
        convert(tmp_path / "in", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_two_files_of_one_name_are_refused(tmp_path):
    write_sleeve(tmp_path / "in", "Grab_20250521150000.json.gz")
    write_sleeve(tmp_path / "in", "Grab_20250521150000.json")
    with pytest.raises(ImportSourceError, match=r"would become Grab_.*\.mcap"):
        convert_sleeve(tmp_path / "in", tmp_path / "out")


def test_what_a_failed_conversion_found_in_its_folder_stays(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine.txt").write_text("kept")
    with pytest.raises(ImportSourceError):
        convert_sleeve(broken_folder(tmp_path), tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine.txt"]


def broken_folder(tmp_path):
    write_sleeve(tmp_path / "in", "Grab_20250521150000.json")
    (tmp_path / "in/Tap_20250521150100.json").write_text("[]")
    return tmp_path / "in"


def test_the_same_files_make_the_same_bytes(tmp_path):
    write_sleeve(tmp_path / "in", "Grab_20250521150000.json.gz")
    write_shearsense(tmp_path / "in", "tap/tapP1_FLAT.npz")
    write_socialtouch(tmp_path / "in")
    for folder in ("one", "two"):
        convert_sleeve(tmp_path / "in", tmp_path / folder)
        convert_shearsense(tmp_path / "in", tmp_path / folder)
        convert_socialtouch(tmp_path / "in", tmp_path / folder)
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert len(names) == 3
    for name in names:
        one, two = (tmp_path / folder / name for folder in ("one", "two"))
        assert one.read_bytes() == two.read_bytes()


def test_the_real_sleeve_set_has_its_four_sessions_and_224_touches(
    tmp_path, sleeve_folder
):
    result = convert_sleeve(sleeve_folder, tmp_path)
    recordings = [read_recording(path) for path in tmp_path.iterdir()]
    sessions = Counter(recording.metadata.session for recording in recordings)
    assert sorted(sessions) == [
        "20250521-1505",
        "20250528-1415",
        "20250528-1445",
        "20250603-1120",
    ]
    gestures = {label.gesture for r in recordings for label in r.labels}
    assert gestures == {"grab", "stroke", "tap", "punch", "squeeze", "hug", "tickle"}
    assert (result.recordings, result.labels) == (23, 224)
    assert not any(recording.truncated for recording in recordings)


def test_the_real_shearsense_set_has_18_gestures_each_of_a_known_person(
    tmp_path, shearsense_folder
):
    some = tmp_path / "some"
    for path in shearsense_folder.rglob("*P8*FLAT*.npz"):
        (some / path.parent.name).mkdir(parents=True)
        (some / path.parent.name / path.name).symlink_to(path)
    result = convert_shearsense(some, tmp_path / "out")
    recordings = [read_recording(path) for path in (tmp_path / "out").iterdir()]
    assert result.recordings == len(recordings) == result.labels == 18
    assert {recording.metadata.subject for recording in recordings} == {"P8"}
    gestures = {recording.labels[0].gesture for recording in recordings}
    assert len(gestures) == 18 and "none" in gestures


def test_every_name_in_the_real_shearsense_set_is_understood(shearsense_folder):
    files = find_shearsense_files(shearsense_folder)
    people = {parse_participant(path, path.stem) for path in files}
    assert people >= {f"P{number}" for number in range(1, 9)}
    assert {parse_support(path.stem) for path in files} == {"FLAT", "PILLOW"}


def test_the_real_socialtouch_set_has_32_gestures_of_two_people(
    tmp_path, socialtouch_folder
):
    with (socialtouch_folder / "GesturesRated.csv").open() as file:
        names = [row["gesture_name"] for row in csv.DictReader(file)]
    assert tuple(name.replace("carress", "caress") for name in names) == GESTURES
    result = convert_socialtouch(socialtouch_folder, tmp_path)
    assert (result.recordings, result.readings) == (64, 64_677)
    assert result.labels == 1_815, "five of 1,820 repetitions touch next to nothing"
    recordings = [read_recording(path) for path in tmp_path.iterdir()]
    assert {r.metadata.subject for r in recordings} == {"P0", "P1"}
    assert {label.gesture for r in recordings for label in r.labels} == set(GESTURES)
