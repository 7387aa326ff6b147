"""What was really done, beside what the skin counted; and many scans at once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from eskin.errors import RecordingError
from eskin.recording import (
    Metadata,
    RecordingWriter,
    TruthRecord,
    read_recording,
    rewrite_recording,
)
from eskin.recording.messages import (
    pack_joint_state,
    pack_joint_states,
    pack_reading,
    pack_readings,
    pack_truth,
    unpack_truth,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND + 5
JOINTS = ("shoulder", "elbow")
SKIN = build_grid_skin(3, 4, name="square")
TRUTHS = tuple(
    TruthRecord(START + i * SECOND // 50, i // 9, "poke", "tip", "arm", 4.0 + i, *rest)
    for i, rest in enumerate([(1e-4, (0.1, -0.2, float(i))) for i in range(12)])
)


def open_writer(path, joints=JOINTS):
    calibration = Calibration.uniform(SKIN.count, 4095, 100.0)
    return RecordingWriter(path, "ur5", SKIN, calibration, Metadata(), joints)


def block(count, joints=2, start=START):
    rng = np.random.default_rng(count)
    return (
        start + np.arange(count) * (SECOND // 50),
        rng.integers(0, 4096, (count, SKIN.count)).astype(np.int32),
        rng.random((count, SKIN.count)) < 0.9,
        rng.normal(size=(count, joints)),
    )


@settings(max_examples=30, deadline=None)
@given(
    count=st.integers(0, 5),
    frame=st.text(max_size=9).filter(lambda text: "\0" not in text),
    names=st.lists(st.sampled_from(["a", "bc", "elbow", "wrist_1", "ü"]), max_size=3),
)
def test_many_scans_are_packed_as_one_by_one(count, frame, names):
    stamps, counts, received, q = block(count, len(names))
    one_by_one = [
        Scan(int(s), c, r, p)
        for s, c, r, p in zip(stamps, counts, received, q, strict=True)
    ]
    assert pack_readings(stamps, counts, received, frame) == [
        pack_reading(scan, frame) for scan in one_by_one
    ]
    assert pack_joint_states(stamps, tuple(names), q) == [
        pack_joint_state(scan.stamp, tuple(names), scan.q) for scan in one_by_one
    ]


def test_a_block_gives_the_same_file_as_its_scans(tmp_path):
    parts = block(120)
    with open_writer(tmp_path / "block.mcap") as writer:
        writer.write_block(*(part[:70] for part in parts))
        writer.write_block(*(part[70:] for part in parts))
    with open_writer(tmp_path / "single.mcap") as writer:
        for stamp, counts, received, q in zip(*parts, strict=True):
            writer.write(Scan(int(stamp), counts, received, q))
    whole = (tmp_path / "block.mcap").read_bytes()
    assert whole == (tmp_path / "single.mcap").read_bytes()


def test_a_block_that_does_not_fit_is_refused_and_not_written(tmp_path):
    stamps, counts, received, q = block(5)
    with open_writer(tmp_path / "a.mcap") as writer:
        writer.write_block(stamps, counts, received, q)
        later = stamps + SECOND
        for parts, message in (
            ((stamps, counts, received, q), "stamps must increase"),
            ((later[::-1], counts, received, q), "of a block must increase"),
            ((later, counts[:, 1:], received[:, 1:], q), "scan has 11 counts"),
            ((later, counts, received, q[:, 1:]), "scan has 1 joint positions"),
            ((later, counts - 5000, received, q), "cannot be recorded"),
            ((-later, counts, received, q), "must increase"),
        ):
            with pytest.raises(RecordingError, match=message):
                writer.write_block(*parts)
    assert read_recording(tmp_path / "a.mcap").count == 5


def write_truths(path):
    with open_writer(path) as writer:
        writer.write_block(*block(12))
        for record in TRUTHS:
            writer.write_truth(record)
    return path


def test_a_recording_gives_back_what_was_really_done(tmp_path):
    recording = read_recording(write_truths(tmp_path / "a.mcap"))
    assert tuple(recording.truths()) == TRUTHS
    assert (recording.count, recording.truncated) == (12, False)


def test_a_copy_with_other_labels_keeps_what_was_really_done(tmp_path):
    recording = read_recording(write_truths(tmp_path / "a.mcap"))
    rewrite_recording(recording, tmp_path / "b.mcap", labels=())
    assert tuple(read_recording(tmp_path / "b.mcap").truths()) == TRUTHS
    rewrite_recording(recording)
    once = (tmp_path / "a.mcap").read_bytes()
    rewrite_recording(read_recording(tmp_path / "a.mcap"))
    assert (tmp_path / "a.mcap").read_bytes() == once


def test_packing_then_unpacking_a_truth_changes_nothing():
    for record in TRUTHS:
        assert unpack_truth(pack_truth(record)) == record


def test_a_recording_of_a_real_skin_does_not_know_the_topic(tmp_path):
    with open_writer(tmp_path / "a.mcap") as writer:
        writer.write_block(*block(3))
    assert b"/eskin/truth" not in (tmp_path / "a.mcap").read_bytes()
    assert list(read_recording(tmp_path / "a.mcap").truths()) == []


def test_another_reader_finds_every_field_of_a_truth(tmp_path):
    path = write_truths(tmp_path / "a.mcap")
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages(topics=["/eskin/truth"]))
    for (schema, channel, message, got), record in zip(found, TRUTHS, strict=True):
        assert (schema.name, schema.encoding) == ("eskin_msgs/msg/Truth", "ros2msg")
        assert channel.message_encoding == "cdr"
        assert message.log_time == record.stamp
        assert got.header.stamp.sec * SECOND + got.header.stamp.nanosec == record.stamp
        assert got.header.frame_id == "world"
        assert (got.touch, got.gesture, got.kind) == (record.touch, "poke", "tip")
        assert (got.link, got.force, got.area) == ("arm", record.force, record.area)
        centroid = (got.centroid.x, got.centroid.y, got.centroid.z)
        assert centroid == record.p_world
