"""Wrong recordings, labels and ranges are refused, each in one line that says why.

What a writer refuses, which then goes on, and files that are cut are tested with them.
"""

from unittest.mock import patch

import numpy as np
import pytest
import zstandard
from mcap.records import Attachment, Chunk
from mcap.records import Metadata as MetadataItem

from eskin.errors import RecordingError
from eskin.labelling import label_recording
from eskin.recording import (
    Label,
    LabelSet,
    check_labels,
    find_recordings,
    load_ranges,
    read_recording,
    rewrite_recording,
)
from eskin.recording.mcap_file import MAX_CHUNK_BYTES
from eskin.recording.messages import pack_joint_state
from eskin.touch import Calibration
from helpers.recording_files import change_chunk, change_record, read_records
from helpers.recordings import SECOND, START, open_writer
from helpers.refusals import REFUSALS, check_refusal, refusal
from lab.fuzz.recordings import RecordingTarget

LABEL = b"poke\0\0\0\0\x05\0\0\0true"
INFINITE = Calibration.uniform(30, 4095, 100.0).to_bytes().replace(b"4095", b"1e999")


@pytest.fixture(scope="module")
def target(tmp_path_factory):
    """Return a recording of 30 scans on 30 taxels, and its records."""
    return RecordingTarget(tmp_path_factory.mktemp("target"))


def content(data):
    """Return the row of a file of some bytes."""

    def call(target, folder):
        (folder / "a.mcap").write_bytes(data)
        read_recording(folder / "a.mcap")

    return refusal(f"file {data!r}", RecordingError, call, "a.mcap", "MCAP magic")


def facts(changes, *parts):
    """Return the row of a recording with other metadata; None leaves a key out."""

    def change(item):
        both = item.metadata | changes
        item.metadata = {key: text for key, text in both.items() if text is not None}

    def call(target, folder):
        read_records(target, change_record(target, MetadataItem, change))

    name = f"metadata {str(changes):.30}"
    return refusal(name, RecordingError, call, "a.mcap", *parts)


def attachment(name, data, *parts):
    """Return the row of a recording with another attachment."""

    def change(item):
        item.data = data

    def call(target, folder):
        kept = f"name='{name}".encode()
        read_records(target, change_record(target, Attachment, change, kept))

    return refusal(f"{name} {data!r:.20}", RecordingError, call, "a.mcap", *parts)


def message(name, old, new, *parts):
    """Return the row of a recording with other bytes in a chunk."""

    def call(target, folder):
        read_records(target, change_chunk(target, old, new)).arrays()

    return refusal(name, RecordingError, call, "a.mcap", *parts)


def limit(name, most, *parts):
    """Return the row of a recording that exceeds a limit, which is lowered for it."""

    def call(target, folder):
        target.path.write_bytes(target.whole)
        with patch(f"eskin.recording.{name}", most):
            read_recording(target.path)

    return refusal(name, RecordingError, call, "a.mcap", *parts)


def ranges(text, *parts):
    """Return the row of a file of ranges."""

    def call(target, folder):
        (folder / "ranges.yaml").write_text(text)
        load_ranges(folder / "ranges.yaml", 0)

    return refusal(f"ranges {text:.50}", RecordingError, call, "ranges.yaml", *parts)


def read_large_chunk(target, folder):
    """Read a chunk that unpacks to more than is allowed."""

    def change(chunk):
        chunk.data = zstandard.compress(bytes(MAX_CHUNK_BYTES + 1))
        chunk.uncompressed_size = MAX_CHUNK_BYTES + 1

    read_records(target, change_record(target, Chunk, change))


def read_other_joints(target, folder):
    """Read joint positions without one of the recording's joints."""
    target.path.write_bytes(target.whole)
    data = pack_joint_state(START, ("b", "c"), np.zeros(2))
    read_recording(target.path).parse_joint_positions(data)


def label_without_ranges(target, folder):
    """Label a recording that has no labels of gestures, without ranges."""
    target.path.write_bytes(target.whole)
    rewrite_recording(read_recording(target.path), folder / "b.mcap", labels=())
    label_recording(read_recording(folder / "b.mcap"))


