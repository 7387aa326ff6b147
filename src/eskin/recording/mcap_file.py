"""This module reads and writes MCAP files, whatever they hold.

A file is read front to back without its index, so all whole records of a truncated
file can be read. Writing uses zstd chunks and puts an index at the end. The records are
those of the `mcap` package; messages and chunks, nearly all of a file, are encoded
here, several times as fast as by that package's own writer.
"""

import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from eskin.errors import RecordingError
from eskin.files import open_file

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEADER = struct.Struct("<BQ")
MESSAGE_HEADER = struct.Struct("<HIQQ")
MESSAGE_INDEX = struct.Struct("<HI")
CHUNK_HEADER = struct.Struct("<QQQII")
"""First and last log time, size and CRC before compression, and length of the name of
the compression, at the start of a chunk."""
CHUNK_HEAD_BYTES = 100
"""Number of bytes at the start of a chunk that hold its header and that of its data."""
NO_OPCODE = 0
"""Opcode of no record: a disk that was full, or lost power, leaves a hole of zeros."""
READ_OPCODES = (
    Opcode.HEADER,
    Opcode.METADATA,
    Opcode.ATTACHMENT,
    Opcode.CHUNK,
    Opcode.CHANNEL,
    Opcode.MESSAGE,
)
RECORD_AND_MESSAGE = struct.Struct(
    RECORD_HEADER.format + MESSAGE_HEADER.format.lstrip("<")
)
FOOTER = struct.Struct("<BQQQ")
FOOTER_BYTES = 20
MAX_FILE_BYTES = 1 << 42
"""Largest file that is read: 4 TiB, since nothing grows with it [bytes]."""
MAX_CHUNK_BYTES = 64 << 20
"""Largest chunk that is read, before compression [bytes]."""
MAX_RECORD_BYTES = 80 << 20
"""Largest record that is read, such as an attachment [bytes]."""
MAX_CHUNK_MESSAGES = 100_000
"""Largest number of messages in a chunk."""
MAX_MESSAGE_BYTES = 4 << 20
"""Largest message, which holds one reading of at most 200,000 taxels [bytes]."""
MAX_UNPACKED_RATIO = 300
FREE_UNPACKED_BYTES = 64 << 20
"""Largest size before compression over the size of the file, beyond some bytes that are
free. Scans that are all the same compress to a 170th."""
MAX_TOPIC = 400
"""Longest name of a topic; none that is read is longer."""
CHUNK_BYTES = 1 << 20
"""Size above which a chunk is written, before compression [bytes]."""
ZSTD_LEVEL = 1
"""Compression level: counts are mostly noise, so a higher level saves 4 % at most and
takes twice the time."""


class DamageError(Exception):
    """A record is damaged: its bytes are not those that were written."""


# The mcap package raises OverflowError for lengths that an index cannot hold.
DAMAGE_ERRORS = (
    DamageError,
    McapError,
    OverflowError,
    UnicodeDecodeError,
    struct.error,
)


class TopicMessage(NamedTuple):
    """A message as stored, with its topic and log time [ns since the epoch]."""

    topic: str
    log_time: int
    data: bytes


McapItem = Header | Metadata | Attachment | TopicMessage


