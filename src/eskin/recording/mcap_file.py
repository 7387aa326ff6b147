"""This module reads and writes MCAP files, whatever they hold.

Reading goes front to back and needs no index, so a file that is cut anywhere still gives
all its whole records. Writing uses zstd chunks and puts an index at the end. The records
are those of the `mcap` package; messages and chunks, nearly all of a file, are put
together here, several times as fast as that package's own writer does it.
"""

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

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")
MOST_CHUNK = 64 << 20
"""Of one chunk, before compression [bytes]; ours have about one million."""


class DamageError(Exception):
    """A record whose bytes are not those that were written."""


# A length beyond what an index can hold overflows in the mcap library.
DAMAGES = (DamageError, McapError, OverflowError, UnicodeDecodeError, struct.error)


class TopicMessage(NamedTuple):
    """One message as stored."""

    topic: str
    log_time: int
    data: bytes


McapItem = Header | Metadata | Attachment | TopicMessage


class McapReader:
    """Iterates over what an MCAP file holds; `truncated` is known at its end.

    Every iteration reads the file again from its start.
    """

    def __init__(self, path: Path) -> None:
        """Look at `path`; nothing is read before iterating."""
        self.path = path
        self.truncated = True
        self.topics: dict[int, str] = {}

    def __iter__(self) -> Iterator[McapItem]:
        """Header, metadata, attachments and messages in the order of the file."""
        self.truncated = True
        self.topics = {}
        try:
            with self.path.open("rb") as file:
                yield from self.items(file)
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror}") from error

    def items(self, file: BinaryIO) -> Iterator[McapItem]:
        """Items until the closing magic, a cut or a damaged record."""
        size = self.path.stat().st_size
        self.check_magic(file.read(len(MAGIC)))
        while len(head := file.read(RECORD.size)) == RECORD.size:
            opcode, length = RECORD.unpack(head)
            if file.tell() + length > size:
                return
            if opcode == Opcode.FOOTER:
                file.seek(length, 1)
                self.truncated = file.read(len(MAGIC)) != MAGIC
                return
            body = file.read(length)
            if opcode == Opcode.DATA_END or len(body) < length:
                continue
            try:
                items = list(self.parse(opcode, body))
            except DAMAGES:
                return
            yield from items

    def check_magic(self, start: bytes) -> None:
        """Raise when the file does not start as MCAP does."""
        if start != MAGIC[: len(start)]:
            raise RecordingError(
                f"{self.path} starts with {start!r}, not with the MCAP magic; "
                "give a recording made by eskin"
            )

    def parse(self, opcode: int, body: bytes) -> Iterator[McapItem]:
        """Items of one record outside chunks."""
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.HEADER:
            yield Header.read(stream)
        elif opcode == Opcode.METADATA:
            yield Metadata.read(stream)
        elif opcode == Opcode.ATTACHMENT:
            check_attachment(body)
            yield Attachment.read(stream)
        elif opcode == Opcode.CHUNK:
            yield from self.messages(self.decompress(Chunk.read(stream)))
        elif opcode in (Opcode.CHANNEL, Opcode.MESSAGE):
            yield from self.messages(RECORD.pack(opcode, len(body)) + body)

    def decompress(self, chunk: Chunk) -> bytes:
        """Records of a chunk, checked against its CRC."""
        if chunk.compression not in ("", "zstd"):
            raise RecordingError(
                f"{self.path} has chunks compressed with {chunk.compression!r:.40}; "
                "allowed are zstd and none; compress it again: mcap compress"
            )
        data = self.unpacked(chunk) if chunk.compression else chunk.data
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise DamageError
        return data

    def unpacked(self, chunk: Chunk) -> bytes:
        """What a compressed chunk holds; no more memory is taken than it promises."""
        try:
            size = zstandard.frame_content_size(chunk.data)
            if size not in (-1, chunk.uncompressed_size):
                raise DamageError
            if chunk.uncompressed_size > MOST_CHUNK:
                raise RecordingError(
                    f"{self.path} has a chunk of {chunk.uncompressed_size} bytes; "
                    f"allowed are {MOST_CHUNK}; write it again in smaller chunks"
                )
            return zstandard.decompress(chunk.data, chunk.uncompressed_size)
        except zstandard.ZstdError as error:
            raise DamageError from error

    def messages(self, data: bytes) -> Iterator[TopicMessage]:
        """Messages among records that lie one after the other; channels are noted."""
        offset = 0
        while offset < len(data):
            opcode, length = RECORD.unpack_from(data, offset)
            offset += RECORD.size
            body = data[offset : offset + length]
            offset += length
            if opcode == Opcode.MESSAGE:
                channel, _, log_time, _ = MESSAGE.unpack_from(body)
                if channel in self.topics:
                    topic = self.topics[channel]
                    yield TopicMessage(topic, log_time, body[MESSAGE.size :])
            elif opcode == Opcode.CHANNEL:
                self.note(Channel.read(ReadDataStream(BytesIO(body))))

    def note(self, channel: Channel) -> None:
        """Remember the topic of a channel whose messages can be read."""
        if channel.message_encoding == "cdr":
            self.topics[channel.id] = channel.topic


def check_attachment(body: bytes) -> None:
    """Raise when an attachment's bytes do not fit its CRC; zero means not given."""
    (crc,) = struct.unpack("<I", body[-4:])
    if crc not in (0, zlib.crc32(body[:-4])):
        raise DamageError


