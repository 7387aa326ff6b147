"""Recordings: what is written is what is read, however much of the file is left."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory

from eskin.errors import RecordingError
from eskin.recording import (
    DetectionRecord,
    Label,
    Metadata,
    RecordingWriter,
    find_recordings,
    read_recording,
    write_all,
)
from eskin.recording.cdr import CdrPacker, CdrUnpacker
from eskin.recording.messages import (
    pack_detection,
    pack_label,
    pack_reading,
    unpack_detection,
    unpack_label,
    unpack_reading,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND + 123_456_789
JOINTS = ("shoulder", "elbow")
SKIN = build_grid_skin(3, 4, kind="shear", name="square")
CALIBRATION = Calibration(np.linspace(0.1, 0.2, SKIN.count), 4095, 0.5, 128)
METADATA = Metadata("set", "P1", "morning", "paper", {"rate": "50 Hz", "b": "ü"})
DETECTION = DetectionRecord(
    stamp=START + SECOND,
    gesture="poke",
    confidence=0.875,
    onset=START,
    end=START + SECOND // 2,
    link="forearm",
    patch="a",
    p_world=(0.1, 0.2, 0.3),
    n_world=(0.0, 0.6, 0.8),
    direction_world=(0.0, 0.0, 0.0),
    peak_force=12.5,
)


def make_scans(count, period=SECOND // 20, shear=True, joints=2):
    rng = np.random.default_rng(7)
    return [
        Scan(
            START + i * period,
            rng.integers(0, 4096, SKIN.count).astype(np.int32),
            rng.random(SKIN.count) < 0.9,
            rng.normal(size=joints),
            rng.integers(-300, 300, (SKIN.count, 2)).astype(np.int32)
            if shear
            else None,
        )
        for i in range(count)
    ]


def make_labels(scans):
    stamps = [scan.stamp for scan in scans]
    return (
        Label(stamps[3], stamps[10], "poke"),
        Label(stamps[5], stamps[12], "poke", "auto"),
        Label(stamps[20], stamps[-1] + 1, "stroke", "range"),
    )


def open_writer(path, joints=JOINTS, metadata=METADATA):
    return RecordingWriter(path, "ur5", SKIN, CALIBRATION, metadata, joints)


def write_recording(path, scans, labels=(), joints=JOINTS):
    with open_writer(path, joints) as writer:
        write_all(writer, scans, labels)
        writer.write_detection(DETECTION)
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Four seconds of scans with labels and a detection, as (path, scans, labels)."""
    scans = make_scans(80)
    path = tmp_path_factory.mktemp("recording") / "whole.mcap"
    return write_recording(path, scans, make_labels(scans)), scans, make_labels(scans)