def check_overlap(target, folder):
    """Check two labels of one source that overlap."""
    stroke = Label(3 * SECOND // 2, 3 * SECOND, "stroke")
    labels = (stroke, Label(SECOND, 2 * SECOND, "poke"))
    check_labels([LabelSet(folder / "a.mcap", labels, SECOND // 2, 3 * SECOND)])


ROWS = [
    *map(content, (b"PK\x03\x04 a zip", b"\x89MCAP0\n\n", b"x")),
    *(
        refusal(
            f"no recording to {name}",
            RecordingError,
            lambda target, folder, find=find: find(folder / "gone.mcap"),
            "no recording at ",
            "gone.mcap",
        )
        for name, find in (
            ("read", read_recording),
            ("find", lambda path: find_recordings([path])),
        )
    ),
    refusal(
        "no recording in a folder",
        RecordingError,
        lambda target, folder: find_recordings([folder]),
        "no .mcap file below",
    ),
    refusal(
        "folder for a recording",
        RecordingError,
        lambda target, folder: read_recording(folder),
        "is a folder",
        "find_recordings",
    ),
    refusal(
        "recording in no folder",
        RecordingError,
        lambda target, folder: open_writer(folder / "nowhere" / "a.mcap"),
        "cannot write ",
        "No such file",
    ),
    refusal(
        "joint without position",
        RecordingError,
        read_other_joints,
        "no position for joint 'a'",
    ),
    facts({"robot": None}, "does not say its robot"),
    facts({"joints": ""}, "joints ''", "JSON list"),
    facts({"joints": "7"}, "joints '7'", "JSON list"),
    facts({"joints": "[1]"}, "joints '[1]'", "JSON list"),
    facts({"joints": "[" * 5000}, "joints '[[[", "JSON list"),
    facts({"format": "a\nb"}, r"format 'a\nb'"),
    attachment("skin", b"\xff", "has a skin", "byte 0 is not UTF-8"),
    attachment("calibration", b"[" * 5000, "calibration cannot", "recursion"),
    attachment("calibration", INFINITE, "calibration cannot", "infinity"),
    refusal(
        "large chunk",
        RecordingError,
        read_large_chunk,
        str(MAX_CHUNK_BYTES + 1),
        str(MAX_CHUNK_BYTES),
    ),
    message(
        "invalid label",
        LABEL,
        LABEL.replace(b"po", b"p\n").replace(b"true", b"trux"),
        "'p ke'",
        "'trux'",
    ),
    message("byte order", b"\0\1\0\0", b"\0\0\0\0", "encapsulation 0000", "0001"),
    limit("reader.MAX_LABELS", 0, "more than 0 labels"),
    limit("reader.MAX_METADATA_BYTES", 10, "characters of metadata"),
    limit("reader.MAX_STRINGS", 1, 'joints \'["a", "b"]'),
    limit("cdr.MAX_STRING", 3, "a string has"),
    limit("mcap_file.MAX_CHUNK_MESSAGES", 5, "more than 5 records"),
    limit("mcap_file.MAX_MESSAGE_BYTES", 50, "more than 50 bytes"),
    limit("mcap_file.MAX_RECORD_BYTES", 500, "a record of ", "allowed are 500"),
    limit("mcap_file.MAX_FILE_BYTES", 500, "it has ", "allowed are 500"),
    refusal(
        "label that ends when it starts",
        RecordingError,
        lambda target, folder: Label(SECOND, SECOND, "poke"),
        "after its start",
    ),
    refusal(
        "label without a gesture",
        RecordingError,
        lambda target, folder: Label(SECOND, 2 * SECOND, ""),
        "no gesture",
    ),
    refusal(
        "labels that overlap",
        RecordingError,
        check_overlap,
        "a.mcap",
        "'poke' from 0.50 to 1.50 s and 'stroke' from 1.00 to 2.50 s overlap",
    ),
    refusal("no ranges", RecordingError, label_without_ranges, "--ranges FILE"),
    refusal(
        "missing ranges",
        RecordingError,
        lambda target, folder: load_ranges(folder / "gone.yaml", 0),
        "no ranges at ",
        "gone.yaml",
    ),
    ranges("", "no list"),
    ranges("start_s: 1", "no list"),
    ranges("- {start_s: 1", "not plain YAML"),
    ranges("- {start_s: 1, end_s: 2}", "range 1 is", "such as {start_s"),
    ranges("- {start_s: 2, end_s: 1, gesture: poke}", "range 1 ends at 1 s"),
    ranges("- {start_s: x, end_s: 1, gesture: poke}", "'x'", "seconds"),
    ranges("- {start_s: .nan, end_s: 1, gesture: poke}", "nan", "seconds"),
    ranges("- {start_s: 1, end_s: 2, gesture: 3}", "3}; allowed", "gesture's name"),
    ranges("- {start_s: 1, end_s: 2, gesture: ''}", "''}; allowed", "gesture's name"),
]


@pytest.mark.parametrize(REFUSALS, ROWS)
def test_wrong_recording_is_refused_in_one_line(error, call, parts, target, tmp_path):
    check_refusal(error, call, parts, target, tmp_path)