CHUNK_BYTES = 1 << 20
LEVEL = 1
"""Of zstd: counts are mostly noise, more effort takes twice the time for 4 %."""

FOOTER = struct.Struct("<BQQQ")
FOOTER_BYTES = 20
RECORD_AND_MESSAGE = struct.Struct(RECORD.format + MESSAGE.format.lstrip("<"))
MESSAGE_INDEX = struct.Struct("<HI")


def packed(records: Iterable[McapRecord]) -> bytes:
    """Records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()


class McapWriter:
    """Writes one file front to back."""

    def __init__(self, file: BinaryIO, profile: str, library: str) -> None:
        """Write the header."""
        self.file = file
        self.compressor = zstandard.ZstdCompressor(level=LEVEL)
        self.schemas: list[Schema] = []
        self.channels: list[Channel] = []
        self.attachments: list[AttachmentIndex] = []
        self.metadata: list[MetadataIndex] = []
        self.chunks: list[ChunkIndex] = []
        self.counts: dict[int, int] = {}
        self.begin_chunk()
        file.write(MAGIC + packed([Header(profile, library)]))

    def begin_chunk(self) -> None:
        """Start an empty chunk."""
        self.chunk: list[bytes] = []
        self.size = 0
        self.places: dict[int, list[int]] = {}
        self.stamps: list[int] = []

    def add_metadata(self, name: str, facts: dict[str, str]) -> None:
        """Write facts under a name."""
        data, start = packed([Metadata(name=name, metadata=facts)]), self.file.tell()
        self.file.write(data)
        self.metadata.append(MetadataIndex(offset=start, length=len(data), name=name))

    def add_attachment(self, name: str, media_type: str, content: bytes) -> None:
        """Write an attachment without time."""
        attachment = Attachment(
            create_time=0, log_time=0, name=name, media_type=media_type, data=content
        )
        data, start = packed([attachment]), self.file.tell()
        self.file.write(data)
        index = AttachmentIndex(
            create_time=0,
            log_time=0,
            name=name,
            media_type=media_type,
            data_size=len(content),
            length=len(data),
            offset=start,
        )
        self.attachments.append(index)

    def add_channel(self, topic: str, type_name: str, definition: str) -> int:
        """Declare a topic of CDR messages with its `ros2msg` definition."""
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
        self.append(packed([schema, channel]))
        return number

    def append(self, data: bytes) -> None:
        """Append records to the chunk."""
        self.chunk.append(data)
        self.size += len(data)

    def add_message(self, channel: int, stamp: int, data: bytes) -> None:
        """Append a message; a chunk that is full is written."""
        self.places.setdefault(channel, []).extend((stamp, self.size))
        self.stamps.append(stamp)
        length = MESSAGE.size + len(data)
        self.append(
            RECORD_AND_MESSAGE.pack(Opcode.MESSAGE, length, channel, 0, stamp, stamp)
        )
        self.append(data)
        if self.size > CHUNK_BYTES:
            self.end_chunk()

    def end_chunk(self) -> None:
        """Write the chunk so far, if there is any message in it."""
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
        data, start = packed([chunk]), self.file.tell()
        self.file.write(data)
        self.chunks.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                chunk_start_offset=start,
                chunk_length=len(data),
                message_index_offsets={},
                message_index_length=0,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        self.write_places(self.chunks[-1])
        self.file.flush()
        self.begin_chunk()

    def write_places(self, chunk: ChunkIndex) -> None:
        """Write where in the chunk the messages of each channel are."""
        start = self.file.tell()
        for channel, places in self.places.items():
            chunk.message_index_offsets[channel] = self.file.tell()
            body = struct.pack(f"<{len(places)}Q", *places)
            head = MESSAGE_INDEX.pack(channel, len(body))
            size = len(head) + len(body)
            self.file.write(RECORD.pack(Opcode.MESSAGE_INDEX, size) + head + body)
            self.counts[channel] = self.counts.get(channel, 0) + len(places) // 2
        chunk.message_index_length = self.file.tell() - start

    def finish(self) -> None:
        """Write the index; the file stays open."""
        self.end_chunk()
        self.file.write(packed([DataEnd(0)]))
        start = self.file.tell()
        groups: dict[Opcode, list] = {
            Opcode.SCHEMA: self.schemas,
            Opcode.CHANNEL: self.channels,
            Opcode.STATISTICS: [self.statistics()],
            Opcode.CHUNK_INDEX: self.chunks,
            Opcode.ATTACHMENT_INDEX: self.attachments,
            Opcode.METADATA_INDEX: self.metadata,
        }
        summary, offsets = b"", []
        for opcode, records in groups.items():
            data = packed(records)
            offsets.append(SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        offset_start = start + len(summary)
        summary += packed(offsets)
        head = FOOTER.pack(Opcode.FOOTER, FOOTER_BYTES, start, offset_start)
        crc = zlib.crc32(summary + head)
        footer = Footer(
            summary_start=start, summary_offset_start=offset_start, summary_crc=crc
        )
        self.file.write(summary + packed([footer]) + MAGIC)

    def statistics(self) -> Statistics:
        """What the file holds, in numbers."""
        return Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=self.counts,
            chunk_count=len(self.chunks),
            message_count=sum(self.counts.values()),
            metadata_count=len(self.metadata),
            message_start_time=min(
                (c.message_start_time for c in self.chunks), default=0
            ),
            message_end_time=max((c.message_end_time for c in self.chunks), default=0),
            schema_count=len(self.schemas),
        )