def assert_same_scans(got, expected):
    assert len(got) == len(expected)
    for one, other in zip(got, expected, strict=True):
        assert one.stamp == other.stamp
        for name in ("counts", "received", "q"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert (one.shear is None) == (other.shear is None)
        if one.shear is not None:
            np.testing.assert_array_equal(one.shear, other.shear)


def assert_same_skin(one, other):
    assert (one.name, one.patches) == (other.name, other.patches)
    assert one.calibrated == other.calibrated
    for name in ("patch_index", "rows", "columns", "positions", "normals", "areas"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_recording_gives_back_all_that_was_written(whole):
    path, scans, labels = whole
    recording = read_recording(path)
    assert_same_scans(list(recording.scans()), scans)
    assert_same_skin(recording.skin, SKIN)
    np.testing.assert_array_equal(recording.calibration.gain, CALIBRATION.gain)
    assert recording.calibration.shear_rest == CALIBRATION.shear_rest
    assert recording.metadata == METADATA
    assert recording.labels == tuple(sorted(labels))
    assert (recording.robot_name, recording.joint_names) == ("ur5", JOINTS)
    assert (recording.count, recording.truncated) == (80, False)
    assert (recording.start, recording.end) == (scans[0].stamp, scans[-1].stamp)
    assert recording.period == SECOND // 20
    kept = recording.detections[0]
    assert dataclasses.replace(kept, confidence=0.875, peak_force=12.5) == DETECTION


@pytest.mark.parametrize("shear", [True, False])
def test_arrays_hold_the_scans_row_by_row(tmp_path, shear):
    scans = make_scans(30, shear=shear, joints=0)
    path = write_recording(tmp_path / "a.mcap", scans, joints=())
    arrays = read_recording(path).arrays()
    np.testing.assert_array_equal(arrays.counts, [scan.counts for scan in scans])
    np.testing.assert_array_equal(arrays.received, [scan.received for scan in scans])
    np.testing.assert_array_equal(arrays.stamps, [scan.stamp for scan in scans])
    assert arrays.q.shape == (30, 0)
    assert (arrays.shear is not None) == shear
    if shear:
        np.testing.assert_array_equal(arrays.shear, [scan.shear for scan in scans])


def test_a_recording_without_scans_is_a_recording(tmp_path):
    with open_writer(tmp_path / "empty.mcap"):
        pass
    recording = read_recording(tmp_path / "empty.mcap")
    assert (recording.count, recording.start, recording.period) == (0, 0, 0)
    assert recording.arrays().counts.shape == (0, SKIN.count)
    assert not recording.truncated


@settings(max_examples=40, deadline=None)
@given(
    counts=hnp.arrays(np.int32, 12, elements=st.integers(0, 65535)),
    received=hnp.arrays(np.bool_, 12),
    shear=st.none()
    | hnp.arrays(np.int32, (12, 2), elements=st.integers(-32768, 32767)),
    stamp=st.integers(0, 2**31 * SECOND - 1),
    frame=st.text(max_size=9).filter(lambda text: "\0" not in text),
)
def test_packing_then_unpacking_a_reading_changes_nothing(
    counts, received, shear, stamp, frame
):
    scan = Scan(stamp, counts, received, np.empty(0), shear)
    message = unpack_reading(pack_reading(scan, frame))
    got = Scan(
        message.stamp, message.counts, message.received, np.empty(0), message.shear
    )
    assert_same_scans([got], [scan])


@settings(max_examples=40, deadline=None)
@given(
    gesture=st.text(min_size=1).filter(lambda text: "\0" not in text),
    start=st.integers(0, 2**60),
    length=st.integers(1, 2**59),
    source=st.sampled_from(["true", "range", "auto"]),
)
def test_packing_then_unpacking_a_label_changes_nothing(gesture, start, length, source):
    label = Label(start, start + length, gesture, source)
    assert unpack_label(pack_label(label)) == label


def test_packing_then_unpacking_a_detection_changes_nothing():
    assert unpack_detection(pack_detection(DETECTION)) == DETECTION


def decode(path):
    """Messages of a recording by topic, as mcap-ros2-support decodes them."""
    messages = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, _, message in reader.iter_decoded_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            messages.setdefault(channel.topic, []).append((schema.name, message))
    return messages


def stamp_of(time):
    return time.sec * SECOND + time.nanosec


def test_another_reader_of_ros_2_recordings_finds_every_field(whole):
    path, scans, labels = whole
    messages = decode(path)
    assert set(messages) == {
        "/eskin/reading",
        "/joint_states",
        "/eskin/label",
        "/eskin/detection",
    }
    for (name, reading), scan in zip(messages["/eskin/reading"], scans, strict=True):
        assert name == "eskin_msgs/msg/Reading"
        assert stamp_of(reading.header.stamp) == scan.stamp
        assert reading.header.frame_id == "square"
        np.testing.assert_array_equal(reading.counts, scan.counts)
        np.testing.assert_array_equal(reading.received, scan.received)
        np.testing.assert_array_equal(reading.shear, scan.shear.reshape(-1))
    for (name, state), scan in zip(messages["/joint_states"], scans, strict=True):
        assert name == "sensor_msgs/msg/JointState"
        assert stamp_of(state.header.stamp) == scan.stamp
        assert tuple(state.name) == JOINTS
        np.testing.assert_array_equal(state.position, scan.q)
        assert (len(state.velocity), len(state.effort)) == (0, 0)
    got = [
        Label(stamp_of(m.start), stamp_of(m.end), m.gesture, m.source)
        for _, m in messages["/eskin/label"]
    ]
    assert sorted(got) == sorted(labels)


def test_another_reader_finds_every_field_of_a_detection(whole):
    [(name, message)] = decode(whole[0])["/eskin/detection"]
    assert name == "eskin_msgs/msg/Detection"
    assert stamp_of(message.header.stamp) == DETECTION.stamp
    assert (message.gesture, message.link, message.patch) == ("poke", "forearm", "a")
    assert message.confidence == 0.875
    assert message.peak_force == 12.5
    assert stamp_of(message.onset) == DETECTION.onset
    assert stamp_of(message.end) == DETECTION.end
    for vector, expected in (
        (message.point, DETECTION.p_world),
        (message.normal, DETECTION.n_world),
        (message.direction, DETECTION.direction_world),
    ):
        assert (vector.x, vector.y, vector.z) == expected


def test_a_skin_on_no_robot_has_no_joint_states(tmp_path):
    path = write_recording(tmp_path / "a.mcap", make_scans(5, joints=0), joints=())
    assert "/joint_states" not in decode(path)
    assert all(len(scan.q) == 0 for scan in read_recording(path).scans())


def chunks_of(path):
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True).records
        return [record for record in records if isinstance(record, Chunk)]


def test_a_chunk_holds_less_than_a_second_and_is_compressed(whole):
    chunks = chunks_of(whole[0])
    assert len(chunks) == 4
    for chunk in chunks:
        assert chunk.compression == "zstd"
        assert chunk.message_end_time - chunk.message_start_time < SECOND


def cut(path, length, folder):
    left = folder / f"cut{length}.mcap"
    left.write_bytes(path.read_bytes()[:length])
    return left


def chunk_ends(path):
    """Offset of the end of each chunk record and the scans up to there."""
    with path.open("rb") as file:
        indexes = make_reader(file).get_summary().chunk_indexes
    return [
        (index.chunk_start_offset + index.chunk_length, (number + 1) * 20)
        for number, index in enumerate(indexes)
    ]


def test_a_file_cut_anywhere_reads_up_to_its_last_whole_chunk(whole, tmp_path):
    path, scans, _ = whole
    size = path.stat().st_size
    ends = chunk_ends(path)
    first = ends[0][0]
    places = {e + d for e, _ in ends for d in (-1, 0, 1)} | {size - 1, size - 8}
    places |= set(np.random.default_rng(1).integers(first, size, 60).tolist())
    for place in sorted(places):
        recording = read_recording(cut(path, place, tmp_path))
        expected = max([n for end, n in ends if end <= place], default=0)
        assert recording.truncated
        assert recording.count == expected
        assert_same_scans(list(recording.scans()), scans[:expected])
        assert recording.metadata == METADATA


def test_a_file_cut_before_its_skin_says_so_in_one_line(whole, tmp_path):
    path, _, _ = whole
    with path.open("rb") as file:
        index = make_reader(file).get_summary().attachment_indexes[1]
    usable = index.offset + index.length
    for place in [*range(9), *range(9, usable, 17), usable - 1]:
        with pytest.raises(RecordingError, match="is cut before its") as caught:
            read_recording(cut(path, place, tmp_path))
        assert "\n" not in str(caught.value)
    assert read_recording(cut(path, usable, tmp_path)).count == 0


def test_a_damaged_chunk_ends_what_can_be_read(whole, tmp_path):
    path, scans, _ = whole
    data = bytearray(path.read_bytes())
    data[chunk_ends(path)[1][0] - 40] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    recording = read_recording(damaged)
    assert recording.truncated
    assert_same_scans(list(recording.scans()), scans[:20])


def test_a_chunk_that_does_not_fit_its_crc_is_not_believed(whole, tmp_path):
    path, scans, _ = whole
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        index = make_reader(file).get_summary().chunk_indexes[2]
    data[index.chunk_start_offset + 9 + 24] ^= 1
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    assert_same_scans(list(read_recording(damaged).scans()), scans[:40])


def test_a_record_longer_than_the_file_ends_it(whole, tmp_path):
    path, scans, _ = whole
    end = chunk_ends(path)[0][0]
    damaged = tmp_path / "damaged.mcap"
    giant = b"\x06" + b"\xff" * 8
    damaged.write_bytes(path.read_bytes()[:end] + giant + b"left over")
    assert_same_scans(list(read_recording(damaged).scans()), scans[:20])


def test_a_cut_file_labels_only_what_it_holds(whole, tmp_path):
    path, _, labels = whole
    for end, _ in chunk_ends(path):
        recording = read_recording(cut(path, end, tmp_path))
        assert set(recording.labels) >= {x for x in labels if x.end <= recording.end}
        assert all(label.end <= recording.end + 1 for label in recording.labels)


def test_labels_written_in_any_order_are_read_in_order_of_time(tmp_path):
    scans = make_scans(60)
    labels = make_labels(scans)
    with open_writer(tmp_path / "a.mcap") as writer:
        for label in reversed(labels):
            writer.write_label(label)
        write_all(writer, scans, ())
    assert read_recording(tmp_path / "a.mcap").labels == labels


def test_every_field_is_aligned_to_its_size_after_any_other():
    packer = CdrPacker()
    for _ in range(2):
        packer.string("abcd")
        packer.stamp(START)
        packer.string("a")
        packer.number(0.5, "f")
        packer.number(0.25)
        packer.string("")
        packer.sequence(np.array([1.5, 2.5]))
    data = packer.bytes()
    unpacker = CdrUnpacker(data)
    for _ in range(2):
        assert (unpacker.string(), unpacker.stamp()) == ("abcd", START)
        assert (unpacker.string(), unpacker.number("f")) == ("a", 0.5)
        assert (unpacker.number(), unpacker.string()) == (0.25, "")
        np.testing.assert_array_equal(unpacker.sequence("<f8"), [1.5, 2.5])
    assert unpacker.offset == len(data)


def test_a_message_of_another_byte_order_is_refused():
    with pytest.raises(RecordingError, match="encapsulation 0000; allowed is 0001"):
        CdrUnpacker(b"\x00\x00\x00\x00")


@pytest.mark.parametrize("content", [b"PK\x03\x04 a zip", b"\x89MCAP0\n\n", b"x"])
def test_what_is_no_recording_is_refused(tmp_path, content):
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="not with the MCAP magic"):
        read_recording(path)


