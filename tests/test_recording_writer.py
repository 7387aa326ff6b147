"""Tests of writing recordings: what is written is read, by eskin and by others."""

import dataclasses

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
from eskin.recording import Label, read_recording, rewrite_recording, write_all
from eskin.skin import build_grid_skin, skin_to_bytes
from eskin.touch import Scan
from helpers.recordings import (
    CALIBRATION,
    DETECTION,
    EVENT,
    JOINTS,
    METADATA,
    SECOND,
    SKIN,
    START,
    TRUTHS,
    assert_same_scans,
    make_labels,
    make_scans,
    open_writer,
    write_recording,
)

SCANS = make_scans(80)
LABELS = make_labels(SCANS)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return the path of a recording of four seconds with everything in it."""
    path = tmp_path_factory.mktemp("recording") / "whole.mcap"
    return write_recording(path, SCANS, LABELS, truths=TRUTHS)


def decode(path):
    """Return the messages of a recording by topic, as mcap-ros2-support reads them."""
    messages = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, _, message in reader.iter_decoded_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            messages.setdefault((channel.topic, schema.name), []).append(message)
    return messages


def read_stamp(time):
    return time.sec * SECOND + time.nanosec


def read_vector(message):
    return (message.x, message.y, message.z)


def test_everything_is_read_as_it_was_written(path):
    recording = read_recording(path)
    assert_same_scans(list(recording.scans()), SCANS)
    assert skin_to_bytes(recording.skin) == skin_to_bytes(SKIN)
    assert recording.calibration.to_bytes() == CALIBRATION.to_bytes()
    assert recording.metadata == METADATA
    assert recording.labels == LABELS
    assert recording.detections == (DETECTION,)
    assert recording.events == (EVENT,)
    assert tuple(recording.truths()) == TRUTHS
    assert (recording.robot_name, recording.joint_names) == ("ur5", JOINTS)
    assert (recording.count, recording.truncated) == (80, False)
    assert (recording.start, recording.end) == (SCANS[0].stamp, SCANS[-1].stamp)
    assert recording.period == SECOND // 20


@pytest.mark.parametrize("shear", [True, False])
def test_arrays_hold_a_scan_a_row(tmp_path, shear):
    """A skin on no robot has no joint states, a real one no ground truth."""
    scans = make_scans(30, shear=shear, joints=0)
    path = write_recording(tmp_path / "a.mcap", scans, joints=())
    assert not {"/joint_states", "/eskin/truth"} & {topic for topic, _ in decode(path)}
    arrays = read_recording(path).arrays()
    assert arrays.stamps.tolist() == [scan.stamp for scan in scans]
    for name in ("counts", "received", "q", *(["shear"] if shear else [])):
        expected = [getattr(scan, name) for scan in scans]
        np.testing.assert_array_equal(getattr(arrays, name), expected)
    assert (arrays.shear is not None) == shear


def test_recording_without_scans_is_empty(tmp_path):
    with open_writer(tmp_path / "empty.mcap") as writer:
        writer.write_block(*make_block(0))
    recording = read_recording(tmp_path / "empty.mcap")
    assert (recording.count, recording.start, recording.period) == (0, 0, 0)
    assert recording.arrays().counts.shape == (0, SKIN.count)
    assert list(recording.truths()) == []
    assert not recording.truncated


TEXT = st.text(max_size=9).filter(lambda text: "\0" not in text)


@settings(max_examples=40, deadline=None)
@given(
    counts=hnp.arrays(np.int32, 12, elements=st.integers(0, 65535)),
    received=hnp.arrays(np.bool_, 12),
    shear=st.none()
    | hnp.arrays(np.int32, (12, 2), elements=st.integers(-32768, 32767)),
    stamp=st.integers(0, 2**31 * SECOND - 1),
    texts=st.lists(TEXT, min_size=3, max_size=3),
    start=st.integers(0, 2**60),
    source=st.sampled_from(["true", "range", "auto"]),
)
def test_any_values_are_read_by_eskin_and_by_another_reader(
    tmp_path_factory, counts, received, shear, stamp, texts, start, source
):
    """Fields of any length do not shift the fields after them."""
    path = tmp_path_factory.getbasetemp() / "any.mcap"
    path.unlink(missing_ok=True)
    scan = Scan(stamp, counts, received, np.empty(0), shear)
    label = Label(start, start + 1 + stamp % 2**59, texts[0] + "x", source)
    changes = dict(zip(("gesture", "link", "patch"), texts, strict=True))
    detection = dataclasses.replace(DETECTION, p_world=(stamp / 7, 0.0, 1.0), **changes)
    with open_writer(path, ()) as writer:
        write_all(writer, [scan], [label], [detection])
    recording = read_recording(path)
    assert_same_scans(list(recording.scans()), [scan])
    assert recording.labels == (label,)
    assert recording.detections == (detection,)
    messages = {topic: found for (topic, _), [found] in decode(path).items()}
    found = messages["/eskin/reading"]
    assert (read_stamp(found.header.stamp), found.header.frame_id) == (stamp, "square")
    np.testing.assert_array_equal(found.counts, counts)
    np.testing.assert_array_equal(found.received, received)
    np.testing.assert_array_equal(found.shear, [] if shear is None else shear.flat)
    found = messages["/eskin/label"]
    assert (found.gesture, found.source) == (label.gesture, source)
    assert (read_stamp(found.start), read_stamp(found.end)) == (label.start, label.end)
    found = messages["/eskin/detection"]
    assert [found.gesture, found.link, found.patch] == texts
    assert read_stamp(found.header.stamp) == DETECTION.stamp
    assert (read_stamp(found.onset), read_stamp(found.end)) == (START, DETECTION.end)
    assert (found.confidence, found.peak_force) == (0.875, 12.5)
    assert read_vector(found.point) == detection.p_world
    assert read_vector(found.normal) == DETECTION.n_world


def test_another_reader_finds_joints_and_truth_under_their_types(path):
    messages = decode(path)
    assert {(topic, name.split("/")[-1]) for topic, name in messages} == {
        ("/eskin/reading", "Reading"),
        ("/joint_states", "JointState"),
        ("/eskin/label", "Label"),
        ("/eskin/detection", "Detection"),
        ("/eskin/truth", "Truth"),
        ("/eskin/event", "Event"),
    }
    messages = {topic: found for (topic, _), found in messages.items()}
    for state, scan in zip(messages["/joint_states"], SCANS, strict=True):
        assert (read_stamp(state.header.stamp), tuple(state.name)) == (
            scan.stamp,
            JOINTS,
        )
        np.testing.assert_array_equal(state.position, scan.q)
    for truth, record in zip(messages["/eskin/truth"], TRUTHS, strict=True):
        assert read_stamp(truth.header.stamp) == record.stamp
        assert truth.header.frame_id == "world"
        assert (truth.touch, truth.gesture, truth.kind) == (record.touch, "poke", "tip")
        assert (truth.link, truth.force, truth.area) == ("arm", record.force, 1e-4)
        assert read_vector(truth.centroid) == record.p_world


def test_chunk_spans_less_than_a_second_and_is_compressed(path):
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True).records
        chunks = [record for record in records if isinstance(record, Chunk)]
    assert len(chunks) == 4
    for chunk in chunks:
        assert chunk.compression == "zstd"
        assert chunk.message_end_time - chunk.message_start_time < SECOND


def test_same_content_makes_the_same_bytes_and_labels_are_sorted(path, tmp_path):
    again = write_recording(tmp_path / "a.mcap", SCANS, LABELS, truths=TRUTHS)
    assert again.read_bytes() == path.read_bytes()
    with open_writer(tmp_path / "b.mcap") as writer:
        for label in reversed(LABELS):
            writer.write_label(label)
    assert read_recording(tmp_path / "b.mcap").labels == LABELS


def make_block(count, joints=2):
    """Return stamps, counts, received and joint positions of some scans."""
    rng = np.random.default_rng(count)
    return (
        START + np.arange(count) * (SECOND // 50),
        rng.integers(0, 4096, (count, SKIN.count)).astype(np.int32),
        rng.random((count, SKIN.count)) < 0.9,
        rng.normal(size=(count, joints)),
    )


@pytest.mark.parametrize(
    ("joints", "skin"),
    [((), "abcd"), (("a",), "s"), (("bc", "ü"), ""), (("wrist_1", "x", "elbow"), "ab")],
)
def test_block_makes_the_same_file_as_its_scans(tmp_path, joints, skin):
    skin = build_grid_skin(3, 4, name=skin or "skin")
    block = make_block(120, len(joints))
    with open_writer(tmp_path / "block.mcap", joints, skin) as writer:
        writer.write_block(*(part[:70] for part in block))
        writer.write_block(*(part[70:] for part in block))
    with open_writer(tmp_path / "single.mcap", joints, skin) as writer:
        for stamp, counts, received, q in zip(*block, strict=True):
            writer.write(Scan(int(stamp), counts, received, q))
    found = (tmp_path / "block.mcap").read_bytes()
    assert found == (tmp_path / "single.mcap").read_bytes()


COUNTS = np.zeros(12, np.int32)


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"counts": COUNTS[:5], "received": COUNTS[:5] > 0}, "5 counts.*12 taxels"),
        ({"q": np.zeros(3)}, "3 joint positions.*2 joints"),
        ({"stamp": START}, "stamps must increase"),
        ({"counts": COUNTS + 70000}, "70000.*0 to 65535"),
        ({"counts": COUNTS - 1}, "-1.*0 to 65535"),
        ({"shear": np.full((12, 2), 40000, np.int32)}, "-32768 to 32767"),
        ({"stamp": 2**31 * SECOND}, "0 to 2.31 s"),
    ],
)
def test_scan_that_cannot_be_written_is_refused(tmp_path, change, parts):
    first, second = make_scans(2, shear="shear" in change)
    with open_writer(tmp_path / "a.mcap") as writer:
        writer.write(first)
        with pytest.raises(RecordingError, match=parts) as caught:
            writer.write(dataclasses.replace(second, **change))
        assert "\n" not in str(caught.value)
    assert read_recording(tmp_path / "a.mcap").count == 1


def test_block_that_cannot_be_written_is_refused_as_a_whole(tmp_path):
    stamps, counts, received, q = make_block(5)
    later = stamps + SECOND
    with open_writer(tmp_path / "a.mcap") as writer:
        writer.write_block(stamps, counts, received, q)
        for block, part in (
            ((stamps, counts, received, q), "must increase"),
            ((later[::-1], counts, received, q), "must increase"),
            ((later, counts[:, 1:], received[:, 1:], q), "11 counts"),
            ((later, counts - 5000, received, q), "0 to 65535"),
        ):
            with pytest.raises(RecordingError, match=part):
                writer.write_block(*block)
    assert read_recording(tmp_path / "a.mcap").count == 5


def test_writer_renames_its_part_file_when_the_recording_is_complete(tmp_path):
    """It can be read from the start, and has all scans up to the last second."""
    path = tmp_path / "a.mcap"
    with open_writer(path) as writer:
        assert read_recording(tmp_path / "a.mcap.part").metadata == METADATA
        write_all(writer, SCANS[:50], ())
        assert not path.exists()
        part = read_recording(tmp_path / "a.mcap.part")
        assert_same_scans(list(part.scans()), SCANS[:40])
    assert list(tmp_path.iterdir()) == [path]


def test_recording_never_replaces_a_file_that_came_meanwhile(tmp_path):
    path = tmp_path / "a.mcap"
    part = tmp_path / "a.mcap.part"
    with pytest.raises(RecordingError, match="a.mcap.part"), open_writer(path) as made:
        write_all(made, SCANS[:50], ())
        path.write_bytes(b"another")
    assert path.read_bytes() == b"another"
    assert_same_scans(list(read_recording(part).scans()), SCANS[:50])


def test_exception_leaves_the_part_file(tmp_path):
    with pytest.raises(KeyError), open_writer(tmp_path / "a.mcap") as writer:
        write_all(writer, SCANS[:50], ())
        raise KeyError("device lost")
    part = read_recording(tmp_path / "a.mcap.part")
    assert part.truncated
    assert_same_scans(list(part.scans()), SCANS[:50])


@pytest.mark.parametrize("name", ["a.mcap", "a.mcap.part"])
def test_no_recording_is_replaced_or_deleted_by_one_of_its_name(path, tmp_path, name):
    """The rest of a recording that was stopped is kept as a whole one is."""
    old = tmp_path / name
    old.write_bytes(b"an older one")
    with pytest.raises(RecordingError, match=f"{name} is there already; .*another"):
        open_writer(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match=f"{name} is there already; .*another"):
        rewrite_recording(read_recording(path), tmp_path / "a.mcap")
    assert [(each, each.read_bytes()) for each in tmp_path.iterdir()] == [
        (old, b"an older one")
    ]


def test_recording_that_is_rewritten_leaves_the_rest_of_another(path, tmp_path):
    kept = tmp_path / "a.mcap"
    rest = tmp_path / "a.mcap.part"
    kept.write_bytes(path.read_bytes())
    rest.write_bytes(b"the rest")
    rewrite_recording(read_recording(kept), labels=())
    assert read_recording(kept).labels == ()
    assert rest.read_bytes() == b"the rest"


def test_rewriting_changes_the_labels_and_nothing_else(path, tmp_path):
    recording = read_recording(path)
    labels = [*LABELS, Label(START, START + SECOND, "hug", "auto")]
    rewrite_recording(recording, tmp_path / "a.mcap", labels=labels)
    assert list(tmp_path.iterdir()) == [tmp_path / "a.mcap"]
    copy = read_recording(tmp_path / "a.mcap")
    assert copy.labels == tuple(sorted(labels))
    rewrite_recording(copy, labels=LABELS)
    assert (tmp_path / "a.mcap").read_bytes() == path.read_bytes()


def test_failed_rewriting_leaves_everything_as_it_was(path, tmp_path):
    kept = tmp_path / "a.mcap"
    kept.write_bytes(path.read_bytes())

    def read_labels():
        yield LABELS[0]
        raise OSError("disk full")

    for target in (None, tmp_path / "b.mcap"):
        with pytest.raises(OSError, match="disk full"):
            rewrite_recording(read_recording(kept), target, labels=read_labels())
        assert list(tmp_path.iterdir()) == [kept]
        assert kept.read_bytes() == path.read_bytes()


def test_truncated_recording_is_copied_but_not_replaced(path, tmp_path):
    data = path.read_bytes()[:-30]
    (tmp_path / "a.mcap").write_bytes(data)
    cut = read_recording(tmp_path / "a.mcap")
    with pytest.raises(RecordingError, match=r"a\.mcap is cut short .* elsewhere"):
        rewrite_recording(cut)
    assert cut.path.read_bytes() == data
    rewrite_recording(cut, tmp_path / "b.mcap")
    copy = read_recording(tmp_path / "b.mcap")
    assert (copy.count, copy.truncated) == (cut.count, False)