class McapReader:
    """Reads an MCAP file from its start at every iteration.

    Attributes:
        truncated: whether the file is cut or damaged; known after an iteration.
    """

    def __init__(self, path: Path) -> None:
        """Store the path; nothing is read before iterating."""
        self.path = path
        self.truncated = True
        self.topics: dict[int, str] = {}

    def __iter__(self) -> Iterator[McapItem]:
        """Yield header, metadata, attachments and messages in the file's order."""
        self.truncated = True
        self.topics = {}
        try:
            with open_file(self.path, MAX_FILE_BYTES) as file:
                size = os.fstat(file.fileno()).st_size
                self.check_unpacked(file, size)
                file.seek(0)
                yield from self.read_items(file, size)
        except OSError as error:
            raise RecordingError(
                f"{self.path} cannot be read: {error.strerror}; give a recording, an "
                ".mcap file"
            ) from error

    def check_unpacked(self, file: BinaryIO, size: int) -> None:
        """Raise where chunks say that they unpack to far more than the file has.

        Only their heads are read. What follows a damaged chunk is not read at all.
        """
        unpacked = 0
        limit = FREE_UNPACKED_BYTES + MAX_UNPACKED_RATIO * size
        file.seek(len(MAGIC))
        while len(head := file.read(RECORD_HEADER.size)) == RECORD_HEADER.size:
            opcode, length = RECORD_HEADER.unpack(head)
            end = file.tell() + length
            if end > size or opcode in (NO_OPCODE, Opcode.FOOTER):
                return
            if opcode == Opcode.CHUNK:
                stated = read_unpacked_size(file.read(min(length, CHUNK_HEAD_BYTES)))
                if stated is None:
                    return
                unpacked += stated
            if unpacked > limit:
                raise RecordingError(
                    f"{self.path} has {size:,} bytes and unpacks to {unpacked:,} or "
                    f"more; allowed are {limit:,}; record it again"
                )
            file.seek(end)

    def read_items(self, file: BinaryIO, size: int) -> Iterator[McapItem]:
        """Yield items up to the closing magic, a cut or a damaged record."""
        start = file.read(min(len(MAGIC), size))
        if start != MAGIC[: len(start)]:
            raise RecordingError(
                f"{self.path} starts with {start!r}, not with the MCAP magic; "
                "give a recording made by eskin"
            )
        while len(head := file.read(RECORD_HEADER.size)) == RECORD_HEADER.size:
            opcode, length = RECORD_HEADER.unpack(head)
            if file.tell() + length > size or opcode == NO_OPCODE:
                return
            if opcode == Opcode.FOOTER:
                file.seek(length, 1)
                self.truncated = file.read(len(MAGIC)) != MAGIC
                return
            if opcode not in READ_OPCODES:
                file.seek(length, 1)
                continue
            if length > MAX_RECORD_BYTES:
                raise RecordingError(
                    f"{self.path} has a record of {length:,} bytes; allowed are "
                    f"{MAX_RECORD_BYTES:,}; write it again in smaller parts"
                )
            body = file.read(length)
            if len(body) < length:
                return
            try:
                items = list(self.parse_record(opcode, body))
            except DAMAGE_ERRORS:
                return
            yield from items

    def parse_record(self, opcode: int, body: bytes) -> Iterator[McapItem]:
        """Yield the items of one record outside chunks."""
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.HEADER:
            yield Header.read(stream)
        elif opcode == Opcode.METADATA:
            yield Metadata.read(stream)
        elif opcode == Opcode.ATTACHMENT:
            check_attachment(body)
            yield Attachment.read(stream)
        elif opcode == Opcode.CHUNK:
            yield from self.parse_messages(self.decompress(Chunk.read(stream)))
        elif opcode in (Opcode.CHANNEL, Opcode.MESSAGE):
            yield from self.parse_messages(RECORD_HEADER.pack(opcode, len(body)) + body)

    def decompress(self, chunk: Chunk) -> bytes:
        """Return the records of a chunk, checked against its CRC."""
        if chunk.compression not in ("", "zstd"):
            raise RecordingError(
                f"{self.path} has chunks compressed with {chunk.compression!r:.40}; "
                "allowed are zstd and none; compress it again: mcap compress"
            )
        data = self.decompress_zstd(chunk) if chunk.compression else chunk.data
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise DamageError
        return data

    def decompress_zstd(self, chunk: Chunk) -> bytes:
        """Decompress a chunk; allocate no more memory than the chunk announces."""
        try:
            size = zstandard.frame_content_size(chunk.data)
            if size not in (-1, chunk.uncompressed_size):
                raise DamageError
            if chunk.uncompressed_size > MAX_CHUNK_BYTES:
                raise RecordingError(
                    f"{self.path} has a chunk of {chunk.uncompressed_size} bytes; "
                    f"allowed are {MAX_CHUNK_BYTES}; write it again in smaller chunks"
                )
            return zstandard.decompress(chunk.data, chunk.uncompressed_size)
        except zstandard.ZstdError as error:
            raise DamageError from error

    def parse_messages(self, data: bytes) -> Iterator[TopicMessage]:
        """Yield the messages among consecutive records; remember their channels."""
        offset = count = 0
        while offset < len(data):
            opcode, length = RECORD_HEADER.unpack_from(data, offset)
            offset += RECORD_HEADER.size
            count += 1
            if count > MAX_CHUNK_MESSAGES or length > MAX_MESSAGE_BYTES:
                raise RecordingError(
                    f"{self.path} has a chunk of more than {MAX_CHUNK_MESSAGES:,} "
                    f"records, or with one of more than {MAX_MESSAGE_BYTES:,} bytes; "
                    "allowed are fewer; write it again in smaller chunks"
                )
            body = data[offset : offset + length]
            offset += length
            if opcode == Opcode.MESSAGE:
                channel, _, log_time, _ = MESSAGE_HEADER.unpack_from(body)
                if channel in self.topics:
                    topic = self.topics[channel]
                    yield TopicMessage(topic, log_time, body[MESSAGE_HEADER.size :])
            elif opcode == Opcode.CHANNEL:
                found = Channel.read(ReadDataStream(BytesIO(body)))
                if found.message_encoding == "cdr" and len(found.topic) <= MAX_TOPIC:
                    self.topics[found.id] = found.topic