def test_a_missing_recording_is_named(tmp_path):
    with pytest.raises(RecordingError, match=r"no recording at .*gone\.mcap"):
        read_recording(tmp_path / "gone.mcap")
    with pytest.raises(RecordingError, match=r"no recording at .*gone"):
        find_recordings([tmp_path / "gone"])
    with pytest.raises(RecordingError, match=r"no \.mcap file below"):
        find_recordings([tmp_path])


def test_recordings_are_found_in_folders_once_and_sorted(whole, tmp_path):
    for name in ("b/2.mcap", "b/1.mcap", "a.mcap", "notes.txt"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"")
    found = find_recordings([tmp_path / "b", tmp_path])
    names = [str(path.relative_to(tmp_path)) for path in found]
    assert names == ["b/1.mcap", "b/2.mcap", "a.mcap"]


def test_the_name_appears_only_when_the_recording_is_whole(tmp_path):
    path = tmp_path / "a.mcap"
    with open_writer(path) as writer:
        write_all(writer, make_scans(30), ())
        assert not path.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_an_exception_leaves_what_was_written_in_the_part_file(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"an older one")
    scans = make_scans(50)
    with pytest.raises(KeyError), open_writer(path) as writer:
        write_all(writer, scans, ())
        raise KeyError("device lost")
    assert path.read_bytes() == b"an older one"
    left = read_recording(tmp_path / "a.mcap.part")
    assert left.truncated
    assert_same_scans(list(left.scans()), scans)


