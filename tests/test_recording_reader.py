"""Tests of reading recordings that are cut, damaged or wrong inside."""

import struct

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

from eskin.errors import RecordingError
from eskin.recording import RecordingWriter, find_recordings, read_recording
from eskin.recording.messages import pack_joint_state
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan
from helpers.recording_files import change_chunk, read_records
from helpers.recordings import (
    METADATA,
    SECOND,
    START,
    assert_same_scans,
    make_labels,
    make_scans,
    write_recording,
)
from lab.fuzz.recordings import RecordingTarget

SCANS = make_scans(80)
LABELS = make_labels(SCANS)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return the path of a recording of four seconds, in chunks of 20 scans."""
    path = tmp_path_factory.mktemp("recording") / "whole.mcap"
    return write_recording(path, SCANS, LABELS)


@pytest.fixture(scope="module")
def summary(path):
    with path.open("rb") as file:
        return make_reader(file).get_summary()


@pytest.fixture(scope="module")
def chunk_ends(summary):
    """Return the offset in the file of the end of each chunk."""
    return [
        index.chunk_start_offset + index.chunk_length for index in summary.chunk_indexes
    ]


@pytest.fixture
def read_bytes(tmp_path):
    """Return a function that reads a recording of some bytes."""

    def read(data):
        (tmp_path / "a.mcap").write_bytes(data)
        return read_recording(tmp_path / "a.mcap")

    return read


@pytest.mark.slow
def test_cut_recording_is_read_up_to_its_last_whole_chunk(path, chunk_ends, read_bytes):
    data = path.read_bytes()
    near_ends = {end + d for end in (*chunk_ends, len(data) - 2) for d in (-1, 0, 1)}
    places = np.random.default_rng(1).integers(chunk_ends[0], len(data), 20)
    for place in sorted({*near_ends, *places}):
        recording = read_bytes(data[:place])
        count = 20 * sum(end <= place for end in chunk_ends)
        assert recording.truncated
        assert recording.count == count
        assert_same_scans(list(recording.scans()), SCANS[:count])
        assert recording.metadata == METADATA
        complete = {label for label in LABELS if label.end <= recording.end}
        assert complete <= set(recording.labels)
        assert all(label.end <= recording.end + 1 for label in recording.labels)


def test_recording_cut_before_its_calibration_is_refused(path, summary, read_bytes):
    last = summary.attachment_indexes[1]
    usable = last.offset + last.length
    for place in [*range(9), *range(9, usable, 37), usable - 1]:
        with pytest.raises(RecordingError, match="is cut before its") as caught:
            read_bytes(path.read_bytes()[:place])
        assert "\n" not in str(caught.value)
    assert read_bytes(path.read_bytes()[:usable]).count == 0


@pytest.mark.parametrize("damage", ["content", "CRC", "length"])
def test_damage_ends_what_is_read(path, summary, chunk_ends, read_bytes, damage):
    data = bytearray(path.read_bytes())
    count = 20
    if damage == "content":
        data[chunk_ends[1] - 40] ^= 0xFF
    elif damage == "CRC":
        data[summary.chunk_indexes[1].chunk_start_offset + 9 + 24] ^= 1
    else:
        data[chunk_ends[0] :] = b"\x06" + b"\xff" * 8 + b"left over"
    recording = read_bytes(data)
    assert recording.truncated
    assert_same_scans(list(recording.scans()), SCANS[:count])


def test_recordings_are_found_in_folders_once_and_sorted(tmp_path):
    names = ("b/1.mcap", "b/2.mcap", "a.mcap", "notes.txt")
    (tmp_path / "b").mkdir()
    for name in reversed(names):
        (tmp_path / name).write_bytes(b"")
    found = find_recordings([tmp_path / "b", tmp_path])
    assert found == tuple(tmp_path / name for name in names[:3])


def test_joints_are_put_in_the_order_of_the_recording_by_name(path):
    recording = read_recording(path)
    data = pack_joint_state(START, ("elbow", "gripper", "shoulder"), np.arange(3.0))
    np.testing.assert_array_equal(recording.parse_joint_positions(data), [2.0, 0.0])


@pytest.fixture(scope="module")
def target(tmp_path_factory):
    """Return a recording of 30 scans on 30 taxels, and its records."""
    return RecordingTarget(tmp_path_factory.mktemp("target"))


SIZE = 16
PACKED_SIZE = 36
"""Offsets of the sizes of the content of a chunk in its record."""


@pytest.mark.parametrize(
    ("offset", "size"),
    [*((SIZE, size) for size in (0, 10, 2**32, 2**64 - 1)), (PACKED_SIZE, 2**63)],
)
def test_chunk_of_another_size_than_stated_ends_what_is_read(target, offset, size):
    records = list(target.records)
    place = [opcode for opcode, _ in records].index(Opcode.CHUNK)
    body = bytearray(records[place][1])
    struct.pack_into("<Q", body, offset, size)
    records[place] = Opcode.CHUNK, bytes(body)
    recording = read_records(target, records)
    assert recording.truncated and recording.count < 30


def test_every_byte_but_zero_means_received(target):
    records = change_chunk(target, b"\x01" * 30, b"\x02" * 30)
    arrays = read_records(target, records).arrays()
    assert set(arrays.received.view(np.uint8).flat) == {1}


def test_file_that_unpacks_to_far_more_than_its_size_is_refused(path, monkeypatch):
    monkeypatch.setattr("eskin.recording.mcap_file.FREE_UNPACKED_BYTES", 0)
    assert read_recording(path).count == len(SCANS)
    monkeypatch.setattr("eskin.recording.mcap_file.MAX_UNPACKED_RATIO", 0.5)
    with pytest.raises(RecordingError, match="unpacks to"):
        read_recording(path)


@pytest.mark.slow
def test_recording_of_a_large_skin_whose_counts_never_change_is_read(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("eskin.recording.mcap_file.FREE_UNPACKED_BYTES", 0)
    skin = build_grid_skin(100, 100)
    same = np.full(skin.count, 7, np.int32)
    calibration = Calibration.uniform(skin.count, 4095, 60.0)
    path = tmp_path / "same.mcap"
    with RecordingWriter(path, "table", skin, calibration, METADATA, ()) as writer:
        for number in range(30_000):
            stamp = START + number * SECOND // 50
            writer.write(Scan(stamp, same, np.ones(skin.count, bool), np.empty(0)))
    assert read_recording(path).count == 30_000


def test_hole_in_a_file_ends_what_is_read(path, tmp_path):
    """As after a power failure: the file has its length, and zeros at its end."""
    cut = tmp_path / "hole.mcap"
    data = path.read_bytes()
    cut.write_bytes(data[: len(data) // 2] + bytes(100_000))
    assert read_recording(cut).truncated
    assert 0 < read_recording(cut).count < len(SCANS)