def read_unpacked_size(head: bytes) -> int | None:
    """Return the size of a chunk before compression; None where it is damaged.

    Args:
        head: start of the chunk.
    """
    if len(head) < CHUNK_HEADER.size:
        return None
    _, _, size, _, name_length = CHUNK_HEADER.unpack_from(head)
    data = head[CHUNK_HEADER.size + name_length + 8 :]
    try:
        stated = zstandard.frame_content_size(data) if name_length else size
    except zstandard.ZstdError:
        return None
    return size if stated in (-1, size) else None


def check_attachment(body: bytes) -> None:
    """Raise if an attachment's bytes do not match its CRC; zero means not given."""
    (crc,) = struct.unpack("<I", body[-4:])
    if crc not in (0, zlib.crc32(body[:-4])):
        raise DamageError


def encode_records(records: Iterable[McapRecord]) -> bytes:
    """Return records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


class McapWriter:
    """Writes one MCAP file front to back."""

    def __init__(self, file: BinaryIO, profile: str, library: str) -> None:
        """Write the header."""
        self.file = file
        self.compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self.schemas: list[Schema] = []
        self.channels: list[Channel] = []
        self.attachments: list[AttachmentIndex] = []
        self.metadata: list[MetadataIndex] = []
        self.chunks: list[ChunkIndex] = []
        self.counts: dict[int, int] = {}
        self.begin_chunk()
        file.write(MAGIC + encode_records([Header(profile, library)]))

    def begin_chunk(self) -> None:
        """Start an empty chunk."""
        self.chunk: list[bytes] = []
        self.size = 0
        self.message_index: dict[int, list[int]] = {}
        self.stamps: list[int] = []

    def write_record(self, record: McapRecord) -> tuple[int, int]:
        """Write one record outside chunks; return its offset and length."""
        start = self.file.tell()
        self.file.write(encode_records([record]))
        return start, self.file.tell() - start

    def add_metadata(self, name: str, facts: dict[str, str]) -> None:
        """Write a map of strings under a name."""
        start, length = self.write_record(Metadata(name=name, metadata=facts))
        self.metadata.append(MetadataIndex(offset=start, length=length, name=name))

    def add_attachment(self, name: str, media_type: str, content: bytes) -> None:
        """Write an attachment without a time."""
        attachment = Attachment(
            create_time=0, log_time=0, name=name, media_type=media_type, data=content
        )
        start, length = self.write_record(attachment)
        index = AttachmentIndex(
            create_time=0,
            log_time=0,
            name=name,
            media_type=media_type,
            data_size=len(content),
            length=length,
            offset=start,
        )
        self.attachments.append(index)

    def add_channel(self, topic: str, type_name: str, definition: str) -> int:
        """Declare a topic of CDR messages, defined in `ros2msg`; return its channel."""
        number = len(self.channels) + 1
        schema = Schema(
            id=number, data=definition.encode(), encoding="ros2msg", name=type_name
        )
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding="cdr",
            schema_id=number,
            metadata={"offered_qos_profiles": ""},
        )
        self.schemas.append(schema)
        self.channels.append(channel)
        self.append(encode_records([schema, channel]))
        return number

    def append(self, data: bytes) -> None:
        """Append records to the chunk."""
        self.chunk.append(data)
        self.size += len(data)

    def add_message(self, channel: int, stamp: int, data: bytes) -> None:
        """Append a message; write the chunk when it is full."""
        self.message_index.setdefault(channel, []).extend((stamp, self.size))
        self.stamps.append(stamp)
        length = MESSAGE_HEADER.size + len(data)
        self.append(
            RECORD_AND_MESSAGE.pack(Opcode.MESSAGE, length, channel, 0, stamp, stamp)
        )
        self.append(data)
        if self.size > CHUNK_BYTES:
            self.end_chunk()

    def end_chunk(self) -> None:
        """Write the chunk so far if it holds any message."""
        if not self.stamps:
            return
        raw = b"".join(self.chunk)
        chunk = Chunk(
            compression="zstd",
            data=self.compressor.compress(raw),
            message_start_time=min(self.stamps),
            message_end_time=max(self.stamps),
            uncompressed_crc=zlib.crc32(raw),
            uncompressed_size=len(raw),
        )
        start, length = self.write_record(chunk)
        self.chunks.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=start,
                chunk_length=length,
                message_index_offsets={},
                message_index_length=0,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        self.write_message_index(self.chunks[-1])
        self.file.flush()
        self.begin_chunk()

    def write_message_index(self, chunk: ChunkIndex) -> None:
        """Write the positions of each channel's messages in the chunk."""
        start = self.file.tell()
        for channel, entries in self.message_index.items():
            chunk.message_index_offsets[channel] = self.file.tell()
            body = struct.pack(f"<{len(entries)}Q", *entries)
            head = MESSAGE_INDEX.pack(channel, len(body))
            record = RECORD_HEADER.pack(Opcode.MESSAGE_INDEX, len(head) + len(body))
            self.file.write(record + head + body)
            self.counts[channel] = self.counts.get(channel, 0) + len(entries) // 2
        chunk.message_index_length = self.file.tell() - start

    def finish(self) -> None:
        """Write the index at the end; the file stays open."""
        self.end_chunk()
        self.file.write(encode_records([DataEnd(0)]))
        start = self.file.tell()
        groups: dict[Opcode, list] = {
            Opcode.SCHEMA: self.schemas,
            Opcode.CHANNEL: self.channels,
            Opcode.STATISTICS: [self.build_statistics()],
            Opcode.CHUNK_INDEX: self.chunks,
            Opcode.ATTACHMENT_INDEX: self.attachments,
            Opcode.METADATA_INDEX: self.metadata,
        }
        summary = b""
        offsets = []
        for opcode, records in groups.items():
            data = encode_records(records)
            offsets.append(SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        offset_start = start + len(summary)
        summary += encode_records(offsets)
        head = FOOTER.pack(Opcode.FOOTER, FOOTER_BYTES, start, offset_start)
        crc = zlib.crc32(summary + head)
        footer = Footer(
            summary_start=start, summary_offset_start=offset_start, summary_crc=crc
        )
        self.file.write(summary + encode_records([footer]) + MAGIC)

    def build_statistics(self) -> Statistics:
        """Return the numbers of records in the file and its span of time."""
        starts = [chunk.message_start_time for chunk in self.chunks]
        ends = [chunk.message_end_time for chunk in self.chunks]
        return Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=self.counts,
            chunk_count=len(self.chunks),
            message_count=sum(self.counts.values()),
            metadata_count=len(self.metadata),
            message_start_time=min(starts, default=0),
            message_end_time=max(ends, default=0),
            schema_count=len(self.schemas),
        )