def test_finished_chunks_are_on_disk_while_recording_goes_on(tmp_path):
    scans = make_scans(50)
    with open_writer(tmp_path / "a.mcap") as writer:
        write_all(writer, scans, ())
        part = read_recording(tmp_path / "a.mcap.part")
        assert_same_scans(list(part.scans()), scans[:40])


def test_the_same_scans_make_the_same_bytes(tmp_path):
    scans = make_scans(40)
    one = write_recording(tmp_path / "1.mcap", scans, make_labels(scans))
    other = write_recording(tmp_path / "2.mcap", scans, make_labels(scans))
    assert one.read_bytes() == other.read_bytes()


def changed(scan, **changes):
    return dataclasses.replace(scan, **changes)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"counts": np.zeros(5, np.int32), "received": np.ones(5, bool)},
            "scan has 5 counts, skin 'square' has 12 taxels",
        ),
        ({"q": np.zeros(3)}, "scan has 3 joint positions, the robot has 2 joints"),
        ({"stamp": START}, "stamps must increase"),
        ({"counts": np.full(12, 70000, np.int32)}, "counts from 70000 to 70000 cannot"),
        ({"counts": np.full(12, -1, np.int32)}, "allowed are 0 to 65535"),
        ({"shear": np.full((12, 2), 40000, np.int32)}, "allowed are -32768 to 32767"),
        ({"stamp": 2**31 * SECOND}, "allowed are 0 to 2^31 s"),
    ],
)
def test_a_scan_that_does_not_belong_is_refused(tmp_path, change, message):
    first, second = make_scans(2)
    if "counts" in change and "shear" not in change:
        change = change | {"shear": None}
    with open_writer(tmp_path / "a.mcap") as writer:
        writer.write(first)
        with pytest.raises(RecordingError) as caught:
            writer.write(changed(second, **change))
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)
    assert read_recording(tmp_path / "a.mcap").count == 1


def test_a_folder_that_is_not_there_is_refused_before_anything_is_written():
    with pytest.raises(RecordingError, match="cannot write .*No such file"):
        open_writer(Path("nowhere/a.mcap"))


def test_joints_are_put_in_the_recordings_order_by_name(whole):
    from eskin.recording.messages import pack_joint_state

    recording = read_recording(whole[0])
    data = pack_joint_state(START, ("elbow", "gripper", "shoulder"), np.arange(3.0))
    np.testing.assert_array_equal(recording.parse_joint_positions(data), [2.0, 0.0])
    with pytest.raises(RecordingError, match="no position for joint 'shoulder'"):
        recording.parse_joint_positions(
            pack_joint_state(START, ("elbow",), np.zeros(1))
        )
