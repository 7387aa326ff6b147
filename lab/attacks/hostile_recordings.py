"""Hostile recordings: small files that unpack to gigabytes, or whose skin does."""

import struct
from pathlib import Path

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message
from mcap.records import Metadata as MetadataItem

from eskin.recording import Label, Metadata, RecordingWriter
from eskin.recording.mcap_file import MAGIC
from eskin.recording.messages import LABEL, READING, pack_label
from eskin.recording.records import CALIBRATION_NAME, FORMAT, RECORD_NAME, SKIN_NAME
from eskin.skin import Skin, skin_to_bytes
from eskin.touch import Calibration, Scan
from lab.attacks.hostile_texts import (
    LAUGHS,
    MEGABYTE,
    SMALL,
    Write,
    squeeze_taxels,
    stack_taxels,
    write_hole,
    write_noise,
)
from lab.fuzz.recordings import encode_records

START = 1_700_000_000_000_000_000
PERIOD = 20_000_000
READINGS = 1
LABELS = 2
OTHERS = 3
"""Channels of the files; there is no channel 3, so its messages are passed over."""


def write_records(path: Path, *records: McapRecord) -> None:
    """Write records as a whole file."""
    end = struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0)
    path.write_bytes(MAGIC + encode_records(records) + end + MAGIC)


def build_head(skin: bytes = b"", calibration: bytes = b"") -> list[McapRecord]:
    """Return the records before the messages; without arguments those of 30 taxels."""
    skin = skin or skin_to_bytes(SMALL)
    calibration = calibration or Calibration.uniform(30, 4095, 100.0).to_bytes()
    topics = {READINGS: READING.name, LABELS: LABEL.name}
    return [
        Header("ros2", "eskin"),
        MetadataItem(RECORD_NAME, {"format": FORMAT, "robot": "table", "joints": "[]"}),
        Attachment(0, 0, SKIN_NAME, "", skin),
        Attachment(0, 0, CALIBRATION_NAME, "", calibration),
        *(Channel(number, name, "cdr", {}, 0) for number, name in topics.items()),
    ]


def pack_chunk(records: bytes, size: int | None = None) -> Chunk:
    """Return a compressed chunk; `size` replaces that before compression."""
    data = zstandard.compress(records)
    return Chunk("zstd", data, START, START, 0, len(records) if size is None else size)


def write_chunks(channel: int, data: bytes, size: int, times: int = 1) -> Write:
    """Return a function that writes equal chunks, each of one message repeated.

    Args:
        channel: channel of the message.
        data: content of the message.
        size: size of a chunk before compression [bytes].
        times: number of chunks.
    """

    def write(path: Path) -> None:
        record = encode_records([Message(channel, START, data, START, 0)])
        chunk = pack_chunk(record * (size // len(record)))
        write_records(path, *build_head(), *[chunk] * times)

    return write


def write_head(skin: bytes = b"", calibration: bytes = b"") -> Write:
    """Return a function that writes a recording without messages."""
    return lambda path: write_records(path, *build_head(skin, calibration))


def write_chunk(size: int, stated: int) -> Write:
    """Return a function that writes a chunk of another size than it states [bytes]."""

    def write(path: Path) -> None:
        write_records(path, *build_head(), pack_chunk(bytes(size), stated))

    return write


def write_attachment(path: Path) -> None:
    """Write a recording whose skin has 200 MB."""
    skin = Attachment(0, 0, SKIN_NAME, "", bytes(200 * MEGABYTE))
    write_records(path, Header("ros2", "eskin"), skin)


def build_skin_writer(skin: Skin) -> Write:
    """Return a function that writes a valid recording of two scans of a skin."""

    def write(path: Path) -> None:
        calibration = Calibration(np.full(skin.count, 0.02), 4095)
        received = np.ones(skin.count, np.bool_)
        with RecordingWriter(path, "table", skin, calibration, Metadata(), ()) as file:
            for number in range(2):
                counts = np.full(skin.count, 2000 * number, np.int32)
                stamp = START + number * PERIOD
                file.write(Scan(stamp, counts, received, np.empty(0)))
            file.write_label(Label(START, START + PERIOD, "poke"))

    return write


POKE = pack_label(Label(START, START + 1, "poke"))

RECORDINGS: dict[str, Write] = {
    "250,000 equal labels": write_chunks(LABELS, POKE, 20 * MEGABYTE),
    "2,000,000 messages in a chunk": write_chunks(OTHERS, b"", 60 * MEGABYTE),
    "60 GB in 1,000 chunks": write_chunks(OTHERS, bytes(MEGABYTE), 60 * MEGABYTE, 1000),
    "a message of 60 MB": write_chunks(READINGS, bytes(60 * MEGABYTE), 61 * MEGABYTE),
    "a chunk of 512 MB": write_chunk(512 * MEGABYTE, 512 * MEGABYTE),
    "a label of 1 MB": write_chunks(
        LABELS, POKE[:20] + b"\xff" * MEGABYTE, 4 * MEGABYTE
    ),
    "a skin of 200 MB": write_attachment,
    "a skin of aliases": write_head((LAUGHS + "\n...\n").encode()),
    "a calibration of 100,000 brackets": write_head(calibration=b"[" * 100_000),
    "a calibration of 20 MB": write_head(
        calibration=b'{"gain": [' + b"1," * 10 * MEGABYTE
    ),
    "10,000 taxels in one point": build_skin_writer(stack_taxels(10_000)),
    "10,000 taxels, of them four far away": build_skin_writer(
        squeeze_taxels(10_000, 1.0)
    ),
    "a hole of 1 TB": write_hole(1 << 40, MAGIC),
    "noise": write_noise,
}
