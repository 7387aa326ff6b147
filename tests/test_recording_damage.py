"""Recordings that are wrong inside: refused in one line, or read up to the damage."""

import io
import struct
import zlib

import numpy as np
import pytest
import zstandard
from benchmarks.fuzz.recordings import RecordingTarget, joined, split
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk
from mcap.records import Metadata as MetadataItem

from eskin.errors import RecordingError
from eskin.recording import read_recording
from eskin.recording.mcap_file import (
    MAGIC,
    MAX_CHUNK_BYTES,
    RECORD_HEADER,
    encode_records,
)
from eskin.touch import Calibration

LABEL = b"poke\0\0\0\0\x05\0\0\0true"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording and its records."""
    return RecordingTarget(tmp_path_factory.mktemp("recording"))


def replaced(whole, kind, change, holding=b""):
    """The records, the first of a kind changed that holds these bytes when read."""
    records = list(whole.records)
    for place, (opcode, body) in enumerate(records):
        if opcode == kind.opcode:
            item = kind.read(ReadDataStream(io.BytesIO(body)))
            if holding in unpacked(item):
                change(item)
                records[place] = opcode, encode_records([item])[RECORD_HEADER.size :]
                return records
    raise LookupError(holding)


def unpacked(item):
    if isinstance(item, Chunk):
        return zstandard.decompress(item.data, item.uncompressed_size)
    return repr(item).encode()


@pytest.fixture(autouse=True)
def opcodes(monkeypatch):
    """Each kind of record knows its opcode."""
    for kind, opcode in (
        (Chunk, Opcode.CHUNK),
        (Attachment, Opcode.ATTACHMENT),
        (MetadataItem, Opcode.METADATA),
    ):
        monkeypatch.setattr(kind, "opcode", opcode, raising=False)


def read(whole, records):
    whole.path.write_bytes(MAGIC + b"".join(map(joined, records)) + MAGIC)
    return read_recording(whole.path)


def refusal(whole, records):
    with pytest.raises(RecordingError) as caught:
        read(whole, records).arrays()
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


def rewritten(old, new):
    """A change of a chunk's content, its CRC and size put right."""

    def change(chunk):
        data = unpacked(chunk).replace(old, new)
        chunk.data = zstandard.compress(data)
        chunk.uncompressed_size, chunk.uncompressed_crc = len(data), zlib.crc32(data)

    return change


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"robot": None}, "does not say its robot"),
        ({"joints": ""}, "has joints ''; allowed is a JSON list of names"),
        ({"joints": "7"}, "has joints '7'; allowed is a JSON list of names"),
        ({"joints": "[1]"}, "has joints '[1]'; allowed is a JSON list of names"),
        ({"joints": "[" * 5000}, "allowed is a JSON list of names"),
        ({"format": "a\nb"}, r"has recording format 'a\nb'; allowed is"),
    ],
)
def test_metadata_that_says_nothing_sensible_is_refused(whole, facts, said):
    def change(item):
        both = item.metadata | facts
        item.metadata = {key: text for key, text in both.items() if text is not None}

    assert said in refusal(whole, replaced(whole, MetadataItem, change))


def test_a_skin_that_cannot_be_used_is_told_with_its_recording(whole):
    def change(item):
        item.data = b"\xff" + item.data

    said = refusal(whole, replaced(whole, Attachment, change, b"name='skin'"))
    assert "a.mcap has a skin that cannot be used: skin: byte 0 is not UTF-8" in said


@pytest.mark.parametrize("wild", ["nested", "infinite"])
def test_a_calibration_that_cannot_be_read_is_refused(whole, wild):
    text = Calibration.uniform(30, 4095, 100.0).to_bytes()

    def change(item):
        infinite = text.replace(b"4095", b"1e999")
        item.data = b"[" * 5000 if wild == "nested" else infinite

    records = replaced(whole, Attachment, change, b"calibration.json")
    assert "calibration cannot be read" in refusal(whole, records)


@pytest.mark.parametrize("size", [0, 10, 2**32, 2**63, 2**64 - 1])
def test_a_chunk_of_another_size_than_it_promises_is_damage(whole, size):
    def change(chunk):
        chunk.uncompressed_size = size

    recording = read(whole, replaced(whole, Chunk, change))
    assert recording.truncated and recording.count < 30


def test_a_chunk_that_unpacks_to_too_much_is_refused_before_it_is(whole):
    def change(chunk):
        chunk.data = zstandard.compress(bytes(MAX_CHUNK_BYTES + 1))
        chunk.uncompressed_size = MAX_CHUNK_BYTES + 1

    said = refusal(whole, replaced(whole, Chunk, change))
    assert (
        f"has a chunk of {MAX_CHUNK_BYTES + 1} bytes; allowed are {MAX_CHUNK_BYTES}"
        in said
    )


def test_a_length_beyond_all_bounds_is_damage(whole):
    records = list(whole.records)
    place = [opcode for opcode, _ in records].index(Opcode.CHUNK)
    body = bytearray(records[place][1])
    struct.pack_into("<Q", body, 36, 2**63)  # How long the compressed data is.
    records[place] = Opcode.CHUNK, bytes(body)
    recording = read(whole, records)
    assert recording.truncated and recording.count < 30


def test_a_wrong_label_with_a_line_break_is_refused_in_one_line(whole):
    change = rewritten(LABEL, LABEL.replace(b"po", b"p\n").replace(b"true", b"trux"))
    said = refusal(whole, replaced(whole, Chunk, change, LABEL))
    assert "label 'p ke' has source 'trux'" in said


def test_any_byte_but_zero_says_received(whole):
    change = rewritten(b"\x01" * 30, b"\x02" * 30)
    arrays = read(whole, replaced(whole, Chunk, change)).arrays()
    assert set(arrays.received.view(np.uint8).flat) == {1}


def test_records_come_apart_and_together_again(whole):
    middle = whole.whole[len(MAGIC) : -len(MAGIC)]
    assert b"".join(map(joined, split(middle))) == middle
