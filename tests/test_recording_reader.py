"""Tests of reading recordings that are cut, damaged or wrong inside."""

import io
import struct
import zlib

import numpy as np
import pytest
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Chunk
from mcap.records import Metadata as MetadataItem

from eskin.errors import RecordingError
from eskin.recording import find_recordings, read_recording
from eskin.recording.mcap_file import (
    MAGIC,
    MAX_CHUNK_BYTES,
    RECORD_HEADER,
)
from eskin.recording.messages import pack_joint_state
from eskin.touch import Calibration
from helpers.recordings import (
    METADATA,
    START,
    assert_same_scans,
    make_labels,
    make_scans,
    write_recording,
)
from lab.fuzz.recordings import RecordingTarget, encode_records, joined

OPCODES = {
    Chunk: Opcode.CHUNK,
    Attachment: Opcode.ATTACHMENT,
    MetadataItem: Opcode.METADATA,
}
LABEL = b"poke\0\0\0\0\x05\0\0\0true"
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


@pytest.mark.parametrize("content", [b"PK\x03\x04 a zip", b"\x89MCAP0\n\n", b"x"])
def test_file_of_another_kind_is_refused(read_bytes, content):
    with pytest.raises(RecordingError, match="MCAP magic"):
        read_bytes(content)


def test_missing_recordings_are_refused(tmp_path):
    for find in (read_recording, lambda path: find_recordings([path])):
        with pytest.raises(RecordingError, match=r"no recording at .*gone\.mcap"):
            find(tmp_path / "gone.mcap")
    with pytest.raises(RecordingError, match=r"no \.mcap file below"):
        find_recordings([tmp_path])
    with pytest.raises(RecordingError, match="is a folder.*find_recordings"):
        read_recording(tmp_path)


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
    with pytest.raises(RecordingError, match="no position for joint 'shoulder'"):
        data = pack_joint_state(START, ("elbow",), np.zeros(1))
        recording.parse_joint_positions(data)


@pytest.fixture(scope="module")
def target(tmp_path_factory):
    """Return a recording of 30 scans on 30 taxels, and its records."""
    return RecordingTarget(tmp_path_factory.mktemp("target"))


def get_content(item):
    if isinstance(item, Chunk):
        return zstandard.decompress(item.data, item.uncompressed_size)
    return repr(item).encode()


def change_record(target, kind, change, content=b""):
    """Return the records with the first one changed that has a kind and a content."""
    records = list(target.records)
    for place, (opcode, body) in enumerate(records):
        if opcode == OPCODES[kind]:
            item = kind.read(ReadDataStream(io.BytesIO(body)))
            if content in get_content(item):
                change(item)
                records[place] = opcode, encode_records([item])[RECORD_HEADER.size :]
                return records
    raise LookupError(content)


def change_chunk(target, old, new):
    """Return the records with bytes of a chunk replaced, its CRC and size correct."""

    def change(chunk):
        data = get_content(chunk).replace(old, new)
        chunk.data = zstandard.compress(data)
        chunk.uncompressed_size = len(data)
        chunk.uncompressed_crc = zlib.crc32(data)

    return change_record(target, Chunk, change, old)


def read_records(target, records):
    target.path.write_bytes(MAGIC + b"".join(map(joined, records)) + MAGIC)
    return read_recording(target.path)


def assert_refused(target, records, *parts):
    """Check that reading the records is refused in one line that has some parts."""
    with pytest.raises(RecordingError) as caught:
        read_records(target, records).arrays()
    message = str(caught.value)
    assert all(part in message for part in parts), message
    assert len(message.splitlines()) == 1


@pytest.mark.parametrize(
    ("facts", "parts"),
    [
        ({"robot": None}, ["robot"]),
        ({"joints": ""}, ["joints ''", "JSON list"]),
        ({"joints": "7"}, ["joints '7'", "JSON list"]),
        ({"joints": "[1]"}, ["joints '[1]'", "JSON list"]),
        ({"joints": "[" * 5000}, ["JSON list"]),
        ({"format": "a\nb"}, [r"format 'a\nb'"]),
    ],
)
def test_invalid_metadata_is_refused(target, facts, parts):
    def change(item):
        both = item.metadata | facts
        item.metadata = {key: text for key, text in both.items() if text is not None}

    assert_refused(target, change_record(target, MetadataItem, change), *parts)


