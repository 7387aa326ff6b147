"""This module reads MCAP files, whatever they hold; the `mcap` package writes them.

A file is read front to back without its index, so all whole records of a truncated
file can be read. The `mcap` package decodes the records. Its `StreamReader` does not
find them here, since it does not check the CRC of an attachment, reads a hole of zeros
to its end, nine bytes at a time (9 MB in 1.5 s), unpacks a chunk to whatever size its
data has, and holds all messages of a chunk at once (400 MB for 6 kB of a file).
"""

import os
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
from eskin.files import open_file

MCAP_SUFFIX = ".mcap"
"""End of the name of an MCAP file."""
MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of an MCAP file."""
RECORD_HEADER = struct.Struct("<BQ")
MESSAGE_HEADER = struct.Struct("<HIQQ")
CHUNK_HEADER = struct.Struct("<QQQII")
"""First and last log time, size and CRC before compression, and length of the name of
the compression, at the start of a chunk."""
CHUNK_HEAD_BYTES = 100
"""Number of bytes at the start of a chunk that hold both headers, its own and of its
data."""
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
MAX_UNPACKED_RATIO = 4000
FREE_UNPACKED_BYTES = 64 << 20
"""Largest size before compression over the size of the file, beyond some bytes that are
free. Scans that are all the same compress to a 205th part on 2,000 taxels, and to a
1,650th on 40,000."""
MAX_TOPIC = 400
"""Longest name of a topic; none that is read is longer."""


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
                self.check_magic(file.read(min(len(MAGIC), size)))
                self.check_unpacked(file, size)
                yield from self.read_items(file, size)
        except OSError as error:
            raise RecordingError(
                f"{self.path} cannot be read: {error.strerror}; give a recording, an "
                ".mcap file"
            ) from error

    def check_magic(self, start: bytes) -> None:
        """Raise unless a file starts like an MCAP file, as far as it goes."""
        if start != MAGIC[: len(start)]:
            raise RecordingError(
                f"{self.path} starts with {start!r}, not with the MCAP magic; "
                "give a recording made by eskin"
            )

    def check_unpacked(self, file: BinaryIO, size: int) -> None:
        """Raise where chunks say that they unpack to far more than the file has.

        Only their heads are read. What follows a damaged chunk is not read at all.
        """
        unpacked = 0
        limit = FREE_UNPACKED_BYTES + MAX_UNPACKED_RATIO * size
        for opcode, length in walk_records(file, size):
            if opcode != Opcode.CHUNK:
                continue
            stated = read_unpacked_size(file.read(min(length, CHUNK_HEAD_BYTES)))
            if stated is None:
                return
            unpacked += stated
            if unpacked > limit:
                raise RecordingError(
                    f"{self.path} has {size:,} bytes and unpacks to {unpacked:,} or "
                    f"more; allowed are {limit:,}; record it again"
                )

    def read_items(self, file: BinaryIO, size: int) -> Iterator[McapItem]:
        """Yield items up to the closing magic, a cut or a damaged record."""
        for opcode, length in walk_records(file, size):
            if opcode == Opcode.FOOTER:
                file.seek(length, os.SEEK_CUR)
                self.truncated = file.read(len(MAGIC)) != MAGIC
            if opcode not in READ_OPCODES:
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


def walk_records(file: BinaryIO, size: int) -> Iterator[tuple[int, int]]:
    """Yield opcode and length of each whole record, with the file at its content.

    The walk ends at a cut, at a hole of zeros and after the footer.

    Args:
        file: file to read, at any place.
        size: size of the file [bytes].
    """
    file.seek(len(MAGIC))
    while len(head := file.read(RECORD_HEADER.size)) == RECORD_HEADER.size:
        opcode, length = RECORD_HEADER.unpack(head)
        end = file.tell() + length
        if end > size or opcode == NO_OPCODE:
            return
        yield opcode, length
        if opcode == Opcode.FOOTER:
            return
        file.seek(end)


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
