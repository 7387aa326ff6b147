"""Fuzz the reader of recordings: whole files, records, and messages inside chunks."""

import random
import struct
import zlib
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import final

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord

from eskin.errors import RecordingError
from eskin.recording import (
    DetectionRecord,
    Label,
    Metadata,
    RecordingWriter,
    TruthRecord,
    read_recording,
)
from eskin.recording.mcap_file import MAGIC, RECORD_HEADER
from eskin.touch import Calibration, Scan
from lab.fuzz.mutation import EDGES, mutate
from lab.fuzz.run import Target, check_refusal
from lab.fuzz.skin_files import TABLE_WORDS, YAML_WORDS, small_skin

START = 1_700_000_000_000_000_000
PERIOD = 50_000_000
WORDS = (
    b"[",
    b"{}",
    b"null",
    b"NaN",
    b"1e999",
    b"Infinity",
    b"true",
    b'"',
    b"9" * 5000,
    b"joints",
    b"robot",
    b"format",
    b"cdr",
    b"zstd",
    b"lz4",
    b"skin",
    b"\0",
    b"\xff",
    b"[" * 2000,
)
Record = tuple[int, bytes]
"""Opcode and content."""


@final
class RecordingTarget(Target):
    """Fuzzes the reader of recordings."""

    def __init__(self, folder: Path) -> None:
        """Start from a recording of 1.5 s; the inputs are written into the folder."""
        self.path = folder / "a.mcap"
        write(self.path)
        self.whole = self.path.read_bytes()
        self.records = split(self.whole[len(MAGIC) : -len(MAGIC)])

    def make(self, rng: random.Random) -> bytes:
        """Return the file mutated anywhere, or in one record with a corrected CRC."""
        if rng.random() < 0.3:
            return mutate(self.whole, rng)
        records = list(self.records)
        place = rng.randrange(len(records))
        change = rng.random()
        if change < 0.05:
            del records[place]
        elif change < 0.1:
            records.insert(rng.randrange(len(records)), records[place])
        else:
            records[place] = changed(records[place], rng)
        return MAGIC + b"".join(map(joined, records)) + MAGIC

    def feed(self, data: bytes) -> bool:
        """Read everything in the file."""
        self.path.write_bytes(data)
        try:
            recording = read_recording(self.path)
            recording.arrays()
            list(recording.truths())
        except RecordingError as error:
            check_refusal(error)
            return False
        return True


def write(path: Path) -> None:
    """Write a recording with every kind of content."""
    skin = small_skin()
    rng = np.random.default_rng(0)
    calibration = Calibration.uniform(skin.count, 4095, 100.0)
    metadata = Metadata("set", "P1", "morning", "paper", {"rate": "20 Hz"})
    received = np.ones(skin.count, np.bool_)
    point = (0.1, 0.2, 0.3)
    with RecordingWriter(
        path, "table", skin, calibration, metadata, ("a", "b")
    ) as writer:
        for stamp in range(START, START + 30 * PERIOD, PERIOD):
            counts = rng.integers(0, 4096, skin.count).astype(np.int32)
            shear = rng.integers(-300, 300, (skin.count, 2)).astype(np.int32)
            writer.write(Scan(stamp, counts, received, rng.normal(size=2), shear))
            writer.write_truth(
                TruthRecord(stamp, 1, "poke", "tip", "t", 1.0, 1e-4, point)
            )
        writer.write_label(Label(START, START + 9 * PERIOD, "poke"))
        writer.write_detection(
            DetectionRecord(
                stamp=START,
                gesture="poke",
                confidence=0.9,
                onset=START,
                end=START,
                link="t",
                patch="grid",
                p_world=point,
                n_world=point,
                direction_world=point,
                peak_force=1.0,
            )
        )


def encode_records(records: Iterable[McapRecord]) -> bytes:
    """Encode records one after the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


def split(data: bytes) -> list[Record]:
    """Split consecutive records."""
    records = []
    offset = 0
    while offset < len(data):
        opcode, length = RECORD_HEADER.unpack_from(data, offset)
        offset += RECORD_HEADER.size
        records.append((opcode, data[offset : offset + length]))
        offset += length
    return records


def joined(record: Record) -> bytes:
    """Encode a record."""
    return RECORD_HEADER.pack(record[0], len(record[1])) + record[1]


def changed(record: Record, rng: random.Random) -> Record:
    """Mutate a record, most often so that its CRC is valid or absent."""
    opcode, body = record
    if opcode == Opcode.CHUNK:
        return opcode, changed_chunk(body, rng)
    words = rng.choice((WORDS, YAML_WORDS, TABLE_WORDS))
    if opcode == Opcode.ATTACHMENT:
        body = mutate(body[:-4], rng, words)
        return opcode, body + struct.pack("<I", zlib.crc32(body))
    return opcode, mutate(body, rng, words)


def changed_chunk(body: bytes, rng: random.Random) -> bytes:
    """Mutate a record of a chunk, or the declared size of the chunk."""
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    records = split(zstandard.decompress(chunk.data, chunk.uncompressed_size))
    place = rng.randrange(len(records))
    opcode, content = records[place]
    head = 22 if opcode == Opcode.MESSAGE and rng.random() < 0.8 else 0
    records[place] = opcode, content[:head] + mutate(content[head:], rng, WORDS)
    data = b"".join(map(joined, records))
    chunk.uncompressed_size = len(data)
    chunk.uncompressed_crc = zlib.crc32(data)
    chunk.data = zstandard.compress(data)
    if rng.random() < 0.1:
        chunk.uncompressed_size = rng.choice(EDGES)
    if rng.random() < 0.1:
        chunk.uncompressed_crc = 0
        chunk.data = mutate(chunk.data, rng)
    return encode_records([chunk])[RECORD_HEADER.size :]
