"""These helpers change records of a recording, whose sizes and CRCs stay correct."""

import io
import zlib

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk
from mcap.records import Metadata as MetadataItem

from eskin.recording import read_recording
from eskin.recording.mcap_file import MAGIC, RECORD_HEADER
from lab.fuzz.recordings import encode_records, joined

OPCODES = {
    Chunk: Opcode.CHUNK,
    Attachment: Opcode.ATTACHMENT,
    MetadataItem: Opcode.METADATA,
}


def get_content(item):
    """Return what a record holds: the records of a chunk, or the text of another."""
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
    """Return the records with bytes of a chunk replaced."""

    def change(chunk):
        data = get_content(chunk).replace(old, new)
        chunk.data = zstandard.compress(data)
        chunk.uncompressed_size = len(data)
        chunk.uncompressed_crc = zlib.crc32(data)

    return change_record(target, Chunk, change, old)


def read_records(target, records):
    """Write the records as the file of a target, and read it."""
    target.path.write_bytes(MAGIC + b"".join(map(joined, records)) + MAGIC)
    return read_recording(target.path)