@pytest.mark.parametrize(
    ("name", "data", "parts"),
    [
        ("skin", b"\xff", ["a.mcap has a skin", "byte 0 is not UTF-8"]),
        ("calibration", b"[" * 5000, ["calibration cannot be read"]),
        (
            "calibration",
            Calibration.uniform(30, 4095, 100.0).to_bytes().replace(b"4095", b"1e999"),
            ["calibration cannot be read"],
        ),
    ],
    ids=["skin", "nested", "infinite"],
)
def test_invalid_attachment_is_refused(target, name, data, parts):
    def change(item):
        item.data = data

    content = f"name='{name}".encode()
    assert_refused(target, change_record(target, Attachment, change, content), *parts)


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


def test_chunk_that_unpacks_to_too_much_is_refused_before_it_is_unpacked(target):
    def change(chunk):
        chunk.data = zstandard.compress(bytes(MAX_CHUNK_BYTES + 1))
        chunk.uncompressed_size = MAX_CHUNK_BYTES + 1

    sizes = str(MAX_CHUNK_BYTES + 1), str(MAX_CHUNK_BYTES)
    assert_refused(target, change_record(target, Chunk, change), *sizes)


def test_invalid_label_is_refused_in_one_line(target):
    new = LABEL.replace(b"po", b"p\n").replace(b"true", b"trux")
    assert_refused(target, change_chunk(target, LABEL, new), "'p ke'", "'trux'")


def test_message_of_another_byte_order_is_refused(target):
    records = change_chunk(target, b"\0\1\0\0", b"\0\0\0\0")
    assert_refused(target, records, "encapsulation 0000", "0001")


def test_every_byte_but_zero_means_received(target):
    records = change_chunk(target, b"\x01" * 30, b"\x02" * 30)
    arrays = read_records(target, records).arrays()
    assert set(arrays.received.view(np.uint8).flat) == {1}


@pytest.mark.parametrize(
    ("name", "most", "part"),
    [
        ("eskin.recording.reader.MAX_LABELS", 1, "more than 1 labels"),
        ("eskin.recording.reader.MAX_METADATA_BYTES", 10, "metadata"),
        ("eskin.recording.reader.MAX_STRINGS", 1, "joints"),
        ("eskin.recording.cdr.MAX_STRING", 3, "a string has"),
        ("eskin.recording.mcap_file.MAX_CHUNK_MESSAGES", 5, "more than 5 records"),
        ("eskin.recording.mcap_file.MAX_MESSAGE_BYTES", 50, "more than 50 bytes"),
        ("eskin.recording.mcap_file.MAX_RECORD_BYTES", 500, "allowed are 500"),
        ("eskin.recording.mcap_file.MAX_FILE_BYTES", 500, "allowed are 500"),
    ],
)
def test_recording_beyond_a_limit_is_refused(path, monkeypatch, name, most, part):
    monkeypatch.setattr(name, most)
    with pytest.raises(RecordingError, match=part) as caught:
        read_recording(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_file_that_unpacks_to_far_more_than_its_size_is_refused(path, monkeypatch):
    monkeypatch.setattr("eskin.recording.mcap_file.FREE_UNPACKED_BYTES", 0)
    assert read_recording(path).count == len(SCANS)
    monkeypatch.setattr("eskin.recording.mcap_file.MAX_UNPACKED_RATIO", 0.5)
    with pytest.raises(RecordingError, match="unpacks to"):
        read_recording(path)


def test_hole_in_a_file_ends_what_is_read(path, tmp_path):
    """As after a power failure: the file has its length, and zeros at its end."""
    cut = tmp_path / "hole.mcap"
    data = path.read_bytes()
    cut.write_bytes(data[: len(data) // 2] + bytes(100_000))
    assert read_recording(cut).truncated
    assert 0 < read_recording(cut).count < len(SCANS)
