"""Reading MCAP front to back, whatever its end looks like.

Needs no index: a file that was cut anywhere gives all that its whole records hold.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata

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


class McapStream:
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
